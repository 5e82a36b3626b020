"""Convex obstacles in space: boxes, cylinders, spheres, hulls of points, and obstacles of the plane with their heights.

The world's z points up and the table is at z = 0. Each record gives the `Solid` that the compiled kernels read.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from jaxtyping import Float

from cableway.core.errors import TaskError
from cableway.core.quantities import limit_text, place
from cableway.geometry import rotations
from cableway.geometry.spatial_convex import Solid
from cableway.scene import checks, obstacles
from cableway.scene.checks import Coordinate, Extent, Quantity
from cableway.scene.obstacles import Disc, Obstacle

Place = Annotated[tuple[Coordinate, Coordinate, Coordinate], "[x, y, z]"]
Part = Annotated[float, Quantity("", -1.001, 1.001)]
Quaternion = Annotated[tuple[Part, Part, Part, Part], "a unit quaternion [w, x, y, z]"]
Direction = Annotated[tuple[Part, Part, Part], "a direction [x, y, z]"]

THINNEST = 1e-4
"""Least extent [m] of an obstacle."""

MOST_POINTS = 2000
"""Of a mesh, corners of its hull."""

UNIT = 1e-3
"""By which the length of a quaternion or a direction may differ from 1; it is then made 1."""


@dataclass(frozen=True, kw_only=True)
class Cuboid:
    """A box.

    Attributes:
        center: (x, y, z) [m].
        size: Lengths [m] of its edges along its own axes.
        orientation: Unit quaternion (w, x, y, z) of its axes.

    Raises:
        TaskError: A value is not finite or out of range, or the quaternion is not of length 1.
    """

    center: Place
    size: Annotated[tuple[Extent, Extent, Extent], "[along x, y, z]"]
    orientation: Quaternion = (1.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", checks.numbers(self.center, ("center",), (checks.COORDINATE,) * 3))
        object.__setattr__(self, "size", checks.numbers(self.size, ("size",), (THICKNESS,) * 3))
        object.__setattr__(self, "orientation", unit(self.orientation, 4, ("orientation",)))

    @property
    def solid(self) -> Solid:
        """For the kernels."""
        return Solid.box(np.array(self.center), np.array(self.size), axes_of(self.orientation))


@dataclass(frozen=True, kw_only=True)
class Cylinder:
    """A cylinder with flat ends.

    Attributes:
        center: (x, y, z) of its middle [m].
        radius: [m].
        height: From end to end [m].
        axis: Its direction, of length 1.

    Raises:
        TaskError: A value is not finite or out of range, or the axis is not of length 1.
    """

    center: Place
    radius: Extent
    height: Extent
    axis: Direction = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", checks.numbers(self.center, ("center",), (checks.COORDINATE,) * 3))
        for name in ("radius", "height"):
            object.__setattr__(self, name, THICKNESS(getattr(self, name), (name,)))
        object.__setattr__(self, "axis", unit(self.axis, 3, ("axis",)))

    @property
    def solid(self) -> Solid:
        """For the kernels."""
        third = np.array(self.axis)
        first = np.cross(third, np.eye(3)[int(np.argmin(np.abs(third)))])
        first /= np.linalg.norm(first)
        axes = np.stack([first, np.cross(third, first), third])
        return Solid.cylinder(np.array(self.center), self.radius, self.height, axes)


@dataclass(frozen=True, kw_only=True)
class Sphere:
    """A ball.

    Attributes:
        center: (x, y, z) [m].
        radius: [m].

    Raises:
        TaskError: A value is not finite or out of range.
    """

    center: Place
    radius: Extent

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", checks.numbers(self.center, ("center",), (checks.COORDINATE,) * 3))
        object.__setattr__(self, "radius", THICKNESS(self.radius, ("radius",)))

    @property
    def solid(self) -> Solid:
        """For the kernels."""
        return Solid.sphere(np.array(self.center), self.radius)


@dataclass(frozen=True, kw_only=True, eq=False)
class ConvexMesh:
    """The convex hull of points.

    Attributes:
        points: (k, 3) [m]; those inside the hull are left out.

    Raises:
        TaskError: They are fewer than 4, not finite, in one plane, or more than `MOST_POINTS` corners.
    """

    points: Float[np.ndarray, "k 3"]

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", corners(self.points, ("points",)))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ConvexMesh) and np.array_equal(self.points, other.points)

    def __hash__(self) -> int:
        return hash(self.points.tobytes())

    @property
    def solid(self) -> Solid:
        """For the kernels."""
        return Solid.hull(self.points)


@dataclass(frozen=True, kw_only=True)
class Prism:
    """An obstacle of the plane that stands on the table, as high as its `height` says; without one it never ends.

    Attributes:
        section: The obstacle, from above.
    """

    section: Obstacle

    @property
    def solid(self) -> Solid:
        """For the kernels."""
        height = math.inf if self.section.height is None else self.section.height
        middle = np.array([0.0, 0.0, 0.0 if math.isinf(height) else height / 2])
        return Solid.extruded(self.section.vertices, middle, height / 2, self.section.rounding)


SpatialObstacle = Cuboid | Cylinder | Sphere | ConvexMesh | Prism


def displaced(obstacle: SpatialObstacle, by: tuple[float, float, float]) -> SpatialObstacle:
    """The obstacle moved by (dx, dy, dz) [m].

    Raises:
        TaskError: It stands on the table, and is to be raised.
    """
    if isinstance(obstacle, Prism):
        if by[2]:
            raise TaskError(f"({describe(obstacle)}) stands on the table, where it can be moved by x and y alone")
        return Prism(section=obstacles.displaced(obstacle.section, by[:2]))
    if isinstance(obstacle, ConvexMesh):
        return ConvexMesh(points=obstacle.points + np.array(by))
    return replace(obstacle, center=tuple(np.add(obstacle.center, by).tolist()))


THICKNESS = Quantity("m", THINNEST, 50.0)


def unit(value: object, count: int, where: tuple[str, ...]) -> tuple[float, ...]:
    """`value` as `count` numbers of length 1.

    Raises:
        TaskError: It is not; a length that is `UNIT` off is made 1.
    """
    numbers = checks.numbers(value, where, (Quantity("", -1.0 - UNIT, 1.0 + UNIT),) * count)
    size = length(numbers)
    if abs(size - 1) > UNIT:
        raise TaskError(f"must have length 1, got {size:.4g}", where)
    exact = abs(size - 1) < 4e-16  # as it is written by cableway itself
    return numbers if exact else tuple(number / size for number in numbers)


def length(numbers: Iterable[float]) -> float:
    """The length of a vector, to the last digit the same on every processor; NumPy's is not."""
    return math.sqrt(math.fsum(number * number for number in numbers))


def corners(points: object, where: tuple[str, ...]) -> Float[np.ndarray, "k 3"]:
    """The corners of the convex hull of points [m], in their order.

    Raises:
        TaskError: They are fewer than 4, not finite, next to flat, or too many.
    """
    from scipy.spatial import ConvexHull, QhullError  # here, since planar tasks are read without it

    rows = checks.rows(points, where, (checks.COORDINATE,) * 3)
    if len(rows) < 4:
        raise TaskError(f"must be at least 4 points, got {len(rows)}", where)
    try:
        hull = ConvexHull(rows)
    except QhullError:
        raise TaskError("must not all lie in one plane", where) from None
    if hull.volume < THINNEST**3:
        raise TaskError(f"is degenerate: the hull is flatter than {limit_text(THINNEST)}", where)
    kept = rows[np.sort(hull.vertices)]
    if len(kept) > MOST_POINTS:
        raise TaskError(f"must be at most {MOST_POINTS} corners of a hull, got {len(kept)}", where)
    kept.setflags(write=False)
    return kept


def axes_of(orientation: tuple[float, ...]) -> Float[np.ndarray, "3 3"]:
    """The axes of a frame as rows, as `Solid` takes them."""
    return rotations.matrices(np.array(orientation)).T


def describe(obstacle: SpatialObstacle) -> str:
    """A short text that tells an obstacle from the others.

    >>> describe(Sphere(center=(0.1, 0.2, 0.3), radius=0.05))
    'sphere at (100, 200, 300) mm, radius 50 mm'
    """
    if isinstance(obstacle, Prism):
        height = obstacle.section.height
        tall = "of unlimited height" if height is None else f"{limit_text(height)} high"
        kind = "cylinder" if isinstance(obstacle.section, Disc) else "prism"
        return f"{kind} {tall} on a {obstacles.describe(obstacle.section)}"
    if isinstance(obstacle, ConvexMesh):
        return f"mesh of {len(obstacle.points)} corners about {place(obstacle.points.mean(axis=0))}"
    if isinstance(obstacle, Cuboid):
        return f"box at {place(obstacle.center)}"
    kind = type(obstacle).__name__.lower()
    return f"{kind} at {place(obstacle.center)}, radius {limit_text(obstacle.radius)}"
