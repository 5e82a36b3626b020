"""What is done about a cable that has left its plan for good."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cableway.errors import InputError, PlanningError, TaskError
from cableway.records import Observation, Plan
from cableway.scene.task import Task
from cableway.tracking.loop import Loop

LEFT = "the cable left its plan"
"""How the outcome of a run begins that was not brought back."""


@dataclass(frozen=True, kw_only=True)
class Recovery:
    """What happens when the cable leaves its plan for good: it snapped to another shape, slipped, or is blocked.

    The grippers stop and stand still; a new plan is made from where the cable is, and the run goes on with it.

    Attributes:
        replan: Plans a task that starts where the cable is; told the plan that was left. Raises `PlanningError` where
            there is no way.
        times: Recoveries in one run, after which it ends.
        deviation: Mean distance [m] of the keypoints from their reference from which the cable is not on its plan.
        patience: Time [s] for which that must be so.
        rest: Time [s] that the grippers stand still.

    Raises:
        InputError: A value is out of range.
    """

    replan: Callable[[Task, Plan], Plan]
    times: int = 2
    deviation: float = 0.05
    patience: float = 0.3
    rest: float = 1.0

    def __post_init__(self) -> None:
        for name in ("times", "deviation", "patience", "rest"):
            if not 0 <= getattr(self, name) < math.inf:
                raise InputError(f"{name} must be finite and not negative, got {getattr(self, name)!r}")


class Watch:
    """Sees that the cable has left its plan, and brings it back."""

    def __init__(self, recovery: Recovery, control_step: float) -> None:
        self._recovery = recovery
        self._patience = max(1, math.ceil(recovery.patience / control_step))
        self._rest = max(1, math.ceil(recovery.rest / control_step))
        self._off = 0
        self.recovered: list[float] = []

    def is_lost(self, observation: Observation, reference: Float[np.ndarray, "n 2"]) -> bool:
        """Whether the keypoints have been far from their reference for long enough; hidden ones tell nothing."""
        distance = np.linalg.norm(observation.keypoints - reference, axis=1)
        seen = distance[np.isfinite(distance)]
        if len(seen):
            self._off = self._off + 1 if seen.mean() > self._recovery.deviation else 0
        return self._off >= self._patience

    def recover(self, loop: Loop) -> str | None:
        """Stand still, plan anew from where the cable is and follow that; how the run ended, if it did."""
        if len(self.recovered) >= self._recovery.times:
            return f"{LEFT}: already brought back {len(self.recovered)} times"
        keypoints = np.full_like(loop.observation.keypoints, np.nan)
        for _ in range(self._rest):
            outcome = loop.stand()
            if outcome is not None:
                return outcome
            seen = loop.observation.keypoints
            keypoints = np.where(np.isfinite(seen), seen, keypoints)
        try:
            task = loop.plant.task.resumed_from(keypoints)
            loop.follow(task, self._recovery.replan(task, loop.plan))
        except (TaskError, PlanningError) as error:
            return f"{LEFT}: {error}"
        self._off = 0
        self.recovered.append(loop.time)
        return None
