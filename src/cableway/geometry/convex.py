"""Convex obstacles packed for the compiled kernels, and signed distance to them and to the walls.

An obstacle is a convex polygon with its vertices counter-clockwise, grown by a rounding radius; a disc is one
vertex with a rounding. Signed distance is positive outside, and negative inside by the depth below the surface.
The walls of the workspace count as obstacles; their indices follow those of the obstacles in the order
left, bottom, right, top. What moves `above` a height meets only what is higher.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from cableway.core.compiled import kernel

WALLS = ("left wall", "bottom wall", "right wall", "top wall")

World = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class ConvexWorld:
    """Convex obstacles inside a rectangle, packed.

    Attributes:
        vertices: (k, v, 2) [m], counter-clockwise, rows past `counts` unused.
        counts: (k,) number of vertices of each obstacle.
        rounding: (k,) [m] by which each polygon is grown.
        size: (2,) [m] extent of the workspace, whose lower left corner is the origin.
        boxes: (k, 4) [m] least x and y and greatest x and y of each obstacle.
        heights: (k + 1,) [m] above the table, of each obstacle and of the walls.
    """

    vertices: Float[np.ndarray, "k v 2"]
    counts: Int[np.ndarray, "k"]
    rounding: Float[np.ndarray, "k"]
    size: Float[np.ndarray, "2"]
    boxes: Float[np.ndarray, "k 4"]
    heights: Float[np.ndarray, "k+1"]

    @property
    def arrays(self) -> World:
        """What the kernels take as `world`."""
        return self.vertices, self.counts, self.rounding, self.size, self.boxes, self.heights


def pack(
    polygons: Sequence[Float[np.ndarray, "_ 2"]],
    rounding: Sequence[float],
    size: Sequence[float],
    heights: Sequence[float] | None = None,
) -> ConvexWorld:
    """Pack convex polygons [m] (counter-clockwise) with their rounding radii [m] into a `ConvexWorld`.

    Heights [m] are those of all polygons and of the walls; unlimited where None.
    """
    most = max((len(polygon) for polygon in polygons), default=1)
    vertices, boxes = np.zeros((len(polygons), most, 2)), np.zeros((len(polygons), 4))
    for row, box, polygon, grown in zip(vertices, boxes, polygons, rounding, strict=True):
        row[: len(polygon)] = polygon
        box[:2], box[2:] = np.min(polygon, axis=0) - grown, np.max(polygon, axis=0) + grown
    counts = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
    heights = [math.inf] * (len(polygons) + 1) if heights is None else heights
    return ConvexWorld(
        vertices, counts, np.array(rounding, float), np.array(size, float), boxes, np.array(heights, float)
    )


def signed_distance(
    points: Float[np.ndarray, "... 2"],
    world: ConvexWorld,
    ceiling: float = math.inf,
    above: Float[np.ndarray, "..."] | float = 0.0,
) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "... 2"], Int[np.ndarray, "..."]]:
    """Signed distance [m] of points to the nearest obstacle or wall, its gradient, and which one that is.

    Where nothing is nearer than `ceiling` [m], that is the distance, the gradient is zero and the index -1: less work.
    `above` [m] is the height of each point, or of all.
    """
    points = np.asarray(points, float)
    flat = np.ascontiguousarray(points.reshape(-1, 2))
    shape = points.shape[:-1]
    lowest = np.broadcast_to(np.asarray(above, float), shape).ravel()
    d, gradient, index = _point_distances(flat, world.arrays, ceiling, lowest)
    return d.reshape(shape), gradient.reshape(points.shape), index.reshape(shape)


def polyline_distance(
    polylines: Float[np.ndarray, "b m 2"], world: ConvexWorld, above: float = 0.0
) -> tuple[Float[np.ndarray, "b"], Int[np.ndarray, "b"]]:
    """Least signed distance [m] over all points of each polyline, vertices and segments, and to which obstacle.

    Exact: along a segment the signed distance to a convex set is a convex function, so a segment that cuts
    through a corner is found, and by how much.
    """
    lines = np.ascontiguousarray(polylines, dtype=float)
    return _polyline_distances(lines, world.arrays, above)


@kernel
def convex_distance(px, py, polygon, count, rounding):
    """Signed distance of one point to one rounded convex polygon, and its gradient."""
    if count == 1:
        dx, dy = px - polygon[0, 0], py - polygon[0, 1]
        r = math.sqrt(dx * dx + dy * dy)
        if r < 1e-15:
            return -rounding, 1.0, 0.0
        return r - rounding, dx / r, dy / r
    inside, nearest, gx, gy = True, np.inf, 1.0, 0.0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        ex, ey = polygon[j, 0] - polygon[i, 0], polygon[j, 1] - polygon[i, 1]
        ox, oy = px - polygon[i, 0], py - polygon[i, 1]
        if ey * ox - ex * oy > 0.0:
            inside = False
        t = min(1.0, max(0.0, (ox * ex + oy * ey) / (ex * ex + ey * ey)))
        dx, dy = ox - t * ex, oy - t * ey
        d2 = dx * dx + dy * dy
        if d2 < nearest:
            nearest, gx, gy = d2, dx, dy
    r = math.sqrt(nearest)
    if not inside and r >= 1e-15:
        return r - rounding, gx / r, gy / r
    deepest, nx, ny = -np.inf, 1.0, 0.0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        ex, ey = polygon[j, 0] - polygon[i, 0], polygon[j, 1] - polygon[i, 1]
        edge = math.sqrt(ex * ex + ey * ey)
        outward = (ey * (px - polygon[i, 0]) - ex * (py - polygon[i, 1])) / edge
        if outward > deepest:
            deepest, nx, ny = outward, ey / edge, -ex / edge
    return min(deepest, 0.0) - rounding, nx, ny


@kernel
def wall_distance(px, py, size):
    """Signed distance of one point to the walls (positive inside the workspace), its gradient, which wall."""
    d, gx, gy, wall = px, 1.0, 0.0, 0
    if py < d:
        d, gx, gy, wall = py, 0.0, 1.0, 1
    if size[0] - px < d:
        d, gx, gy, wall = size[0] - px, -1.0, 0.0, 2
    if size[1] - py < d:
        d, gx, gy, wall = size[1] - py, 0.0, -1.0, 3
    return d, gx, gy, wall


@kernel
def box_gap(low_x, low_y, high_x, high_y, box):
    """A lower bound of the signed distance between anything in a rectangle and what a box holds."""
    return max(box[0] - high_x, low_x - box[2], box[1] - high_y, low_y - box[3])


@kernel
def nearest_obstacle(px, py, world, ceiling, above):
    """Signed distance of one point to everything, its gradient, and which is nearest; see `signed_distance`."""
    vertices, counts, rounding, size, boxes, heights = world
    d, gx, gy, index = ceiling, 0.0, 0.0, -1
    if heights[len(counts)] > above:
        dw, ux, uy, wall = wall_distance(px, py, size)
        if dw < d:
            d, gx, gy, index = dw, ux, uy, len(counts) + wall
    for k in range(len(counts)):
        if heights[k] > above and box_gap(px, py, px, py, boxes[k]) < d:
            dk, ux, uy = convex_distance(px, py, vertices[k], counts[k], rounding[k])
            if dk < d:
                d, gx, gy, index = dk, ux, uy, k
    return d, gx, gy, index


@kernel
def distance_at(px, py, world, above):
    """Signed distance of one point to everything higher than `above`."""
    vertices, counts, rounding, size, boxes, heights = world
    d = wall_distance(px, py, size)[0] if heights[len(counts)] > above else np.inf
    first, gap = -1, d
    for k in range(len(counts)):
        if heights[k] > above:
            gap_k = box_gap(px, py, px, py, boxes[k])
            if gap_k < gap:
                first, gap = k, gap_k
    if first >= 0:
        d = min(d, convex_distance(px, py, vertices[first], counts[first], rounding[first])[0])
    for k in range(len(counts)):
        if k != first and heights[k] > above and box_gap(px, py, px, py, boxes[k]) < d:
            d = min(d, convex_distance(px, py, vertices[k], counts[k], rounding[k])[0])
    return d


@kernel
def _point_distances(points, world, ceiling, above):
    m = len(points)
    d, gradient, index = np.empty(m), np.empty((m, 2)), np.empty(m, np.int64)
    for i in range(m):
        d[i], gradient[i, 0], gradient[i, 1], index[i] = nearest_obstacle(
            points[i, 0], points[i, 1], world, ceiling, above[i]
        )
    return d, gradient, index


@kernel
def _segment_point_squared(ax, ay, bx, by, px, py):
    ex, ey = bx - ax, by - ay
    squared = ex * ex + ey * ey
    t = 0.0
    if squared > 0.0:
        t = min(1.0, max(0.0, ((px - ax) * ex + (py - ay) * ey) / squared))
    dx, dy = px - ax - t * ex, py - ay - t * ey
    return dx * dx + dy * dy


@kernel
def _depth_along(ax, ay, bx, by, polygon, count):
    """Least over a segment of the largest signed distance to the edge lines: below 0 where it cuts the polygon."""
    best = np.inf
    slopes, starts = np.empty(count), np.empty(count)
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        ex, ey = polygon[j, 0] - polygon[i, 0], polygon[j, 1] - polygon[i, 1]
        edge = math.sqrt(ex * ex + ey * ey)
        starts[i] = (ey * (ax - polygon[i, 0]) - ex * (ay - polygon[i, 1])) / edge
        slopes[i] = (ey * (bx - polygon[i, 0]) - ex * (by - polygon[i, 1])) / edge - starts[i]
    for i in range(count):
        for j in range(-2, i):
            if j < 0:
                t = float(j + 2)
            else:
                change = slopes[i] - slopes[j]
                if change == 0.0:
                    continue
                t = (starts[j] - starts[i]) / change
                if t < 0.0 or t > 1.0:
                    continue
            top = -np.inf
            for k in range(count):
                top = max(top, starts[k] + t * slopes[k])
            best = min(best, top)
    return best


@kernel
def segment_distance(ax, ay, bx, by, polygon, count, rounding):
    """Least signed distance over the points of a segment to one rounded convex polygon."""
    if count == 1:
        return math.sqrt(_segment_point_squared(ax, ay, bx, by, polygon[0, 0], polygon[0, 1])) - rounding
    da = convex_distance(ax, ay, polygon, count, 0.0)[0]
    db = convex_distance(bx, by, polygon, count, 0.0)[0]
    d = min(da, db)
    if d > 0.0:
        if da + db <= math.hypot(bx - ax, by - ay):  # else too short to reach inside
            depth = _depth_along(ax, ay, bx, by, polygon, count)
            if depth <= 0.0:
                return depth - rounding
        for i in range(count):
            d = min(d, math.sqrt(_segment_point_squared(ax, ay, bx, by, polygon[i, 0], polygon[i, 1])))
        return d - rounding
    return _depth_along(ax, ay, bx, by, polygon, count) - rounding


@kernel
def segment_clearance(ax, ay, bx, by, world, ceiling, above):
    """Least signed distance over a segment to everything higher than `above`, at most `ceiling`, and to which."""
    vertices, counts, rounding, size, boxes, heights = world
    d, index = ceiling, -1
    if heights[len(counts)] > above:
        for x, y in ((ax, ay), (bx, by)):
            dw, _, _, wall = wall_distance(x, y, size)
            if dw < d:
                d, index = dw, len(counts) + wall
    low_x, low_y, high_x, high_y = min(ax, bx), min(ay, by), max(ax, bx), max(ay, by)
    for k in range(len(counts)):
        if heights[k] > above and box_gap(low_x, low_y, high_x, high_y, boxes[k]) < d:
            dk = segment_distance(ax, ay, bx, by, vertices[k], counts[k], rounding[k])
            if dk < d:
                d, index = dk, k
    return d, index


@kernel
def _polyline_distances(lines, world, above):
    b = len(lines)
    d, index = np.full(b, np.inf), np.full(b, -1)
    for i in range(b):
        for j in range(lines.shape[1] - 1):
            ax, ay, bx, by = lines[i, j, 0], lines[i, j, 1], lines[i, j + 1, 0], lines[i, j + 1, 1]
            nearer, which = segment_clearance(ax, ay, bx, by, world, d[i], above)
            if which >= 0:
                d[i], index[i] = nearer, which
    return d, index
