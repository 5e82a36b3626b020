"""How the simulated cable in space differs from the one that planner and controller know."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from jaxtyping import Float

from cableway.core.checks import Checked, NotNegative
from cableway.core.errors import InputError
from cableway.geometry.groups import SE3
from cableway.scene.spatial.cable import SpatialCable
from cableway.scene.spatial.task import SpatialTask
from cableway.simulation.spatial_plant import SpatialConfig, SpatialPlant

LENGTH, STIFFNESS = 0.02, 0.3
"""Shares by which length and bending stiffness of a drawn cable differ at most."""

GRASP, GRASP_TURN = 0.003, math.radians(5.0)
"""Most that a drawn grasp is off [m] and turned [rad]."""

NOISE, DELAY = 0.001, 1
"""Of keypoints [m], and in control steps of 0.1 s."""


@dataclass(frozen=True, kw_only=True)
class SpatialPerturbation(Checked):
    """What differs; by default, nothing.

    Attributes:
        cable: The true cable; the task's where None.
        grasps: (2, 7) poses of the cable's ends in the gripper frames.
        config: Of the plant; noise and delay of what is seen among it.
        obstacles: Displacement [m] of each obstacle, in the order of the task; none moves where empty.
        revealed: Time [s] from which the controller knows of these; never where None. The plan does not.

    Raises:
        InputError: A displacement is not finite, or `revealed` is out of range.
    """

    cable: SpatialCable | None = None
    grasps: Float[np.ndarray, "2 7"] = field(default_factory=lambda: np.tile(SE3.identity, (2, 1)))
    config: SpatialConfig = field(default_factory=SpatialConfig)
    obstacles: tuple[tuple[float, float, float], ...] = ()
    revealed: NotNegative[float] | None = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not np.isfinite(self.obstacles).all():
            raise InputError(f"obstacles must be finite displacements, got {self.obstacles!r}")

    @property
    def another_start(self) -> bool:
        """Whether the cable begins in another shape than the task's: it is another one, or is held otherwise."""
        return self.cable is not None or not np.array_equal(self.grasps, np.tile(SE3.identity, (2, 1)))

    @classmethod
    def drawn(cls, task: SpatialTask, seed: int) -> Self:
        """A cable up to 2% longer or shorter and 30% stiffer or less stiff, held up to 3 mm and 5 degrees askew, seen
        with 1 mm of noise and 0.1 s late."""
        rng, cable = np.random.default_rng([26, seed]), task.cable
        length, stiffness = 1 + LENGTH * rng.uniform(-1, 1), 1 + STIFFNESS * rng.uniform(-1, 1)
        other = replace(
            cable, length=cable.length * length, bending_stiffness=cable.bending_stiffness * stiffness, preset=None
        )
        off = np.concatenate([_within(rng, GRASP), _within(rng, GRASP_TURN)], axis=1)
        grasps = SE3.plus(np.tile(SE3.identity, (2, 1)), off)
        return cls(cable=other, grasps=grasps, config=SpatialConfig(keypoint_noise=NOISE, measurement_delay=DELAY))

    def true_task(self, task: SpatialTask) -> SpatialTask:
        """The task with the obstacles where they are, which the controller knows from `revealed` on.

        Raises:
            InputError: There is not one displacement for each obstacle of the task.
            TaskError: A displaced obstacle touches the start or the goal, lies outside, or cannot be raised.
        """
        if not self.obstacles:
            return task
        if len(self.obstacles) != (count := len(task.scene.obstacles)):
            raise InputError(
                f"obstacles must be one displacement for each of the task's {count} obstacles, "
                f"got {len(self.obstacles)}"
            )
        return replace(task, scene=task.scene.changed(self.obstacles))

    def build(self, task: SpatialTask, seed: int) -> SpatialPlant | RevealingPlant:
        """The plant; `seed` is of its noise.

        Raises:
            InputError: See `true_task`.
            SimulationError: See `SpatialPlant`.
        """
        plant = SpatialPlant(self.true_task(task), self.cable, self.grasps, self.config, seed)
        return plant if not self.obstacles or self.revealed == 0 else RevealingPlant(plant, task, self.revealed)


class RevealingPlant:
    """A plant whose obstacles are known from some time on.

    Args:
        plant: The plant.
        planned: The task as it is known until then.
        revealed: That time [s]; never where None.
    """

    def __init__(self, plant: SpatialPlant, planned: SpatialTask, revealed: float | None) -> None:
        self._plant, self._planned = plant, planned
        self._revealed = math.inf if revealed is None else revealed
        self.control_step = plant.control_step
        self.reset, self.step, self.measure = plant.reset, plant.step, plant.measure

    @property
    def task(self) -> SpatialTask:
        """As it is known by now."""
        return self._planned if self._plant.time < self._revealed else self._plant.task


def _within(rng: np.random.Generator, most: float) -> Float[np.ndarray, "2 3"]:
    """A vector for each gripper, of any direction, uniformly at most so long."""
    directions = rng.normal(size=(2, 3))
    return most * rng.uniform(size=(2, 1)) * directions / np.linalg.norm(directions, axis=1, keepdims=True)
