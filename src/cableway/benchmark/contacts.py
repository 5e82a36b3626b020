"""Which contacts no controller could have avoided: the first touch of something that it did not know of yet."""

from __future__ import annotations

import math

import numpy as np

from cableway.records import Rollout
from cableway.scene.clearance import body_clearance
from cableway.scene.task import Task

LETTING_GO = 3.0
"""Time [s] after the first touch in which it must be over: a contact is noticed in 1 s, and left in 1.5 s."""

REACTION = 0.2
"""Time [s] after the first touch in which grippers cannot stop: a frame is 0.1 s late, and a control step takes as
long. What the thing touched presses the cable onto by then, no controller could have kept it from."""


def is_unavoidable(rollout: Rollout, task: Task, revealed: float | None) -> bool:
    """Whether something was touched that was yet to be revealed, and not for long or again.

    Nor may anything known be touched but by what could not be stopped any more.

    Args:
        rollout: The record, with the clearance from what is really there.
        task: What the planner knew.
        revealed: Time [s] from which the rest is known; never where None.
    """
    step = float(rollout.times[1] - rollout.times[0])
    rows = np.flatnonzero(np.minimum(rollout.clearance, rollout.gripper_clearance) <= 0)
    if not len(rows):
        return False
    first, last = rollout.times[rows[[0, -1]]]
    known = task.scene.clearance(rollout.centreline, task.cable.radius)
    known = np.min([known, *(body_clearance(body, rollout.poses, task.scene) for body in task.bodies)], axis=0)
    also = np.flatnonzero(known <= 0)
    knocked_on = not len(also) or 0 < also[0] - rows[0] <= round(REACTION / step)
    known_late = first <= (math.inf if revealed is None else revealed + step)
    return bool(knocked_on and last - first <= LETTING_GO and known_late)
