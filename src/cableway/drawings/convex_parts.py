"""Convex parts of an outline.

Where its convex hull would cover what is free, an outline is cut in two through the deepest such place, and the parts
again (after J.-M. Lien and N. Amato, "Approximate convex decomposition of polygons", 2006, with straight cuts).
`cableway.perception.outlines` does the same with cells.
"""

from __future__ import annotations

import numpy as np
import shapely
import shapely.ops
from jaxtyping import Float

from cableway.core.errors import InputError

CUTS = 12
"""Directions of a cut besides those of the edges that meet where it begins; the one that leaves the least area in the
two hulls is taken."""

MOST_PARTS = 300
"""Of one outline."""

BEYOND = 1e-7
"""How far a cut reaches beyond the outline [m], so that rounding leaves no bridge."""


def convex_parts(outline: shapely.Polygon, tolerance: float) -> list[shapely.Polygon]:
    """Convex outlines that cover one together, and beyond it only notches no deeper than `tolerance`.

    Args:
        outline: Simple and without holes [m].
        tolerance: [m].

    Raises:
        InputError: They are more than `MOST_PARTS`.

    >>> corner = shapely.Polygon([(0, 0), (2, 0), (2, 1), (1, 1), (1, 3), (0, 3)])
    >>> sorted(part.area for part in convex_parts(corner, 0.01))
    [2.0, 2.0]
    """
    waiting, done = [shapely.orient_polygons(outline)], []
    while waiting:
        part = waiting.pop()
        vertex, depth = _deepest_notch(part)
        halves = _halves(part, vertex) if depth > tolerance else []
        if not halves:
            done.append(part.convex_hull)
        waiting += halves
        if len(done) + len(waiting) > MOST_PARTS:
            raise InputError(f"it takes more than {MOST_PARTS} convex parts; with a larger --tolerance it takes fewer")
    return done


def _ring(part: shapely.Polygon) -> Float[np.ndarray, "k 2"]:
    return shapely.get_coordinates(part.exterior)[:-1]


def _deepest_notch(part: shapely.Polygon) -> tuple[int, float]:
    """The vertex that is deepest in a notch, and how deep: its distance from the edge of the hull before the notch."""
    ring, hull = _ring(part), part.convex_hull
    corners = {tuple(corner) for corner in shapely.get_coordinates(hull)}
    on_hull = [k for k, vertex in enumerate(ring.tolist()) if tuple(vertex) in corners]
    deepest, most = 0, 0.0
    for first, last in zip(on_hull, [*on_hull[1:], on_hull[0] + len(ring)], strict=True):
        between = np.arange(first + 1, last) % len(ring)
        if not len(between):
            continue
        lid = ring[last % len(ring)] - ring[first]
        away = ring[between] - ring[first]
        depths = np.abs(lid[0] * away[:, 1] - lid[1] * away[:, 0]) / max(float(np.linalg.norm(lid)), 1e-12)
        if depths.max() > most:
            deepest, most = int(between[np.argmax(depths)]), float(depths.max())
    return deepest, most


def _halves(part: shapely.Polygon, vertex: int) -> list[shapely.Polygon]:
    """The part cut at a vertex; nothing where no cut is found."""
    ring = _ring(part)
    at, before, after = ring[vertex], ring[vertex - 1], ring[(vertex + 1) % len(ring)]
    angles = np.arange(CUTS) * np.pi / CUTS
    ways = [at - before, after - at, *np.column_stack([np.cos(angles), np.sin(angles)])]
    best: list[shapely.Polygon] = []
    least = np.inf
    for way in ways:
        halves = _cut(part, at, way / np.linalg.norm(way))
        area = sum(half.convex_hull.area for half in halves)
        if len(halves) > 1 and area < least - 1e-9:
            best, least = halves, area
    return best


def _cut(part: shapely.Polygon, at: Float[np.ndarray, "2"], way: Float[np.ndarray, "2"]) -> list[shapely.Polygon]:
    """The pieces of a part on either side of the line through a point, as far as that runs inside on from there."""
    left, low, right, high = part.bounds
    reach = right - left + high - low
    line = shapely.LineString([at - reach * way, at + reach * way])
    runs = [run for run in shapely.get_parts(part.intersection(line)) if isinstance(run, shapely.LineString)]
    point = shapely.Point(at)
    near = [run for run in runs if run.distance(point) <= BEYOND]
    if not near:
        return []
    along = (np.vstack([shapely.get_coordinates(run) for run in near]) - at) @ way
    cut = shapely.LineString([at + (along.min() - BEYOND) * way, at + (along.max() + BEYOND) * way])
    pieces = shapely.get_parts(shapely.ops.split(part, cut))
    return [piece for piece in pieces if isinstance(piece, shapely.Polygon) and piece.area > BEYOND**2]
