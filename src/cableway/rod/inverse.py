"""Inverse problems of the rod: the equilibrium nearest to given keypoints, and those that given grippers allow."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError
from cableway.core.quantities import limit_text, told_apart
from cableway.core.time_limit import checkpoint
from cableway.geometry import polyline
from cableway.rod import fitting, kernels
from cableway.rod.held_rod import HeldRod
from cableway.rod.planar import PlanarRod

Bend = Literal["left", "right"]

LEAST_AREA = 1e-6
"""Area beside the line between the ends, in squared lengths of the rod, up to which a shape is bent to neither side."""

SAME_SHAPE = 1e-4
"""Distance, in lengths of the rod, up to which two shapes count as one."""

STAGES = 16
"""Steps from the uniform rod to another one in `nearest_shape`; with four, one that is curled by a full turn at one end
is lost."""

STAGE = fitting.QUICK._replace(steps=50.0)
"""Of the fit in each."""


def fit_keypoints(
    rod: PlanarRod, keypoints: Float[np.ndarray, "n 2"], guess: Float[np.ndarray, "6"] | None = None
) -> tuple[Float[np.ndarray, "6"], float]:
    """The equilibrium q whose keypoints are nearest to the given ones, and the stacked distance left [m].

    Args:
        rod: The rod; its length is kept whatever the length of `keypoints`.
        keypoints: (n, 2) [m], at equal arc length.
        guess: q to start from, in addition to `HeldRod.guesses`.

    Returns:
        q (6,) and ||keypoints(q) - keypoints|| [m].
    """
    keypoints = keypoints.copy()  # those of a task are read-only, for which Numba would compile once more
    guesses = [rod.guesses(keypoints[None])[0], *([] if guess is None else [guess])]
    if rod.modes:
        uniform = fit_keypoints(replace(rod, modes=()), keypoints)[0]
        guesses.append(_changed(uniform, keypoints, *rod.arrays, rod.stride))
    return _fit(rod, keypoints, guesses)


def fit_sequence(
    rod: PlanarRod, shapes: Float[np.ndarray, "t n 2"], first: Float[np.ndarray, "6"]
) -> Float[np.ndarray, "t 6"]:
    """`fit_keypoints` of one shape after the other, each guessed from the one before, the first one from `first`."""
    fits = [first]
    for shape, guess in zip(shapes, rod.guesses(shapes), strict=True):
        checkpoint()
        fits.append(_fit(rod, shape, [guess, fits[-1]])[0])
    return np.array(fits[1:]).reshape(-1, rod.dof)


def _fit(rod: PlanarRod, keypoints: np.ndarray, guesses: list[np.ndarray]) -> tuple[np.ndarray, float]:
    """The best fit from several guesses."""
    keypoints, starts = np.ascontiguousarray(keypoints, dtype=float), [np.array(guess, float) for guess in guesses]
    p, modes = rod.arrays
    costs = [fitting.fit_shape(q, keypoints, p, modes, rod.stride, 0.0, fitting.EXACT) for q in starts]
    best = int(np.argmin(costs))
    return starts[best], float(np.sqrt(2 * costs[best]) * rod.length)


FOLD_DAMPING = 1e-4
"""Of `motion_jacobian` near a fold, where shapes run away."""


def motion_jacobian(rod: HeldRod, q: Float[np.ndarray, "d"]) -> Float[np.ndarray, "k a"]:
    """Derivative of all numbers of the keypoints [m] by those of both gripper poses [m, rad] at the shape q.

    Near a fold it is that of the nearest motions that the rod can make.
    """
    _, dstations, poses, dposes = rod.jacobians(q[None])
    units = np.tile(rod.group.step_units(rod.length), poses.shape[1])
    rates = dposes.reshape(-1, rod.dof) / units[:, None] * rod.units
    moved = np.linalg.solve(rates.T @ rates + FOLD_DAMPING * np.eye(rod.dof), rates.T / units)
    return (rod.at_keypoints(dstations) * rod.units).reshape(-1, rod.dof) @ moved


def equilibria_at(
    rod: HeldRod,
    poses: Float[np.ndarray, "2 pose"],
    starts: int = 129,
    minimum_stability: float = 0.0,
    most_energy: float = 120.0,
) -> Float[np.ndarray, "k d"]:
    """The stable equilibria that grippers at `poses` allow, lowest energy first.

    Newton's method from a fixed set of loads, so the answer is the same every time. In the plane the set is its own
    mirror image, and its own under reversal of the rod, so the answers are too. The rod's total turn is that of the
    grippers, modulo full turns.

    Args:
        rod: The rod.
        poses: (2, 3) left and right gripper (x, y, theta) [m, m, rad], or (2, 7) in space.
        starts: Number of first guesses, rounded up to what `HeldRod.guesses_between` makes.
        minimum_stability: Least stability margin of what is returned.
        most_energy: Energy [EI/L] above which a shape is left out (wound-up shapes).

    Raises:
        InputError: The grippers are farther apart than the rod is long.
    """
    poses = np.asarray(poses, float)
    span = float(rod.group.distance(*poses)[0])
    if span > rod.length * (1 + 1e-9):
        raise InputError(
            f"the grippers are {told_apart(span, rod.length)} apart, farther than the cable is long "
            f"({limit_text(rod.length)})"
        )
    q = meet_poses(rod, poses, rod.guesses_between(poses, starts))
    q = q[(rod.stability(q)[0] > minimum_stability) & (rod.energy(q) <= most_energy)]
    q = q[np.argsort(rod.energy(q), kind="stable")]
    shapes = rod.shapes(q)[0]
    found: list[int] = []
    for i, shape in enumerate(shapes):
        known = any(np.abs(shape - shapes[j]).max() <= SAME_SHAPE * rod.length for j in found)
        if not known and not rod.passes_through_itself(shape):
            found.append(i)
    return q[found]


def nearest_equilibrium(
    rod: HeldRod, poses: Float[np.ndarray, "2 pose"], keypoints: Float[np.ndarray, "n space"]
) -> Float[np.ndarray, "d"] | None:
    """Of `equilibria_at`, the one whose keypoints are nearest (stacked) to those given; None where there is none."""
    found = equilibria_at(rod, poses)
    away = np.linalg.norm(rod.at_keypoints(rod.shapes(found)[0]) - keypoints, axis=(1, 2))
    return found[int(np.argmin(away))] if len(found) else None


def stable_near(rod: PlanarRod, q: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6"]:
    """q, or where it is unstable, the stable equilibrium between the same grippers whose keypoints are nearest to its.

    It is q all the same where there is none.
    """
    if rod.stability(q[None])[0][0] > 0:
        return q
    stations, poses = rod.shapes(q[None])
    found = nearest_equilibrium(rod, poses[0], rod.at_keypoints(stations)[0])
    return q if found is None else rod.written_near(found, q)


def shape_between(rod: PlanarRod, poses: Float[np.ndarray, "2 3"], bend: Bend) -> Float[np.ndarray, "6"]:
    """The stable equilibrium of lowest energy that lies mostly on one side of the line between the grippers.

    Args:
        rod: The rod.
        poses: (2, 3) left and right gripper (x, y, theta) [m, m, rad].
        bend: Side of the straight line from left to right gripper, by signed area.

    Raises:
        InputError: The grippers are too far apart, or no stable shape lies on that side.
    """
    sign = 1.0 if bend == "left" else -1.0
    for q in equilibria_at(rod, poses):
        if sign * polyline.signed_area(rod.shapes(q[None])[0][0]) > LEAST_AREA * rod.length**2:
            return q
    raise InputError(f"no stable shape of the cable bends to the {bend} between these gripper poses")


LARGEST_STEP = (1.0, 1.5, 2.0)
"""Of a position, an angle and a load, each in its unit, in one step of `meet_poses`."""


def meet_poses(rod: HeldRod, poses: np.ndarray, q: np.ndarray, iterations: int = 40) -> np.ndarray:
    """Damped Newton on the residuals of both gripper poses from each row of q; the rows that arrive.

    Note:
        As many equations as unknowns, and a hundred starts at a time, for any rod. Near folds a Newton step keeps the
        digits that the normal equations of `cableway.rod.least_squares` lose: they square the condition.
    """
    q = q.copy()
    units, scale, count = rod.group.step_units(rod.length), rod.units, int(np.prod(rod.step_shape))
    largest = np.full(rod.dof, LARGEST_STEP[1])
    largest[: rod.group.space], largest[rod.loads] = LARGEST_STEP[0], LARGEST_STEP[2]
    largest *= scale

    def residual(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        error = (rod.group.minus(rod.end_poses(rows), poses) / units).reshape(-1, count)
        return error, np.linalg.norm(error, axis=1)

    error, norm = residual(q)
    moving = np.ones(len(q), dtype=bool)
    for _ in range(iterations):
        moving &= norm > 1e-11
        if not moving.any():
            break
        jacobian = (rod.jacobians(q[moving])[3] / units[:, None]).reshape(-1, count, rod.dof) * scale
        step = -scale * np.einsum("kij,kj->ki", np.linalg.pinv(jacobian, rcond=1e-9), error[moving])
        step *= np.minimum(1.0, (largest / (np.abs(step) + 1e-15)).min(axis=1, keepdims=True))
        left = np.flatnonzero(moving)
        for _ in range(8):
            trial = rod.retract(q[left], step)
            trial_error, trial_norm = residual(trial)
            better = trial_norm < norm[left]
            q[left[better]], error[left[better]], norm[left[better]] = (
                trial[better],
                trial_error[better],
                trial_norm[better],
            )
            left, step = left[~better], step[~better] / 2
            if not len(left):
                break
        moving[left] = False
    return q[norm < 1e-9]


def nearest_shape(
    rod: PlanarRod, stiffness: Float[np.ndarray, "N"], rest: Float[np.ndarray, "N"], keypoints: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "n 2"], float]:
    """The equilibrium of any elastic rod whose keypoints are nearest to given ones, whatever grippers make it.

    Args:
        rod: Length and keypoints.
        stiffness: (N,) factors on the stiffness of the hinges.
        rest: (N,) turn [rad] at rest, per length of the rod.
        keypoints: (n, 2) [m], at equal arc length.

    Returns:
        Its keypoints (n, 2) [m] and their stacked distance [m] from the given ones.
    """
    modes = np.ascontiguousarray(np.stack([np.log(stiffness), rest]))
    p = np.array([rod.length, 1.0, 0.0, 0.0, 1.0])
    q = _changed(fit_keypoints(rod, keypoints)[0], keypoints, p, modes, rod.stride)
    found = rod.at_keypoints(kernels.batch_shapes(q[None], p, modes, 0)[0])[0]
    return found, float(np.linalg.norm(found - keypoints))


def nearest_shapes(
    rod: PlanarRod, q: Float[np.ndarray, "t 6"], shapes: Float[np.ndarray, "t n 2"]
) -> Float[np.ndarray, "t 6"]:
    """Equilibria of a rod nearest to the shapes of another one.

    Args:
        rod: The rod.
        q: (t, 6) of the other rod.
        shapes: (t, n, 2) its keypoints [m].
    """
    return fitting.fit_along(q, q[0], np.ascontiguousarray(shapes, float), *rod.arrays, rod.stride)


def _changed(q: np.ndarray, keypoints: np.ndarray, p: np.ndarray, modes: np.ndarray, stride: int) -> np.ndarray:
    """The fit of a rod that is made of the uniform one, whose fit is q, step by step, each from the shape before."""
    found, wanted = q.copy(), np.array(keypoints, float)
    for share in np.linspace(0.0, 1.0, STAGES + 1)[1:]:
        changed = np.concatenate([p[:1], share * p[1:]])
        fitting.fit_shape(found, wanted, changed, modes, stride, 0.0, STAGE)
    return found
