"""Convex obstacles: boxes, polygons and discs, as high as they are."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import shapely
from jaxtyping import Float

from cableway.core.errors import TaskError
from cableway.core.quantities import limit_text, place
from cableway.geometry import polyline, se2
from cableway.scene import checks
from cableway.scene.checks import Quantity

MINIMUM_AREA = 1e-8
"""Area [m^2] under which an obstacle counts as degenerate: 0.1 mm x 0.1 mm."""

ROUNDING = 2e-6
"""Distance [m] by which a vertex may stand inside its neighbours' line, or an edge be short: figures in a file are
rounded to micrometres."""


Height = Annotated[float | None, "a height", Quantity("m", 1e-4, 50.0)]
"""Above the table; None where nothing passes above."""


@dataclass(frozen=True, kw_only=True)
class Box:
    """A rectangle.

    Attributes:
        center: (x, y) [m].
        size: Width and height [m] before turning.
        angle: Turn about the centre [rad].
        height: Above the table [m]; None where nothing passes above.

    Raises:
        TaskError: A value is not finite or out of range, or the area is next to nothing.
    """

    center: checks.Point
    size: Annotated[tuple[checks.Extent, checks.Extent], "[width, height]"]
    angle: checks.Radians = 0.0
    height: Height = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", checks.pair(self.center, ("center",), checks.COORDINATE))
        object.__setattr__(self, "size", checks.pair(self.size, ("size",), checks.EXTENT))
        checks.check_quantities(self)
        _require_area(self.size[0] * self.size[1], "size")

    @property
    def vertices(self) -> Float[np.ndarray, "4 2"]:
        """Corners [m], counter-clockwise."""
        corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * np.array(self.size) / 2
        return se2.transform(corners, np.array(self.center), self.angle)

    rounding = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Polygon:
    """A convex polygon, its vertices given in either sense.

    Attributes:
        vertices: (k, 2) [m]; kept counter-clockwise.
        height: Above the table [m]; None where nothing passes above.

    Raises:
        TaskError: Fewer than 3 vertices, a number that is not finite, two vertices in one place, next to no area,
            or not convex.
    """

    vertices: Float[np.ndarray, "k 2"]
    height: Height = None

    def __post_init__(self) -> None:
        vertices = checks.rows(self.vertices, ("vertices",), checks.XY)
        check_convex(vertices, "vertices")
        object.__setattr__(self, "vertices", counter_clockwise(vertices))
        checks.check_quantities(self)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Polygon):
            return False
        return self.height == other.height and np.array_equal(self.vertices, other.vertices)

    def __hash__(self) -> int:
        return hash((self.height, self.vertices.tobytes()))

    rounding = 0.0


@dataclass(frozen=True, kw_only=True)
class Disc:
    """A disc.

    Attributes:
        center: (x, y) [m].
        radius: [m].
        height: Above the table [m]; None where nothing passes above.

    Raises:
        TaskError: A value is not finite or out of range, or the area is next to nothing.
    """

    center: checks.Point
    radius: checks.Extent
    height: Height = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", checks.pair(self.center, ("center",), checks.COORDINATE))
        checks.check_quantities(self)
        _require_area(np.pi * self.radius**2, "radius")

    @property
    def vertices(self) -> Float[np.ndarray, "1 2"]:
        """The centre, as the one vertex of a polygon grown by `rounding`."""
        return np.array([self.center], dtype=float)

    @property
    def rounding(self) -> float:
        """The radius [m]."""
        return self.radius


Obstacle = Box | Polygon | Disc


def displaced(obstacle: Obstacle, by: tuple[float, float]) -> Obstacle:
    """The obstacle moved by (dx, dy) [m]."""
    if isinstance(obstacle, Polygon):
        return replace(obstacle, vertices=obstacle.vertices + np.array(by))
    return replace(obstacle, center=tuple(np.add(obstacle.center, by).tolist()))


def _require_area(area: float, name: str) -> None:
    if area < MINIMUM_AREA:
        found, least = limit_text(area, "m²"), limit_text(MINIMUM_AREA, "m²")
        raise TaskError(f"is degenerate: it gives an area of {found}, below {least}", (name,))


def _area(vertices: Float[np.ndarray, "k 2"]) -> float:
    return -polyline.signed_area(np.vstack([vertices, vertices[:1]]))


def counter_clockwise(vertices: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "k 2"]:
    """The vertices of a polygon in that sense."""
    return vertices[::-1].copy() if _area(vertices) < 0 else vertices


def check_convex(vertices: Float[np.ndarray, "k 2"], name: str) -> None:
    """Require of vertices [m], in either sense, that they are those of a convex polygon.

    Raises:
        TaskError: Of the key `name`: fewer than 3 vertices, two in one place, next to no area, or not convex.
    """
    if len(vertices) < 3:
        raise TaskError(f"must be at least 3 points, got {len(vertices)}", (name,))
    area = _area(vertices)
    _require_area(abs(area), name)
    edges = np.roll(vertices, -1, axis=0) - vertices
    lengths = np.linalg.norm(edges, axis=1)
    if lengths.min() < ROUNDING:
        i = int(np.argmin(lengths))
        raise TaskError(f"repeats the point {i} as point {(i + 1) % len(vertices)}", (name,))
    following = np.roll(edges, -1, axis=0)
    turns = np.sign(area) * (edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0])
    chords = np.linalg.norm(edges + following, axis=1)
    winding = np.arctan2(turns, np.sum(edges * following, axis=1)).sum()
    inward = turns < -ROUNDING * np.maximum(chords, ROUNDING)
    if inward.any() or abs(winding - 2 * np.pi) > 1e-6:
        where = f" at point {(int(np.argmin(turns)) + 1) % len(vertices)}" if inward.any() else ", its edges cross"
        raise TaskError(f"is not convex{where}; split it into convex parts", (name,))


def to_shapely(obstacle: Obstacle) -> shapely.Polygon:
    """The obstacle for Shapely; a disc becomes a polygon of 256 sides (0.008% of its radius inside it)."""
    if isinstance(obstacle, Disc):
        return shapely.Point(obstacle.center).buffer(obstacle.radius, quad_segs=64)
    return shapely.Polygon(obstacle.vertices)


def describe(obstacle: Obstacle) -> str:
    """A few words for messages, such as 'box at (350, 300) mm'."""
    return f"{type(obstacle).__name__.lower()} at {place(obstacle.vertices.mean(axis=0))}"
