"""Compiled kernels of RRT-Connect among equilibria in space; `cableway.planning.spatial_rrt` is what to call.

As `cableway.planning.rrt_connect_kernels` in the plane; between two shapes the centre's frame turns the short way, so
that it does not matter by which rotation vector it is written. A `space` is that of `cableway.motion.spatial_kernels`.
"""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import inlined, kernel
from cableway.motion.spatial_kernels import between, free_share, turn_between
from cableway.rod.spatial_kernels import held_shape, rotation

STATIONS = 5
"""Points of a shape by whose displacement two shapes are near or far;"""

FEATURES = 3 * (STATIONS + 1)
"""besides them one beside the centre, which tells how the rod is rolled,"""

LEVER = 0.15
"""at so many lengths from it."""

REACH = 8
"""Steps that a tree grows towards a sample at most,"""

TOWARDS_EACH_OTHER = 10**6
"""and towards a new node of the other tree: all the way."""

TURNED_WAY = 1 / 3
"""Way of the rod's points, in lengths, for a turn of 1 rad of its centre."""


@kernel
def features(q, rod, out):
    """Coordinates (FEATURES,) [m] of points at equal arc length on the rod, ends included, and of one beside it."""
    p, stiff = rod
    last = 2 * len(stiff)
    stations, flat = np.empty((last + 1, 3)), np.empty((last + 1, 3, 0))
    poses, none, frame = np.empty((2, 7)), np.empty((2, 6, 0)), np.empty((3, 3))
    held_shape(q, p, stiff, stations, flat, poses, none)
    rotation(q[3:6], frame)
    for k in range(3):
        for i in range(STATIONS):
            out[3 * i + k] = stations[i * last // (STATIONS - 1), k]
        out[3 * STATIONS + k] = q[k] + LEVER * p[0] * frame[k, 1]


@inlined
def steps_between(angle, shape_a, shape_b, length, step):
    """Number of steps between shapes `angle` apart such that no point of the rod moves much more than `step` [m]."""
    most = angle * length * TURNED_WAY
    for i in range(STATIONS):
        squared = 0.0
        for k in range(3 * i, 3 * i + 3):
            squared += (shape_b[k] - shape_a[k]) ** 2
        most = max(most, math.sqrt(squared))
    return max(1, math.ceil(most / step))


@inlined
def nearest(shapes, count, shape):
    """Index of the row of `shapes` (first `count`) with the least squared distance to `shape`."""
    best, at = np.inf, 0
    for i in range(count):
        total = 0.0
        for k in range(FEATURES):
            total += (shapes[i, k] - shape[k]) ** 2
            if total >= best:
                break
        if total < best:
            best, at = total, i
    return at


@inlined
def _grow(tree, shapes, parents, count, target, target_shape, most, space, step):
    """Grow a tree towards a target by at most `most` steps: the new count, and whether the target was reached."""
    rod, turn = space[0], np.empty(3)
    start = nearest(shapes, count, target_shape)
    angle = turn_between(tree[start], target, turn)
    steps = steps_between(angle, shapes[start], target_shape, rod[0][0], step)
    free = free_share(tree[start], target, turn, steps, most, space)
    if free == 0 or count == len(tree):
        return count, False
    between(tree[start], target, turn, free / steps, tree[count])
    features(tree[count], rod, shapes[count])
    parents[count] = start
    return count + 1, free == steps


@kernel
def connect(samples, trees, shapes, parents, counts, space, step):
    """RRT-Connect over rows of `samples` (k, 12): trees (2, cap, 12) grow towards them and towards each other.

    `counts` (2,) is updated; returns the last nodes of both trees where they met, or (-1, -1).
    """
    rod, sample_shape = space[0], np.empty(FEATURES)
    for i in range(len(samples)):
        features(samples[i], rod, sample_shape)
        target, target_shape, most = samples[i], sample_shape, REACH
        for side in (i % 2, 1 - i % 2):
            before = counts[side]
            counts[side], met = _grow(
                trees[side], shapes[side], parents[side], before, target, target_shape, most, space, step
            )
            if met and most > REACH:
                return counts[0] - 1, counts[1] - 1
            if counts[side] == before:
                break
            new = counts[side] - 1
            target, target_shape, most = trees[side, new], shapes[side, new], TOWARDS_EACH_OTHER
    return -1, -1


@kernel
def way(a, b, rod, step, turn):
    """Number of steps from q a to q b, and in `turn` (3,) the rotation between their frames."""
    one, other = np.empty(FEATURES), np.empty(FEATURES)
    features(a, rod, one)
    features(b, rod, other)
    return steps_between(turn_between(a, b, turn), one, other, rod[0][0], step)


@kernel
def dense(path, rod, step):
    """The path (k, 12) with rows about `step` [m] apart."""
    turn, counts = np.empty(3), np.empty(len(path) - 1, np.int64)
    for i in range(len(path) - 1):
        counts[i] = way(path[i], path[i + 1], rod, step, turn)
    out, row = np.empty((np.sum(counts) + 1, 12)), 0
    for i in range(len(path) - 1):
        turn_between(path[i], path[i + 1], turn)
        for j in range(counts[i]):
            between(path[i], path[i + 1], turn, j / counts[i], out[row])
            row += 1
    out[row] = path[-1]
    return out


@kernel
def shortcut(path, pairs, space, step):
    """Replace sections of a path (k, 12) by straight free ones; `pairs` (m, 2) in [0, 1) says which to try."""
    rod, turn = space[0], np.empty(3)
    for k in range(len(pairs)):
        n = len(path)
        i, j = int(pairs[k, 0] * n), int(pairs[k, 1] * n)
        if i > j:
            i, j = j, i
        if j - i < 2:
            continue
        steps = way(path[i], path[j], rod, step, turn)
        if free_share(path[i], path[j], turn, steps, steps, space) == steps:
            path = np.concatenate((path[: i + 1], path[j:]))
    return path
