"""Small motions in space."""

from __future__ import annotations

from functools import cache

import numpy as np

from cableway.motion.spatial import SpatialProblem
from cableway.planning.planner import plan
from cableway.records import Plan
from cableway.scene.spatial.cable import SpatialCable
from cableway.scene.spatial.obstacles import Cuboid, Sphere
from cableway.scene.spatial.scene import SpatialScene
from cableway.scene.spatial.task import SpatialTask

HANGING = np.array([0.2, 0.4, 0.4, 0.0, 0.0, np.pi / 2, -6.0, 0.0, 0.0, 0.0, 0.0, 2.0])
"""A cable along y that hangs a little and bends."""


def ball_task(radius: float = 0.08) -> SpatialTask:
    """A ball between a start and a goal 0.4 m apart."""
    goal = HANGING.copy()
    goal[0] = 0.6
    return SpatialTask(
        name="past-a-ball",
        scene=SpatialScene((0.8, 0.8, 0.8), (Sphere(center=(0.4, 0.4, 0.38), radius=radius),)),
        cable=SpatialCable(length=0.3),
        start=HANGING,
        goal=goal,
    )


def past_a_ball(radius: float = 0.08) -> SpatialProblem:
    """`ball_task` as values."""
    return SpatialProblem.of(ball_task(radius))


def walled_task() -> SpatialTask:
    """A wall without a hole between start and goal."""
    goal = HANGING.copy()
    goal[0] = 0.6
    wall = Cuboid(center=(0.4, 0.4, 0.4), size=(0.04, 0.9, 0.9))
    return SpatialTask(
        name="walled", scene=SpatialScene((0.8, 0.8, 0.8), (wall,)), cable=SpatialCable(length=0.3), start=HANGING,
        goal=goal,
    )  # fmt: skip


@cache
def ball_plan() -> Plan:
    """The plan of `ball_task`."""
    return plan(ball_task())
