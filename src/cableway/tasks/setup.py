"""What random tasks are drawn on: the table, the cable, the grippers; and what a kind hands back."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from cableway.rod.planar import PlanarRod
from cableway.scene.cable import Cable
from cableway.scene.grippers import Grippers
from cableway.scene.obstacles import Obstacle

MARGIN = 0.008
"""Clearance [m] that a witness keeps from obstacles drawn around it: twice what a plan must keep."""

GAP = 0.025
"""Least gap [m] between two obstacles, or an obstacle and a wall, that are not one wall: a cable of 8 mm with the
witness's margin on both sides."""


class Rejected(Exception):
    """A draw that came to nothing; the next one is tried."""


@dataclass(frozen=True, kw_only=True)
class Setup:
    """A table without obstacles.

    Attributes:
        size: (width, height) of the workspace [m].
        cable: The cable.
        grippers: The grippers.
        height: Of the obstacles above the table [m]; None where nothing passes above.
        wall_height: The same of the walls.
    """

    size: tuple[float, float] = (0.7, 0.7)
    cable: Cable = field(default_factory=Cable)
    grippers: Grippers = field(default_factory=Grippers)
    height: float | None = None
    wall_height: float | None = None

    @property
    def rod(self) -> PlanarRod:
        """The rod that stands for the cable."""
        return self.cable.rod

    @property
    def thickness(self) -> float:
        """Radius [m] of the widest of cable and grippers."""
        return max(self.cable.radius, self.grippers.radius)


@dataclass(frozen=True, kw_only=True)
class Draft:
    """What a kind draws: all of a task but its name.

    Attributes:
        setup: Table, cable and grippers.
        obstacles: What stands on the table.
        motion: (t, 6) rod coordinates from start to goal: a way, or, where there is none, its two ends.
        solvable: Whether the motion is a way.
        description: One sentence for the task.
    """

    setup: Setup
    obstacles: tuple[Obstacle, ...]
    motion: Float[np.ndarray, "t 6"]
    solvable: bool = True
    description: str
