from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from cableway.scene.cable import Cable
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.simulation.plant import CableSimulator

BENT = np.array([0.35, 0.35, 0.4, -20.0, 2.0, 3.0])
"""Rod coordinates of a moderately bent cable in the middle of the workspace."""


@pytest.fixture
def bent() -> np.ndarray:
    return BENT.copy()


@pytest.fixture
def task_at() -> Callable[..., Task]:
    """A task whose cable starts, and ends, at rod coordinates q."""

    def make(q: np.ndarray = BENT, scene: Scene | None = None, cable: Cable | None = None) -> Task:
        cable = cable or Cable()
        shape = cable.rod.at_keypoints(cable.rod.shapes(q[None])[0])[0]
        return Task(name="here", scene=scene or Scene(), cable=cable, start=shape, goal=shape)

    return make


@pytest.fixture
def drive() -> Callable[..., list]:
    """Lead the grippers from where they are to poses (2, 3) in equal steps, wait, and return every measurement."""

    def lead(plant: CableSimulator, poses: np.ndarray, steps: int, wait: int = 0) -> list:
        action = (poses - plant.measure().poses) / steps
        rows = []
        for k in range(steps + wait):
            plant.step(action if k < steps else np.zeros((2, 3)))
            rows.append(plant.measure())
        return rows

    return lead
