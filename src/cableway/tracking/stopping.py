"""When a run ends."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from cableway.control.base import ControllerState
from cableway.core.checks import Checked, NotNegative
from cableway.outcome import Outcome
from cableway.records import Observation, Plan


class Ending(NamedTuple):
    """How a run ended, and what was particular to it."""

    outcome: Outcome
    detail: str = ""


@dataclass(frozen=True, kw_only=True)
class TrackConfig(Checked):
    """When a run ends.

    After the last row of the reference the run goes on until the shape error is small or has stopped falling.

    Attributes:
        settle_time: Longest time [s] after the end of the reference.
        patience: Time [s] within which the error must fall to go on.
        improvement: Share of the error by which it must fall in that time.
        small_error: Stacked shape error [m], of 2n numbers, below which the run ends at once.
        overtime: Longest time [s] beyond the plan's own duration, standing still and settling included.
    """

    settle_time: NotNegative[float] = 5.0
    patience: NotNegative[float] = 1.0
    improvement: NotNegative[float] = 0.05
    small_error: NotNegative[float] = 5e-4
    overtime: NotNegative[float] = 30.0


class StopRule:
    """Decides after each step whether the run is over.

    Args:
        config: When that is.
        plan: The plan.
        control_step: Time [s] between two calls.
        swing_period: Of the cable [s]; one that swings is waited for at least one period, and three at most.
    """

    def __init__(self, config: TrackConfig, plan: Plan, control_step: float, swing_period: float = 0.0) -> None:
        self._config, self._goal = config, plan.shapes[-1]
        self._most_steps = plan.steps + math.ceil(config.overtime / control_step)
        self._settle_steps = math.ceil(max(config.settle_time, 3 * swing_period) / control_step)
        self._patience_steps = max(1, math.ceil(max(config.patience, swing_period) / control_step))
        self._steps = 0
        self._errors: list[float] = []

    def outcome(
        self, state: ControllerState, observation: Observation, missing: str = "", unsure: bool = False
    ) -> Ending | None:
        """How the run ended, if it did; `missing` says what it has been waiting for.

        A cable of which it is not known well enough where it lies (`unsure`) has not settled.
        """
        self._steps += 1
        if state.progress >= 1.0 and not unsure:
            self._errors.append(_stacked_error(observation.keypoints, self._goal))
            if self._settled():
                return Ending(Outcome.SETTLED)
        return Ending(Outcome.TIMED_OUT, missing) if self._steps >= self._most_steps else None

    def _settled(self) -> bool:
        errors, patience = self._errors, self._patience_steps
        if errors[-1] < self._config.small_error or len(errors) > self._settle_steps:
            return True
        if len(errors) <= patience:
            return False
        return min(errors[-patience:]) > (1 - self._config.improvement) * min(errors[:-patience])


def _stacked_error(keypoints: Float[np.ndarray, "n 2"], goal: Float[np.ndarray, "n 2"]) -> float:
    """Stacked error [m], hidden keypoints taken to be as far off as the others; infinite where all are hidden."""
    squared = np.sum((keypoints - goal) ** 2, axis=1)
    visible = np.isfinite(squared)
    return math.sqrt(len(goal) * float(squared[visible].mean())) if visible.any() else math.inf
