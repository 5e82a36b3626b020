"""The scene: a walled rectangle with convex obstacles, and how far points and cables are from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float

from cableway.core.errors import Point, TaskError
from cableway.core.quantities import quantity, size_text
from cableway.geometry import convex
from cableway.scene import checks
from cableway.scene.obstacles import Disc, Height, Obstacle, describe, displaced, to_shapely

WALL_TOLERANCE = 1e-6
"""Distance [m] by which an obstacle may reach beyond a wall: figures in a file are rounded to micrometres."""

DEPTH_STEP = 1e-4
"""Spacing [m] of the points at which the depth of an overlap is measured, for messages to 0.1 mm."""


class Overlap(NamedTuple):
    """How deep something is in an obstacle or wall.

    Attributes:
        depth: [m], positive for an overlap, else the negative clearance.
        solid: Index of what it is in, or nearest to; see `Scene.name_of`.
        at: Where [m]: the deepest point of its centre line, or where that is outside the nearest one of the obstacle.
    """

    depth: float
    solid: int
    at: Point


@dataclass(frozen=True)
class Scene:
    """A workspace and what stands in it.

    Attributes:
        size: (width, height) [m]; the origin is the lower left corner, and the walls are obstacles.
        obstacles: Convex obstacles inside the workspace; they may touch its walls and overlap each other.
        wall_height: Of the walls above the table [m]; None where nothing passes above. The cable and the tips of the
            grippers stay inside in any case.

    Raises:
        TaskError: A size or height is not positive and finite, or an obstacle reaches beyond a wall.
    """

    size: tuple[float, float] = (0.7, 0.7)
    obstacles: tuple[Obstacle, ...] = ()
    wall_height: Height = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", checks.pair(self.size, ("workspace", "size"), checks.WORKSPACE))
        checks.check_quantities(self, "workspace")
        object.__setattr__(self, "obstacles", tuple(self.obstacles))
        faults = [fault for index in range(len(self.obstacles)) if (fault := self._outside(index))]
        if faults:
            raise faults[0].of(self, faults[1:])

    def _outside(self, index: int) -> TaskError | None:
        """What is wrong with an obstacle that reaches beyond a wall; None where it does not."""
        obstacle = self.obstacles[index]
        low = obstacle.vertices.min(axis=0) - obstacle.rounding
        high = obstacle.vertices.max(axis=0) + obstacle.rounding
        beyond = float(max(-low.min(), (high - self.size).max()))
        if beyond <= WALL_TOLERANCE:
            return None
        whole = bool((high <= 0).any() or (low >= self.size).any())
        extreme = np.where(high - self.size > -low, high, low)  # of each axis the side that reaches farther
        middle = (low + high) / 2
        x, y = np.where((extreme < 0) | (extreme > self.size), np.clip(extreme, 0, self.size), middle)
        return TaskError(
            f"({describe(obstacle)}) {'lies wholly' if whole else 'reaches'} outside the workspace of "
            f"{size_text(self.size)}, by {quantity(beyond)}",
            ("obstacles", index),
            at=(float(x), float(y)),
        )

    def changed(
        self, by: Sequence[tuple[float, float]] = (), discs: Sequence[tuple[float, float, float]] = ()
    ) -> Scene:
        """The scene with each obstacle displaced by (dx, dy) [m], none where `by` is empty, and further `discs`.

        Args:
            by: One displacement for each obstacle, or none at all.
            discs: (x, y, radius) [m] of each.

        Raises:
            TaskError: An obstacle then reaches beyond a wall, or a disc is none.
        """
        moved = [displaced(*pair) for pair in zip(self.obstacles, by, strict=True)] if by else self.obstacles
        return replace(self, obstacles=(*moved, *(Disc(center=(x, y), radius=radius) for x, y, radius in discs)))

    @cached_property
    def world(self) -> convex.ConvexWorld:
        """The obstacles packed for the compiled kernels."""
        polygons = [obstacle.vertices for obstacle in self.obstacles]
        heights = [math.inf if height is None else height for height in self.heights]
        return convex.pack(polygons, [obstacle.rounding for obstacle in self.obstacles], self.size, heights)

    @property
    def heights(self) -> tuple[float | None, ...]:
        """Heights [m] of all obstacles, then of the walls."""
        return (*(obstacle.height for obstacle in self.obstacles), self.wall_height)

    @cached_property
    def solids(self) -> tuple[shapely.Polygon, ...]:
        """The obstacles for Shapely."""
        return tuple(to_shapely(obstacle) for obstacle in self.obstacles)

    def name_of(self, index: int) -> str:
        """What stands behind an index that `geometry.convex` returns, such as 'obstacles[2] (box at ...)'."""
        if index >= len(self.obstacles):
            return "the " + convex.WALLS[index - len(self.obstacles)]
        return f"obstacles[{index}] ({describe(self.obstacles[index])})"

    def signed_distance(self, points: Float[np.ndarray, "... 2"], above: float = 0.0) -> Float[np.ndarray, "..."]:
        """Signed distance [m] of points to the nearest obstacle or wall higher than `above` [m], positive outside."""
        return convex.signed_distance(points, self.world, above=above)[0]

    def clearance(
        self, polylines: Float[np.ndarray, "b m 2"], radius: float, above: float = 0.0
    ) -> Float[np.ndarray, "b"]:
        """Signed distance [m] of polylines grown by `radius` to the nearest obstacle or wall higher than `above`."""
        return convex.polyline_distance(polylines, self.world, above)[0] - radius

    def overlap(self, line: Float[np.ndarray, "m 2"], radius: float, above: float = 0.0) -> Overlap:
        """The deepest overlap, to 0.1 mm, of a cable (a polyline grown by `radius`) or a disc (one vertex).

        With what is higher than `above` [m]; where nothing is, the depth is minus infinity.
        Uses Shapely, so that a task can be read and shown before any kernel is compiled.
        """
        curve = shapely.LineString(line) if len(line) > 1 else shapely.Point(line[0])
        found = [_closest(curve, obstacle) for obstacle in self.obstacles]
        for axis, end in ((0, 0.0), (1, 0.0), (0, self.size[0]), (1, self.size[1])):
            inward = line[:, axis] if end == 0.0 else end - line[:, axis]
            vertex = int(np.argmin(inward))
            at = line[vertex].copy()
            at[axis] = end
            found.append((float(inward[vertex]), at))
        heights = [*self.heights[:-1], *[self.wall_height] * 4]
        for k, height in enumerate(heights):
            if height is not None and height <= above:
                found[k] = (math.inf, found[k][1])
        index = min(range(len(found)), key=lambda i: found[i][0])
        distance, (x, y) = found[index]
        return Overlap(radius - distance, index, (float(x), float(y)))


def _closest(curve: shapely.LineString | shapely.Point, obstacle: Obstacle) -> tuple[float, Float[np.ndarray, "2"]]:
    """Signed distance [m] to an obstacle, and where."""
    if isinstance(obstacle, Disc):
        center = np.array(obstacle.center)
        near = shapely.get_coordinates(shapely.shortest_line(curve, shapely.Point(center)))[0]
        away = float(np.linalg.norm(near - center))
        if away <= obstacle.radius:
            return away - obstacle.radius, near
        return away - obstacle.radius, center + obstacle.radius / away * (near - center)
    solid = to_shapely(obstacle)
    distance = float(curve.distance(solid))
    if distance > 0:
        return distance, shapely.get_coordinates(shapely.shortest_line(curve, solid))[1]
    inside = curve.intersection(solid)
    inside = shapely.segmentize(inside, max(DEPTH_STEP, inside.length / 2000))
    coordinates = np.vstack([shapely.get_coordinates(inside), shapely.get_coordinates(curve)])
    points = shapely.points(coordinates)
    depths = np.where(shapely.intersects(points, solid), shapely.distance(points, solid.exterior), 0.0)
    deepest = int(np.argmax(depths))
    return -float(depths[deepest]), coordinates[deepest]
