"""Inverse problems of the rod: the equilibrium nearest to given keypoints, and those that given grippers allow."""

from __future__ import annotations

from typing import Literal

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError
from cableway.geometry import polyline, se2
from cableway.geometry.groups import SE2
from cableway.rod import fitting, kernels
from cableway.rod.held_rod import HeldRod
from cableway.rod.planar import PlanarRod

Bend = Literal["left", "right"]

LEAST_AREA = 1e-6
"""Area beside the chord, in squared lengths of the rod, up to which a shape counts as bent to neither side."""

SAME_SHAPE = 1e-4
"""Distance, in lengths of the rod, up to which two shapes count as one."""

FIT_STEPS = 100
"""Most steps of one fit; a fit takes some ten."""

STAGES = 16
"""Steps from the uniform rod to another one in `nearest_shape`; with four, one that is curled by a full turn at one end
is lost."""

LOAD_RANGE = (30.0, 30.0, 6.0)
"""Largest |a_x|, |a_y|, |m| of a first guess, beside the turn between the grippers: stable shapes have about these."""


def fit_keypoints(
    rod: PlanarRod, keypoints: Float[np.ndarray, "n 2"], guess: Float[np.ndarray, "6"] | None = None
) -> tuple[Float[np.ndarray, "6"], float]:
    """The equilibrium q whose keypoints are nearest to the given ones, and the stacked distance left [m].

    The first guess comes from the bends of the polyline: phi_j N = m + a x (p_j - c)/L is linear in (a, m).

    Args:
        rod: The rod; its length is kept whatever the length of `keypoints`.
        keypoints: (n, 2) [m], at equal arc length.
        guess: q to start from, in addition to that estimate.

    Returns:
        q (6,) and ||keypoints(q) - keypoints|| [m].
    """
    return _fit(rod, keypoints, [_guesses_from_bends(rod, keypoints[None])[0], *([] if guess is None else [guess])])


def fit_sequence(
    rod: PlanarRod, shapes: Float[np.ndarray, "t n 2"], first: Float[np.ndarray, "6"]
) -> Float[np.ndarray, "t 6"]:
    """`fit_keypoints` of one shape after the other, each guessed from the one before, the first one from `first`."""
    fits = [first]
    for shape, guess in zip(shapes, _guesses_from_bends(rod, shapes), strict=True):
        fits.append(_fit(rod, shape, [guess, fits[-1]])[0])
    return np.array(fits[1:]).reshape(-1, 6)


def _fit(rod: PlanarRod, keypoints: np.ndarray, guesses: list[np.ndarray]) -> tuple[np.ndarray, float]:
    """The best fit from several guesses."""
    keypoints, starts = np.ascontiguousarray(keypoints, dtype=float), [np.array(guess, float) for guess in guesses]
    p, modes = kernels.uniform(rod.length, rod.hinges)
    costs = [fitting.fit_shape(q, keypoints, p, modes, rod.stride, 0.0, FIT_STEPS, fitting.EXACT) for q in starts]
    best = int(np.argmin(costs))
    return starts[best], float(np.sqrt(2 * costs[best]) * rod.length)


def _guesses_from_bends(rod: PlanarRod, keypoints: Float[np.ndarray, "t n 2"]) -> Float[np.ndarray, "t 6"]:
    n = keypoints.shape[1]
    steps = np.diff(keypoints, axis=1)
    angles = np.unwrap(np.arctan2(steps[..., 1], steps[..., 0]), axis=1)
    bends = np.diff(angles, axis=1) * (n - 1)
    centre = np.array([polyline.resample(line, 3)[1] for line in keypoints]).reshape(-1, 2)
    theta = (angles[:, (n - 2) // 2] + angles[:, (n - 1) // 2]) / 2
    x, y = np.moveaxis(keypoints[:, 1:-1] - centre[:, None], 2, 0) / rod.length
    c, s = np.cos(theta)[:, None], np.sin(theta)[:, None]
    # a x p = a_x p_y - a_y p_x; a pull to zero where the points cannot tell the loads apart
    rows = np.stack([c * y - s * x, -c * x - s * y, np.ones_like(bends)], axis=2)
    normal = rows.swapaxes(1, 2) @ rows + 0.03**2 * np.eye(3)
    load = np.linalg.solve(normal, rows.swapaxes(1, 2) @ bends[..., None])[..., 0]
    return np.column_stack([centre, theta, np.clip(load, -150, 150)])


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
    rod: PlanarRod,
    poses: Float[np.ndarray, "2 3"],
    starts: int = 129,
    minimum_stability: float = 0.0,
    most_energy: float = 120.0,
) -> Float[np.ndarray, "k 6"]:
    """The stable equilibria that grippers at `poses` allow, lowest energy first.

    Newton's method from a fixed set of `starts` loads, so the answer is the same every time. The set is its own mirror
    image, and its own under reversal of the rod, so the answers are too. The rod's total turn is that of the grippers,
    modulo full turns.

    Args:
        rod: The rod.
        poses: (2, 3) left and right gripper (x, y, theta) [m, m, rad].
        starts: Number of first guesses, rounded up to one more than a multiple of four.
        minimum_stability: Least stability margin of what is returned.
        most_energy: Bending energy [EI/L] above which a shape is left out (wound-up shapes).

    Raises:
        InputError: The grippers are farther apart than the rod is long.
    """
    poses = np.asarray(poses, float)
    gap = float(np.linalg.norm(poses[1, :2] - poses[0, :2]))
    if gap > rod.length * (1 + 1e-9):
        raise InputError(f"the grippers are {gap:.4f} m apart, farther than the cable is long ({rod.length:.4f} m)")
    q = meet_poses(rod, poses, _load_guesses(rod, poses, starts))
    q = q[(rod.stability(q)[0] > minimum_stability) & (rod.energy(q) <= most_energy)]
    q = q[np.argsort(rod.energy(q), kind="stable")]
    shapes = rod.shapes(q)[0]
    found: list[int] = []
    for i, shape in enumerate(shapes):
        known = any(np.abs(shape - shapes[j]).max() <= SAME_SHAPE * rod.length for j in found)
        if not known and not polyline.crosses_itself(shape[::2]):
            found.append(i)
    return q[found]


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


def _load_guesses(rod: PlanarRod, poses: np.ndarray, count: int) -> np.ndarray:
    """First guesses (count, 6): spread loads, each moved so that its ends lie about the grippers.

    The loads are a low-discrepancy sequence (multiples of powers of 1/g, g^4 = 1 + g, modulo 1: Roberts 2018, "The
    unreasonable effectiveness of quasirandom sequences") in all four images under mirroring and reversal, after none.
    """
    g = 1.2207440846057596
    unit = (0.5 + np.arange(-(-(count - 1) // 4))[:, None] / g ** np.arange(1, 4)) % 1.0
    unit[:, 0] = 2 * unit[:, 0] - 1
    images = np.array([[1, 1, 1], [1, -1, -1], [1, 1, -1], [1, -1, 1]])
    q = np.zeros((1 + 4 * len(unit), 6))
    q[1:, 3:] = (unit[:, None] * images * LOAD_RANGE).reshape(-1, 3)
    q[:, 5] += float(se2.wrap_angle(poses[1, 2] - poses[0, 2]))
    target = poses[1, :2] - poses[0, :2]
    ends = rod.shapes(q)[1]
    chord = ends[:, 1, :2] - ends[:, 0, :2]
    q[:, 2] = np.arctan2(target[1], target[0]) - np.arctan2(chord[:, 1], chord[:, 0])
    if np.linalg.norm(target) < 0.2 * rod.length:
        turns = poses[:, 2] - ends[:, :, 2]
        q[:, 2] = turns[:, 0] + se2.wrap_angle(turns[:, 1] - turns[:, 0]) / 2
    q[:, :2] = poses[:, :2].mean(0) - rod.shapes(q)[1][:, :, :2].mean(1)
    return q


def meet_poses(rod: PlanarRod, poses: np.ndarray, q: np.ndarray, iterations: int = 40) -> np.ndarray:
    """Damped Newton on the six pose residuals from each row of q; the rows that arrive."""
    units = np.array([rod.length, rod.length, 1.0])
    scale = np.array([rod.length, rod.length, 1.0, 10.0, 10.0, 3.0])
    longest = np.array([1.0, 1.0, 1.5, 2.0, 2.0, 2.0]) * scale

    def residual(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        error = (SE2.minus(rod.shapes(rows)[1], poses) / units).reshape(-1, 6)
        return error, np.linalg.norm(error, axis=1)

    error, norm = residual(q)
    moving = np.ones(len(q), dtype=bool)
    for _ in range(iterations):
        moving &= norm > 1e-11
        if not moving.any():
            break
        jacobian = (rod.jacobians(q[moving])[3] / units[:, None]).reshape(-1, 6, 6) * scale
        step = -scale * np.einsum("kij,kj->ki", np.linalg.pinv(jacobian, rcond=1e-9), error[moving])
        step *= np.minimum(1.0, (longest / (np.abs(step) + 1e-15)).min(axis=1, keepdims=True))
        left = np.flatnonzero(moving)
        for _ in range(8):
            trial = q[left] + step
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

    The rod is made of the uniform one step by step, each from the shape before.

    Args:
        rod: Length and keypoints.
        stiffness: (N,) factors on the stiffness of the hinges.
        rest: (N,) turn [rad] at rest, per length of the rod.
        keypoints: (n, 2) [m], at equal arc length.

    Returns:
        Its keypoints (n, 2) [m] and their stacked distance [m] from the given ones.
    """
    modes = np.ascontiguousarray(np.stack([np.log(stiffness), rest]))
    wanted = np.array(keypoints, float)[None]
    q, found = fit_keypoints(rod, wanted[0])[0][None].copy(), np.empty_like(wanted)
    for share in np.linspace(0.0, 1.0, STAGES + 1)[1:]:
        p = np.array([rod.length, share, 0.0, 0.0, share])
        fitting.fit_shapes(q, wanted, p, modes, rod.stride, 0.0, 50, found, np.empty((1, 2, 3)))
    return found[0], float(np.linalg.norm(found - wanted))
