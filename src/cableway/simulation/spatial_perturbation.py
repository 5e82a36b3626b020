"""How the simulated cable in space differs from the one that planner and controller know."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from jaxtyping import Float

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
class SpatialPerturbation:
    """What differs; by default, nothing.

    Attributes:
        cable: The true cable; the task's where None.
        grasps: (2, 7) poses of the cable's ends in the gripper frames.
        config: Of the plant; noise and delay of what is seen among it.
    """

    cable: SpatialCable | None = None
    grasps: Float[np.ndarray, "2 7"] = field(default_factory=lambda: np.tile(SE3.identity, (2, 1)))
    config: SpatialConfig = field(default_factory=SpatialConfig)

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

    def build(self, task: SpatialTask, seed: int) -> SpatialPlant:
        """The plant; `seed` is of its noise.

        Raises:
            SimulationError: See `SpatialPlant`.
        """
        return SpatialPlant(task, self.cable, self.grasps, self.config, seed)


def _within(rng: np.random.Generator, most: float) -> Float[np.ndarray, "2 3"]:
    """A vector for each gripper, of any direction, uniformly at most so long."""
    directions = rng.normal(size=(2, 3))
    return most * rng.uniform(size=(2, 1)) * directions / np.linalg.norm(directions, axis=1, keepdims=True)
