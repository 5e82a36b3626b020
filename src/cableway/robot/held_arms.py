"""The arms that hold a cable in a run, where they are by now, and what of a motion they can follow from there."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from jaxtyping import Float

from cableway.geometry.groups import SE2
from cableway.records import Plan
from cableway.robot.branches import SINGULAR
from cableway.robot.cell_kinematics import CellKinematics
from cableway.scene.cell import Way
from cableway.scene.task import CONTROL_STEP, Task

ROOM = 0.005
"""Clearance [m] of links that corrections leave: 1 mm more than `cell_kinematics.LEAST`, of 10 mm that plans keep."""

HANDS = 0.001
"""Clearance [m] of hands from obstacles and each other that corrections leave: a hand may be that far off where it is
sent, as the judge has it of a plan."""

TURN = 2e-4
"""Way to the joints' limits of position [rad] that corrections leave, since servos overshoot: less than plans leave."""

EASED = 0.999
"""Share of a limit of acceleration that is aimed at, since joints do not follow grippers along straight lines."""

EASINGS = 3
"""Times that this is corrected for, at most."""


@dataclass(frozen=True)
class HeldArms:
    """Both arms of a cell at a control step.

    Attributes:
        kinematics: Of these arms, as they hold the cable.
        joints: (2, 6) where they were sent last [rad].
        moved: (2, 6) by how much that was in the control step before [rad].
    """

    kinematics: CellKinematics
    joints: Float[np.ndarray, "2 6"]
    moved: Float[np.ndarray, "2 6"] = field(default_factory=lambda: np.zeros((2, 6)))

    @classmethod
    def of_plan(cls, plan: Plan, task: Task, poses: Float[np.ndarray, "2 3"]) -> Self | None:
        """Those that hold the grippers at `poses` [m, m, rad] as a plan has it; None where task or plan have no arms.

        Raises:
            SimulationError: An arm cannot hold its gripper there.
        """
        way = Way.of_record(plan.metadata)
        if task.cell is None or way is None:
            return None
        kinematics = CellKinematics(task, way)
        near = np.zeros((2, 6)) if plan.joints is None else plan.joints[0]
        return cls(kinematics, kinematics.joints(poses, near, least=0.0))

    def in_task(self, task: Task) -> Self:
        """The same arms among other obstacles."""
        return replace(self, kinematics=CellKinematics(task, self.kinematics.way))

    def led(self, poses: Float[np.ndarray, "2 3"]) -> Self:
        """The same arms one control step later, when the grippers are at `poses` [m, m, rad].

        Raises:
            SimulationError: An arm cannot hold its gripper there.
        """
        joints = self.kinematics.joints(poses, self.joints, least=0.0)
        return replace(self, joints=joints, moved=joints - self.joints)

    def eased(
        self, action: Float[np.ndarray, "2 3"], before: Float[np.ndarray, "2 3"], poses: Float[np.ndarray, "2 3"]
    ) -> Float[np.ndarray, "2 3"]:
        """An action at gripper `poses`, changed no more from the one before it [m, m, rad] than joints can accelerate.

        Each gripper's change is shortened in its own direction. Where even going on as before would accelerate a joint
        by more than its limit, that is its limit here.
        """
        most = self.kinematics.acceleration_limit * CONTROL_STEP**2
        for _ in range(EASINGS):
            tried = SE2.plus(poses, np.stack([before, action]))
            reached = self.kinematics.held(tried, self.joints)[0]
            going_on, asked = (reached - self.joints - self.moved) / most
            limit, change = np.maximum(np.abs(going_on), EASED), asked - going_on
            if (np.abs(asked) <= np.maximum(limit, 1.0)).all():
                break
            left = np.where(change > 0, limit - going_on, limit + going_on)
            share = np.where(np.abs(change) > left, left / np.maximum(np.abs(change), 1e-300), 1.0).min(axis=1)
            action = before + share[:, None] * (action - before)
        return action

    def room(self, poses: Float[np.ndarray, "k 2 3"]) -> Float[np.ndarray, "k c"]:
        """What is left to the arms at gripper poses [m, m, rad] that are reached in one control step.

        Each column is of one limit, and below zero beyond it: clearance of links over `ROOM`, distance from
        singularities over that of plans, way to the joints' limits of position and of speed. All are minus infinity
        where an arm cannot get there. For acceleration see `eased`.
        """
        joints, away = self.kinematics.held(poses, self.joints)
        clearance, turn = self.kinematics.room(joints)
        speed = CONTROL_STEP * self.kinematics.speed_limit - np.abs(joints - self.joints)
        room = np.column_stack(
            [clearance - ROOM, away - SINGULAR, (turn - TURN).reshape(len(poses), -1), speed.reshape(len(poses), -1)]
        )
        return np.where((away > 0).all(axis=1, keepdims=True), room, -np.inf)
