"""The cable at start or goal, led by its grippers: the equilibrium that it follows, and where it snaps."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError
from cableway.geometry import polyline
from cableway.rod.held_rod import HeldRod
from cableway.rod.inverse import equilibria_at, fit_keypoints, meet_poses, nearest_equilibrium, shape_between
from cableway.rod.planar import PlanarRod
from cableway.scene.files.loading import AnyDraft
from cableway.scene.spatial.task import SpatialDraft
from cableway.scene.task import End

MOST_SPAN = 0.99
"""Distance of the grippers, in lengths of the cable, beyond which one of them is not led: the cable is taut."""

STEP = (0.02, 0.1)
"""Length [m] and angle [rad] of the steps in which the equilibrium is followed; a page sends larger ones when busy."""

MOST_STEPS = 60
"""Of one drag. A gripper that was put somewhere by a number moves in larger steps, or the cable snaps."""


class Led(NamedTuple):
    """The cable after its grippers were led somewhere.

    Attributes:
        q: (d,) its rod coordinates.
        snapped: Whether it became unstable on the way, and took the nearest stable shape.
    """

    q: Float[np.ndarray, "d"]
    snapped: bool


def held_shape(draft: AnyDraft, end: End) -> Float[np.ndarray, "d"] | None:
    """Rod coordinates of the cable at an end: nearest to its keypoints, or of lowest energy between stated grippers; in
    space, as the task has them.

    None where none of it is known, or no cable is held so.
    """
    if isinstance(draft, SpatialDraft):
        q = getattr(draft, end)
        return None if q is None else np.array(q)
    rod, keypoints, poses = draft.cable.rod, getattr(draft, end), getattr(draft, f"{end}_poses")
    if keypoints is not None and len(keypoints) == rod.keypoints:
        return fit_keypoints(rod, keypoints)[0]
    try:
        found = [] if poses is None else equilibria_at(rod, poses)
    except InputError:
        return None
    return found[0] if len(found) else None


def within_reach(rod: HeldRod, poses: Float[np.ndarray, "2 pose"], side: int) -> Float[np.ndarray, "2 pose"]:
    """The same gripper poses, that of one `side` brought as near to the other as the cable is long."""
    at = rod.group.position(poses)
    apart = at[side] - at[1 - side]
    span, most = float(np.linalg.norm(apart)), MOST_SPAN * rod.length
    if span <= most:
        return poses
    nearer = poses.copy()
    rod.group.position(nearer)[side] = at[1 - side] + most / span * apart
    return nearer


def led(rod: HeldRod, q: Float[np.ndarray, "d"], poses: Float[np.ndarray, "2 pose"]) -> Led:
    """The cable q once its grippers were led straight to `poses`.

    Raises:
        InputError: They hold no stable cable.
    """
    group, start = rod.group, rod.end_poses(q[None])[0]
    step = group.minus(poses, start)
    move, turn = step[:, : group.space], step[:, group.space :]
    wanted = max(float(np.abs(move).max()) / STEP[0], float(np.abs(turn).max()) / STEP[1], 1.0)
    count = min(math.ceil(wanted), MOST_STEPS)
    for k in range(1, count + 1):
        found = meet_poses(rod, group.plus(start, k / count * step), q[None])
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


def with_end(draft: AnyDraft, end: End, q: Float[np.ndarray, "d"]) -> AnyDraft:
    """The draft with the cable q at an end; gripper poses are stated where they were."""
    if isinstance(draft, SpatialDraft):
        return replace(draft, **{end: q})
    stations, poses = draft.cable.rod.shapes(q[None])
    shape: dict[str, Any] = {end: draft.cable.rod.at_keypoints(stations)[0]}
    if getattr(draft, f"{end}_poses") is not None:
        shape[f"{end}_poses"] = poses[0]
    return replace(draft, **shape)


def _jumped(rod: HeldRod, q: Float[np.ndarray, "d"], found: Float[np.ndarray, "d"]) -> bool:
    """Whether Newton's method went to another branch: a keypoint moved by far more than the grippers did."""
    before, after = rod.shapes(np.stack([q, found]))[0]
    return bool(np.linalg.norm(after - before, axis=1).max() > 0.25 * rod.length)


def _snapped(rod: HeldRod, q: Float[np.ndarray, "d"], poses: Float[np.ndarray, "2 pose"]) -> Float[np.ndarray, "d"]:
    keypoints = rod.at_keypoints(rod.shapes(q[None])[0])[0]
    found = nearest_equilibrium(rod, poses, keypoints)
    if found is None:
        raise InputError("no stable shape of the cable lies between these grippers")
    return found
