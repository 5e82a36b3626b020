"""The closed loop: a plant, a controller and a plan, until the cable lies at its goal."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float
from threadpoolctl import threadpool_limits

from cableway.control.base import Controller, ControllerState
from cableway.errors import InputError, PlanningError, SimulationError, TaskError
from cableway.provenance import describe
from cableway.records import Measurement, Observation, Plan, Rollout
from cableway.scene.task import Task

Progress = Callable[[str, float], None]
"""Called with the name of a stage and the share of it that is done, from 0 to 1."""

LOST = "off the plan: stopped"
"""Status of a step in which the grippers stand still because the cable has left its plan."""

LEFT = "the cable left its plan"
"""How the outcome of a run begins that was not brought back."""


class Plant(Protocol):
    """What a cable held by two grippers must offer: a simulator, a robot, a recording."""

    @property
    def task(self) -> Task:
        """What planner and controller believe; the plant itself may differ."""
        ...

    @property
    def control_step(self) -> float:
        """Time [s] that one step takes."""
        ...

    def reset(self) -> Observation:
        """Go to the start and look.

        Raises:
            SimulationError: The start cannot be taken.
        """
        ...

    def step(self, action: Float[np.ndarray, "2 3"]) -> Observation:
        """Move the grippers by an action (dx, dy, dtheta) [m, m, rad], left then right, and look.

        Raises:
            SimulationError: The plant cannot go on.
        """
        ...

    def measure(self) -> Measurement:
        """The state after the last step as well as it can be known; never shown to a controller."""
        ...


@dataclass(frozen=True, kw_only=True)
class TrackConfig:
    """When a run ends.

    After the last row of the reference the run goes on until the shape error is small or has stopped falling.

    Attributes:
        settle_time: Longest time [s] after the end of the reference.
        patience: Time [s] within which the error must fall to go on.
        improvement: Share of the error by which it must fall in that time.
        small_error: Stacked shape error [m], of 2n numbers, below which the run ends at once.
        overtime: Longest time [s] beyond the plan's own duration, standing still and settling included.
    """

    settle_time: float = 5.0
    patience: float = 1.0
    improvement: float = 0.05
    small_error: float = 5e-4
    overtime: float = 30.0

    def __post_init__(self) -> None:
        for entry in fields(self):
            if not 0 <= getattr(self, entry.name) < math.inf:
                raise InputError(f"{entry.name} must be finite and not negative, got {getattr(self, entry.name)!r}")


class _Log:
    """What was seen and done so far."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self.observed: list[np.ndarray] = []
        self.measured: list[Measurement] = []
        self.reference: list[np.ndarray] = []
        self.actions: list[np.ndarray] = []
        self.solve_time: list[float] = []
        self.status: list[str] = []

    def see(self, time: float, observation: Observation, measurement: Measurement, reference: np.ndarray) -> None:
        _require_finite(measurement)
        self.times.append(time)
        self.observed.append(observation.keypoints)
        self.measured.append(measurement)
        self.reference.append(reference)

    def act(self, action: np.ndarray, solve_time: float, status: str) -> None:
        self.actions.append(action)
        self.solve_time.append(solve_time)
        self.status.append(status)

    def end_early(self, error: SimulationError) -> str:
        """Leave out the step that failed and say so in the status of the one before."""
        self.status.pop()
        if self.status:
            self.status[-1] += "; then the plant failed"
        return f"plant failed: {error}"

    def rollout(self, metadata: dict[str, Any]) -> Rollout:
        steps = len(self.times) - 1
        truth = {
            name: np.array([getattr(row, name) for row in self.measured])
            for name in ("keypoints", "poses", "centreline", "clearance", "gripper_clearance")
        }
        return Rollout(
            times=np.array(self.times),
            observed=np.array(self.observed),
            reference=np.array(self.reference),
            actions=np.array(self.actions[:steps]).reshape(steps, 2, 3),
            solve_time=np.array(self.solve_time[:steps]),
            status=np.array(self.status, dtype=np.str_),
            metadata=metadata,
            **truth,
        )


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


# Threads of the linear algebra library cost more than they save on matrices of this size, most on a busy machine.
@threadpool_limits.wrap(limits=1, user_api="blas")
def track(
    plant: Plant,
    controller: Controller[Any],
    plan: Plan,
    *,
    config: TrackConfig | None = None,
    recovery: Recovery | None = None,
    progress: Progress | None = None,
    seed: int = 0,
) -> Rollout:
    """Lead the plant along the plan until the cable has settled.

    Args:
        plant: What is led.
        controller: What leads.
        plan: Shapes and gripper poses to follow.
        config: When to end, the defaults where None.
        recovery: What to do when the cable leaves the plan; nothing where None.
        progress: Told how far along the plan the run is.
        seed: For the record.

    Returns:
        All that happened. `metadata["outcome"]` says how it ended, which is "settled", "time ran out",
        "the cable left its plan: ..." with why it was not brought back, or, where the plant gave up, "plant failed:
        ..." with its reason, which the last status says too; the rollout then ends with the last state before that.
        `metadata["recovered"]` has the times [s] from which a new plan was followed.

    Raises:
        InputError: Plan and plant differ in their number of keypoints, or controller and plant in their control step.
        SimulationError: The plant could not even take its start.
    """
    config = config or TrackConfig()
    if not math.isclose(controller.control_step, plant.control_step, rel_tol=1e-6):
        raise InputError(
            f"the controller makes a step every {controller.control_step:.4g} s, "
            f"the plant takes steps of {plant.control_step:.4g} s"
        )
    loop = _Loop(plant, controller, plan, config)
    watch = _Watch(recovery, plant.control_step) if recovery is not None else None
    outcome = None
    while outcome is None:
        outcome = loop.step()
        if outcome is None and watch is not None and watch.is_lost(loop.observation, loop.state.reference):
            outcome = watch.recover(loop)
        if progress is not None:
            progress("track", 1.0 if outcome else min(loop.state.progress, 0.99))
    recovered = watch.recovered if watch is not None else []
    return loop.log.rollout(_metadata(controller, config, outcome, seed) | {"recovered": recovered})


class _Loop:
    """A run: plant and controller, what was seen last, and the record."""

    def __init__(self, plant: Plant, controller: Controller[Any], plan: Plan, config: TrackConfig) -> None:
        self.plant, self._controller, self._config, self.log = plant, controller, config, _Log()
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
        self._rule = _StopRule(self._config, plan, self.plant.control_step)

    def step(self) -> str | None:
        """One control step; how the run ended, if it did."""
        before = time.perf_counter()
        action, self.state = self._controller.step(self.state, self.observation)
        self.log.act(action, time.perf_counter() - before, str(self.state.status))
        return self._move(action) or self._rule.outcome(self.state, self.observation)

    def stand(self) -> str | None:
        """One control step without motion."""
        self.log.act(np.zeros((2, 3)), 0.0, LOST)
        return self._move(np.zeros((2, 3)))

    def _move(self, action: np.ndarray) -> str | None:
        try:
            self.observation = self.plant.step(action)
            now = len(self.log.times) * self.plant.control_step
            self.log.see(now, self.observation, self.plant.measure(), self.state.reference)
        except SimulationError as error:
            return self.log.end_early(error)
        return None


class _Watch:
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

    def recover(self, loop: _Loop) -> str | None:
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


class _StopRule:
    """Decides after each step whether the run is over."""

    def __init__(self, config: TrackConfig, plan: Plan, control_step: float) -> None:
        self._config, self._goal = config, plan.shapes[-1]
        self._most_steps = plan.steps + math.ceil(config.overtime / control_step)
        self._settle_steps = math.ceil(config.settle_time / control_step)
        self._patience_steps = max(1, math.ceil(config.patience / control_step))
        self._steps = 0
        self._errors: list[float] = []

    def outcome(self, state: ControllerState, observation: Observation) -> str | None:
        self._steps += 1
        if state.progress >= 1.0:
            error = float(np.linalg.norm(observation.keypoints - self._goal))
            self._errors.append(error if math.isfinite(error) else math.inf)
            if self._settled():
                return "settled"
        return "time ran out" if self._steps >= self._most_steps else None

    def _settled(self) -> bool:
        errors, patience = self._errors, self._patience_steps
        if errors[-1] < self._config.small_error or len(errors) > self._settle_steps:
            return True
        if len(errors) <= patience:
            return False
        return min(errors[-patience:]) > (1 - self._config.improvement) * min(errors[:-patience])


def _require_finite(measurement: Measurement) -> None:
    for name in ("keypoints", "poses", "centreline"):
        if not np.isfinite(getattr(measurement, name)).all():
            raise SimulationError(f"the plant reported {name} that are not finite")


def _metadata(controller: Controller[Any], config: TrackConfig, outcome: str, seed: int) -> dict[str, Any]:
    return {
        "seed": seed,
        "outcome": outcome,
        "controller": {"name": type(controller).__name__, "config": describe(controller.config)},
        "track": describe(config),
    }
