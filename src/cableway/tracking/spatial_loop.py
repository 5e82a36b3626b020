"""The closed loop in space: a controller leads a plant along a plan until the cable has come to rest.

Where an obstacle turns out to stand in the way of the rest of the plan, the grippers stand still, a new plan is made
from the shape that the cable was to have there, and the run goes on with it; without one, it ends.

Note:
    Simulation only: there is no watchdog here, and no recovery of a cable that has left its plan, as there are in
    `tracking.closed_loop`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float
from threadpoolctl import threadpool_limits

from cableway.control.spatial_following import SpatialFollower
from cableway.core.errors import Cancelled, PlanningError, PlanningInterrupted, SimulationError, TaskError
from cableway.core.provenance import versions
from cableway.core.time_limit import checkpoint
from cableway.estimation.gating import is_blind
from cableway.geometry.spatial_convex import chain_distance
from cableway.motion.spatial import SpatialProblem
from cableway.outcome import Outcome
from cableway.records import Measurement, Observation, Plan, Rollout
from cableway.scene.spatial.task import SpatialTask
from cableway.tracking.logbook import Log, OnRow
from cableway.tracking.loop import BLIND, BLOCKED
from cableway.tracking.robot import SILENT_CAMERA, UNSEEN
from cableway.tracking.stopping import Ending

SETTLING = (1.0, 5.0)
"""Time [s] after the plan's last row, at the least and at the most, that the cable is given to come to rest."""

REST = 0.002
"""Speed [m/s] of a keypoint that counts as rest."""


PAUSE = 1.0
"""Time [s] that the grippers stand still before a new plan is followed."""

ROOM = 0.002
"""Clearance [m] of the rest of a plan from which nothing stands in its way; controllers make more themselves."""

Replan = Callable[[SpatialTask], Plan]
"""Plans a task that starts where the cable is. Raises `PlanningError` where there is no way."""


class SpatialPlantLike(Protocol):
    """A cable between two grippers in space, as the loop sees it; see `tracking.plant.Plant`."""

    control_step: float

    @property
    def task(self) -> SpatialTask:
        """The task with the obstacles as they are known by now; the loop reads it at every step."""
        ...

    def reset(self) -> Observation:
        """What is seen at the start."""
        ...

    def step(self, action: Float[np.ndarray, "2 6"]) -> Observation:
        """What is seen after a motion [m, rad] of the grippers; a `SimulationError` ends the run."""
        ...

    def measure(self) -> Measurement:
        """The truth, hidden from the controller."""
        ...


# Threads of the linear algebra library wait for each other in small matrices.
@threadpool_limits.wrap(limits=1, user_api="blas")
def track_in_space(
    task: SpatialTask,
    plant: SpatialPlantLike,
    controller: SpatialFollower[Any],
    plan: Plan,
    replan: Replan,
    on_row: OnRow | None = None,
) -> Rollout:
    """Lead a cable along a plan in space.

    Args:
        task: The task that was planned for.
        plant: The cable.
        controller: The controller.
        plan: The plan.
        replan: Makes a new plan.
        on_row: Told of each row as it comes; the run ends where it raises `Cancelled`.

    Returns:
        What happened; a plant that fails ends it, which its outcome says.
    """
    run = _Run(task, plant, controller, plan, replan, on_row)
    try:
        ending = run.followed()
    except Cancelled as stop:
        ending = Ending(Outcome.INTERRUPTED, str(stop))
    outcome, detail = ending
    metadata = {"outcome": str(outcome), "detail": detail, "versions": versions(), "recovered": run.recovered}
    return run.log.rollout(metadata)


class _Run:
    """A run under way; `recovered` has the times [s] from which a new plan was followed."""

    def __init__(
        self, task: SpatialTask, plant: SpatialPlantLike, controller: SpatialFollower[Any], plan: Plan, replan: Replan,
        on_row: OnRow | None,
    ) -> None:  # fmt: skip
        self._plant, self._controller, self._replan = plant, controller, replan
        self._scene, self._state, self.log = task.scene, controller.init(task, plan), Log(on_row)
        self._seen, self._known = plant.reset(), 0.0
        self.recovered: list[float] = []

    def followed(self) -> Ending:
        """Follow the plan to its end, and those that take its place; how the run ended."""
        plant, controller, log, arrived = self._plant, self._controller, self.log, 0
        log.see(self._seen.time, self._seen, plant.measure(), self._reference)
        while not _over(log.measured, arrived * plant.control_step, plant.control_step):
            checkpoint()
            if (ending := self._look_round()) is not None:
                return ending
            if is_blind(self._seen):
                if (ending := self._stay()) is not None:
                    return ending
                continue
            begun = time.perf_counter()
            action, self._state = controller.step(self._state, self._seen)
            seconds = time.perf_counter() - begun
            if (ending := self._acted(action, seconds, str(self._state.status))) is not None:
                return ending
            arrived = arrived + 1 if controller.row(self._state) == self._state.plan.steps else 0
        return Ending(Outcome.SETTLED)

    @property
    def _reference(self) -> Float[np.ndarray, "n 3"]:
        return self._state.plan.shapes[self._controller.row(self._state)]

    def _acted(self, action: Float[np.ndarray, "2 6"], seconds: float, status: str) -> Ending | None:
        """One control step; how the run ended, if it did."""
        self.log.act(action, seconds, status, self._state.estimates())
        try:
            self._seen = self._plant.step(action)
        except SimulationError as error:
            return self.log.end_early(error)
        if not is_blind(self._seen):
            self._known = self._seen.time
        self.log.see(self._seen.time, self._seen, self._plant.measure(), self._reference)
        return None

    def _stay(self) -> Ending | None:
        """One control step without motion, as it is not known where the cable is; not for ever."""
        if (ending := self._acted(np.zeros((2, 6)), 0.0, BLIND)) is not None:
            return ending
        silent = self._seen.time - self._known
        if silent >= SILENT_CAMERA and is_blind(self._seen):
            return Ending(Outcome.PLANT_FAILED, f"{UNSEEN} for {silent:.3g} s")
        return None

    def _look_round(self) -> Ending | None:
        """Give the controller the scene as it is known, and a new plan where something stands in the way of the present
        one; how the run ended, if it did."""
        task = self._plant.task
        if task.scene == self._scene:
            return None
        before, self._scene = self._state.problem, task.scene
        self._state = state = self._controller.in_scene(self._state, task)
        assert state.plan.q is not None
        rest = state.plan.q[self._controller.row(state) :]
        known, now = (_clearances(rest, problem) for problem in (before, state.problem))
        return self._go_round(task, rest[0]) if (now < np.minimum(known, ROOM)).any() else None

    def _go_round(self, task: SpatialTask, here: Float[np.ndarray, "12"]) -> Ending | None:
        """Stand still, and follow a new plan from the shape that was to be had; how the run ended, if it did."""
        for _ in range(round(PAUSE / self._plant.control_step)):
            if (ending := self._acted(np.zeros((2, 6)), 0.0, BLOCKED)) is not None:
                return ending
        try:
            plan = self._replan(replace(task, start=here))
        except PlanningInterrupted as error:
            return Ending(Outcome.INTERRUPTED, str(error))
        except (TaskError, PlanningError) as error:
            return Ending(Outcome.BLOCKED_WAY, str(error))
        self._state = self._controller.resume(self._state, plan)
        self.recovered.append(self._seen.time)
        return None


def _clearances(q: Float[np.ndarray, "t 12"], problem: SpatialProblem) -> Float[np.ndarray, "t"]:
    """Of the cable and the hands from obstacles and walls [m]; of hulls no more than they are measured to."""
    stations, poses = problem.rod.shapes(q)
    cable = chain_distance(stations, problem.world)[0] - problem.radius
    return np.minimum(cable, problem.bodies.gaps(poses, problem.world)[:, 0])


def _over(measured: Sequence[Measurement], since: float, step: float) -> bool:
    """Whether the cable is at rest, or should long be, `since` [s] after the plan's last row."""
    if since < SETTLING[0]:
        return False
    moved = np.linalg.norm(measured[-1].keypoints - measured[-2].keypoints, axis=1).max()
    return bool(moved < REST * step or since >= SETTLING[1])
