"""Compiled kernels of the tree search among equilibria; `cableway.planning.rrt_connect` is what to call."""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import kernel
from cableway.geometry.convex import box_gap, convex_distance, segment_clearance, wall_distance
from cableway.rod.kernels import stability, world_shape

FEATURES = 5
"""Points of a shape by whose displacement two shapes are near or far."""

REACH = 8
"""Steps that a tree grows towards a sample at most."""


@kernel
def features(q, length, hinges, out):
    """Coordinates (2 FEATURES,) [m] of points at equal arc length on the rod, both ends included."""
    stations, poses = np.empty((2 * hinges + 1, 2)), np.empty((2, 3))
    world_shape(q, length, hinges, stations, poses)
    for i in range(FEATURES):
        at = i * 2 * hinges // (FEATURES - 1)
        out[2 * i], out[2 * i + 1] = stations[at, 0], stations[at, 1]


@kernel
def crosses_itself(stations):
    """Whether the polyline through every second station cuts itself."""
    m = (len(stations) - 1) // 2
    for i in range(m - 2):
        ax, ay = stations[2 * i]
        ux, uy = stations[2 * i + 2, 0] - ax, stations[2 * i + 2, 1] - ay
        for j in range(i + 2, m):
            bx, by = stations[2 * j]
            vx, vy = stations[2 * j + 2, 0] - bx, stations[2 * j + 2, 1] - by
            cross = ux * vy - uy * vx
            if cross == 0.0:
                continue
            s = ((bx - ax) * vy - (by - ay) * vx) / cross
            t = ((bx - ax) * uy - (by - ay) * ux) / cross
            if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
                return True
    return False


@kernel
def sharpest_turn(stations, length, hinges):
    """Greatest sine of the turn from link to link."""
    most = 0.0
    for i in range(1, 2 * hinges, 2):
        ux, uy = stations[i, 0] - stations[i - 1, 0], stations[i, 1] - stations[i - 1, 1]
        vx, vy = stations[i + 1, 0] - stations[i, 0], stations[i + 1, 1] - stations[i, 1]
        most = max(most, abs(ux * vy - uy * vx))
    return most / (length / (2 * hinges)) ** 2


@kernel
def _keeps_distance(stations, world, limits):
    """Whether the centre line and its two ends keep their distances from walls and obstacles."""
    vertices, counts, rounding, size, boxes = world
    last = len(stations) - 1
    widest = max(limits[0], limits[1])
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    for i in range(last + 1):
        x, y = stations[i, 0], stations[i, 1]
        if wall_distance(x, y, size)[0] < (limits[1] if i == 0 or i == last else limits[0]):
            return False
        low_x, low_y, high_x, high_y = min(low_x, x), min(low_y, y), max(high_x, x), max(high_y, y)
    for k in range(len(counts)):
        if box_gap(low_x, low_y, high_x, high_y, boxes[k]) >= widest:
            continue
        for i in range(last + 1):
            wanted = limits[1] if i == 0 or i == last else limits[0]
            x, y = stations[i, 0], stations[i, 1]
            if box_gap(x, y, x, y, boxes[k]) >= wanted:
                continue
            if convex_distance(x, y, vertices[k], counts[k], rounding[k])[0] < wanted:
                return False
    return True


@kernel
def _plug_keeps_distance(pose, length, half, wanted, world):
    """Whether tip and sides of a plug ahead of `pose` keep their distance from walls and obstacles."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    rear_x, rear_y, tip_x, tip_y = pose[0], pose[1], pose[0] + length * c, pose[1] + length * s
    right_x, right_y = half * s, -half * c
    for ax, ay, bx, by in (
        (tip_x + right_x, tip_y + right_y, tip_x - right_x, tip_y - right_y),
        (rear_x + right_x, rear_y + right_y, tip_x + right_x, tip_y + right_y),
        (rear_x - right_x, rear_y - right_y, tip_x - right_x, tip_y - right_y),
    ):
        if segment_clearance(ax, ay, bx, by, world, wanted)[0] < wanted:
            return False
    return True


@kernel
def self_distance(stations, apart):
    """Least distance [m] between two stations at least `apart` places from each other; infinite if there are none."""
    least = np.inf
    for i in range(len(stations) - apart):
        for j in range(i + apart, len(stations)):
            x, y = stations[j, 0] - stations[i, 0], stations[j, 1] - stations[i, 1]
            least = min(least, x * x + y * y)
    return math.sqrt(least)


@kernel
def is_free(q, rod, world, limits):
    """Whether a shape keeps its distances, is stable, has slack, bends no further and does not cross itself.

    Args: rod (length, hinges); world (`ConvexWorld.arrays`); limits (distance of the centre line, distance of the
    grippers' centres, stability margin, greatest and least distance between the grippers, greatest sine of the turn at
    a hinge, places along the rod from which on it could touch itself, distance of stations there, length of the plug
    or 0, half its width, distance of its outline).
    """
    length, hinges = rod
    stations, poses = np.empty((2 * hinges + 1, 2)), np.empty((2, 3))
    world_shape(q, length, hinges, stations, poses)
    last = 2 * hinges
    chord = math.hypot(stations[last, 0] - stations[0, 0], stations[last, 1] - stations[0, 1])
    if not limits[4] <= chord <= limits[3] or sharpest_turn(stations, length, hinges) > limits[5]:
        return False
    if not _keeps_distance(stations, world, limits):
        return False
    if limits[8] > 0.0 and not _plug_keeps_distance(poses[1], limits[8], limits[9], limits[10], world):
        return False
    gradient = np.empty(3)
    if stability(q[3:], length, hinges, limits[2], gradient) < limits[2]:
        return False
    return not crosses_itself(stations) and self_distance(stations, int(limits[6])) >= limits[7]


@kernel
def steps_between(a, b, shape_a, shape_b, length, step):
    """Number of steps from a to b such that no point of the rod moves much more than `step` [m] in one."""
    most = abs(b[2] - a[2]) * length / 2
    for i in range(FEATURES):
        move = math.hypot(shape_b[2 * i] - shape_a[2 * i], shape_b[2 * i + 1] - shape_a[2 * i + 1])
        most = max(most, move)
    return max(1, math.ceil(most / step))


@kernel
def nearest(shapes, count, shape):
    """Index of the row of `shapes` (first `count`) with the least squared distance to `shape`."""
    best, at = np.inf, 0
    for i in range(count):
        total = 0.0
        for k in range(2 * FEATURES):
            total += (shapes[i, k] - shape[k]) ** 2
            if total >= best:
                break
        if total < best:
            best, at = total, i
    return at


@kernel
def free_share(a, b, count, most, rod, world, limits):
    """How many of the first `most` of `count` equal steps from a to b are free, one after the other."""
    for i in range(1, min(count, most) + 1):
        if not is_free(a + (b - a) * (i / count), rod, world, limits):
            return i - 1
    return min(count, most)


@kernel
def _grow(tree, shapes, parents, count, target, target_shape, most, rod, world, limits, step):
    """Grow a tree towards a target by at most `most` steps: the new count, and whether the target was reached."""
    start = nearest(shapes, count, target_shape)
    steps = steps_between(tree[start], target, shapes[start], target_shape, rod[0], step)
    free = free_share(tree[start], target, steps, most, rod, world, limits)
    if free == 0 or count == len(tree):
        return count, False
    tree[count] = tree[start] + (target - tree[start]) * (free / steps)
    features(tree[count], rod[0], rod[1], shapes[count])
    parents[count] = start
    return count + 1, free == steps


@kernel
def connect(samples, trees, shapes, parents, counts, rod, world, limits, step):
    """RRT-Connect over rows of `samples` (k, 6): trees (2, cap, 6) grow towards them and towards each other.

    `counts` (2,) is updated; returns the last nodes of both trees where they met, or (-1, -1).
    """
    sample_shape = np.empty(2 * FEATURES)
    for i in range(len(samples)):
        side = i % 2
        features(samples[i], rod[0], rod[1], sample_shape)
        before = counts[side]
        counts[side], _ = _grow(
            trees[side], shapes[side], parents[side], before, samples[i], sample_shape, REACH, rod, world, limits, step
        )
        if counts[side] == before:
            continue
        new, other = counts[side] - 1, 1 - side
        counts[other], met = _grow(
            trees[other], shapes[other], parents[other], counts[other], trees[side, new], shapes[side, new],
            10**6, rod, world, limits, step,
        )  # fmt: skip
        if met:
            last = counts[other] - 1
            return (new, last) if side == 0 else (last, new)
    return -1, -1


@kernel
def shortcut(path, pairs, rod, world, limits, step):
    """Replace stretches of a path (k, 6) by straight free ones; `pairs` (m, 2) in [0, 1) says which to try."""
    shapes = np.empty((len(path), 2 * FEATURES))
    for i in range(len(path)):
        features(path[i], rod[0], rod[1], shapes[i])
    for k in range(len(pairs)):
        n = len(path)
        i, j = int(pairs[k, 0] * n), int(pairs[k, 1] * n)
        if i > j:
            i, j = j, i
        if j - i < 2:
            continue
        steps = steps_between(path[i], path[j], shapes[i], shapes[j], rod[0], step)
        if free_share(path[i], path[j], steps, steps, rod, world, limits) == steps:
            path = np.concatenate((path[: i + 1], path[j:]))
            shapes = np.concatenate((shapes[: i + 1], shapes[j:]))
    return path
