"""Which contacts no controller could have avoided: the first touch of something that it did not know of yet."""

from __future__ import annotations

import math

import numpy as np

from cableway.records import Rollout
from cableway.scene.clearance import body_clearance
from cableway.scene.task import Task

LETTING_GO = 3.0
"""Time [s] after the first touch in which it must be over: a contact is noticed in 1 s, and left in 1.5 s."""


def is_unavoidable(rollout: Rollout, task: Task, revealed: float | None) -> bool:
    """Whether something was touched that was yet to be revealed, and nothing else, nor that for long or again.

    Args:
        rollout: The record, with the clearance from what is really there.
        task: What the planner knew.
        revealed: Time [s] from which the rest is known; never where None.
    """
    touched = rollout.times[np.minimum(rollout.clearance, rollout.gripper_clearance) <= 0]
    if not len(touched):
        return False
    known = task.scene.clearance(rollout.centreline, task.cable.radius).min()
    known = min([known, *(body_clearance(body, rollout.poses, task.scene).min() for body in task.bodies)])
    lasting = touched[-1] - touched[0] > LETTING_GO
    step = float(rollout.times[1] - rollout.times[0])
    return bool(known > 0 and not lasting and touched[0] <= (math.inf if revealed is None else revealed + step))
