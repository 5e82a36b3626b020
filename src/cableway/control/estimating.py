"""What the states of controllers share that follow a plan and estimate the rod's parameters on the way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

from cableway.control.following import FollowerState
from cableway.estimation.delay import DELAYS
from cableway.estimation.rod_filter import RodEstimate, RodEstimator
from cableway.records import Estimate, Observation
from cableway.rod.material import ROD
from cableway.scene.cable import EstimatedCable

SETTLED = 10
"""Frames from which on an estimate is good enough to plan with."""


@dataclass(frozen=True, kw_only=True)
class EstimatingState(FollowerState):
    """State of a follower that estimates the cable.

    Attributes:
        estimator: Of the rod's parameters.
        estimate: The present one.
    """

    estimator: RodEstimator
    estimate: RodEstimate

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
            self.estimate, tracker.keypoints, tracker.at_frame, tracker.speed, tracker.confidence
        )
        return replace(self, tracker=tracker, estimate=estimate)
