"""What the states of all controllers share that follow a plan by time and look at grippers and cable."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from jaxtyping import Float

from cableway.control.base import ControllerState, Status
from cableway.control.limits import within_limits
from cableway.control.reference import PlanReference, reference_for
from cableway.estimation.gating import poses_usable
from cableway.estimation.gripper_tracker import NOMINAL_GRASPS, GripperTracker
from cableway.records import Observation, Plan
from cableway.scene.task import Task

BLIND_STEPS = 3
"""Control steps in a row that go on without gripper poses before the grippers stop."""

UNSEEN_STEPS = 10
"""The same without any keypoint."""

LEAST_RATE = 0.25
"""Share of the plan's pace at which the reference goes on at least, however little of the motion is made: one that
waits for what cannot be reached waits forever."""


@dataclass(frozen=True, kw_only=True)
class FollowerState(ControllerState):
    """State of a controller that follows a plan.

    Attributes:
        task: The task.
        plan: The plan by time.
        index: Control steps of the reference that are over.
        tracker: Of gripper poses and delays.
        rate: Share of the plan's pace at which the reference goes on.
    """

    task: Task
    plan: PlanReference
    index: float
    tracker: GripperTracker
    rate: float = 1.0

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
            "tracker": GripperTracker.at_rest(plan.poses[0], task.cable.keypoints),
        }

    def looking(
        self,
        observation: Observation | None,
        grasps: Float[np.ndarray, "2 3"] = NOMINAL_GRASPS,
        hidden: bool = False,
    ) -> Self:
        """After an observation; `grasps` and `hidden` as for `GripperTracker.updated`."""
        if observation is None or not poses_usable(observation):
            return replace(self, tracker=self.tracker.predicted())
        return replace(self, tracker=self.tracker.updated(observation, grasps, self.task.cable, hidden))

    @property
    def must_stop(self) -> bool:
        """Whether poses are missing for more than `BLIND_STEPS` or keypoints for more than `UNSEEN_STEPS`."""
        tracker = self.tracker
        return tracker.steps_without_poses > BLIND_STEPS or tracker.steps_without_keypoints > UNSEEN_STEPS

    @property
    def tracking_status(self) -> Status:
        """Of an action computed now: with keypoints, or without."""
        return Status.UNSEEN if self.tracker.steps_without_keypoints else Status.TRACKING

    def sending(
        self, action: Float[np.ndarray, "2 3"], status: Status, max_span: float, waits: bool = False
    ) -> tuple[Float[np.ndarray, "2 3"], Self]:
        """The action within the limits, and the state after it.

        Args:
            action: (2, 3) gripper motion [m, m, rad].
            status: How it came about.
            max_span: Largest distance [m] between the grippers.
            waits: Whether the reference waits, as it does in any case where the grippers are stopped.
        """
        action = within_limits(action, self.tracker.commanded, self.task.grippers, max_span)
        return action, self._sent(action, status, waits or status in (Status.STOPPED, Status.UNEXPLAINED))

    def stopping(self, status: Status = Status.STOPPED) -> tuple[Float[np.ndarray, "2 3"], Self]:
        """Grippers that stand still, and the state after that."""
        return self.sending(np.zeros(self.task.cable.rod.step_shape), status, math.inf)

    def overruled(self, action: Float[np.ndarray, "2 3"], status: str, waits: bool | None = None) -> Self:
        """See `ControllerState.overruled`."""
        waiting = not action.any() if waits is None else waits
        return replace(self, tracker=self.tracker.predicted())._sent(action, status, waiting)

    def cut(self, action: Float[np.ndarray, "2 3"], made: float) -> Self:
        """See `ControllerState.cut`: the reference goes on as far as the grippers do."""
        tracker = replace(self.tracker, commands=self.tracker.commands.corrected(action))
        return replace(self._at(self.index - (1 - max(made, LEAST_RATE)) * self.rate), tracker=tracker)

    def _at(self, index: float) -> Self:
        return replace(self, reference=self.plan.shape(index), progress=self.plan.progress(index), index=index)

    def _sent(self, action: Float[np.ndarray, "2 3"], status: str, waiting: bool) -> Self:
        index = self.index + (0 if waiting else self.rate)
        return replace(self._at(index), status=status, tracker=self.tracker.commanding(action))
