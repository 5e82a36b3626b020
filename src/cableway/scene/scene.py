"""The scene: a walled rectangle with convex obstacles, and how far points and cables are from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from jaxtyping import Float

from cableway.errors import TaskError
from cableway.geometry import convex
from cableway.scene.obstacles import Obstacle, describe, to_shapely


@dataclass(frozen=True)
class Scene:
    """A workspace and what stands in it.

    Attributes:
        size: (width, height) [m]; the origin is the lower left corner, and the walls are obstacles.
        obstacles: Convex obstacles; they may overlap each other and the walls.
    """

    size: tuple[float, float] = (0.7, 0.7)
    obstacles: tuple[Obstacle, ...] = ()

    def __post_init__(self) -> None:
        if not min(self.size) > 0:
            raise TaskError(f"workspace.size must be positive, got {tuple(self.size)}")
        object.__setattr__(self, "obstacles", tuple(self.obstacles))

    @cached_property
    def world(self) -> convex.ConvexWorld:
        """The obstacles packed for the compiled kernels."""
        polygons = [obstacle.vertices for obstacle in self.obstacles]
        return convex.pack(polygons, [obstacle.rounding for obstacle in self.obstacles], self.size)

    @cached_property
    def solids(self) -> tuple[shapely.Polygon, ...]:
        """The obstacles for Shapely."""
        return tuple(to_shapely(obstacle) for obstacle in self.obstacles)

    def name_of(self, index: int) -> str:
        """What stands behind an index that `geometry.convex` returns, such as 'obstacle 2 (box at ...)'."""
        if index >= len(self.obstacles):
            return "the " + convex.WALLS[index - len(self.obstacles)]
        return f"obstacle {index} ({describe(self.obstacles[index])})"

    def signed_distance(self, points: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "..."]:
        """Signed distance [m] of points to the nearest obstacle or wall, positive in free space."""
        return convex.signed_distance(points, self.world)[0]

    def clearance(self, polylines: Float[np.ndarray, "b m 2"], radius: float) -> Float[np.ndarray, "b"]:
        """Signed distance [m] of the surface of cables, polylines grown by `radius`, to what is nearest."""
        return convex.polyline_distance(polylines, self.world)[0] - radius
