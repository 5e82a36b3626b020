"""Distances in space by Coal: of moving lines, balls and hulls from the obstacles and walls of a scene; capsules.

Obstacles become Coal's own shapes, from the records of the scene; nothing is shared with `cableway.geometry`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Float, Integer
from scipy.spatial.transform import Rotation

from cableway.core.extras import require
from cableway.core.time_limit import checkpoint
from cableway.scene.spatial.obstacles import ConvexMesh, Cuboid, Cylinder, Prism, SpatialObstacle, Sphere
from cableway.scene.spatial.scene import SpatialScene

FAR = 0.02
"""Distance [m] beyond which none is measured: it is given as this."""

POINT = 1e-6
"""Radius [m] of what stands for a point."""

CLOSE = 1e-6
"""Within which [m] the nearest piece of a line is found."""

NORMALS = 4
"""Planes kept from a line to the next."""

BEYOND = 1.0
"""Height [m] by which an obstacle of unlimited height reaches above the workspace."""


@cache
def library() -> Any:
    """Coal.

    Raises:
        MissingExtraError: It is not installed.
    """
    require("cell", "the verification of arms, and of plans in space,")
    import coal

    return coal


@dataclass(frozen=True)
class Shape:
    """A convex shape of Coal at a place, the box about it [m], and what it is spanned by.

    It is the hull of `corners` (k, 3), each of which stands for a ball of `radius` [m], or for a disc across `axis`.
    """

    solid: Any
    place: Any
    low: Float[np.ndarray, "3"]
    high: Float[np.ndarray, "3"]
    corners: Float[np.ndarray, "k 3"]
    radius: float
    axis: Float[np.ndarray, "3"]

    @classmethod
    def of(
        cls, solid: Any, turn: Float[np.ndarray, "3 3"], at: Float[np.ndarray, "3"], corners: Float[np.ndarray, "k 3"],
        radius: float = 0.0, axis: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> Shape:  # fmt: skip
        """A shape turned by a matrix and put at a point; corners and axis are given in its own frame."""
        place = library().Transform3s(turn, np.asarray(at, float))
        box = library().CollisionObject(solid, place)
        box.computeAABB()
        bounds = box.getAABB()
        placed = np.asarray(corners, float) @ turn.T + at
        return cls(solid, place, np.array(bounds.min_), np.array(bounds.max_), placed, radius, turn @ axis)

    def beyond(self, line: Float[np.ndarray, "m 3"], normals: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "pieces"]:
        """What the pieces of a line, or its only point, are at least away [m]: how far they are beyond the planes that
        touch this shape and have it behind them, whose unit normals are given; the largest of these."""
        disc = np.sqrt(np.maximum(0.0, 1.0 - (normals @ self.axis) ** 2))
        along = line @ normals.T - (self.corners @ normals.T).max(0) - self.radius * disc
        return (along if len(line) == 1 else np.minimum(along[:-1], along[1:])).max(1)


def hull(points: Float[np.ndarray, "k 3"]) -> Any:
    """Coal's convex hull of points."""
    coal = library()
    vertices = coal.StdVec_Vec3s()
    vertices.extend(list(np.asarray(points, float)))
    return coal.Convex.convexHull(vertices, True, None)


def shape_of(obstacle: SpatialObstacle, top: float) -> Shape:
    """An obstacle; one of unlimited height ends at `top` [m]."""
    coal = library()
    if isinstance(obstacle, Cuboid):
        turn = Rotation.from_quat(obstacle.orientation, scalar_first=True).as_matrix()
        corners = np.array(list(product((-0.5, 0.5), repeat=3))) * obstacle.size
        return Shape.of(coal.Box(*obstacle.size), turn, np.array(obstacle.center), corners)
    if isinstance(obstacle, Cylinder):
        turn = Rotation.align_vectors([obstacle.axis], [[0.0, 0.0, 1.0]])[0].as_matrix()
        return _cylinder(obstacle.radius, obstacle.height, turn, np.array(obstacle.center))
    if isinstance(obstacle, Sphere):
        middle = np.array(obstacle.center)
        return Shape.of(coal.Sphere(obstacle.radius), np.eye(3), middle, np.zeros((1, 3)), obstacle.radius)
    if isinstance(obstacle, ConvexMesh):
        return Shape.of(hull(obstacle.points), np.eye(3), np.zeros(3), obstacle.points)
    return _prism(obstacle, top)


def _prism(obstacle: Prism, top: float) -> Shape:
    section, height = obstacle.section, top if obstacle.section.height is None else obstacle.section.height
    if len(section.vertices) == 1:
        return _cylinder(section.rounding, height, np.eye(3), np.array([*section.vertices[0], height / 2]))
    corners = np.array([[x, y, z] for x, y in section.vertices for z in (0.0, height)])
    return Shape.of(hull(corners), np.eye(3), np.zeros(3), corners)


def _cylinder(radius: float, height: float, turn: np.ndarray, at: np.ndarray) -> Shape:
    corners = np.array([[0.0, 0.0, -height / 2], [0.0, 0.0, height / 2]])
    return Shape.of(library().Cylinder(radius, height), turn, at, corners, radius, (0.0, 0.0, 1.0))


class ToScene:
    """What measures moving lines of capsules, or single balls, against a scene; a `swept.Measure`.

    Args:
        scene: Obstacles and walls.
        radius: Of the capsules [m]; distances are those of their centre lines all the same.
    """

    def __init__(self, scene: SpatialScene, radius: float) -> None:
        self._size, self._radius = np.array(scene.size), radius
        self._shapes = [shape_of(each, scene.size[2] + BEYOND) for each in scene.obstacles]
        self._low = np.array([each.low for each in self._shapes]).reshape(-1, 3)
        self._high = np.array([each.high for each in self._shapes]).reshape(-1, 3)

    def __call__(self, lines: Float[np.ndarray, "t m 3"]) -> tuple[Float[np.ndarray, "t"], Integer[np.ndarray, "t"]]:
        """Distance [m] of each line, at most `FAR`, negative inside, and the index of what is nearest."""
        walls = np.concatenate([lines.min(1), self._size - lines.max(1)], axis=1)
        distance, nearest = walls.min(1), len(self._shapes) + walls.argmin(1)
        distance = np.minimum(distance, FAR + self._radius)
        gaps = np.maximum(self._low - lines.max(1)[:, None], lines.min(1)[:, None] - self._high).max(2)
        for index, shape in enumerate(self._shapes):
            normals = np.zeros((0, 3))
            for row in np.flatnonzero(gaps[:, index] < distance):
                checkpoint()
                gap, normals = self._nearest(lines[row], shape, distance[row], normals)
                if gap < distance[row]:
                    distance[row], nearest[row] = gap, index
        return distance, nearest

    def _nearest(
        self, line: Float[np.ndarray, "m 3"], shape: Shape, enough: float, normals: Float[np.ndarray, "k 3"]
    ) -> tuple[float, Float[np.ndarray, "h 3"]]:
        """Distance [m] of a line, or `enough` where it is no nearer, and normals of planes between the two.

        Coal measures piece after piece, the one that could be nearest first, until the planes between those measured
        and the shape have all others behind what is found.

        Args:
            line: Its points [m].
            shape: The shape.
            enough: As above [m].
            normals: Of planes to begin with, such as those of a line nearby.
        """
        if not len(normals):
            away = line.mean(0) - (shape.low + shape.high) / 2
            size = float(np.linalg.norm(away))
            normals = np.array([away / size if size > POINT else [0.0, 0.0, 1.0]])
        least = shape.beyond(line, normals)
        while least[piece := int(least.argmin())] < enough - CLOSE:
            gap, normal = self._measured(line[[piece, min(piece + 1, len(line) - 1)]], shape)
            enough = min(enough, gap)
            if abs(normal @ normal - 1.0) < CLOSE:
                normals = np.concatenate([normal[None], normals[: NORMALS - 1]])
                least = np.maximum(least, shape.beyond(line, normals[:1]))
            least[piece] = np.inf
        return enough, normals

    def hull_distance(self, solid: Any, place: Any, corners: Float[np.ndarray, "k 3"], enough: float) -> float:
        """Distance [m] of a hull with these corners from walls and obstacles; what is beyond `FAR` or `enough` from
        its box is left out."""
        low, high = corners.min(0), corners.max(0)
        least = min(float(low.min()), float((self._size - high).min()), max(FAR, enough))
        gaps = np.maximum(self._low - high, low - self._high).max(1)
        for index in np.flatnonzero(gaps < least):
            if gaps[index] < least:
                shape = self._shapes[index]
                least = min(least, between(solid, place, shape.solid, shape.place))
        return least

    def box_bound(
        self, low: Float[np.ndarray, "t 3"], high: Float[np.ndarray, "t 3"], enough: float
    ) -> Float[np.ndarray, "t"]:
        """What `hull_distance` is at least [m] for hulls whose boxes have these corners."""
        least = np.minimum(np.minimum(low.min(1), (self._size - high).min(1)), max(FAR, enough))
        for bottom, top in zip(self._low, self._high, strict=True):
            least = np.minimum(least, boxes_apart(low, high, bottom, top))
        return least

    def _measured(self, ends: np.ndarray, shape: Shape) -> tuple[float, np.ndarray]:
        """Distance [m] between a piece of a line and a shape, and the unit vector from the shape to it."""
        coal = library()
        result = coal.DistanceResult()
        solid, place = capsule(ends, self._radius), placed(ends)
        gap = coal.distance(solid, place, shape.solid, shape.place, coal.DistanceRequest(), result)
        return float(gap) + self._radius, -np.array(result.normal)


def boxes_apart(
    low: Float[np.ndarray, "t 3"], high: Float[np.ndarray, "t 3"], bottom: np.ndarray, top: np.ndarray
) -> Float[np.ndarray, "t"]:
    """Distance [m] of boxes along the axes from others, negative by the depth: what is in them is no nearer."""
    gaps = np.maximum(low - top, bottom - high)
    return np.where(gaps.max(1) > 0, np.linalg.norm(np.maximum(gaps, 0.0), axis=1), gaps.max(1))


def capsule(ends: Float[np.ndarray, "2 3"], radius: float) -> Any:
    """A capsule between two points [m], or a ball where they are one."""
    length = float(np.linalg.norm(ends[1] - ends[0]))
    return library().Capsule(radius, length) if length > 1e-9 else library().Sphere(radius)


def placed(ends: Float[np.ndarray, "2 3"]) -> Any:
    """Where a capsule between two points [m] is."""
    (ax, ay, az), (bx, by, bz) = ends.tolist()
    x, y, z = bx - ax, by - ay, bz - az
    length = math.sqrt(x * x + y * y + z * z)
    if length <= 1e-9:
        return library().Transform3s(np.eye(3), ends[0])
    x, y, z = x / length, y / length, z / length
    if z < 0.0:  # either end may come first, and the formula is singular downwards
        x, y, z = -x, -y, -z
    k = 1.0 / (1.0 + z)  # the turn about a horizontal axis that brings the z axis there
    turn = np.array([[1.0 - x * x * k, -x * y * k, x], [-x * y * k, 1.0 - y * y * k, y], [-x, -y, z]])
    return library().Transform3s(turn, np.array([(ax + bx) / 2, (ay + by) / 2, (az + bz) / 2]))


def between(a: Any, at_a: Any, b: Any, at_b: Any) -> float:
    """Distance [m] of two shapes, negative by their depth."""
    coal = library()
    return float(coal.distance(a, at_a, b, at_b, coal.DistanceRequest(), coal.DistanceResult()))


def nearest(bounds: Float[np.ndarray, "pairs rows"], gap: Callable[[int, int], float]) -> tuple[float, int, int]:
    """The least distance [m] of pairs in rows, with the pair and the row, where `bounds` [m] are below each.

    Pairs are measured by their bounds, least first, until none can be nearer.
    """
    best, at = np.inf, (0, 0)
    for flat in np.argsort(bounds, axis=None):
        pair, row = (int(each) for each in np.unravel_index(flat, bounds.shape))
        if bounds[pair, row] >= best:
            break
        if (found := gap(pair, row)) < best:
            best, at = found, (pair, row)
    return float(best), *at
