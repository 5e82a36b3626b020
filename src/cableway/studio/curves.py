"""A plan over time: how clear cable and grippers are, and how much of their limits the grippers use."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from cableway.geometry import polyline
from cableway.geometry.spatial_convex import chain_distance, signed_distance
from cableway.records import Plan
from cableway.scene.clearance import PIECES, pieces_clearance
from cableway.scene.files.loading import AnyDraft
from cableway.scene.spatial.task import SpatialDraft
from cableway.scene.spatial.validity import body_clearance
from cableway.scene.task import CONTROL_STEP


class Curves(NamedTuple):
    """One number for each row of a plan.

    Attributes:
        times: [s].
        cable: Clearance of the cable's surface [m].
        grippers: Clearance of what moves with the grippers [m].
        speed: (t, 2) share of the limits that the step to each row takes of the left and the right gripper.
    """

    times: Float[np.ndarray, "t"]
    cable: Float[np.ndarray, "t"]
    grippers: Float[np.ndarray, "t"]
    speed: Float[np.ndarray, "t 2"]


def curves_of(draft: AnyDraft, plan: Plan) -> Curves:
    """The curves of a plan."""
    lines, limits = polyline.spline(plan.shapes, PIECES), draft.grippers
    cable, grippers = (_in_space if isinstance(draft, SpatialDraft) else _on_table)(draft, plan, lines)
    move, turn = draft.cable.rod.group.distance(plan.poses[:-1], plan.poses[1:])
    share = np.maximum(move / limits.max_step, turn / limits.max_turn)
    times = CONTROL_STEP * np.arange(len(plan.shapes))
    return Curves(times, cable, grippers, np.vstack([share[:1], share]))


def _on_table(draft: Any, plan: Plan, lines: Float[np.ndarray, "t m 2"]) -> tuple[np.ndarray, np.ndarray]:
    """Clearance [m] of the cable, whose lines are given, and of the grippers in each row."""
    limits = draft.grippers
    discs = draft.scene.signed_distance(plan.poses[:, :, :2]).min(axis=1) - limits.radius
    if limits.pieces:
        discs = np.minimum(discs, pieces_clearance(lines, plan.poses, draft.checked()))
    return draft.scene.clearance(lines, draft.cable.radius), discs


def _in_space(draft: Any, plan: Plan, lines: Float[np.ndarray, "t m 3"]) -> tuple[np.ndarray, np.ndarray]:
    """The same in space."""
    scene = draft.scene
    grippers = np.full(len(lines), np.inf)
    for body in draft.bodies:
        poses = plan.poses[:, body.side]
        if len(body.points) == 1:
            away = signed_distance(body.placed(poses)[:, 0], scene.world)[0] - body.radius
        else:
            away = np.array([body_clearance(body, pose, scene) for pose in poses])
        grippers = np.minimum(grippers, away)
    return chain_distance(lines, scene.world)[0] - draft.cable.radius, grippers
