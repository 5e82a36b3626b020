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

    Between two rows in-betweens are measured no farther apart than `SWEEP_STEP`, but only where they could come
    closer than what is already found.
    """
    distance, obstacle = _distances(lines, scene)
    moves = np.linalg.norm(np.diff(lines, axis=0), axis=2).max(1, initial=0.0)
    row = int(np.argmin(distance))
    best = Closest(float(distance[row]), float(row), int(obstacle[row]))
    bounds = np.minimum(distance[:-1], distance[1:]) - moves / 2
    for t in np.argsort(bounds, kind="stable"):
        if bounds[t] >= best.distance:
            break
        count = int(np.ceil(moves[t] / SWEEP_STEP))
        if count < 2:
            continue
        f = np.arange(1, count) / count
        between = lines[t] + f[:, None, None] * (lines[t + 1] - lines[t])
        d, index = _distances(between, scene)
        k = int(np.argmin(d))
        if d[k] < best.distance:
            best = Closest(float(d[k]), float(t + f[k]), int(index[k]))
    return best


def _distances(lines: np.ndarray, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Distance (t,) of each polyline (t, m, 2), a single point where m = 1, and the obstacle that is nearest.

    An obstacle is measured only where the circle about it leaves room for it to be nearer than what is found.
    """
    x, y = lines[..., 0], lines[..., 1]
    width, height = scene.size
    walls = np.array([x.min(1), y.min(1), (width - x).min(1), (height - y).min(1)])
    distance, nearest = walls.min(0), len(scene.solids) + walls.argmin(0)
    points = np.asarray(shapely.points(lines))
    curves = np.asarray(shapely.linestrings(lines)) if lines.shape[1] > 1 else points[:, 0]
    longest = np.linalg.norm(np.diff(lines, axis=1), axis=2).max(initial=0.0)
    for index, solid in enumerate(scene.solids):
        center = shapely.get_coordinates(solid.centroid)[0]
        radius = np.linalg.norm(shapely.get_coordinates(solid.exterior) - center, axis=1).max()
        off = np.hypot(x - center[0], y - center[1]).min(1) - longest / 2 - radius
        rows = np.flatnonzero(off < distance)
        if not len(rows):
            continue
        gap = np.asarray(shapely.distance(curves[rows], solid))
        inside = shapely.contains_xy(solid, x[rows], y[rows])
        hit = inside.any(1)
        if hit.any():
            depth = shapely.distance(points[rows[hit]], solid.exterior)
            gap[hit] = -np.where(inside[hit], depth, 0.0).max(1)
        nearer = gap < distance[rows]
        distance[rows[nearer]], nearest[rows[nearer]] = gap[nearer], index
    return distance, nearest
