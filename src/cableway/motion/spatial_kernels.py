"""Compiled kernels of `cableway.motion.spatial`: whether one shape in space is free, and the way between two.

A `space` is (rod, world, limits, bodies): parameters and hinges of the rod (`cableway.rod.spatial_kernels`), the arrays
of a `SpatialWorld`, `SpatialLimits` and the arrays of `SpatialBodies`.
"""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import inlined, kernel
from cableway.geometry.spatial_convex_kernels import nearest_solid, points_keep, self_distance
from cableway.rod.spatial_kernels import held_shape
from cableway.rod.spatial_stability import has_margin

TURNED = 1e-12
"""Half the sine of half an angle below which a rotation is none."""


@inlined
def quaternion_of(v, out):
    """The unit quaternion (4,) of a rotation vector (3,)."""
    angle = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    factor = 0.5 - angle * angle / 48.0 if angle < 1e-4 else math.sin(0.5 * angle) / angle
    out[0] = math.cos(0.5 * angle)
    for k in range(3):
        out[1 + k] = factor * v[k]


@inlined
def vector_of(a, out):
    """The rotation vector (3,), at most half a turn, of a unit quaternion (4,)."""
    sine = math.sqrt(a[1] * a[1] + a[2] * a[2] + a[3] * a[3])
    factor = 2.0
    if sine > TURNED:
        factor = 2.0 * math.atan2(sine, abs(a[0])) / sine
    if a[0] < 0.0:
        factor = -factor
    for k in range(3):
        out[k] = factor * a[1 + k]


@inlined
def product(a, b, out):
    """The rotation b followed by a."""
    out[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3]
    out[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2]
    out[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1]
    out[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]


@kernel
def turn_between(a, b, turn):
    """The rotation vector (3,), the short way about the world's axes, from the frame of q a to that of b; its angle."""
    first, last, whole = np.empty(4), np.empty(4), np.empty(4)
    quaternion_of(a[3:6], first)
    quaternion_of(b[3:6], last)
    for k in range(1, 4):
        first[k] = -first[k]
    product(last, first, whole)
    vector_of(whole, turn)
    return math.sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2])


@kernel
def between(a, b, turn, share, out):
    """`SpatialRod.between`: q (12,) at a share of the way from a to b, whose frames are `turn` (3,) apart."""
    part, first, whole = np.empty(4), np.empty(4), np.empty(4)
    quaternion_of(share * turn, part)
    quaternion_of(a[3:6], first)
    product(part, first, whole)
    vector_of(whole, out[3:6])
    for k in range(12):
        if k < 3 or k > 5:
            out[k] = a[k] + share * (b[k] - a[k])


@inlined
def turned(pose, at, out):
    """The point `at` (3,) of the frame at a pose (7,), in the world."""
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    a = 2.0 * (y * at[2] - z * at[1])
    b = 2.0 * (z * at[0] - x * at[2])
    c = 2.0 * (x * at[1] - y * at[0])
    out[0] = pose[0] + at[0] + w * a + y * c - z * b
    out[1] = pose[1] + at[1] + w * b + z * a - x * c
    out[2] = pose[2] + at[2] + w * c + x * b - y * a


@kernel
def sharpest_turn(stations, length):
    """Greatest sine of the turn from link to link."""
    most = 0.0
    for i in range(1, len(stations) - 1, 2):
        ux, uy, uz = (
            stations[i, 0] - stations[i - 1, 0],
            stations[i, 1] - stations[i - 1, 1],
            stations[i, 2] - stations[i - 1, 2],
        )
        vx, vy, vz = (
            stations[i + 1, 0] - stations[i, 0],
            stations[i + 1, 1] - stations[i, 1],
            stations[i + 1, 2] - stations[i, 2],
        )
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        most = max(most, x * x + y * y + z * z)
    return math.sqrt(most) / (length / (len(stations) - 1)) ** 2


@kernel
def body_points(poses, bodies, out):
    """The points (k, 3) of all bodies in the world, the grippers at `poses` (2, 7)."""
    sides, at = bodies[0], bodies[1]
    for i in range(len(sides)):
        turned(poses[sides[i]], at[i], out[i])


@kernel
def bodies_keep(points, stations, world, limits, bodies):
    """Whether points of bodies keep their distances from obstacles, walls, those of the other gripper and the cable."""
    sides, _, radii, spared = bodies
    gradient, trial = np.empty(3), np.empty(3)
    last = len(stations) - 1
    for i in range(len(points)):
        wanted = radii[i] + limits.gripper_clearance
        if nearest_solid(points[i], world, wanted, gradient, trial)[0] < wanted:
            return False
        for j in range(i):
            if sides[i] != sides[j]:
                apart = max(0.0, radii[i] + radii[j] + limits.bodies_apart)
                if _squared(points[i], points[j]) < apart * apart:
                    return False
        apart = max(0.0, radii[i] + limits.bodies_off_cable)
        for s in range(spared[i], last + 1):
            if _squared(points[i], stations[last - s if sides[i] else s]) < apart * apart:
                return False
    return True


@inlined
def _squared(a, b):
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2


@kernel
def is_free(q, space):
    """Whether cable and bodies keep their distances, and the shape is stable, slack, little twisted and not coiled.

    The cheapest tests come first.
    """
    rod, world, limits, bodies = space
    p, hinges = rod
    if abs(q[9]) > limits.most_twist * p[1]:
        return False
    last = 2 * hinges
    stations, flat = np.empty((last + 1, 3)), np.empty((last + 1, 3, 0))
    poses, none = np.empty((2, 7)), np.empty((2, 6, 0))
    held_shape(q, p, hinges, stations, flat, poses, none)
    squared = _squared(stations[0], stations[last])
    if not limits.least_span**2 <= squared <= limits.most_span**2:
        return False
    if sharpest_turn(stations, p[0]) > limits.sharpest_turn:
        return False
    if not points_keep(stations, world, limits.cable_distance):
        return False
    points = np.empty((len(bodies[0]), 3))
    body_points(poses, bodies, points)
    if not bodies_keep(points, stations, world, limits, bodies):
        return False
    if self_distance(stations, limits.apart) < limits.self_distance:
        return False
    return has_margin(q, p, hinges, limits.stability)


@kernel
def are_free(q, space):
    """`is_free` of each row of q (k, 12)."""
    free = np.empty(len(q), np.bool_)
    for i in range(len(q)):
        free[i] = is_free(q[i], space)
    return free


@kernel
def free_share(a, b, turn, count, most, space):
    """How many of the first `most` of `count` equal steps from a to b are free, one after the other."""
    q = np.empty(12)
    for i in range(1, min(count, most) + 1):
        between(a, b, turn, i / count, q)
        if not is_free(q, space):
            return i - 1
    return min(count, most)


@kernel
def closest_parts(stations, apart):
    """Of each row of stations (t, s, 3), the two at least `apart` places from each other that are nearest.

    Returns:
        Their distances (t,), infinite where there are none, and their indices (t, 2).
    """
    away, which = np.full(len(stations), np.inf), np.zeros((len(stations), 2), np.int64)
    for t in range(len(stations)):
        line = stations[t]
        for i in range(len(line) - apart):
            for j in range(i + apart, len(line)):
                squared = _squared(line[i], line[j])
                if squared < away[t]:
                    away[t], which[t, 0], which[t, 1] = squared, i, j
        away[t] = math.sqrt(away[t])
    return away, which


@kernel
def nearest_to_cable(points, stations, sides, spared):
    """Of each row of body points (t, k, 3), the nearest station that the body does not hold.

    Returns:
        Distances (t, k), infinite where there is none, and indices (t, k).
    """
    last = stations.shape[1] - 1
    away, which = np.full(points.shape[:2], np.inf), np.zeros(points.shape[:2], np.int64)
    for t in range(len(points)):
        for i in range(points.shape[1]):
            for s in range(spared[i], last + 1):
                at = last - s if sides[i] else s
                squared = _squared(points[t, i], stations[t, at])
                if squared < away[t, i]:
                    away[t, i], which[t, i] = squared, at
            away[t, i] = math.sqrt(away[t, i])
    return away, which
