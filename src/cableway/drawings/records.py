"""What was understood of a drawing or a model."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import shapely
from jaxtyping import Float

from cableway.core.errors import FileFormatError, InputError
from cableway.core.quantities import place, quantity
from cableway.drawings.curves import MOST_POINTS
from cableway.scene.obstacles import MINIMUM_AREA

Circle = tuple[float, float, float]
"""Centre x, y and radius [m]."""

Rectangle = tuple[float, float, float, float]
"""Left, lower edge, width and height [m]."""

UNITS = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "um": 1e-6, "in": 0.0254, "ft": 0.3048}
"""Metres in a unit of length."""

TOLERANCE = 0.0005
"""Distance [m] by which outlines are off at most, by default: an eighth of the clearance of a plan."""

MOST_OUTLINES = 1000
"""Of a drawing."""

FARTHEST = 1000.0
"""Largest coordinate [m]: twenty times the largest workspace."""


@dataclass(frozen=True, eq=False)
class Outline:
    """A closed outline, seen from above.

    Attributes:
        name: As it is called in the file.
        region: What it holds [m], x to the right and y up.
        circle: The same where it is a circle.
        height: Of what stands there, above the table [m]; None where nothing passes above.
    """

    name: str
    region: shapely.Polygon
    circle: Circle | None = None
    height: float | None = None


@dataclass(frozen=True)
class LeftOut:
    """Something that was not understood, or is no obstacle.

    Attributes:
        name: As it is called in the file.
        why: A few words.
        at: Where it is drawn [m]; None where that is not known.
    """

    name: str
    why: str
    at: shapely.Geometry | None = None

    def __str__(self) -> str:
        return f"{self.name}: {self.why}"


@dataclass(frozen=True, eq=False)
class Drawing:
    """What was understood of a file.

    Attributes:
        outlines: Of what stands there.
        left_out: What is not among them.
        page: The sheet that it is drawn on; None where there is none.
        unit: The unit of the file and who says so.
    """

    outlines: tuple[Outline, ...]
    left_out: tuple[LeftOut, ...]
    page: Rectangle | None
    unit: str


@dataclass(kw_only=True)
class Found:
    """Outlines on the way through a file.

    Attributes:
        path: The file.
        outlines: So far.
        left_out: What is not among them.
    """

    path: Path
    outlines: list[Outline] = field(default_factory=list)
    left_out: list[LeftOut] = field(default_factory=list)

    def add(self, found: Outline | LeftOut) -> None:
        """Take one up.

        Raises:
            InputError: They are too many.
        """
        if isinstance(found, LeftOut):
            self.left_out.append(found)
            return
        self.outlines.append(found)
        if len(self.outlines) > MOST_OUTLINES:
            raise InputError(f"{self.path}: it has more than {MOST_OUTLINES} outlines")


def circle_outline(name: str, circle: Circle, height: float | None = None) -> Outline:
    """An outline that is a circle."""
    x, y, radius = circle
    return Outline(name, shapely.Point(x, y).buffer(radius, quad_segs=64), circle, height)


def require_points(name: str, points: Float[np.ndarray, "k 2"], source: object) -> None:
    """Check what becomes an outline [m].

    Raises:
        FileFormatError: Points are too many, or not finite, or too far away.
    """
    if len(points) > MOST_POINTS:
        raise FileFormatError(f"{source}: {name} has {len(points)} points; it may have {MOST_POINTS} at this tolerance")
    if not (np.abs(points) <= FARTHEST).all():
        raise FileFormatError(f"{source}: {name} is farther than {FARTHEST:g} m from the origin: is the unit right?")


def closed_outline(name: str, points: Float[np.ndarray, "k 2"], source: object) -> Outline | LeftOut:
    """The outline of a closed line [m], or why there is none.

    Raises:
        InputError: The line crosses itself.
        FileFormatError: See `require_points`.
    """
    require_points(name, points, source)
    line = shapely.remove_repeated_points(shapely.LineString(points)) if len(points) > 1 else None
    if line is None or len(line.coords) < 4:
        return LeftOut(name, "no area", line)
    area = shapely.Polygon(line)
    if area.convex_hull.area < MINIMUM_AREA:
        return LeftOut(name, "no area", line)
    if not area.is_valid:
        raise InputError(f"{source}: {name} crosses or touches itself: {shapely.is_valid_reason(area)[:80]} [m]")
    return Outline(name, area)


def told_once(outlines: Iterable[Outline], source: object) -> tuple[list[Outline], list[LeftOut]]:
    """The outlines without those drawn twice.

    Raises:
        InputError: One lies in another, which is a hole or the edge of the table.
    """
    kept: list[Outline] = []
    twice: list[LeftOut] = []
    for outline in outlines:
        if any(outline.region.equals_exact(other.region, 1e-9, normalize=True) for other in kept):
            twice.append(LeftOut(outline.name, "drawn twice", outline.region))
        else:
            kept.append(outline)
    _refuse_holes(kept, source)
    return kept, twice


def _refuse_holes(outlines: Sequence[Outline], source: object) -> None:
    areas = np.array([outline.region for outline in outlines], dtype=object)
    tree = shapely.STRtree(areas)
    inner, outer = tree.query(areas, predicate="covered_by")
    for k, j in zip(inner.tolist(), outer.tolist(), strict=True):
        if k != j:
            hole, around = outlines[k], outlines[j]
            at = place(shapely.get_coordinates(hole.region.centroid)[0])
            raise InputError(
                f"{source}: {hole.name}, at {at}, lies in {around.name}, and an obstacle has no holes: if the outer "
                "one is the edge of the table, name it by --frame; else draw it in parts, or leave one of the two out"
            )


def framed(outlines: Sequence[Outline], frame: str, source: object) -> tuple[list[Outline], Rectangle]:
    """The outlines without the one that is the edge of the table, and its extent.

    Args:
        outlines: All.
        frame: A word of its name: an id, a label or a layer.
        source: The file.

    Raises:
        InputError: None or several are called so, or it is no rectangle along the axes.
    """
    named = [outline for outline in outlines if frame in outline.name.replace("'", " ").replace(",", " ").split()]
    if len(named) != 1:
        known = ", ".join(outline.name for outline in outlines[:8]) or "none"
        raise InputError(f"{source}: --frame {frame}: {len(named)} outlines are called so; there are: {known}")
    area = named[0].region
    left, low, right, high = area.bounds
    lacking = shapely.box(left, low, right, high).difference(area.buffer(1e-4)).area
    if lacking > MINIMUM_AREA:
        raise InputError(
            f"{source}: --frame: {named[0].name} is no rectangle along the axes, {quantity(right - left)} x "
            f"{quantity(high - low)} about it"
        )
    return [outline for outline in outlines if outline is not named[0]], (
        left,
        low,
        round(right - left, 6),
        round(high - low, 6),
    )
