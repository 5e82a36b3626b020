"""Compiled kernels of `cableway.motion.spatial`: whether one shape in space is free, and the way between two.

A `space` is (rod, world, limits, bodies, arms): parameters and stiffness of the rod (`cableway.rod.spatial_kernels`),
the arrays of a `SpatialWorld`, `SpatialLimits`, the arrays of `SpatialBodies`, of which the last are those of its
hulls, or None, and the arms of `cableway.robot.free_spatial_arms`, or None.
"""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import inlined, kernel
from cableway.geometry.pose_kernels import product, quaternion_of, turned, vector_of
from cableway.geometry.spatial_convex_kernels import box_gap, nearest_solid, points_keep, self_distance
from cableway.geometry.spatial_pair_kernels import ROOM, core_depth, core_gap, solid_core
from cableway.robot.free_spatial_arms import spatial_arms_keep, spatial_arms_reach
from cableway.rod.spatial_kernels import held_shape
from cableway.rod.spatial_stability import has_margin

WORLD, OTHER, OFF = 0, 1, 2
"""What a hull keeps its distance from: obstacles and walls; the other gripper; the cable that it does not hold."""


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
    """The centres (k, 3) of all balls in the world, the grippers at `poses` (2, 7)."""
    sides, at = bodies[0], bodies[1]
    for i in range(len(sides)):
        turned(poses[sides[i]], at[i], out[i])


@kernel
def bodies_keep(points, stations, world, limits, bodies):
    """Whether balls keep their distances from obstacles, walls, those of the other gripper and the cable."""
    sides, radii, spared = bodies[0], bodies[2], bodies[3]
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


@kernel
def _gap(a, b, disc, axis, enough, deep, room, normal, at):
    """`core_gap`; where they overlap, negative by the depth, or without end if it is not `deep`."""
    gap = core_gap(a, b, disc, axis, enough, room, normal, at)
    if gap > 0.0:
        return gap
    return -core_depth(a, b, disc, axis, normal, at) if deep else -np.inf


@inlined
def _bound(corners, radius, box):
    """The box (6,) about a hull grown by a radius."""
    for k in range(3):
        low, high = np.inf, -np.inf
        for i in range(len(corners)):
            low, high = min(low, corners[i, k]), max(high, corners[i, k])
        box[k], box[3 + k] = low - radius, high + radius


@kernel
def _hull_to_world(corners, radius, box, world, least, deep, room, normal, at):
    """Distance of a hull from obstacles and walls, or `least` where it is no nearer, with its slope and nearest point.

    `room` is that of `core_gap` and two rows more.
    """
    bounds, limits, trial, place = world[9], world[10], room[ROOM], room[ROOM + 1]
    for side in range(6):
        k = side % 3
        away = box[k] - limits[0, k] if side < 3 else limits[1, k] - box[3 + k]
        if away < least:
            least = away
            normal[:] = 0.0
            normal[k] = 1.0 if side < 3 else -1.0
            best = np.inf
            for i in range(len(corners)):
                if corners[i, k] * normal[k] < best:
                    best = corners[i, k] * normal[k]
                    at[:] = corners[i]
    for k in range(len(bounds)):
        if box_gap(box[:3], box[3:], bounds[k]) < least:
            solid, disc, axis, grown = solid_core(world, k)
            away = _gap(corners, solid, disc, axis, least + radius + grown, deep, room, trial, place) - radius - grown
            if away < least:
                least = away
                normal[:], at[:] = trial, place
    return least


@kernel
def _hull_to_other(p, corners, boxes, points, bodies, both, least, deep, room, normal, at):
    """The same of hull p from the balls of the other gripper and, if `both`, from its hulls."""
    sides, radii, (hull_sides, _, first, grown, _) = bodies[0], bodies[2], bodies[4]
    own, none, trial, place = corners[first[p] : first[p + 1]], np.zeros(3), room[ROOM], room[ROOM + 1]
    for q in range(len(hull_sides)):
        if both and hull_sides[q] != hull_sides[p] and box_gap(boxes[p, :3], boxes[p, 3:], boxes[q]) < least:
            beyond, other = grown[p] + grown[q], corners[first[q] : first[q + 1]]
            away = _gap(own, other, 0.0, none, least + beyond, deep, room, trial, place) - beyond
            if away < least:
                least = away
                normal[:], at[:] = trial, place
    for i in range(len(sides)):
        if sides[i] != hull_sides[p]:
            beyond = grown[p] + radii[i]
            away = _gap(own, points[i : i + 1], 0.0, none, least + beyond, deep, room, trial, place) - beyond
            if away < least:
                least = away
                normal[:], at[:] = trial, place
    return least


@kernel
def _hull_to_cable(corners, radius, box, stations, spared, side, least, deep, room, normal, at):
    """The same of a hull from the centre line of the cable that it does not hold; the station from which on that is
    nearest, and at what share of the way to the next."""
    none, trial, place = np.zeros(3), room[ROOM], room[ROOM + 1]
    last, nearest, share = len(stations) - 1, 0, 0.0
    for s in range(spared, last):
        i = last - s - 1 if side else s
        gap = -np.inf
        for k in range(3):
            low, high = min(stations[i, k], stations[i + 1, k]), max(stations[i, k], stations[i + 1, k])
            gap = max(gap, max(box[k] - high, low - box[3 + k]))
        if gap < least:
            piece = stations[i : i + 2]
            core = _gap(corners, piece, 0.0, none, least + radius, deep, room, trial, place)
            if core - radius < least:
                least, nearest = core - radius, i
                normal[:], at[:] = trial, place
                along, size = 0.0, 0.0
                for k in range(3):
                    step = piece[1, k] - piece[0, k]
                    along += step * (place[k] - core * trial[k] - piece[0, k])
                    size += step * step
                share = min(1.0, max(0.0, along / size))
    return least, nearest, share


@kernel
def hulls_keep(poses, points, stations, world, limits, bodies, hulls):
    """Whether hulls keep their distances from obstacles, walls, what the other gripper has and the cable.

    Where `hulls` is None, all below is left out as this is compiled.
    """
    if hulls is None:
        return True
    sides, own, first, radii, spared = hulls
    corners, boxes, room = np.empty((len(own), 3)), np.empty((len(sides), 6)), np.empty((ROOM + 4, 3))
    normal, at = room[ROOM + 2], room[ROOM + 3]
    for p in range(len(sides)):
        for i in range(first[p], first[p + 1]):
            turned(poses[sides[p]], own[i], corners[i])
        _bound(corners[first[p] : first[p + 1]], radii[p], boxes[p])
    for p in range(len(sides)):
        wanted, both = limits.bodies_apart, sides[p] == 0
        if _hull_to_other(p, corners, boxes, points, bodies, both, wanted, False, room, normal, at) < wanted:
            return False
    for p in range(len(sides)):
        hull, wanted = corners[first[p] : first[p + 1]], limits.gripper_clearance
        if _hull_to_world(hull, radii[p], boxes[p], world, wanted, False, room, normal, at) < wanted:
            return False
        wanted = limits.bodies_off_cable
        found = _hull_to_cable(hull, radii[p], boxes[p], stations, spared[p], sides[p], wanted, False, room, normal, at)
        if found[0] < wanted:
            return False
    return True


@kernel
def hull_gaps(corners, points, stations, world, bodies, ceilings):
    """How far hulls are from what they keep off, where that is nearer than `ceilings` (3,), negative by the depth.

    Args:
        corners: (t, c, 3) of the hulls in the world.
        points: (t, k, 3) centres of the balls.
        stations: (t, s, 3) of the cable.
        world: Obstacles and walls.
        bodies: All of them.
        ceilings: (3,) by `WORLD`, `OTHER` and `OFF`; the last from the centre line of the cable.

    Returns:
        Distances (t, p, 3), their slopes by moves of the hulls (t, p, 3, 3) and points of the hulls (t, p, 3, 3); and
        the station (t, p) from which on the cable is nearest, at a share (t, p) of the way to the next.
    """
    sides, _, first, radii, spared = bodies[4]
    rows, many = len(corners), len(sides)
    away, normal, at = np.empty((rows, many, 3)), np.zeros((rows, many, 3, 3)), np.zeros((rows, many, 3, 3))
    near, share = np.zeros((rows, many), np.int64), np.zeros((rows, many))
    boxes, room = np.empty((many, 6)), np.empty((ROOM + 2, 3))
    for t in range(rows):
        for p in range(many):
            _bound(corners[t, first[p] : first[p + 1]], radii[p], boxes[p])
        for p in range(many):
            hull, n, x = corners[t, first[p] : first[p + 1]], normal[t, p], at[t, p]
            away[t, p, WORLD] = _hull_to_world(
                hull, radii[p], boxes[p], world, ceilings[WORLD], True, room, n[WORLD], x[WORLD]
            )
            away[t, p, OTHER] = _hull_to_other(
                p, corners[t], boxes, points[t], bodies, True, ceilings[OTHER], True, room, n[OTHER], x[OTHER]
            )
            away[t, p, OFF], near[t, p], share[t, p] = _hull_to_cable(
                hull, radii[p], boxes[p], stations[t], spared[p], sides[p], ceilings[OFF], True, room, n[OFF], x[OFF]
            )
    return away, normal, at, near, share


@inlined
def _squared(a, b):
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2


@kernel
def is_free(q, space):
    """Whether cable and bodies keep their distances, and the shape is stable, slack, little twisted and not coiled.

    The cheapest tests come first.
    """
    rod, world, limits, bodies, arms = space
    p, stiff = rod
    if abs(q[9]) > limits.most_twist * p[1]:
        return False
    last = 2 * len(stiff)
    stations, flat = np.empty((last + 1, 3)), np.empty((last + 1, 3, 0))
    poses, none = np.empty((2, 7)), np.empty((2, 6, 0))
    held_shape(q, p, stiff, stations, flat, poses, none)
    squared = _squared(stations[0], stations[last])
    if not limits.least_span**2 <= squared <= limits.most_span**2:
        return False
    if not spatial_arms_reach(poses, arms):
        return False
    if sharpest_turn(stations, p[0]) > limits.sharpest_turn:
        return False
    if not points_keep(stations, world, limits.cable_distance):
        return False
    points = np.empty((len(bodies[0]), 3))
    body_points(poses, bodies, points)
    if not bodies_keep(points, stations, world, limits, bodies):
        return False
    if not hulls_keep(poses, points, stations, world, limits, bodies, bodies[4]):
        return False
    if self_distance(stations, limits.apart) < limits.self_distance:
        return False
    return spatial_arms_keep(poses, stations, arms) and has_margin(q, p, stiff, limits.stability)


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
