"""Joints and gripper poses of a cell's arms, for who drives them, and where their links are."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError, SimulationError
from cableway.robot.branches import SINGULAR
from cableway.robot.kinematics import branch_joints, flange_poses, gripper_poses, link_frames
from cableway.robot.links import Capsules, arm_clearances, arms_gaps, world_of_arms
from cableway.scene.cell import TOOLS, Way
from cableway.scene.grippers import SIDES
from cableway.scene.task import Task


class CellKinematics:
    """Where joints put the grippers on the table, and back, for arms that hold a cable in one way.

    Args:
        task: A task in a cell.
        way: How its arms hold the cable, as `Way.of_record` has it from a plan's metadata.

    Raises:
        InputError: The task has no cell.
    """

    def __init__(self, task: Task, way: Way) -> None:
        if task.cell is None:
            raise InputError(f"the task {task.name!r} has no cell, whose arms could be driven")
        self._cell, self._way, self._height = task.cell, way, task.cable.radius
        self._bases = [task.cell.arms[arm].base(task.scene) for arm in way.holders]
        self._models = [task.cell.models[arm] for arm in way.holders]
        self._lengths = [np.array(model.lengths) for model in self._models]
        self._capsules = [Capsules.of(model, TOOLS[task.cell.tool]) for model in self._models]
        self._world = world_of_arms(task.scene)

    def poses(self, joints: Float[np.ndarray, "2 6"]) -> Float[np.ndarray, "2 3"]:
        """Gripper poses [m, m, rad] at joint positions [rad]."""
        found, frames, reach = np.empty((2, 3)), np.empty((7, 3, 4)), TOOLS[self._cell.tool].reach
        for side in range(2):
            link_frames(self._lengths[side], self._bases[side], np.ascontiguousarray(joints[side], float), frames)
            found[side] = gripper_poses(frames[6:], reach, self._way.turns[side])[0]
        return found

    def joints(self, poses: Float[np.ndarray, "2 3"], near: Float[np.ndarray, "2 6"]) -> Float[np.ndarray, "2 6"]:
        """Joint positions [rad] that lead to gripper poses [m, m, rad], each in the turn nearest to `near`.

        Raises:
            SimulationError: An arm cannot get there in its branch, or is too near to a singularity there.
        """
        found, reach = np.empty((2, 6)), TOOLS[self._cell.tool].reach
        for side, (name, _) in enumerate(SIDES):
            held = np.asarray(poses[side], float)[None]
            flange = np.linalg.inv(self._bases[side]) @ flange_poses(held, reach, self._height, self._way.turns[side])
            if not branch_joints(self._lengths[side], flange[0], self._way.branches[side], found[side]) >= SINGULAR:
                x, y = held[0, :2]
                raise SimulationError(f"the arm at the {name} cannot reach ({x:.3f}, {y:.3f}) m in its branch")
        return found + 2 * np.pi * np.round((np.asarray(near) - found) / (2 * np.pi))

    def links(
        self, joints: Float[np.ndarray, "t 2 6"]
    ) -> list[tuple[Float[np.ndarray, "t k 2 3"], Float[np.ndarray, "k"]]]:
        """Ends [m] and radii [m] of the capsules of both arms at joint positions [rad], left then right."""
        return [(placed, capsules.radius) for placed, capsules, _ in self._placed(joints)]

    def clearance(self, joints: Float[np.ndarray, "t 2 6"]) -> Float[np.ndarray, "t"]:
        """Least clearance [m] of the links of both arms at joint positions [rad]: see `arm_clearances`, `arms_gaps`."""
        left, right = self._placed(joints)
        return np.min([left[2], right[2], arms_gaps(*left[:2], *right[:2])], axis=0)

    def _placed(self, joints: Float[np.ndarray, "t 2 6"]) -> list[tuple[np.ndarray, Capsules, np.ndarray]]:
        """Of each arm the ends of its capsules, the capsules, and their clearance from all but the other arm."""
        found = []
        for side, capsules in enumerate(self._capsules):
            placed, angles = np.empty((len(joints), len(capsules.frame), 2, 3)), np.ascontiguousarray(joints[:, side])
            arm = (self._lengths[side], self._bases[side], angles)
            found.append((placed, capsules, arm_clearances(*arm, capsules, self._world, placed)))
        return found
