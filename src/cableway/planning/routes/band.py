"""Compiled kernels on paths in free space: cost of a segment, shortcuts, and small sideways moves.

Every change is made only where the new segments keep their distance to the obstacles, tested exactly along the
whole segment, so no change passes through a wall however thin. A world is `ConvexWorld.arrays`.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from cableway.core.compiled import inlined, kernel
from cableway.geometry.convex import ConvexWorld, distance_at, segment_clearance

SMALLEST_CLEARANCE = 1e-6
"""Clearance [m] below which 1/clearance in the cost grows no more."""


def reference_points(world: ConvexWorld) -> Float[np.ndarray, "k 2"]:
    """A point inside each obstacle: a loop that goes round none of them encloses no obstacle."""
    points = [row[:count].mean(axis=0) for row, count in zip(world.vertices, world.counts, strict=True)]
    return np.array(points).reshape(-1, 2)


@kernel
def is_free(ax, ay, da, bx, by, db, world, radius):
    """Whether a segment keeps `radius`, given the signed distance of its ends.

    Signed distance changes no faster than position, so mostly the ends alone decide.
    """
    if min(da, db) < radius:
        return False
    if da + db - math.hypot(bx - ax, by - ay) >= 2 * radius:
        return True
    return segment_clearance(ax, ay, bx, by, world, radius, 0.0)[1] < 0


@kernel
def segment_cost(ax, ay, bx, by, world, length_weight, clearance_weight, step):
    """Integral of length_weight + clearance_weight / distance over a segment (midpoints at most `step` apart)."""
    length = math.hypot(bx - ax, by - ay)
    cost = length_weight * length
    if clearance_weight > 0.0:
        pieces = max(1, math.ceil(length / step))
        for i in range(pieces):
            t = (i + 0.5) / pieces
            d = distance_at(ax + t * (bx - ax), ay + t * (by - ay), world, 0.0)
            cost += clearance_weight * length / pieces / max(d, SMALLEST_CLEARANCE)
    return cost


@kernel
def path_cost(path, world, length_weight, clearance_weight, step):
    """The same over a polyline (m, 2)."""
    cost = 0.0
    for i in range(len(path) - 1):
        cost += segment_cost(
            path[i, 0], path[i, 1], path[i + 1, 0], path[i + 1, 1], world, length_weight, clearance_weight, step
        )
    return cost


@kernel
def _crossing(ax, ay, bx, by, px, py):
    """Signed crossing of a segment with the ray from (px, py) along +x."""
    if (ay <= py) == (by <= py):
        return 0
    x = ax + (py - ay) / (by - ay) * (bx - ax)
    if x <= px:
        return 0
    return 1 if by > ay else -1


@inlined
def encloses(path, first, last, points):
    """Whether the loop along path[first..last] and straight back goes round any of `points`."""
    for k in range(len(points)):
        px, py = points[k, 0], points[k, 1]
        turns = _crossing(path[last, 0], path[last, 1], path[first, 0], path[first, 1], px, py)
        for i in range(first, last):
            turns += _crossing(path[i, 0], path[i, 1], path[i + 1, 0], path[i + 1, 1], px, py)
        if turns != 0:
            return True
    return False


@kernel
def _clearances(path, world, most):
    """A lower bound of each segment's least signed distance, at most `most`; exact where it is below that."""
    out = np.empty(len(path) - 1)
    db = distance_at(path[0, 0], path[0, 1], world, 0.0)
    for i in range(len(out)):
        ax, ay, bx, by = path[i, 0], path[i, 1], path[i + 1, 0], path[i + 1, 1]
        da, db = db, distance_at(bx, by, world, 0.0)
        if da + db - math.hypot(bx - ax, by - ay) >= 2 * most:
            out[i] = most
        else:
            out[i] = segment_clearance(ax, ay, bx, by, world, most, 0.0)[0]
    return out


@kernel
def shortcut(path, world, radius, points, length_weight, clearance_weight, step, rounds):
    """Replace parts of `path` (m, 2) by straight lines wherever that costs less, in place.

    A straight line is taken if it keeps `radius`, or else the clearance of what it replaces, and if the loop of the
    two goes round none of `points`; its vertices are spread evenly over it, so m stays. Parts of m - 1, (m - 1)/2,
    ... segments are tried, all of them up to `rounds` times while anything changes.
    """
    m = len(path)
    clearance = _clearances(path, world, radius)
    cost = np.empty(m - 1)
    for i in range(m - 1):
        cost[i] = segment_cost(
            path[i, 0], path[i, 1], path[i + 1, 0], path[i + 1, 1], world, length_weight, clearance_weight, step
        )
    for _ in range(rounds):
        changed = False
        stride = m - 1
        while stride >= 2:
            for first in range(0, m - stride, max(1, stride // 4)):
                last = first + stride
                ax, ay, bx, by = path[first, 0], path[first, 1], path[last, 0], path[last, 1]
                old = cost[first:last].sum()
                if length_weight * math.hypot(bx - ax, by - ay) > old * (1.0 - 1e-9) - 1e-12:
                    continue
                keep = clearance[first:last].min()
                kept = segment_clearance(ax, ay, bx, by, world, radius, 0.0)[0]
                if kept < keep or encloses(path, first, last, points):
                    continue
                new = segment_cost(ax, ay, bx, by, world, length_weight, clearance_weight, step)
                if new > old * (1.0 - 1e-9) - 1e-12:
                    continue
                clearance[first:last] = kept
                for i in range(first, last):
                    path[i, 0] = ax + (bx - ax) * (i - first) / stride
                    path[i, 1] = ay + (by - ay) * (i - first) / stride
                for i in range(first, last):
                    cost[i] = segment_cost(
                        path[i, 0], path[i, 1], path[i + 1, 0], path[i + 1, 1],
                        world, length_weight, clearance_weight, step,
                    )  # fmt: skip
                changed = True
            stride //= 2
        if not changed:
            break


@inlined
def _slots(path, keep, world, scale, reach):
    """Positions at multiples of `scale` along the normal of each inner vertex, and their signed distances.

    A position that a vertex cannot slide to with the clearance `keep` (m,) has the distance -inf.
    """
    m, options = len(path), 2 * reach + 1
    at, d = np.empty((m, options, 2)), np.full((m, options), -np.inf)
    for i in range(m):
        before, after = max(i - 1, 0), min(i + 1, m - 1)
        nx, ny = path[before, 1] - path[after, 1], path[after, 0] - path[before, 0]
        norm = max(math.hypot(nx, ny), 1e-12)
        at[i, reach, 0], at[i, reach, 1] = path[i, 0], path[i, 1]
        d[i, reach] = distance_at(path[i, 0], path[i, 1], world, 0.0)
        if i == 0 or i == m - 1:
            continue
        for sign in (1, -1):
            for k in range(1, reach + 1):
                j = reach + sign * k
                x, y = path[i, 0] + sign * k * scale * nx / norm, path[i, 1] + sign * k * scale * ny / norm
                here, back = distance_at(x, y, world, 0.0), j - sign
                if not is_free(at[i, back, 0], at[i, back, 1], d[i, back], x, y, here, world, keep[i]):
                    break
                at[i, j, 0], at[i, j, 1], d[i, j] = x, y, here
    return at, d


@kernel
def relax(path, world, radius, target, pull, length_weight, clearance_weight, scale, reach):
    """Move the inner vertices of `path` (m, 2) sideways by multiples of `scale`, at most `reach`, to the least cost.

    The cost is the integral of length_weight + clearance_weight / distance, plus `pull` times the squared distance
    of each vertex to its `target` (m, 2). Exact over all combinations, by dynamic programming. New segments keep
    `radius`, or else the clearance of the segment they replace; vertices slide only through free space. In place.
    """
    m, options = len(path), 2 * reach + 1
    keep = _clearances(path, world, radius)
    around = np.empty(m)
    around[0], around[-1] = keep[0], keep[-1]
    for i in range(1, m - 1):
        around[i] = min(keep[i - 1], keep[i])
    at, d = _slots(path, around, world, scale, reach)
    best = np.full((m, options), np.inf)
    previous = np.zeros((m, options), np.int64)
    rate = np.zeros((m, options))  # half the cost of a metre there that comes from what is near
    best[0, reach], rate[0, reach] = 0.0, 0.5 * clearance_weight / max(d[0, reach], SMALLEST_CLEARANCE)
    for i in range(1, m):
        for j in range(options):
            if d[i, j] == -np.inf:
                continue
            x, y = at[i, j, 0], at[i, j, 1]
            off = pull * ((x - target[i, 0]) ** 2 + (y - target[i, 1]) ** 2)
            rate[i, j] = 0.5 * clearance_weight / max(d[i, j], SMALLEST_CLEARANCE)
            for k in range(options):
                bx, by, db = at[i - 1, k, 0], at[i - 1, k, 1], d[i - 1, k]
                length = math.hypot(x - bx, y - by)
                cost = best[i - 1, k] + off
                cost += length * (length_weight + rate[i, j] + rate[i - 1, k])
                if cost < best[i, j] and (
                    (j == reach and k == reach) or is_free(bx, by, db, x, y, d[i, j], world, keep[i - 1])
                ):
                    best[i, j], previous[i, j] = cost, k
    j = reach
    for i in range(m - 1, 0, -1):
        path[i, 0], path[i, 1] = at[i, j, 0], at[i, j, 1]
        j = previous[i, j]


@kernel
def _in_triangle(px, py, ax, ay, bx, by, cx, cy):
    u = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
    v = (cx - bx) * (py - by) - (cy - by) * (px - bx)
    w = (ax - cx) * (py - cy) - (ay - cy) * (px - cx)
    return (u >= 0 and v >= 0 and w >= 0) or (u <= 0 and v <= 0 and w <= 0)


@kernel
def _sweeps_over(path, i, x, y, points):
    """Whether the area between the two segments at vertex i and those at (x, y) holds one of `points`."""
    for k in range(len(points)):
        for j in (i - 1, i + 1):
            if _in_triangle(points[k, 0], points[k, 1], path[j, 0], path[j, 1], path[i, 0], path[i, 1], x, y):
                return True
    return False


@kernel
def _surely_free(path, i, x, y, here, d, keep):
    """Whether both segments of vertex i stay free with it at (x, y), by lower bounds of the distances alone."""
    for j, required in ((i - 1, keep[i - 1]), (i + 1, keep[i])):
        if min(here, d[j]) < required or here + d[j] - math.hypot(path[j, 0] - x, path[j, 1] - y) < 2 * required:
            return False
    return True


@kernel
def _both_free(path, i, x, y, here, d, world, keep):
    """The same by exact distances."""
    return is_free(path[i - 1, 0], path[i - 1, 1], d[i - 1], x, y, here, world, keep[i - 1]) and is_free(
        x, y, here, path[i + 1, 0], path[i + 1, 1], d[i + 1], world, keep[i]
    )


@kernel
def smooth(path, world, radius, points, bending, sweeps):
    """Move the inner vertices of `path` (m, 2) one by one towards less length and bending, in place.

    Each vertex goes towards the minimum of sum |x_i - x_i-1|^2 + bending sum |x_i-1 - 2 x_i + x_i+1|^2 over its own
    position. A move is rejected if one of its two segments would keep less than `radius` and less than it did
    before, or if the swept area holds one of `points`; then half of it is tried.
    """
    m = len(path)
    keep = _clearances(path, world, radius)
    d = np.full(m, -np.inf)  # lower bounds of the signed distance, which falls no faster than a vertex moves
    for _ in range(sweeps):
        for i in range(1, m - 1):
            weight = 2.0 + 4.0 * bending
            x = (1.0 + 2.0 * bending) * (path[i - 1, 0] + path[i + 1, 0])
            y = (1.0 + 2.0 * bending) * (path[i - 1, 1] + path[i + 1, 1])
            for side in (-1, 1):
                j = i + 2 * side
                if 0 <= j < m:
                    weight += bending
                    x += bending * (2.0 * path[i + side, 0] - path[j, 0])
                    y += bending * (2.0 * path[i + side, 1] - path[j, 1])
            x, y = x / weight, y / weight
            for _ in range(3):
                move = math.hypot(x - path[i, 0], y - path[i, 1])
                if move < 1e-7:
                    break
                here = d[i] - move
                free = _surely_free(path, i, x, y, here, d, keep)
                if not free:
                    here = distance_at(x, y, world, 0.0)
                    for j in (i - 1, i + 1):
                        d[j] = distance_at(path[j, 0], path[j, 1], world, 0.0)
                    free = _both_free(path, i, x, y, here, d, world, keep)
                if free and not _sweeps_over(path, i, x, y, points):
                    path[i, 0], path[i, 1], d[i] = x, y, here
                    break
                x, y = 0.5 * (x + path[i, 0]), 0.5 * (y + path[i, 1])
