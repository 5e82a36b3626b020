"""Compiled kernels of RRT-Connect among equilibria; `cableway.planning.rrt_connect` is what to call.

A `space` is that of `cableway.motion.kernels`.
"""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import inlined, kernel
from cableway.motion.kernels import free_share
from cableway.rod.kernels import world_shape

FEATURES = 5
"""Points of a shape by whose displacement two shapes are near or far."""

REACH = 8
"""Steps that a tree grows towards a sample at most,"""

TOWARDS_EACH_OTHER = 10**6
"""and towards a new node of the other tree: all the way."""


@kernel
def features(q, rod, out):
    """Coordinates (2 FEATURES,) [m] of points at equal arc length on the rod, both ends included."""
    p, modes = rod
    last = 2 * modes.shape[1]
    stations, poses = np.empty((last + 1, 2)), np.empty((2, 3))
    world_shape(q, p, modes, stations, poses)
    for i in range(FEATURES):
        at = i * last // (FEATURES - 1)
        out[2 * i], out[2 * i + 1] = stations[at, 0], stations[at, 1]


@inlined
def steps_between(a, b, shape_a, shape_b, length, step):
    """Number of steps from a to b such that no point of the rod moves much more than `step` [m] in one."""
    most = abs(b[2] - a[2]) * length / 2
    for i in range(FEATURES):
        move = math.hypot(shape_b[2 * i] - shape_a[2 * i], shape_b[2 * i + 1] - shape_a[2 * i + 1])
        most = max(most, move)
    return max(1, math.ceil(most / step))


@inlined
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


@inlined
def _grow(tree, shapes, parents, count, target, target_shape, most, space, step):
    """Grow a tree towards a target by at most `most` steps: the new count, and whether the target was reached."""
    rod = space[0]
    start = nearest(shapes, count, target_shape)
    steps = steps_between(tree[start], target, shapes[start], target_shape, rod[0][0], step)
    free = free_share(tree[start], target, steps, most, space)
    if free == 0 or count == len(tree):
        return count, False
    for k in range(len(target)):
        tree[count, k] = tree[start, k] + (target[k] - tree[start, k]) * (free / steps)
    features(tree[count], rod, shapes[count])
    parents[count] = start
    return count + 1, free == steps


@kernel
def connect(samples, trees, shapes, parents, counts, space, step):
    """RRT-Connect over rows of `samples` (k, 6): trees (2, cap, 6) grow towards them and towards each other.

    `counts` (2,) is updated; returns the last nodes of both trees where they met, or (-1, -1).
    """
    rod, sample_shape = space[0], np.empty(2 * FEATURES)
    for i in range(len(samples)):
        features(samples[i], rod, sample_shape)
        target, target_shape, most = samples[i], sample_shape, REACH
        for side in (i % 2, 1 - i % 2):  # one place that grows a tree, so that it is compiled once
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
def shortcut(path, pairs, space, step):
    """Replace sections of a path (k, 6) by straight free ones; `pairs` (m, 2) in [0, 1) says which to try."""
    rod, shapes = space[0], np.empty((len(path), 2 * FEATURES))
    for i in range(len(path)):
        features(path[i], rod, shapes[i])
    for k in range(len(pairs)):
        n = len(path)
        i, j = int(pairs[k, 0] * n), int(pairs[k, 1] * n)
        if i > j:
            i, j = j, i
        if j - i < 2:
            continue
        steps = steps_between(path[i], path[j], shapes[i], shapes[j], rod[0][0], step)
        if free_share(path[i], path[j], steps, steps, space) == steps:
            path = np.concatenate((path[: i + 1], path[j:]))
            shapes = np.concatenate((shapes[: i + 1], shapes[j:]))
    return path
