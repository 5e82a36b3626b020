"""The scene: a walled rectangle with convex obstacles, and how far points and cables are from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from jaxtyping import Float

from cableway.core.errors import TaskError
from cableway.geometry import convex
from cableway.scene import checks
from cableway.scene.obstacles import Disc, Obstacle, describe, to_shapely

WALL_TOLERANCE = 1e-6
"""Distance [m] by which an obstacle may reach beyond a wall: figures in a file are rounded to micrometres."""

DEPTH_STEP = 1e-4
"""Spacing [m] of the points at which the depth of an overlap is measured, for messages to 0.1 mm."""


@dataclass(frozen=True)
class Scene:
    """A workspace and what stands in it.

    Attributes:
        size: (width, height) [m]; the origin is the lower left corner, and the walls are obstacles.
        obstacles: Convex obstacles inside the workspace; they may touch its walls and overlap each other.

    Raises:
        TaskError: A size is not positive and finite, or an obstacle reaches beyond a wall.
    """

    size: tuple[float, float] = (0.7, 0.7)
    obstacles: tuple[Obstacle, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", checks.pair(self.size, ("workspace", "size"), positive=True))
        object.__setattr__(self, "obstacles", tuple(self.obstacles))
        for index, obstacle in enumerate(self.obstacles):
            self._require_inside(index, obstacle)

    def _require_inside(self, index: int, obstacle: Obstacle) -> None:
        low = obstacle.vertices.min(axis=0) - obstacle.rounding
        high = obstacle.vertices.max(axis=0) + obstacle.rounding
        beyond = float(max(-low.min(), (high - self.size).max()))
        if beyond > WALL_TOLERANCE:
            width, height = self.size
            whole = bool((high <= 0).any() or (low >= self.size).any())
            raise TaskError(
                f"({describe(obstacle)}) {'lies wholly' if whole else 'reaches'} outside the workspace of "
                f"{width:g} m x {height:g} m, by {1000 * beyond:.1f} mm",
                ("obstacles", index),
            )

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
        """What stands behind an index that `geometry.convex` returns, such as 'obstacles[2] (box at ...)'."""
        if index >= len(self.obstacles):
            return "the " + convex.WALLS[index - len(self.obstacles)]
        return f"obstacles[{index}] ({describe(self.obstacles[index])})"

    def signed_distance(self, points: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "..."]:
        """Signed distance [m] of points to the nearest obstacle or wall, positive in free space."""
        return convex.signed_distance(points, self.world)[0]

    def clearance(self, polylines: Float[np.ndarray, "b m 2"], radius: float) -> Float[np.ndarray, "b"]:
        """Signed distance [m] of the surface of cables, polylines grown by `radius`, to what is nearest."""
        return convex.polyline_distance(polylines, self.world)[0] - radius

    def overlap(self, line: Float[np.ndarray, "m 2"], radius: float) -> tuple[float, int]:
        """How deep [m] a cable (a polyline grown by `radius`) or a disc (one vertex) is in what, to 0.1 mm.

        Positive for an overlap, else the negative clearance; the index is that of `name_of`. Uses Shapely, so that a
        task can be read and shown before any kernel is compiled.
        """
        curve = shapely.LineString(line) if len(line) > 1 else shapely.Point(line[0])
        depths = [radius - _signed_distance(curve, obstacle) for obstacle in self.obstacles]
        (x0, y0), (x1, y1) = line.min(axis=0), line.max(axis=0)
        depths += [radius - gap for gap in (x0, y0, self.size[0] - x1, self.size[1] - y1)]
        index = int(np.argmax(depths))
        return float(depths[index]), index


def _signed_distance(curve: shapely.LineString | shapely.Point, obstacle: Obstacle) -> float:
    if isinstance(obstacle, Disc):
        return float(curve.distance(shapely.Point(obstacle.center))) - obstacle.radius
    solid = to_shapely(obstacle)
    distance = float(curve.distance(solid))
    if distance > 0:
        return distance
    inside = curve.intersection(solid)
    inside = shapely.segmentize(inside, max(DEPTH_STEP, inside.length / 2000))
    points = shapely.points(np.vstack([shapely.get_coordinates(inside), shapely.get_coordinates(curve)]))
    return -float(np.where(shapely.intersects(points, solid), shapely.distance(points, solid.exterior), 0.0).max())
