"""A small plant and plan from the rod's equilibria, for tests of the closed loop without a simulator."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cableway.core.errors import SimulationError
from cableway.geometry import convex
from cableway.records import Measurement, Observation, Plan
from cableway.rod.continuation import lead
from cableway.rod.planar import PlanarRod
from cableway.scene.cable import Cable
from cableway.scene.obstacles import Obstacle
from cableway.scene.scene import Scene
from cableway.scene.task import CONTROL_STEP, Task

START = np.array([0.25, 0.3, 0.3, 3.0, 9.0, -1.5])
GOAL = np.array([0.42, 0.4, -0.5, -4.0, 12.0, 1.0])


def straight_plan(rod: PlanarRod, start: np.ndarray = START, goal: np.ndarray = GOAL, steps: int = 50) -> Plan:
    """A plan along the straight line between two rod coordinates."""
    q = start + np.linspace(0, 1, steps + 1)[:, None] * (goal - start)
    stations, poses = rod.shapes(q)
    shapes = rod.at_keypoints(stations)
    return Plan(shapes=shapes, poses=poses)


def task_for(plan: Plan, obstacles: tuple[Obstacle, ...] = (), cable: Cable | None = None) -> Task:
    """The task that a plan solves."""
    return Task(
        name="straight",
        scene=Scene(obstacles=obstacles),
        cable=cable or Cable(),
        start=plan.shapes[0],
        goal=plan.shapes[-1],
    )


@dataclass
class QuasiStaticPlant:
    """A cable that is always at the equilibrium its grippers allow, followed from step to step.

    Attributes:
        task: The task.
        q: Rod coordinates it starts from.
        rod: The true rod.
        lag: Share of the way to the equilibrium that is left after a step.
        fails_after: Step that raises, or None.
    """

    task: Task
    q: np.ndarray
    rod: PlanarRod
    lag: float = 0.0
    fails_after: int | None = None
    control_step: float = CONTROL_STEP
    _now: np.ndarray = field(init=False)
    _step: int = 0

    def reset(self) -> Observation:
        self._now, self._step = self.q.copy(), 0
        self._poses = self.rod.shapes(self._now[None])[1][0]
        self._stations = self.rod.shapes(self._now[None])[0][0]
        return self._observe()

    def step(self, action: np.ndarray) -> Observation:
        self._step += 1
        if self.fails_after is not None and self._step > self.fails_after:
            raise SimulationError("the chain came apart")
        led = lead(self.rod, self._now, np.array([self._poses, self._poses + action]))
        if led.snap is not None:
            raise SimulationError("the rod snaps")
        self._poses, self._now = self._poses + action, led.q[-1]
        reached = self.rod.shapes(self._now[None])[0][0]
        self._stations = reached + self.lag * (self._stations - reached)
        return self._observe()

    def measure(self) -> Measurement:
        world = self.task.scene.world
        clearance = convex.polyline_distance(self._stations[None], world)[0][0] - self.task.cable.radius
        discs = convex.signed_distance(self._poses[:, :2], world)[0].min() - self.task.grippers.radius
        return Measurement(self._keypoints(), self._poses.copy(), self._stations.copy(), float(clearance), float(discs))

    def _keypoints(self) -> np.ndarray:
        return self._stations[:: self.rod.stride].copy()

    def _observe(self) -> Observation:
        return Observation(self._step * CONTROL_STEP, self._keypoints(), self._poses.copy())


def outward(shape: np.ndarray) -> np.ndarray:
    """The unit normal at the middle keypoint of 13, away from the grippers."""
    tangent = shape[7] - shape[5]
    normal = np.array([-tangent[1], tangent[0]]) / np.linalg.norm(tangent)
    return normal * np.sign(normal @ (shape[6] - (shape[0] + shape[-1]) / 2))


def stacked(shape: np.ndarray, wanted: np.ndarray) -> float:
    """The L2 distance over all numbers of two shapes."""
    return float(np.linalg.norm(shape - wanted))
