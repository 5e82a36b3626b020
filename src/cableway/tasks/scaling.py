"""Tasks made larger or smaller: everything on the table scales, what belongs to robot and material does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cableway.core.errors import InputError
from cableway.scene.obstacles import Disc, Obstacle, Polygon
from cableway.scene.task import Task


def scaled(task: Task, by: float) -> Task:
    """The task with workspace, obstacles, cable length, start and goal so many times as large.

    Grippers, their limits in one control step, and the cable's radius, weight per metre and stiffness stay as they are.

    Raises:
        InputError: The factor is not positive, or the task has a plug, which is as large as it is.
        TaskError: What comes out cannot be, a cable shorter than four of its radii, say.
    """
    if not 0 < by < np.inf:
        raise InputError(f"the scale of a task must be positive and finite, got {by!r}")
    if task.plug is not None:
        raise InputError(f"{task.name} has a plug and cannot be scaled")
    obstacles = tuple(_scaled(obstacle, by) for obstacle in task.scene.obstacles)
    width, height = task.scene.size
    return replace(
        task,
        scene=replace(task.scene, size=(by * width, by * height), obstacles=obstacles),
        cable=replace(task.cable, length=by * task.cable.length),
        start=by * task.start,
        goal=by * task.goal,
        start_poses=None,
        goal_poses=None,
    )


def _scaled(obstacle: Obstacle, by: float) -> Obstacle:
    if isinstance(obstacle, Polygon):
        return replace(obstacle, vertices=by * obstacle.vertices)
    x, y = obstacle.center
    if isinstance(obstacle, Disc):
        return replace(obstacle, center=(by * x, by * y), radius=by * obstacle.radius)
    width, height = obstacle.size
    return replace(obstacle, center=(by * x, by * y), size=(by * width, by * height))
