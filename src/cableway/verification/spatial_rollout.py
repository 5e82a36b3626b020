"""Judge a rollout in space from the simulated whole cable that it recorded, by Coal's distances."""

from __future__ import annotations

import numpy as np

from cableway.core.errors import InputError
from cableway.outcome import START_ERROR, SUCCESS_ERROR, stacked_limit
from cableway.records import Check, Rollout, Verdict
from cableway.scene.spatial.task import SpatialTask
from cableway.verification.plan import separation
from cableway.verification.rollout import CLOSER
from cableway.verification.spatial_bodies import bodies_off_cable, bodies_off_scene
from cableway.verification.spatial_distance import ToScene
from cableway.verification.spatial_plan import gripper_motion, swept_clearance


def verify_spatial_rollout(rollout: Rollout, task: SpatialTask, *, same_start: bool = True) -> Verdict:
    """Judge a rollout afresh.

    Args:
        rollout: The rollout.
        task: The task it was for.
        same_start: Whether the plant's cable begins in the task's shape; one that is another, or is held otherwise, has
            another shape between the same grippers, so only its ends are then compared with the start.

    Raises:
        InputError: The rollout is one of the plane, or has another number of keypoints than the task.
        MissingExtraError: Coal is not installed.
    """
    n = task.cable.keypoints
    if rollout.keypoints.shape[2] != 3:
        raise InputError(f"the task {task.name!r} is in space, the rollout is not")
    if rollout.keypoints.shape[1] != n:
        raise InputError(f"the rollout has {rollout.keypoints.shape[1]} keypoints, the task {n}")
    compared = slice(None) if same_start else [0, -1]
    begin = float(np.linalg.norm((rollout.keypoints[0] - task.keypoints("start"))[compared]))
    error, most, most_begin = rollout.shape_error(task.keypoints("goal")), *limits_of(n)
    cable, balls = (ToScene(task.scene, radius) for radius in (task.cable.radius, task.grippers.radius))
    checks = [
        Check("shape error at the end", error, "m", most, error < most),
        Check("distance to start", begin, "m", most_begin, begin < most_begin),
        swept_clearance("cable clearance", rollout.centreline, task, cable, task.cable.radius, 0.0, "the cable"),
        *(
            swept_clearance(
                "gripper clearance", rollout.poses[:, [side], :3], task, balls, task.grippers.radius, 0.0, name
            )
            for side, name in enumerate(("the left gripper", "the right gripper"))
        ),
        separation(rollout.poses[..., :3], task.grippers.least_span - CLOSER),
        *gripper_motion(rollout.poses, task),
        *bodies_off_scene(rollout.poses, task, 0.0),
    ]
    if task.bodies[2:]:
        checks.append(bodies_off_cable(rollout.centreline, rollout.poses, task))
    return Verdict.of(checks, rollout.times)


def limits_of(keypoints: int) -> tuple[float, float]:
    """Stacked errors [m] that the last and the first row of a rollout may have."""
    return stacked_limit(SUCCESS_ERROR, keypoints), stacked_limit(START_ERROR, keypoints)
