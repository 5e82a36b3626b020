"""Compiled kernels of `cableway.motion.validity`: whether one shape is free.

A `space` is (rod, world, limits, bodies): parameters and modes of the rod (`cableway.rod.kernels`),
`ConvexWorld.arrays`, `ShapeLimits`, `PackedBodies`, and the arms of `cableway.robot.free_arms`, or None.
"""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import inlined, kernel
from cableway.geometry.convex import box_gap, convex_distance, wall_distance
from cableway.robot.free_arms import arms_keep
from cableway.rod.kernels import stability, world_shape
from cableway.scene.bodies import bodies_keep_apart, bodies_keep_distance, bodies_keep_off


@kernel
def is_free(q, space):
    """Whether cable and bodies keep their distances, and the shape is stable, slack, not bent too sharply or crossed.

    The cheapest tests come first.
    """
    rod, world, limits, bodies, arms = space
    p, modes = rod
    last = 2 * modes.shape[1]
    stations, poses = np.empty((last + 1, 2)), np.empty((2, 3))
    world_shape(q, p, modes, stations, poses)
    span = math.hypot(stations[last, 0] - stations[0, 0], stations[last, 1] - stations[0, 1])
    if not limits.least_span <= span <= limits.most_span:
        return False
    if sharpest_turn(stations, p[0]) > limits.sharpest_turn:
        return False
    if not _cable_keeps_distance(stations, world, limits.cable_distance):
        return False
    if not bodies_keep_distance(poses, bodies, world) or not bodies_keep_apart(poses, bodies, limits.bodies_apart):
        return False
    if not bodies_keep_off(stations, poses, bodies, p[0], limits.bodies_off_cable):
        return False
    gradient = np.empty(3)
    if stability(q[3:], p, modes, limits.stability, gradient) < limits.stability:
        return False
    if crosses_itself(stations) or self_distance(stations, limits.apart) < limits.self_distance:
        return False
    return arms_keep(poses, arms)


@kernel
def are_free(q, space):
    """`is_free` of each row of q (k, 6)."""
    free = np.empty(len(q), np.bool_)
    for i in range(len(q)):
        free[i] = is_free(q[i], space)
    return free


@inlined
def free_share(a, b, count, most, space):
    """How many of the first `most` of `count` equal steps from a to b are free, one after the other."""
    q = np.empty(len(a))
    for i in range(1, min(count, most) + 1):
        for k in range(len(a)):
            q[k] = a[k] + (b[k] - a[k]) * (i / count)
        if not is_free(q, space):
            return i - 1
    return min(count, most)


@inlined
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
def sharpest_turn(stations, length):
    """Greatest sine of the turn from link to link."""
    most = 0.0
    for i in range(1, len(stations) - 1, 2):
        ux, uy = stations[i, 0] - stations[i - 1, 0], stations[i, 1] - stations[i - 1, 1]
        vx, vy = stations[i + 1, 0] - stations[i, 0], stations[i + 1, 1] - stations[i, 1]
        most = max(most, abs(ux * vy - uy * vx))
    return most / (length / (len(stations) - 1)) ** 2


@kernel
def self_distance(stations, apart):
    """Least distance [m] between two stations at least `apart` places from each other; infinite if there are none."""
    least = np.inf
    for i in range(len(stations) - apart):
        for j in range(i + apart, len(stations)):
            x, y = stations[j, 0] - stations[i, 0], stations[j, 1] - stations[i, 1]
            least = min(least, x * x + y * y)
    return math.sqrt(least)


@inlined
def _cable_keeps_distance(stations, world, wanted):
    """Whether the centre line keeps a distance from walls and obstacles."""
    vertices, counts, rounding, size, boxes, _ = world
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    for i in range(len(stations)):
        x, y = stations[i, 0], stations[i, 1]
        if wall_distance(x, y, size)[0] < wanted:
            return False
        low_x, low_y, high_x, high_y = min(low_x, x), min(low_y, y), max(high_x, x), max(high_y, y)
    for k in range(len(counts)):
        if box_gap(low_x, low_y, high_x, high_y, boxes[k]) >= wanted:
            continue
        for i in range(len(stations)):
            x, y = stations[i, 0], stations[i, 1]
            if box_gap(x, y, x, y, boxes[k]) >= wanted:
                continue
            if convex_distance(x, y, vertices[k], counts[k], rounding[k])[0] < wanted:
                return False
    return True
