"""Convex obstacles: boxes, polygons and discs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Float

from cableway.errors import TaskError
from cableway.geometry import polyline, se2

MINIMUM_AREA = 1e-8
"""Area [m^2] under which a polygon counts as degenerate: 0.1 mm x 0.1 mm."""


@dataclass(frozen=True, kw_only=True)
class Box:
    """A rectangle.

    Attributes:
        center: (x, y) [m].
        size: Width and height [m] before turning.
        angle: Turn about the centre [rad].
    """

    center: tuple[float, float]
    size: tuple[float, float]
    angle: float = 0.0

    def __post_init__(self) -> None:
        if not min(self.size) > 0:
            raise TaskError(f"a box needs a positive size, got {tuple(self.size)}")

    @property
    def vertices(self) -> Float[np.ndarray, "4 2"]:
        """Corners [m], counter-clockwise."""
        corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * np.array(self.size) / 2
        return se2.transform(corners, np.array(self.center), self.angle)

    rounding = 0.0


@dataclass(frozen=True, kw_only=True)
class Polygon:
    """A convex polygon, its vertices given in either sense.

    Attributes:
        vertices: (k, 2) [m]; kept counter-clockwise.
    """

    vertices: Float[np.ndarray, "k 2"]

    def __post_init__(self) -> None:
        vertices = np.asarray(self.vertices, float)
        if vertices.ndim != 2 or vertices.shape[0] < 3 or vertices.shape[1] != 2:
            raise TaskError(f"a polygon needs at least 3 vertices of 2 numbers, got shape {vertices.shape}")
        area = -polyline.signed_area(np.vstack([vertices, vertices[:1]]))
        if abs(area) < MINIMUM_AREA:
            raise TaskError(f"the polygon is degenerate: its area is {abs(area):.2e} m^2")
        if area < 0:
            vertices = vertices[::-1]
        edges = np.roll(vertices, -1, axis=0) - vertices
        following = np.roll(edges, -1, axis=0)
        turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
        sense = np.arctan2(turns, np.sum(edges * following, axis=1)).sum()
        if turns.min() < -1e-9 or abs(sense - 2 * np.pi) > 1e-6:
            raise TaskError("the polygon is not convex; split it into convex parts")
        object.__setattr__(self, "vertices", np.ascontiguousarray(vertices))

    rounding = 0.0


@dataclass(frozen=True, kw_only=True)
class Disc:
    """A disc.

    Attributes:
        center: (x, y) [m].
        radius: [m].
    """

    center: tuple[float, float]
    radius: float

    def __post_init__(self) -> None:
        if not self.radius > 0:
            raise TaskError(f"a disc needs a positive radius, got {self.radius}")

    @property
    def vertices(self) -> Float[np.ndarray, "1 2"]:
        """The centre, as the one vertex of a polygon grown by `rounding`."""
        return np.array([self.center], dtype=float)

    @property
    def rounding(self) -> float:
        """The radius [m]."""
        return self.radius


Obstacle = Box | Polygon | Disc


def to_shapely(obstacle: Obstacle) -> shapely.Polygon:
    """The obstacle for Shapely; a disc becomes a polygon of 256 sides (0.008% of its radius inside it)."""
    if isinstance(obstacle, Disc):
        return shapely.Point(obstacle.center).buffer(obstacle.radius, quad_segs=64)
    return shapely.Polygon(obstacle.vertices)


def describe(obstacle: Obstacle) -> str:
    """A few words for messages, such as 'box at (0.350, 0.300)'."""
    x, y = obstacle.vertices.mean(axis=0)
    return f"{type(obstacle).__name__.lower()} at ({x:.3f}, {y:.3f})"
