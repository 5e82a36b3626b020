"""Joints and gripper poses of a cell's arms, where their links are and what room they leave, for who drives them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError, SimulationError
from cableway.core.quantities import quantity
from cableway.robot.branches import SINGULAR, PackedCell
from cableway.robot.kinematics import branch_joints, gripper_poses, link_frames
from cableway.scene.cell import Way
from cableway.scene.grippers import SIDES
from cableway.scene.task import Task

LEAST = 0.004
"""Clearance [m] of links that is kept by whoever commands arms: the judge of plans asks for as much, and takes up to
that off a rollout for what links may come nearer between its looks."""

ROUNDING = 1e-9
"""[m]."""


class CellKinematics:
    """Where joints put the grippers on the table, and back, for arms that hold a cable in one way.

    Args:
        task: A task in a cell.
        way: How its arms hold the cable, as `Way.of_record` has it from a plan's metadata.

    Attributes:
        way: The same.
        models: Of the arms at the left and the right gripper.
        position_limit: (2, 6) of the joints of the arms at the left and the right gripper, to either side [rad].
        speed_limit: (2, 6) [rad/s].
        acceleration_limit: (2, 6) [rad/s²].

    Raises:
        InputError: The task has no cell.
    """

    def __init__(self, task: Task, way: Way) -> None:
        if task.cell is None:
            raise InputError(f"the task {task.name!r} has no cell, whose arms could be driven")
        self._packed, self.way = PackedCell(task, task.cell), way
        models = self.models = task.cell.models_of(way)
        self.position_limit = np.array([model.position_limit for model in models])
        self.speed_limit = np.array([model.speed_limit for model in models])
        self.acceleration_limit = np.array([model.acceleration_limit for model in models])
        self.room(np.zeros((1, 2, 6)))  # compiles what it needs

    def poses(self, joints: Float[np.ndarray, "2 6"]) -> Float[np.ndarray, "2 3"]:
        """Gripper poses [m, m, rad] at joint positions [rad]."""
        found, frames = np.empty((2, 3)), np.empty((7, 3, 4))
        for side, arm in enumerate(self.way.holders):
            lengths, base = self._packed.lengths[arm], self._packed.bases[arm]
            link_frames(lengths, base, np.ascontiguousarray(joints[side], float), frames)
            found[side] = gripper_poses(frames[6:], self._packed.reach, self.way.turns[side])[0]
        return found

    def heights(self, joints: Float[np.ndarray, "k 2 6"]) -> Float[np.ndarray, "k 2"]:
        """Heights [m] above the table of where tools hold the cable, at joint positions [rad]."""
        found, frames = np.empty(joints.shape[:2]), np.empty((7, 3, 4))
        for side, arm in enumerate(self.way.holders):
            lengths, base = self._packed.lengths[arm], self._packed.bases[arm]
            for k, row in enumerate(np.ascontiguousarray(joints[:, side], float)):
                link_frames(lengths, base, row, frames)
                found[k, side] = frames[6, 2, 3] + self._packed.reach * frames[6, 2, 2]
        return found

    def joints(
        self, poses: Float[np.ndarray, "2 3"], near: Float[np.ndarray, "2 6"], least: float = SINGULAR
    ) -> Float[np.ndarray, "2 6"]:
        """Joint positions [rad] that lead to gripper poses [m, m, rad], each in the turn nearest to `near`.

        Args:
            poses: Of the grippers.
            near: Joint positions [rad].
            least: Distance from singularities down to which they are taken, see `branch_joints`.

        Raises:
            SimulationError: An arm cannot get there in its branch, or is too near to a singularity there.
        """
        found, away = self.held(np.asarray(poses, float)[None], near)
        for side, (name, _) in enumerate(SIDES):
            if not away[0, side] >= least:
                x, y = poses[side][:2]
                raise SimulationError(f"the arm at the {name} cannot reach ({x:.3f}, {y:.3f}) m in its branch")
        return found[0]

    def held(
        self, poses: Float[np.ndarray, "k 2 3"], near: Float[np.ndarray, "2 6"]
    ) -> tuple[Float[np.ndarray, "k 2 6"], Float[np.ndarray, "k 2"]]:
        """Joint positions [rad] that lead to gripper poses [m, m, rad], and how far they are from singularities.

        Returns:
            Each in the turn nearest to `near`; and the distances of `branch_joints`, negative where an arm does not
            reach its pose, and its joints are those of `near`.
        """
        found, away = np.empty((len(poses), 2, 6)), np.empty((len(poses), 2))
        for side, (arm, turn, branch) in enumerate(map(self.way.of, range(2))):
            lengths, flanges = self._packed.lengths[arm], self._packed.flanges(arm, poses[:, side], side, turn)
            for k, flange in enumerate(flanges):
                away[k, side] = branch_joints(lengths, flange, branch, found[k, side])
        found = np.where((away > 0)[..., None], found, near)
        return found + 2 * np.pi * np.round((near - found) / (2 * np.pi)), np.where(away > 0, away, -1.0)

    def along(self, poses: Float[np.ndarray, "t 2 3"]) -> Float[np.ndarray, "t 2 6"]:
        """Joint positions [rad] along gripper poses [m, m, rad] that the arms reach, without jumps."""
        return np.unwrap(self.held(poses, np.zeros((2, 6)))[0], axis=0)

    def room(self, joints: Float[np.ndarray, "k 2 6"]) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 2 6"]]:
        """What the arms have left at joint positions [rad].

        Returns:
            Clearance [m] of the left arm's links from table, obstacles and its own links, the same of the right arm,
            and the distance of both arms from each other; and the way to the joints' limits of position [rad].
        """
        left, right = (self._packed.placed(arm, joints[:, side]) for side, arm in enumerate(self.way.holders))
        gaps = self._packed.gaps(self.way.holders, left[0], right[0])
        return np.column_stack([left[1], right[1], gaps]), self.position_limit - np.abs(joints)

    def fault(self, before: Float[np.ndarray, "2 6"], joints: Float[np.ndarray, "2 6"]) -> str:
        """Why the arms must not go from joint positions to others [rad], in a sentence; "" where they may.

        Links would come within `LEAST` of something; nearer than they are, where they are as near already.
        """
        now, then = self.room(np.stack([before, joints]))[0]
        over = np.minimum(now, LEAST) - ROUNDING - then
        which = int(over.argmax())
        if over[which] <= 0:
            return ""
        near = quantity(then[which]) if then[which] > 0 else "0 mm"
        if which == len(SIDES):
            return f"the arms would come within {near} of each other"
        return f"links of the arm at the {SIDES[which][0]} would come within {near} of table, obstacle or arm"

    def links(
        self, joints: Float[np.ndarray, "t 2 6"]
    ) -> list[tuple[Float[np.ndarray, "t k 2 3"], Float[np.ndarray, "k"]]]:
        """Ends [m] and radii [m] of the capsules of both arms at joint positions [rad], left then right."""
        holders = enumerate(self.way.holders)
        return [
            (self._packed.placed(arm, joints[:, side])[0], self._packed.capsules[arm].radius) for side, arm in holders
        ]

    def clearance(self, joints: Float[np.ndarray, "t 2 6"]) -> Float[np.ndarray, "t"]:
        """Least clearance [m] of the links of both arms at joint positions [rad], see `room`."""
        return self.room(joints)[0].min(axis=1)
