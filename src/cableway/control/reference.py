"""What a plan asks for at each control step: shapes to follow and the gripper motion that goes with them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cableway.core.checks import Checked, NotNegative
from cableway.core.errors import InputError
from cableway.geometry.groups import SE2
from cableway.motion.interpolation import rows_at
from cableway.records import Plan
from cableway.scene.task import CONTROL_STEP, Task


@dataclass(frozen=True)
class PlanReference(Checked):
    """A plan by time: its first row while the start settles, then one row a control step, then its last row.

    Attributes:
        plan: The plan.
        hold: Time [s] at the first row.
    """

    plan: Plan
    hold: NotNegative[float] = 0.0

    @property
    def held_steps(self) -> int:
        """Control steps spent at the first row."""
        return round(self.hold / CONTROL_STEP)

    def progress(self, step: float) -> float:
        """Share of the plan's rows that are over at a control step, from 0 to 1: 0 while the first one is held."""
        if not self.plan.steps:
            return float(step >= self.held_steps)
        return float(self.rows(step, 1)[0]) / self.plan.steps

    def rows(self, step: float, count: int, rate: float = 1.0) -> Float[np.ndarray, "k"]:
        """The plan's row numbers at `count` control steps from `step` on, at a share of the plan's pace."""
        return np.clip(step + rate * np.arange(count) - self.held_steps, 0.0, self.plan.steps)

    def shape(self, step: float) -> Float[np.ndarray, "n 2"]:
        """Keypoints [m] wanted at a control step."""
        return rows_at(self.plan.shapes, self.rows(step, 1))[0]

    def shapes(self, step: float, horizon: int) -> Float[np.ndarray, "H n 2"]:
        """Keypoints [m] wanted after each of the next `horizon` actions."""
        return rows_at(self.plan.shapes, self.rows(step + 1, horizon))

    def poses(self, step: float, horizon: int) -> Float[np.ndarray, "H 2 3"]:
        """The plan's gripper poses [m, m, rad] after each of the next `horizon` actions."""
        return rows_at(self.plan.poses, self.rows(step + 1, horizon))

    def actions(self, step: float, horizon: int) -> Float[np.ndarray, "H 2 3"]:
        """The plan's next `horizon` gripper motions [m, m, rad]."""
        poses = rows_at(self.plan.poses, self.rows(step, horizon + 1))
        return SE2.minus(poses[1:], poses[:-1])


def reference_for(task: Task, plan: Plan, hold: float) -> PlanReference:
    """The reference of a plan for a task.

    Raises:
        InputError: They differ in their number of keypoints.
    """
    planned, wanted = plan.shapes.shape[1], task.cable.keypoints
    if planned != wanted:
        raise InputError(f"the plan has {planned} keypoints, but task {task.name!r} has {wanted}")
    return PlanReference(plan, hold)
