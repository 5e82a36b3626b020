"""What the states of controllers share that follow a plan and estimate the rod's parameters on the way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol, Self

import numpy as np
from jaxtyping import Float

from cableway.control.base import Contact
from cableway.control.following import FollowerState
from cableway.estimation.delay import DELAYS
from cableway.estimation.rod_filter import EstimatorConfig, RodEstimate, RodEstimator
from cableway.records import Estimate, Observation, Plan
from cableway.rod.inverse import fit_keypoints
from cableway.rod.material import ROD
from cableway.scene.cable import QUASI_STATIC, EstimatedCable
from cableway.scene.task import CONTROL_STEP, Task

SETTLED = 10
"""Frames from which on an estimate is good enough to plan with."""


class EstimatingConfig(Protocol):
    """What the settings of a controller that estimates the cable have."""

    @property
    def hold(self) -> float:
        """Time [s] at the plan's first row."""
        ...

    @property
    def estimator(self) -> EstimatorConfig:
        """Settings of the estimation."""
        ...


@dataclass(frozen=True, kw_only=True)
class EstimatingState(FollowerState):
    """State of a follower that estimates the cable.

    Attributes:
        estimator: Of the rod's parameters.
        estimate: The present one.
    """

    estimator: RodEstimator
    estimate: RodEstimate

    @staticmethod
    def estimating(
        task: Task,
        plan: Plan,
        config: EstimatingConfig,
        shape: Float[np.ndarray, "d"] | None = None,
        known: Mapping[str, Estimate] | None = None,
    ) -> dict[str, Any]:
        """The fields of all of these before the first step, as `FollowerState.beginning` those of followers.

        Args:
            task: The task.
            plan: To follow.
            config: With the settings of the estimation and the hold [s].
            shape: Of the task's rod in the plan's first row, if it is known.
            known: What was estimated of the cable before, by name.

        Raises:
            InputError: Task and plan differ in their number of keypoints.
        """
        beginning, rod = FollowerState.beginning(task, plan, config.hold), task.cable.rod
        trust = min(1.0, (task.cable.frequency / QUASI_STATIC) ** 4)
        estimator = RodEstimator(rod, config.estimator, CONTROL_STEP, trust)
        if shape is None:
            shape = rod.continued(fit_keypoints(rod, plan.shapes[0])[0], plan.poses[0])
        return {**beginning, "estimator": estimator, "estimate": estimator.start(shape, known)}

    def knowing(self, earlier: EstimatingState) -> Self:
        """The state before the first step of another plan, with what was estimated until then."""
        estimator, estimate, cable = earlier.estimator, earlier.estimate, earlier.estimated_cable()
        # a nominal rod under the forces of another one may end turned by more than half a turn from it
        rod = estimator.rod if cable is None else cable.rod
        q = rod.continued(estimate.q, self.plan.plan.poses[0])
        estimate = replace(estimate, q=q, surprise=estimate.surprise.forgotten())
        return replace(self, estimator=estimator, estimate=estimate)

    def contact(self, share: float = 1.0) -> Contact | None:
        """See `ControllerState.contact`; none while the estimates settle."""
        held = self.estimator.held_at(self.estimate, share)
        visible = np.flatnonzero(np.isfinite(self.tracker.keypoints[:, 0]))
        if held is None or self.index < self.plan.held_steps or not len(visible):
            return None
        nearest = visible[np.argmin(np.abs(visible - held[0]))]
        return Contact(self.tracker.keypoints[nearest], *held[1:])

    def estimates(self) -> Mapping[str, Estimate]:
        """See `ControllerState.estimates`."""
        return self.estimator.estimates(self.estimate)

    def estimated_cable(self) -> EstimatedCable | None:
        """See `ControllerState.estimated_cable`."""
        estimate = self.estimate
        if estimate.updates < SETTLED or not self.estimator.adapts:
            return None
        length, *modes = estimate.theta[ROD].tolist()
        return self.task.cable.estimated(length, tuple(modes))

    def observing(self, observation: Observation | None) -> Self:
        """After an observation, the grippers tracked with the estimated grasps; the estimator needs few keypoints."""
        return self.looking(observation, self.estimate.grasps, hidden=True)

    def updated(self) -> Self:
        """With the estimate brought up to what the tracker has."""
        tracker = self.tracker
        if tracker.undated:
            earlier = tracker.poses.at(DELAYS)
            tracker = tracker.dated(
                self.estimator.residuals(self.estimate, tracker.keypoints, tracker.at_frame, earlier)
            )
        estimate = self.estimator.update(
            self.estimate, tracker.keypoints, tracker.at_frame, tracker.speed, tracker.confidence, tracker.rod
        )
        return replace(self, tracker=tracker, estimate=estimate)
