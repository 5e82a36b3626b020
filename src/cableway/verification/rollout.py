"""Judge a rollout from the simulated whole cable that it recorded."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError, Point
from cableway.outcome import START_ERROR, SUCCESS_ERROR, stacked_limit
from cableway.records import Check, Rollout, Verdict
from cableway.scene.files.loading import TaskSource, as_task
from cableway.scene.task import Task
from cableway.verification.arms import arm_checks
from cableway.verification.bodies import body_checks
from cableway.verification.grasps import tool_poses
from cableway.verification.plan import (
    cable_clearance,
    gripper_clearance,
    gripper_separation,
    self_crossings,
    with_halves,
)
from cableway.verification.plug import insertion_checks, plug_clearance, require_port
from cableway.verification.recording import recording_checks

CLOSER = 0.002
"""Distance [m] by which tracked grippers may come nearer to each other than a plan may bring them."""


def verify_rollout(rollout: Rollout, task: TaskSource, *, length: float | None = None) -> Verdict:
    """Judge a rollout afresh.

    Args:
        rollout: The rollout.
        task: The task it was for.
        length: True length of the plant's cable [m] where that is not the task's cable. Another cable has another shape
            between the same grippers, so only its ends are compared with the task's start.

    Raises:
        InputError: The rollout has another number of keypoints than the task.
    """
    task = as_task(task)
    physics = _physics(rollout, task, length)
    error = rollout.shape_error(task.goal)
    compared = slice(None) if length is None else [0, -1]
    begin = float(np.linalg.norm((rollout.keypoints[0] - task.start)[compared]))
    n = task.cable.keypoints
    most_error, most_begin = stacked_limit(SUCCESS_ERROR, n), stacked_limit(START_ERROR, n)
    checks = [
        Check("shape error at the end", error, "m", most_error, error < most_error, at=_farthest(rollout, task.goal)),
        Check("distance to start", begin, "m", most_begin, begin < most_begin),
        *physics,
        *plug_clearance(rollout.poses[:, 1], task, 0.0),
    ]
    return Verdict.of(checks, rollout.times)


def verify_insertion(rollout: Rollout, task: TaskSource, *, length: float | None = None) -> Verdict:
    """Judge afresh a rollout of the insertion into the task's port; arguments as for `verify_rollout`.

    Raises:
        InputError: The rollout has another number of keypoints than the task, or the task has no port.
    """
    task = as_task(task)
    require_port(task)
    physics, ends = _physics(rollout, task, length), rollout.poses[:, 1]
    before, most = float(np.linalg.norm(rollout.keypoints[0] - task.goal)), stacked_limit(SUCCESS_ERROR, len(task.goal))
    checks = [
        Check("shape error before the insertion", before, "m", most, before < most),
        *physics,
        *plug_clearance(ends, task, 0.0, inserting=True),
        *insertion_checks(ends, task),
    ]
    return Verdict.of(checks, rollout.times)


def _farthest(rollout: Rollout, goal: Float[np.ndarray, "n 2"]) -> Point:
    """Where the keypoint lies that is farthest from its goal at the end [m]."""
    x, y = rollout.keypoints[-1, int(np.argmax(np.linalg.norm(rollout.keypoints[-1] - goal, axis=1)))]
    return float(x), float(y)


def _physics(rollout: Rollout, task: Task, length: float | None) -> list[Check]:
    """What any rollout must keep, wherever it begins and ends."""
    if rollout.keypoints.shape[2] != 2:
        raise InputError(f"the task {task.name!r} is on the table, the rollout is not")
    if rollout.keypoints.shape[1] != task.cable.keypoints:
        raise InputError(f"the rollout has {rollout.keypoints.shape[1]} keypoints, the task {task.cable.keypoints}")
    grippers = tool_poses(rollout)
    return [
        cable_clearance(rollout.centreline, task, 0.0),
        gripper_clearance(grippers, task, 0.0),
        *body_checks(rollout.centreline, grippers, task, 0.0, held=rollout.poses),
        gripper_separation(grippers, task, CLOSER),
        self_crossings(with_halves(rollout.centreline)),
        *recording_checks(rollout, task, length),
        *arm_checks(rollout, task, 0.0),
    ]
