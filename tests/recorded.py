"""Plans and rollouts made by hand from rod equilibria, for tests that need records and not what makes them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from problems import LOW_ARC, MOVED_ARC, line_in_q, moved

from cableway.records import PaperStages, Plan, Rollout
from cableway.scene.task import CONTROL_STEP, Task


def moved_plan(rows: int = 61) -> tuple[Task, Plan]:
    """The task `moved` and the straight line in q, which is a true plan of it."""
    task = moved()
    rod = task.cable.rod
    stations, poses = rod.shapes(line_in_q(rod, LOW_ARC, MOVED_ARC, rows))
    shapes = np.ascontiguousarray(rod.at_keypoints(stations))
    middle = shapes.shape[1] // 2
    share = np.linspace(0, 1, rows)[:, None].repeat(shapes.shape[1], axis=1)
    passages = np.array([[[0.1, 0.3], [0.6, 0.3]]])
    stages = PaperStages(shapes[:, middle], passages, np.swapaxes(shapes, 0, 1).copy(), share)
    return task, Plan(shapes, poses, stages=stages, metadata={"seed": 7})


def perfect_rollout(task: Task, plan: Plan) -> Rollout:
    """A cable that is at every time just where the plan has it."""
    count = len(plan.shapes)
    clearance = task.scene.clearance(plan.shapes, task.cable.radius)
    grippers = task.scene.signed_distance(plan.poses[:, :, :2]).min(axis=1) - task.grippers.radius
    return Rollout(
        times=CONTROL_STEP * np.arange(count),
        keypoints=plan.shapes,
        observed=plan.shapes,
        poses=plan.poses,
        centreline=plan.shapes,
        actions=np.diff(plan.poses, axis=0),
        reference=plan.shapes,
        solve_time=np.linspace(0.001, 0.002, count - 1),
        status=np.array(["tracking"] * (count - 1)),
        clearance=clearance,
        gripper_clearance=grippers,
        metadata={"outcome": "settled"},
    )


def moved_aside(rollout: Rollout, by: float) -> Rollout:
    """The same with the whole cable `by` metres to the right of its reference at the end."""
    offset = np.array([by, 0.0]) * np.linspace(0, 1, len(rollout.times))[:, None, None]
    return replace(
        rollout,
        keypoints=rollout.keypoints + offset,
        centreline=rollout.centreline + offset,
        poses=rollout.poses + np.concatenate([offset, np.zeros_like(offset[..., :1])], axis=-1),
    )
