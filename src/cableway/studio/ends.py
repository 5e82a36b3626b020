"""The cable at start or goal, led by its grippers: the equilibrium that it follows, and where it snaps."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError
from cableway.geometry import polyline
from cableway.geometry.groups import SE2
from cableway.rod.inverse import equilibria_at, fit_keypoints, meet_poses, nearest_equilibrium, shape_between
from cableway.rod.planar import PlanarRod
from cableway.scene.task import Draft, End

MOST_SPAN = 0.99
"""Distance of the grippers, in lengths of the cable, beyond which one of them is not led: the cable is taut."""

STEP = (0.02, 0.1)
"""Length [m] and angle [rad] of the steps in which the equilibrium is followed; a page sends larger ones when busy."""

MOST_STEPS = 60
"""Of one drag. A gripper that was put somewhere by a number moves in larger steps, or the cable snaps."""


class Led(NamedTuple):
    """The cable after its grippers were led somewhere.

    Attributes:
        q: (6,) its rod coordinates.
        snapped: Whether it became unstable on the way, and took the nearest stable shape.
    """

    q: Float[np.ndarray, "6"]
    snapped: bool


def held_shape(draft: Draft, end: End) -> Float[np.ndarray, "6"] | None:
    """Rod coordinates of the cable at an end: nearest to its keypoints, or of lowest energy between stated grippers.

    None where neither is known, or no cable is held so.
    """
    rod, keypoints, poses = draft.cable.rod, getattr(draft, end), getattr(draft, f"{end}_poses")
    if keypoints is not None and len(keypoints) == rod.keypoints:
        return fit_keypoints(rod, keypoints)[0]
    try:
        found = [] if poses is None else equilibria_at(rod, poses)
    except InputError:
        return None
    return found[0] if len(found) else None


def within_reach(rod: PlanarRod, poses: Float[np.ndarray, "2 3"], side: int) -> Float[np.ndarray, "2 3"]:
    """The same gripper poses, that of one `side` brought as near to the other as the cable is long."""
    apart = poses[side, :2] - poses[1 - side, :2]
    span, most = float(np.linalg.norm(apart)), MOST_SPAN * rod.length
    if span <= most:
        return poses
    nearer = poses.copy()
    nearer[side, :2] = poses[1 - side, :2] + most / span * apart
    return nearer


def led(rod: PlanarRod, q: Float[np.ndarray, "6"], poses: Float[np.ndarray, "2 3"]) -> Led:
    """The cable q once its grippers were led straight to `poses` [m, m, rad].

    Raises:
        InputError: They hold no stable cable.
    """
    start = rod.end_poses(q[None])[0]
    step = SE2.minus(poses, start)
    wanted = max(float(np.abs(step[:, :2]).max()) / STEP[0], float(np.abs(step[:, 2]).max()) / STEP[1], 1.0)
    count = min(math.ceil(wanted), MOST_STEPS)
    for k in range(1, count + 1):
        found = meet_poses(rod, SE2.plus(start, k / count * step), q[None])
        if not len(found) or rod.stability(found)[0][0] <= 0 or _jumped(rod, q, found[0]):
            return Led(_snapped(rod, q, poses), True)
        q = found[0]
    return Led(q, False)


def bent(rod: PlanarRod, q: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6"]:
    """The cable between the same grippers, bent to the other side.

    Raises:
        InputError: No stable shape lies there.
    """
    stations, poses = rod.shapes(q[None])
    left = polyline.signed_area(stations[0]) > 0
    return shape_between(rod, poses[0], "right" if left else "left")


def with_end(draft: Draft, end: End, q: Float[np.ndarray, "6"]) -> Draft:
    """The draft with the cable q at an end; gripper poses are stated where they were."""
    stations, poses = draft.cable.rod.shapes(q[None])
    shape: dict[str, Any] = {end: draft.cable.rod.at_keypoints(stations)[0]}
    if getattr(draft, f"{end}_poses") is not None:
        shape[f"{end}_poses"] = poses[0]
    return replace(draft, **shape)


def _jumped(rod: PlanarRod, q: Float[np.ndarray, "6"], found: Float[np.ndarray, "6"]) -> bool:
    """Whether Newton's method went to another branch: a keypoint moved by far more than the grippers did."""
    before, after = rod.shapes(np.stack([q, found]))[0]
    return bool(np.linalg.norm(after - before, axis=1).max() > 0.25 * rod.length)


def _snapped(rod: PlanarRod, q: Float[np.ndarray, "6"], poses: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "6"]:
    keypoints = rod.at_keypoints(rod.shapes(q[None])[0])[0]
    found = nearest_equilibrium(rod, poses, keypoints)
    if found is None:
        raise InputError("no stable shape of the cable lies between these grippers")
    return found
