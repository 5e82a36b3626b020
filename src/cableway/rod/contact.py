"""Where something holds a cable that lies still: one force at a point, between two rods that are under none.

On either side of the contact the cable is an equilibrium of a shorter rod, clamped in its gripper. Both have the pose
and the moment at the contact in common, and their forces differ by that of the contact: twelve coordinates under ten
conditions, so that two numbers explain all keypoints, once for each keypoint at which the contact may be.

Note:
    Not in the paper (Tang et al.), whose scenes are known.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.geometry import polyline, se2
from cableway.geometry.groups import SE2
from cableway.rod.inverse import fit_keypoints
from cableway.rod.planar import PlanarRod

NOISE = 0.0015
"""Standard deviation [m] of a keypoint of a cable at rest: noise of 2 mm in five frames, and what else differs."""

GRASP = np.array([5e-4, 5e-4, 0.02])
"""The same [m, m, rad] of a cable's end in its gripper."""

MEETING = np.array([1e-4, 1e-4, 2e-3])
"""How far [m, m, rad] the two rods may be from meeting at the contact."""

SAME_MOMENT = 0.05
"""The same of their moments, in EI/L."""

LARGEST = 3.0
"""Mean square of the residuals, in such deviations, up to which one contact explains what is seen."""

NEEDED = 0.25
"""Share of the squared residuals without any contact that one may leave."""

TOGETHER = 2.0
"""Keypoints that are off together, where a cable is not quite the rod, and count as one."""

LEAST_SPREAD = 0.1
"""Least mean square of the best contact's residuals, in such deviations: keypoints are known to 0.5 mm at best."""

LEAST_SHARE = 0.55
"""Probability of a place from which the contact may be there, over that of each if all were as likely."""

EVALUATIONS = 30

LEAST_KEYPOINTS = 3
"""Of a rod."""


def contacts_on(
    rod: PlanarRod, keypoints: Float[np.ndarray, "n 2"], poses: Float[np.ndarray, "2 3"]
) -> list[tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]]:
    """Where something may hold a cable: points of its centreline [m], and the directions of the force (unit vectors).

    One contact is at one of them, the likeliest first. None where no single contact explains the keypoints, or none is
    needed.

    Args:
        rod: Uniform; its length is that of the cable.
        keypoints: (n, 2) of the cable at rest [m].
        poses: (2, 3) of the grippers [m, m, rad].
    """
    free, q = _free(rod, keypoints, poses)
    tried = [_held_at(rod, keypoints, poses, index, q) for index in range(1, len(keypoints) - 1)]
    costs = np.array([cost for cost, *_ in tried])
    if not len(costs) or costs.min() > min(LARGEST * keypoints.size, NEEDED * free):
        return []
    spread = max(TOGETHER * float(costs.min()) / keypoints.size, LEAST_SPREAD)
    shares = np.exp((costs.min() - costs) / (2 * spread))
    shares /= shares.sum()
    likely = [index for index in np.argsort(-shares) if shares[index] > LEAST_SHARE / len(shares)]
    return [(tried[index][1], tried[index][2] / np.linalg.norm(tried[index][2])) for index in likely]


def _free(
    rod: PlanarRod, keypoints: Float[np.ndarray, "n 2"], poses: Float[np.ndarray, "2 3"]
) -> tuple[float, Float[np.ndarray, "6"]]:
    """Squared residuals of the rod under no contact, and its coordinates."""
    from scipy.optimize import least_squares  # here, as in `Task.resumed_from`: most runs never need it

    def residuals(q: np.ndarray) -> np.ndarray:
        stations, ends = rod.shapes(q[None])
        apart = (rod.at_keypoints(stations)[0] - keypoints) / NOISE
        return np.concatenate([apart.ravel(), (SE2.minus(ends[0], poses) / GRASP).ravel()])

    found = least_squares(residuals, fit_keypoints(rod, keypoints)[0], x_scale=rod.units, max_nfev=EVALUATIONS)
    return 2 * float(found.cost), found.x


def _part(rod: PlanarRod, q: Float[np.ndarray, "6"], part: PlanarRod, begin: float) -> Float[np.ndarray, "6"]:
    """Coordinates of the part of a rod that begins at an arc length [m]."""
    stations = rod.shapes(q[None])[0][0]
    middle = begin + part.length / 2
    before, centre, after = polyline.point_at(stations, middle + np.array([-0.02, 0.0, 0.02]) * rod.length)
    pose = np.array([*centre, np.arctan2(*(after - before)[::-1])])
    load = se2.rotation(pose[2]).T @ _force(rod, q) * part.length**2
    return np.array([*pose, *load, _moment(rod, q, pose) * part.length])


def _held_at(
    rod: PlanarRod,
    keypoints: Float[np.ndarray, "n 2"],
    poses: Float[np.ndarray, "2 3"],
    index: int,
    free: Float[np.ndarray, "6"],
) -> tuple[float, Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Squared residuals of the best contact at a keypoint, its place [m] and its force, in EI [1/m^2].

    Started from the parts fitted by themselves, and from those of the rod under no contact.
    """
    from scipy.optimize import least_squares

    spacing = rod.length / (len(keypoints) - 1)
    parts = keypoints[: index + 1], keypoints[index:]
    left, right = (PlanarRod(spacing * (len(part) - 1), max(len(part), LEAST_KEYPOINTS)) for part in parts)
    every = [2 if len(part) == 2 else 1 for part in parts]

    def residuals(x: np.ndarray) -> np.ndarray:
        q, r = np.split(x, 2)
        (stations, ends), (stations_after, ends_after) = left.shapes(q[None]), right.shapes(r[None])
        before, after = ends[0, 1], ends_after[0, 0]
        held = SE2.minus(np.stack([ends[0, 0], ends_after[0, 1]]), poses)
        moments = _moment(left, q, before) - _moment(right, r, after)
        return np.concatenate(
            [
                (left.at_keypoints(stations)[0][:: every[0]] - parts[0]).ravel() / NOISE,
                (right.at_keypoints(stations_after)[0][:: every[1]] - parts[1])[1:].ravel() / NOISE,
                (held / GRASP).ravel(),
                SE2.minus(before[None], after[None])[0] / MEETING,
                [rod.length * moments / SAME_MOMENT],
            ]
        )

    units = np.concatenate([left.units, right.units])
    starts = (
        np.concatenate([fit_keypoints(one, _filled(part))[0] for one, part in zip((left, right), parts, strict=True)]),
        np.concatenate([_part(rod, free, left, 0.0), _part(rod, free, right, left.length)]),
    )
    found = min(
        (least_squares(residuals, start, x_scale=units, max_nfev=EVALUATIONS) for start in starts),
        key=lambda one: one.cost,
    )
    q, r = np.split(found.x, 2)
    place = left.shapes(q[None])[1][0, 1, :2]
    return 2 * float(found.cost), place, _force(left, q) - _force(right, r)


def _filled(part: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "m 2"]:
    """Keypoints, with one between if they are only two."""
    return part if len(part) >= LEAST_KEYPOINTS else np.stack([part[0], part.mean(axis=0), part[1]])


def _force(rod: PlanarRod, q: Float[np.ndarray, "6"]) -> Float[np.ndarray, "2"]:
    """The force along a rod in the world frame, in EI [1/m^2]."""
    return se2.rotation(q[2]) @ q[3:5] / rod.length**2


def _moment(rod: PlanarRod, q: Float[np.ndarray, "6"], pose: Float[np.ndarray, "3"]) -> float:
    """The moment at a pose of a rod, in EI [1/m]."""
    (fx, fy), (dx, dy) = _force(rod, q), pose[:2] - q[:2]
    return float(q[5] / rod.length + fx * dy - fy * dx)
