"""What a plant is: a cable held by two grippers, as the closed loop sees it."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from jaxtyping import Float

from cableway.records import Measurement, Observation
from cableway.scene.task import Task


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
