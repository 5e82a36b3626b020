"""What the states of all controllers share that follow a plan by time and look at grippers and cable."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from jaxtyping import Float

from cableway.control.base import ControllerState, Status
from cableway.control.limits import within_limits
from cableway.control.reference import PlanReference, reference_for
from cableway.estimation.gating import poses_usable
from cableway.estimation.gripper_tracker import HELD_AS_BELIEVED, Sight
from cableway.records import Observation, Plan
from cableway.scene.task import Task


@dataclass(frozen=True, kw_only=True)
class FollowerState(ControllerState):
    """State of a controller that follows a plan.

    Attributes:
        task: The task.
        plan: The plan by time.
        index: Control steps of the reference that are over.
        sight: What is known of grippers and delays.
    """

    task: Task
    plan: PlanReference
    index: int
    sight: Sight

    @staticmethod
    def beginning(task: Task, plan: Plan, hold: float) -> dict[str, Any]:
        """The fields of all followers before the first step.

        Raises:
            InputError: Task and plan differ in their number of keypoints.
        """
        reference = reference_for(task, plan, hold)
        return {
            "status": Status.STARTED,
            "reference": reference.shape(0),
            "progress": 0.0,
            "task": task,
            "plan": reference,
            "index": 0,
            "sight": Sight.before(plan.poses[0], task.cable.keypoints),
        }

    def looking(self, observation: Observation | None, grasps: Float[np.ndarray, "2 3"] = HELD_AS_BELIEVED) -> Self:
        """With what an observation shows; `grasps` says where the cable is believed to be held, see `rod.adapted`."""
        if observation is None or not poses_usable(observation):
            return replace(self, sight=self.sight.blindly())
        return replace(self, sight=self.sight.after(observation, grasps, self.task.cable))

    def sending(
        self, action: Float[np.ndarray, "2 3"], status: Status, longest: float
    ) -> tuple[Float[np.ndarray, "2 3"], Self]:
        """The action within the limits, and the state after it; where the grippers are stopped the reference waits.

        Args:
            action: (2, 3) gripper motion [m, m, rad].
            status: How it came about.
            longest: Largest distance [m] between the grippers.
        """
        action = within_limits(action, self.sight.commanded, self.task.grippers, longest)
        return action, self._sent(action, status, waiting=status == Status.STOPPED)

    def overruled(self, action: Float[np.ndarray, "2 3"], status: str) -> Self:
        """See `ControllerState.overruled`; nothing was seen, and where the grippers stood still the reference waits."""
        return replace(self, sight=self.sight.blindly())._sent(action, status, waiting=not action.any())

    def _sent(self, action: Float[np.ndarray, "2 3"], status: str, waiting: bool) -> Self:
        index = self.index + (not waiting)
        return replace(
            self,
            status=status,
            reference=self.plan.shape(index),
            progress=self.plan.progress(index),
            index=index,
            sight=self.sight.sending(action),
        )
