"""Clearance of moving polylines, outlines and discs from the obstacles and walls of a scene, with Shapely."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import shapely
from jaxtyping import Float, Integer

from cableway.core.time_limit import checkpoint
from cableway.scene.scene import Scene

SWEEP_STEP = 0.001
"""Largest move [m] of a vertex between two polylines that are measured."""


Measure = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Distance [m] of each of some lines (t, m, 2) from whatever it may meet, and the index of what is nearest."""


@dataclass(frozen=True)
class Closest:
    """Where something moving comes closest to anything.

    Attributes:
        distance: [m], negative by the depth of the deepest vertex inside an obstacle.
        row: Fractional row of the motion.
        obstacle: Index of it in the scene, walls after the obstacles.
        wanted: Distance wanted there [m].
    """

    distance: float
    row: float
    obstacle: int
    wanted: float = 0.0


def closest_approach(
    lines: Float[np.ndarray, "t m space"],
    measure: Measure,
    wanted: Float[np.ndarray, "t"] | float = 0.0,
    rate: float = 1.0,
) -> Closest:
    """Where a moving polyline is closest to anything, rows joined by straight motion of the vertices.

    Stretches between two rows are halved until no vertex moves more than `SWEEP_STEP` in one, but only where they
    could come closer than what is already found: distance changes no more than `rate` times what the vertices move.

    Args:
        lines: Its rows [m].
        measure: What it may meet, such as `to_scene`.
        wanted: Distance [m] wanted at each row, linear between rows; the place is found where it is kept the least.
        rate: As above.
    """
    wanted = np.broadcast_to(wanted, len(lines))
    rows = np.arange(len(lines))
    distance, obstacle = measure(lines)
    kept = distance - wanted
    row = int(np.argmin(kept))
    least, best = kept[row], Closest(float(distance[row]), float(row), int(obstacle[row]), float(wanted[row]))
    first, length = rows[:-1], np.linalg.norm(np.diff(lines, axis=0), axis=2).max(1, initial=0.0)
    length = length + np.abs(np.diff(wanted))
    at, before, after = first.astype(float), kept[:-1], kept[1:]
    share = 1.0
    while True:
        keep = (length > SWEEP_STEP) & ((before + after - rate * length) / 2 < least)
        if not keep.any():
            return best
        first, at, before, after = first[keep], at[keep], before[keep], after[keep]
        share, length = share / 2, length[keep] / 2
        f = (at + share - first)[:, None, None]
        distance, obstacle = measure((1 - f) * lines[first] + f * lines[first + 1])
        limits = np.interp(at + share, rows, wanted)
        kept = distance - limits
        k = int(np.argmin(kept))
        if kept[k] < least:
            least = kept[k]
            best = Closest(float(distance[k]), float(at[k] + share), int(obstacle[k]), float(limits[k]))
        first, length = np.tile(first, 2), np.tile(length, 2)
        at = np.concatenate([at, at + share])
        before, after = np.concatenate([before, kept]), np.concatenate([kept, after])


def to_scene(scene: Scene, above: float = 0.0, *, solid: bool = False) -> Measure:
    """`distances` from a scene."""
    return partial(distances, scene=scene, above=above, solid=solid)


def distances(
    lines: Float[np.ndarray, "t m 2"], scene: Scene, above: float = 0.0, *, solid: bool = False
) -> tuple[Float[np.ndarray, "t"], Integer[np.ndarray, "t"]]:
    """Distance [m] of each polyline, a single point where m = 1, as in `Closest`, and the obstacle that is nearest.

    An obstacle is measured only where the boxes about it and the polyline leave room for it to be nearer than what is
    found.

    Args:
        lines: The polylines [m].
        scene: Obstacles and walls.
        above: Height [m] of the polylines; what is no higher is not met.
        solid: Whether each polyline is the outline of something solid.
    """
    low, high = lines.min(1), lines.max(1)
    walls = np.hstack([low, scene.size - high])
    distance, nearest = walls.min(1), len(scene.solids) + walls.argmin(1)
    if scene.wall_height is not None and scene.wall_height <= above:
        distance = np.full(len(lines), np.inf)
    made = shapely.polygons if solid else shapely.linestrings
    curves = np.asarray(made(lines) if lines.shape[1] > 1 else shapely.points(lines[:, 0]))
    boxes = shapely.bounds(np.array(scene.solids, dtype=object)).reshape(-1, 4)
    for index, (obstacle, box) in enumerate(zip(scene.solids, boxes, strict=True)):
        checkpoint()
        height = scene.obstacles[index].height
        if height is not None and height <= above:
            continue
        rows = np.flatnonzero(np.maximum(box[:2] - high, low - box[2:]).max(1) < distance)
        gap = np.asarray(shapely.distance(curves[rows], obstacle))
        met = rows[gap == 0]
        gap[gap == 0] = -depths(lines[met], obstacle)
        nearer = gap < distance[rows]
        distance[rows[nearer]], nearest[rows[nearer]] = gap[nearer], index
    return distance, nearest


def depths(lines: Float[np.ndarray, "t m 2"], solid: shapely.Polygon) -> Float[np.ndarray, "t"]:
    """Depth [m] of the deepest vertex of each polyline inside a polygon; 0 where none is."""
    inside = shapely.contains_xy(solid, lines[..., 0], lines[..., 1])
    return np.where(inside, shapely.distance(shapely.points(lines), solid.exterior), 0.0).max(1)
