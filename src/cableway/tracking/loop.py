"""A run under way: plant and controller, what was seen last, and the record."""

from __future__ import annotations

from typing import Any

import numpy as np

from cableway.control.base import Controller, ControllerState
from cableway.core.errors import SimulationError
from cableway.records import Plan
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.tracking.log import Log
from cableway.tracking.plant import Plant
from cableway.tracking.stopping import Ending, StopRule, TrackConfig
from cableway.tracking.watchdog import Guard, Watchdog

LOST = "off the plan: stopped"
"""Status of a step in which the grippers stand still because the cable has left its plan."""

BLOCKED = "the way is blocked: stopped"
"""The same because something stands where the plan leads."""


class Loop:
    """A run: plant and controller, what was seen last, and the record."""

    def __init__(
        self, plant: Plant, controller: Controller[Any], plan: Plan, config: TrackConfig, watchdog: Watchdog
    ) -> None:
        self.plant, self._controller, self._config, self.log = plant, controller, config, Log()
        self.guard = Guard(watchdog, controller, plant.task, plant.control_step)
        self._scene: Scene | None = None
        self.follow(plant.task, plan)
        self.observation = plant.reset()
        self.log.see(0.0, self.observation, plant.measure(), self.state.reference)

    @property
    def time(self) -> float:
        """[s] since the start."""
        return self.log.times[-1]

    def follow(self, task: Task, plan: Plan) -> None:
        """Begin with a plan."""
        self.plan = plan
        self.state: ControllerState = self._controller.init(task, plan)
        self._rule = StopRule(self._config, plan, self.plant.control_step)

    def looked_round(self) -> bool:
        """Whether the scene of the plant's task is another one than last time; controller and watchdog are told."""
        task = self.plant.task
        if task.scene is self._scene or task.scene == self._scene:
            return False
        self._scene, self.guard.task = task.scene, task
        self.state = self._controller.in_scene(self.state, task)
        return True

    def step(self) -> Ending | None:
        """One control step; how the run ended, if it did."""
        before = self.log.actions[-1] if self.log.actions else np.zeros((2, 3))
        answer = self.guard.step(self.state, self.observation, before)
        self.state = answer.state
        self.log.act(answer.action, answer.seconds, answer.status, self.state.estimates())
        return self._move(answer.action) or self._rule.outcome(self.state, self.observation) or self.guard.outcome

    def stand(self, status: str = LOST) -> Ending | None:
        """One control step without motion."""
        self.log.act(np.zeros((2, 3)), 0.0, status, self.state.estimates())
        return self._move(np.zeros((2, 3)))

    def _move(self, action: np.ndarray) -> Ending | None:
        try:
            self.observation = self.plant.step(action)
            now = len(self.log.times) * self.plant.control_step
            self.log.see(now, self.observation, self.plant.measure(), self.state.reference)
        except SimulationError as error:
            return self.log.end_early(error)
        return None
