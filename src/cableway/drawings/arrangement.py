"""From outlines to a scene."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
import shapely.affinity

from cableway.core.errors import InputError
from cableway.core.quantities import size_text
from cableway.drawings.convex_parts import convex_parts
from cableway.drawings.records import Circle, Drawing, LeftOut, Outline, Rectangle
from cableway.scene.obstacles import MINIMUM_AREA, Disc, Obstacle, Polygon
from cableway.scene.scene import Scene

ROOM = 0.15
"""Room [m] about outlines on a sheet without an edge: half the length of a cable."""

GRID = 1e-5
"""Vertices are whole numbers of it [m]."""

MOST_OBSTACLES = 1000
"""Of a scene; with more, a plan takes minutes."""


@dataclass(frozen=True, eq=False)
class Arrangement:
    """A scene from outlines.

    Attributes:
        scene: Obstacles, which are convex, in a workspace.
        outlines: Which they are from, in the coordinates of the scene [m].
        left_out: What became no obstacle.
        corner: Lower left corner of the workspace in the file [m].
    """

    scene: Scene
    outlines: tuple[Outline, ...]
    left_out: tuple[LeftOut, ...]
    corner: tuple[float, float]


def arranged(drawing: Drawing, tolerance: float, workspace: Rectangle | None = None) -> Arrangement:
    """The scene of a drawing.

    Args:
        drawing: The drawing.
        tolerance: By how much [m] obstacles may be off the outlines.
        workspace: What of it is the workspace; by default its page, or what holds all outlines and some room.

    Raises:
        InputError: There is no outline in the workspace, or it takes too many obstacles.
    """
    x, y, width, height = workspace or drawing.page or _about(drawing)
    inside, obstacles, outlines, gone = shapely.box(0.0, 0.0, width, height), list[Obstacle](), list[Outline](), []
    for outline in drawing.outlines:
        moved = _moved(outline, x, y)
        kept = moved.region.intersection(inside)
        if kept.area < MINIMUM_AREA:
            gone.append(LeftOut(outline.name, "outside the workspace", moved.region))
            continue
        if kept.area < moved.region.area - MINIMUM_AREA:
            gone.append(LeftOut(outline.name, "cut off at the edge of the workspace", moved.region.difference(inside)))
            moved = replace(moved, circle=None)
        outlines.append(moved)
        obstacles += _obstacles(moved, kept, tolerance, (width, height))
    if not obstacles:
        raise InputError(f"there is no outline in the workspace, {size_text((width, height))}")
    if len(obstacles) > MOST_OBSTACLES:
        raise InputError(f"it takes {len(obstacles)} convex obstacles; with a larger --tolerance it takes fewer")
    left_out = (*(replace(each, at=_shifted(each.at, x, y)) for each in drawing.left_out), *gone)
    return Arrangement(Scene((width, height), tuple(obstacles)), tuple(outlines), left_out, (x, y))


def _about(drawing: Drawing) -> Rectangle:
    if not drawing.outlines:
        raise InputError("there is no closed outline in it")
    left, low, right, high = shapely.total_bounds([outline.region for outline in drawing.outlines]).round(4).tolist()
    return left - ROOM, low - ROOM, right - left + 2 * ROOM, high - low + 2 * ROOM


def _shifted(shape: shapely.Geometry | None, x: float, y: float) -> shapely.Geometry | None:
    return None if shape is None else shapely.affinity.translate(shape, -x, -y)


def _moved(outline: Outline, x: float, y: float) -> Outline:
    circle: Circle | None = None
    if outline.circle is not None:
        circle = (outline.circle[0] - x, outline.circle[1] - y, outline.circle[2])
    return replace(outline, region=_shifted(outline.region, x, y), circle=circle)


def _obstacles(outline: Outline, kept: shapely.Geometry, tolerance: float, size: tuple[float, float]) -> list[Obstacle]:
    """What stands for the part of an outline that is inside a workspace of a size [m]."""
    if outline.circle is not None:
        x, y, radius = np.round(outline.circle, 6).tolist()
        return [Disc(center=(x, y), radius=radius, height=outline.height)]
    found: list[Obstacle] = []
    for piece in shapely.get_parts(kept):
        if not isinstance(piece, shapely.Polygon):
            continue
        try:
            parts = convex_parts(piece, tolerance)
        except InputError as error:
            raise InputError(f"{outline.name}: {error}") from None
        for part in parts:
            hull = shapely.set_precision(part, GRID).convex_hull
            if isinstance(hull, shapely.Polygon) and hull.area >= MINIMUM_AREA:
                vertices = shapely.get_coordinates(hull.exterior)[:-1].round(6).clip(0.0, size)
                found.append(Polygon(vertices=vertices, height=outline.height))
    return found
