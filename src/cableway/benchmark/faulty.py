"""Controllers that fail on purpose, to judge what the loop makes of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.control.base import Controller, ControllerState
from cableway.records import Observation, Plan
from cableway.scene.task import Task

SHARE = 0.25
"""Of the steps that fail."""


def _raise(action: Float[np.ndarray, "2 3"], rng: np.random.Generator) -> Any:
    raise ArithmeticError("failed on purpose")


def _nonsense(action: Float[np.ndarray, "2 3"], rng: np.random.Generator) -> Any:
    """Not finite, of another shape, or beyond all limits."""
    return [np.full_like(action, np.nan), action.ravel(), 1e6 * np.ones_like(action), None][int(rng.integers(4))]


FAULTS: dict[str, Callable[[Float[np.ndarray, "2 3"], np.random.Generator], Any]] = {
    "fault-raises": _raise,
    "fault-nonsense": _nonsense,
}
"""What becomes of an action, by the name of the perturbation."""


class FaultyController(Controller[ControllerState]):
    """A controller, some of whose answers are spoilt; for one run.

    Args:
        controller: The controller.
        fault: One of `FAULTS`.
        seed: Of which steps fail.
    """

    def __init__(self, controller: Controller[Any], fault: str, seed: int) -> None:
        self._controller, self._fault = controller, FAULTS[fault]
        self.config, self.control_step = controller.config, controller.control_step
        self._rng = np.random.default_rng(seed)

    def init(self, task: Task, plan: Plan) -> ControllerState:
        """See `Controller.init`."""
        return self._controller.init(task, plan)

    def resume(self, state: ControllerState, task: Task, plan: Plan) -> ControllerState:
        """See `Controller.resume`."""
        return self._controller.resume(state, task, plan)

    def in_scene(self, state: ControllerState, task: Task) -> ControllerState:
        """See `Controller.in_scene`."""
        return self._controller.in_scene(state, task)

    def step(
        self, state: ControllerState, observation: Observation | None
    ) -> tuple[Float[np.ndarray, "2 3"], ControllerState]:
        """See `Controller.step`."""
        action, after = self._controller.step(state, observation)
        return (self._fault(action, self._rng) if self._rng.random() < SHARE else action), after
