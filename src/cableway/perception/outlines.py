"""Convex outlines of what stands in cells of a table.

Cells that touch are one thing. Where its convex hull would cover what is seen to be free it is cut in two through the
deepest such place, and the parts again (after J.-M. Lien and N. Amato, "Approximate convex decomposition of polygons",
2006, with cuts by straight lines).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
from jaxtyping import Bool, Float
from scipy.ndimage import distance_transform_edt, find_objects, label
from shapely.geometry.base import BaseGeometry

CUTS = 24
"""Directions among which that of a cut is chosen: the one that leaves the least area in the two hulls."""

PARTS = 64
"""Of one thing at most; what is left then is covered by hulls, free or not."""

DIAGONALS = np.ones((3, 3), int)
"""Cells touch at corners, too."""


def things(there: Bool[np.ndarray, "k l"], least: int) -> list[Bool[np.ndarray, "k l"]]:
    """The groups of cells that touch, those of fewer than `least` cells left out."""
    numbers = np.empty(there.shape, np.int64)
    label(there, DIAGONALS, output=numbers)
    counts = np.bincount(numbers.ravel())
    return [numbers == number for number in range(1, len(counts)) if counts[number] >= least]


def convex_parts(
    thing: Bool[np.ndarray, "k l"], free: Bool[np.ndarray, "k l"], depth: float
) -> Iterator[Bool[np.ndarray, "k l"]]:
    """Parts of one thing whose convex hulls cover no free cell that is farther than `depth` [cells] inside.

    Args:
        thing: Its cells.
        free: Cells that are seen to be free.
        depth: How far from the part a free cell is that its hull may not cover.
    """
    waiting, done = [thing], 0
    while waiting:
        part = waiting.pop()
        halves = None if done + len(waiting) >= PARTS else _halves(part, free, depth)
        if halves is None:
            done += 1
            yield part
        else:
            waiting += halves


def hull(points: Float[np.ndarray, "k 2"]) -> BaseGeometry:
    """The convex hull."""
    return shapely.MultiPoint(points).convex_hull


def _halves(
    part: Bool[np.ndarray, "k l"], free: Bool[np.ndarray, "k l"], depth: float
) -> list[Bool[np.ndarray, "k l"]] | None:
    """The part cut through the deepest free place in its hull; None where there is none."""
    rows, columns = find_objects(part.astype(np.int8))[0]
    cells = np.argwhere(part[rows, columns]).astype(float)
    inside = free[rows, columns] & _within(hull(cells), part[rows, columns].shape)
    if not inside.any():
        return None
    away = np.where(inside, np.asarray(distance_transform_edt(~part[rows, columns])), 0.0)
    at = np.array(np.unravel_index(int(np.argmax(away)), away.shape), float)
    if away.max() <= depth:
        return None
    best, least = None, np.inf
    for angle in np.arange(CUTS) * (np.pi / CUTS):
        side = (cells - at) @ (np.cos(angle), np.sin(angle)) >= 0
        if side.all() or not side.any():
            continue
        area = hull(cells[side]).area + hull(cells[~side]).area
        if area < least:
            best, least = side, area
    if best is None:
        return None
    halves = []
    for chosen in (best, ~best):
        half = np.zeros_like(part)
        at_rows, at_columns = cells[chosen].astype(int).T
        half[rows.start + at_rows, columns.start + at_columns] = True
        halves.append(half)
    return halves


def _within(area: shapely.Geometry, shape: tuple[int, int]) -> Bool[np.ndarray, "k l"]:
    """Which cells have their middle in an area."""
    rows, columns = np.indices(shape)
    return shapely.contains_xy(area, rows.ravel(), columns.ravel()).reshape(shape)
