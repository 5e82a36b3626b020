"""Passages: where free space narrows between two obstacles, or an obstacle and a wall."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import shapely
from jaxtyping import Float

from cableway.core.time_limit import checkpoint
from cableway.records import Passage
from cableway.scene.scene import Scene

TIE = 1e-6
"""Distances [m] this close count as equal: parallel edges, obstacles that touch."""


def find_passages(scene: Scene) -> tuple[Passage, ...]:
    """The shortest segment between each two obstacles whose circumcircle no third obstacle touches (Tang et al.).

    Walls count as obstacles, but no passage lies between two walls. Between parallel edges the middle one of all
    shortest segments is taken. Obstacles that touch or overlap have no passage between them.
    """
    count = len(scene.obstacles)
    cores = [obstacle.vertices for obstacle in scene.obstacles] + _walls(scene.size)
    rounding = np.array([obstacle.rounding for obstacle in scene.obstacles] + [0.0] * 4)
    solids = np.array([shapely.Point(core[0]) if len(core) == 1 else shapely.Polygon(core) for core in cores])
    found = []
    for i, j in combinations(range(count + 4), 2):
        checkpoint()
        if i >= count or shapely.distance(solids[i], solids[j]) <= rounding[i] + rounding[j] + TIE:
            continue
        ends = _shortest_segment(cores[i], cores[j])
        direction = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        ends = ends + np.outer([rounding[i], -rounding[j]], direction)
        middle, half = ends.mean(axis=0), 0.5 * float(np.linalg.norm(ends[1] - ends[0]))
        distance = shapely.distance(solids, shapely.Point(middle)) - rounding
        if (np.delete(distance, [i, j]) > half + TIE).all():
            found.append(Passage(ends, (i, j)))
    return tuple(found)


def _walls(size: tuple[float, float]) -> list[np.ndarray]:
    """The walls left, bottom, right, top as rectangles outside the workspace."""
    w, h = size
    spans = [(-w, -h, 0, 2 * h), (-w, -h, 2 * w, 0), (w, -h, 2 * w, 2 * h), (-w, h, 2 * w, 2 * h)]
    return [np.array([[a, b], [c, b], [c, d], [a, d]], dtype=float) for a, b, c, d in spans]


def _shortest_segment(a: Float[np.ndarray, "k 2"], b: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "2 2"]:
    """The middle one of the shortest segments from one convex polygon to another apart from it."""
    pairs = np.concatenate([_feet(a, b), _feet(b, a)[:, ::-1]])
    length = np.linalg.norm(pairs[:, 1] - pairs[:, 0], axis=1)
    pairs = pairs[length <= length.min() + TIE]
    across = pairs[0, 1] - pairs[0, 0]
    along = pairs.mean(axis=1) @ np.array([-across[1], across[0]])
    return 0.5 * (pairs[np.argmin(along)] + pairs[np.argmax(along)])


def _feet(points: Float[np.ndarray, "k 2"], polygon: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "km 2 2"]:
    """Each vertex with its nearest point on each edge of a polygon."""
    start, edge = polygon, np.roll(polygon, -1, axis=0) - polygon
    offset = points[:, None] - start
    t = np.sum(offset * edge, axis=-1) / np.maximum(np.sum(edge**2, axis=-1), 1e-30)
    feet = start + np.clip(t, 0.0, 1.0)[..., None] * edge
    return np.stack(np.broadcast_arrays(points[:, None], feet), axis=2).reshape(-1, 2, 2)


def traversed_passages(passages: tuple[Passage, ...], path: Float[np.ndarray, "P 2"]) -> list[tuple[Passage, float]]:
    """The passages that a path goes through, with the arc length [m] of the crossing, in the path's order.

    A passage that the path leaves on the side from which it came is not traversed.
    """
    found = []
    for passage in passages:
        arcs, signs = crossings(path, passage.ends)
        if signs.sum() != 0:
            found.append((passage, float(arcs[np.argmax(signs == np.sign(signs.sum()))])))
    return sorted(found, key=lambda item: item[1])


def crossings(
    path: Float[np.ndarray, "P 2"], segment: Float[np.ndarray, "2 2"]
) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k"]]:
    """Where a path crosses a segment: arc lengths [m] on the path, and 1 where it crosses from right to left, else -1.

    A vertex on the segment belongs to its left, so passing through one counts once.
    """
    along = segment[1] - segment[0]
    offset = path - segment[0]
    side = along[0] * offset[:, 1] - along[1] * offset[:, 0]
    left = side >= 0
    k = np.flatnonzero(left[1:] != left[:-1])
    t = side[k] / (side[k] - side[k + 1])
    points = path[k] + t[:, None] * (path[k + 1] - path[k])
    position = (points - segment[0]) @ along / (along @ along)
    inside = (position >= 0) & (position <= 1)
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    arcs = np.concatenate([[0.0], np.cumsum(steps)])[k] + t * steps[k]
    return arcs[inside], np.where(left[k + 1], 1, -1)[inside]
