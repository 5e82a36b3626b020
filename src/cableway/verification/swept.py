"""Clearance of moving polylines and discs from the obstacles and walls of a scene, with Shapely."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Float

from cableway.scene.scene import Scene

SWEEP_STEP = 0.001
"""Largest move [m] of a vertex between two polylines that are measured."""


@dataclass(frozen=True)
class Closest:
    """Where something moving comes closest to anything.

    Attributes:
        distance: [m], negative by the depth of the deepest vertex inside an obstacle.
        row: Fractional row of the motion.
        obstacle: Index in the scene, walls after the obstacles.
    """

    distance: float
    row: float
    obstacle: int


def closest_approach(lines: Float[np.ndarray, "t m 2"], scene: Scene) -> Closest:
    """Least distance of a moving polyline to anything, rows joined by straight motion of the vertices.

    Stretches between two rows are halved until no vertex moves more than `SWEEP_STEP` in one, but only where they
    could come closer than what is already found: distance changes no faster than the vertices move.
    """
    distance, obstacle = _distances(lines, scene)
    row = int(np.argmin(distance))
    best = Closest(float(distance[row]), float(row), int(obstacle[row]))
    first, length = np.arange(len(lines) - 1), np.linalg.norm(np.diff(lines, axis=0), axis=2).max(1, initial=0.0)
    at, before, after = first.astype(float), distance[:-1], distance[1:]
    share = 1.0
    while True:
        keep = (length > SWEEP_STEP) & ((before + after - length) / 2 < best.distance)
        if not keep.any():
            return best
        first, at, before, after = first[keep], at[keep], before[keep], after[keep]
        share, length = share / 2, length[keep] / 2
        f = (at + share - first)[:, None, None]
        distance, obstacle = _distances((1 - f) * lines[first] + f * lines[first + 1], scene)
        k = int(np.argmin(distance))
        if distance[k] < best.distance:
            best = Closest(float(distance[k]), float(at[k] + share), int(obstacle[k]))
        first, length = np.tile(first, 2), np.tile(length, 2)
        at = np.concatenate([at, at + share])
        before, after = np.concatenate([before, distance]), np.concatenate([distance, after])


def _distances(lines: np.ndarray, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Distance (t,) of each polyline (t, m, 2), a single point where m = 1, and the obstacle that is nearest.

    An obstacle is measured only where the boxes about it and the polyline leave room for it to be nearer than what is
    found.
    """
    low, high = lines.min(1), lines.max(1)
    walls = np.hstack([low, scene.size - high])
    distance, nearest = walls.min(1), len(scene.solids) + walls.argmin(1)
    curves = np.asarray(shapely.linestrings(lines) if lines.shape[1] > 1 else shapely.points(lines[:, 0]))
    boxes = shapely.bounds(np.array(scene.solids, dtype=object)).reshape(-1, 4)
    for index, (solid, box) in enumerate(zip(scene.solids, boxes, strict=True)):
        rows = np.flatnonzero(np.maximum(box[:2] - high, low - box[2:]).max(1) < distance)
        gap = np.asarray(shapely.distance(curves[rows], solid))
        met = rows[gap == 0]
        gap[gap == 0] = -_depth(lines[met], solid)
        nearer = gap < distance[rows]
        distance[rows[nearer]], nearest[rows[nearer]] = gap[nearer], index
    return distance, nearest


def _depth(lines: np.ndarray, solid: shapely.Polygon) -> np.ndarray:
    """Depth (t,) of the deepest vertex of each polyline inside an obstacle."""
    inside = shapely.contains_xy(solid, lines[..., 0], lines[..., 1])
    return np.where(inside, shapely.distance(shapely.points(lines), solid.exterior), 0.0).max(1)
