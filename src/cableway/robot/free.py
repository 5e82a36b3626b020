"""Whether the arms of a cell can hold a cable in one way at two gripper poses; compiled, for searches."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from cableway.core.compiled import inlined, kernel
from cableway.geometry.convex import World
from cableway.robot.kinematics import branch_joints
from cableway.robot.links import Capsules, arm_clearances, arms_gaps
from cableway.scene.cell import TOOLS, Cell, Way
from cableway.scene.task import Task

SINGULAR = 0.06
"""Least sine of the angles of elbow, wrist and shoulder: 3.4 degrees from a singularity."""


class PackedArms(NamedTuple):
    """The arms that hold the left and the right end of a cable, in one way.

    Attributes:
        number: 2, or 0 where there are none.
        lengths: (2, 6), see `cableway.robot.kinematics` [m].
        bases: (2, 4, 4) poses of the bases.
        branches: (2,).
        turns: (2,).
        tip: Height of the flange above the table [m].
        capsules: Of either.
        world: What stands on the table.
        clearance: Of links [m].
    """

    number: int
    lengths: Float[np.ndarray, "2 6"]
    bases: Float[np.ndarray, "2 4 4"]
    branches: Int[np.ndarray, "2"]
    turns: Int[np.ndarray, "2"]
    tip: float
    capsules: tuple[Capsules, Capsules]
    world: World
    clearance: float

    @classmethod
    def of(cls, task: Task, cell: Cell, way: Way, clearance: float) -> PackedArms:
        """Those of a cell that holds a task's cable in a way."""
        tool, models = TOOLS[cell.tool], [cell.models[arm] for arm in way.holders]
        return cls(
            2,
            np.array([model.lengths for model in models]),
            np.array([cell.arms[arm].base(task.scene) for arm in way.holders]),
            np.array(way.branches),
            np.array(way.turns),
            task.cable.radius + tool.reach,
            (Capsules.of(models[0], tool), Capsules.of(models[1], tool)),
            below_arms(task),
            clearance,
        )

    @classmethod
    def none(cls, task: Task) -> PackedArms:
        """No arms."""
        nothing = Capsules(np.zeros(0, np.int64), np.zeros((0, 2, 3)), np.zeros(0), 0)
        still, zeros = np.tile(np.eye(4), (2, 1, 1)), np.zeros(2, np.int64)
        return cls(0, np.zeros((2, 6)), still, zeros, zeros, 0.0, (nothing, nothing), below_arms(task), 0.0)


def below_arms(task: Task) -> World:
    """What stands on a task's table below arms, which come over its walls."""
    *world, heights = task.scene.world.arrays
    vertices, counts, rounding, size, boxes = world
    return vertices, counts, rounding, size, boxes, np.append(heights[:-1], -np.inf)


@inlined
def _flange(pose, base, tip, turn, out):
    """Write the pose (3, 4) of a flange whose tool points down at a gripper's pose, in the frame of a base."""
    sign = 1.0 - 2.0 * turn
    c, s = sign * math.cos(pose[2]), sign * math.sin(pose[2])
    x, y, z = pose[0] - base[0, 3], pose[1] - base[1, 3], tip - base[2, 3]
    for i in range(3):
        a, b, d = base[0, i], base[1, i], base[2, i]
        out[i, 0], out[i, 1], out[i, 2] = -a * c - b * s, -a * s + b * c, -d
        out[i, 3] = a * x + b * y + d * z


@kernel
def arms_are_free(poses, arms):
    """Whether both arms reach their gripper's pose (2, 3), away from singularities and everything else."""
    flange, joints = np.empty((3, 4)), np.empty((1, 6))
    count = max(len(arms.capsules[0].frame), len(arms.capsules[1].frame))
    placed = np.empty((2, 1, count, 2, 3))
    for side in range(2):
        _flange(poses[side], arms.bases[side], arms.tip, arms.turns[side], flange)
        if branch_joints(arms.lengths[side], flange, arms.branches[side], joints[0]) < SINGULAR:
            return False
        clear = arm_clearances(
            arms.lengths[side], arms.bases[side], joints, arms.capsules[side], arms.world, placed[side]
        )
        if clear[0] < arms.clearance:
            return False
    return arms_gaps(placed[0], arms.capsules[0], placed[1], arms.capsules[1])[0] >= arms.clearance
