"""The deformation: how far each keypoint is along its path at each step, so that the cable keeps its length.

Minimise over sigma the energy of springs between keypoints, J = sum_t E(s^t) (Tang et al., "DLO Deformation
Optimization"), with sigma^0 = 0, sigma^T = 1 and lb <= sigma^{t+1} - sigma^t <= ub. It is far from convex, so the
first guess decides: "head" strings the cable out with its right end ahead, "tail" with its left end ahead,
"uniform" moves all keypoints alike. Obstacles do not enter: the paths keep clear of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import scipy.sparse
from jaxtyping import Float

from cableway.geometry import polyline
from cableway.scene.cable import Cable
from cableway.tang2025.planning.config import DeformationConfig
from cableway.tang2025.planning.ipopt import LinearLimits, Objective, minimize
from cableway.tang2025.planning.path_curves import path_curves
from cableway.tang2025.planning.path_set import PathSet
from cableway.tang2025.planning.springs import Springs, pattern

Guess = Literal["head", "tail", "uniform"]
GUESSES: tuple[Guess, ...] = get_args(Guess)


@dataclass(frozen=True)
class DeformationSequence:
    """Shapes along a path set, before they are made shapes of a cable.

    Attributes:
        shapes: (T+1, n, 2) [m].
        progress: (T+1, n): sigma of each keypoint along its path, 0 at the start, 1 at the goal, never falling.
        energy: What was made least [J]: the springs' energy of all shapes together.
        guess: The first guess.
        status: Ipopt's return code.
        iterations: How many it took.
        converged: Whether the sequence is a local minimum; else it is Ipopt's last iterate.
    """

    shapes: Float[np.ndarray, "t n 2"]
    progress: Float[np.ndarray, "t n"]
    energy: float
    guess: Guess
    status: str
    iterations: int
    converged: bool


def optimize_deformation(
    path_set: PathSet,
    cable: Cable,
    config: DeformationConfig,
    guess: Guess = "uniform",
    progress: Callable[[str, float], None] | None = None,
) -> DeformationSequence:
    """The sequence of shapes along the path set with the least spring energy near a first guess.

    Args:
        path_set: One path for each keypoint.
        cable: Its length gives the rest lengths, those of the straight cable.
        config: Stiffness, bounds and resolution.
        guess: Which end leads in the first guess.
        progress: Called with "deformation" and the share of the iterations that are used.

    Returns:
        T + 1 shapes; the first and last are exactly the ends of the paths.

    Raises:
        PlanningError: Ipopt failed.

    Note:
        Beside the paper's energy there is a weak spring between each keypoint and itself one step later
        (`step_stiffness`), without which a plan waits and then jumps: the paper's energy does not see time.
    """
    curves = path_curves(path_set.paths, config)
    n, steps = len(path_set.paths), config.steps
    travel = float(polyline.length(path_set.paths).mean())
    springs = Springs(
        cable.length / (n - 1), (config.near_stiffness, config.far_stiffness), config.step_stiffness, travel
    )
    inner = first_guess(path_set, cable, config, guess)[1:-1]
    used = 0

    def at(x: np.ndarray) -> np.ndarray:
        return np.vstack([np.zeros(n), x.reshape(steps - 1, n), np.ones(n)])

    def gradient(x: np.ndarray) -> np.ndarray:
        nonlocal used
        used += 1
        if progress:
            progress("deformation", min(1.0, used / config.iterations))
        return springs.gradient(at(x), curves)[1:-1].ravel()

    rows, columns = pattern(steps - 1, n)
    objective = Objective(
        lambda x: springs.value(at(x), curves),
        gradient,
        lambda x: springs.hessian(at(x), curves),
        rows,
        columns,
    )
    found = minimize(objective, _limits(n, config), inner.ravel(), config.iterations)
    if progress:
        progress("deformation", 1.0)
    sigma = np.maximum.accumulate(np.clip(at(found.x), 0.0, 1.0), axis=0)
    shapes = curves(sigma)[0]
    shapes[0], shapes[-1] = path_set.paths[:, 0], path_set.paths[:, -1]
    energy = springs.value(sigma, curves) * springs.rest**2
    return DeformationSequence(shapes, sigma, energy, guess, found.status, found.iterations, found.converged)


def first_guess(path_set: PathSet, cable: Cable, config: DeformationConfig, guess: Guess) -> Float[np.ndarray, "t n"]:
    """Progress (T + 1, n) within the bounds: all keypoints alike, or one end ahead as far as the cable is long.

    With one end ahead, keypoint i starts later by the time in which the leading end covers the cable's length
    between them, and all go at one speed.
    """
    n, steps = len(path_set.paths), config.steps
    time = np.linspace(0.0, 1.0, steps + 1)
    # progress = lb t + (1 - lb T) base keeps the lower bound for every base that rises from 0 to 1
    free = 1.0 - config.lower_bound * steps
    travel = float(polyline.length(path_set.paths).mean())
    delay = np.zeros(n)
    if guess != "uniform" and free > 1e-9:
        fastest = (config.upper_bound - config.lower_bound) * steps / free
        most = max(0.0, 0.9 * fastest - 1.0)
        delay = np.linspace(1.0, 0.0, n) * min(cable.length / max(travel, 1e-9), most)
        if guess == "tail":
            delay = delay[::-1]
    base = np.clip(time[:, None] * (1.0 + delay.max()) - delay, 0.0, 1.0)
    return config.lower_bound * steps * time[:, None] + free * base


def _limits(n: int, config: DeformationConfig) -> LinearLimits:
    """0 <= sigma <= 1 and lb <= sigma^{t+1} - sigma^t <= ub on the inner rows of sigma; its ends are fixed."""
    steps, m = config.steps, n * (config.steps - 1)
    difference = scipy.sparse.csr_array(np.eye(steps, steps - 1) - np.eye(steps, steps - 1, k=-1))
    matrix = scipy.sparse.csr_array(scipy.sparse.kron(difference, scipy.sparse.eye_array(n)))
    fixed = np.zeros(steps * n)
    fixed[-n:] = 1.0
    return LinearLimits(np.zeros(m), np.ones(m), matrix, config.lower_bound - fixed, config.upper_bound - fixed)
