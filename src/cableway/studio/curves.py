"""A plan over time: how clear cable and grippers are, and how much of their limits the grippers use."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from cableway.geometry import polyline
from cableway.geometry.groups import SE2
from cableway.records import Plan
from cableway.scene.clearance import PIECES, pieces_clearance
from cableway.scene.task import CONTROL_STEP, Draft


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


def curves_of(draft: Draft, plan: Plan) -> Curves:
    """The curves of a plan."""
    lines, limits = polyline.spline(plan.shapes, PIECES), draft.grippers
    cable = draft.scene.clearance(lines, draft.cable.radius)
    discs = draft.scene.signed_distance(plan.poses[:, :, :2]).min(axis=1) - limits.radius
    if limits.pieces:
        discs = np.minimum(discs, pieces_clearance(lines, plan.poses, draft.checked()))
    move, turn = SE2.distance(plan.poses[:-1], plan.poses[1:])
    share = np.maximum(move / limits.max_step, turn / limits.max_turn)
    times = CONTROL_STEP * np.arange(len(plan.shapes))
    return Curves(times, cable, discs, np.vstack([share[:1], share]))
