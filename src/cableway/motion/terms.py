"""What a shape costs: shortfalls of the constraints of `motion.validity` against softer limits, and their slopes.

A term is a value that is zero where the constraint holds with room, in its own unit, and its derivative. Trajectory
optimisation, random tasks and controllers weigh them and add up their squares.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from cableway.geometry import convex, se2
from cableway.geometry.groups import SE2, Group
from cableway.motion.limits import BODY_SPACING, BodyPoints
from cableway.rod.held_rod import HeldRod
from cableway.scene.bodies import Body, into_frame, out_of_frame
from cableway.scene.clearance import free_stations
from cableway.scene.task import Task

CLEARANCE_SCALE = 0.001
"""Of what is missing of the margin [m]; a scale is the size of a residual that counts as 1."""

ROOM_SCALE = 0.005
"""Of the shortfall of the clearance against the room [m]."""

STABILITY_SCALE = 2.0
"""Of the shortfall of the stability margin."""

TENSION, TENSION_SCALE = 40.0, 5.0
"""Force along the rod at its centre, in EI/L^2, that costs nothing, and the scale of what is beyond. The room asked for
would stretch the cable to 200 in narrow bends, and under tension small errors of the model turn into large motions of
the grippers; plans in clutter stay below 40."""

SPAN_SCALE = 0.005
"""Of the excess of the gripper span, over L."""

BEND_SCALE = 0.01
"""Of the excess of the sine of the turn at a hinge."""


def clearance_shortfall(
    points: Float[np.ndarray, "... 2"],
    world: convex.ConvexWorld,
    wanted: Float[np.ndarray, "..."] | float,
    above: Float[np.ndarray, "..."] | float = 0.0,
) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "... 2"]]:
    """How far points are nearer than `wanted` [m] to something higher than `above` [m], and the slope by position."""
    distance, slope, _ = convex.signed_distance(points, world, float(np.max(wanted)), above)
    short = np.maximum(0.0, wanted - distance)
    return short, -slope * (short > 0)[..., None]


def body_shortfall(
    bodies: BodyPoints, world: convex.ConvexWorld, poses: Float[np.ndarray, "t 2 3"], margin: float
) -> tuple[Float[np.ndarray, "t k"], Float[np.ndarray, "t k 2 3"]]:
    """How far points round the bodies lack a clearance of `margin` [m], and the slope by the gripper poses."""
    at = poses[:, bodies.side]
    points = out_of_frame(bodies.at, at)
    lack, slope = clearance_shortfall(points, world, margin + bodies.rounding, bodies.lowest)
    by_poses = np.zeros((*lack.shape, 2, SE2.dof))
    by_poses[:, np.arange(len(bodies.side)), bodies.side] = SE2.pulled_back(slope, points, at)
    return lack, by_poses


def bodies_shortfall(
    pairs: Sequence[tuple[Body, Body]], poses: Float[np.ndarray, "t 2 3"], wanted: float
) -> tuple[Float[np.ndarray, "t k"], Float[np.ndarray, "t k 2 3"]]:
    """How far points round one body of a pair are nearer than `wanted` [m] to the other, and the slope by the poses.

    Points that are nearer in no row are left out.
    """
    count = len(poses)
    short: list[np.ndarray] = [np.zeros((count, 0))]
    slopes: list[np.ndarray] = [np.zeros((count, 0, 2, SE2.dof))]
    for a, b in pairs:
        rows = np.flatnonzero(_may_be_nearer(a, b, poses, wanted))
        for one, other in ((a, b), (b, a)) if len(rows) else ():
            held, at = poses[rows, one.side], poses[rows, other.side]
            points = one.placed(held, BODY_SPACING)[:, :-1]
            lack, slope = _shortfall_of(points, other, at, wanted + one.rounding)
            some = lack.any(axis=0)
            points, lack, slope = points[:, some], lack[:, some], slope[:, some]
            by_poses = np.zeros((count, lack.shape[1], 2, SE2.dof))
            by_poses[rows, :, one.side] = SE2.pulled_back(slope, points, held[:, None])
            by_poses[rows, :, other.side] = -SE2.pulled_back(slope, points, at[:, None])
            lacks = np.zeros((count, lack.shape[1]))
            lacks[rows] = lack
            short.append(lacks)
            slopes.append(by_poses)
    return np.concatenate(short, axis=1), np.concatenate(slopes, axis=1)


def _may_be_nearer(a: Body, b: Body, poses: Float[np.ndarray, "t 2 3"], wanted: float) -> Bool[np.ndarray, "t"]:
    """In which rows the circles round two bodies are nearer to each other than `wanted` [m]."""
    (one, radius), (other, other_radius) = a.circle, b.circle
    between = out_of_frame(one, poses[:, a.side]) - out_of_frame(other, poses[:, b.side])
    return np.linalg.norm(between, axis=1) < radius + other_radius + wanted


def cable_shortfall(
    stations: Float[np.ndarray, "t s 2"], poses: Float[np.ndarray, "t 2 3"], task: Task, margin: float
) -> tuple[Float[np.ndarray, "t k"], Int[np.ndarray, "k"], Float[np.ndarray, "t k 2"], Float[np.ndarray, "t k 2 3"]]:
    """How far the cable lacks a clearance of `margin` [m] from bodies that could meet it.

    Returns:
        The shortfall of every station that does in some row, body by body, which stations those are, and the slopes by
        their positions and by the gripper poses.
    """
    rows, count = stations.shape[:2]
    short: list[np.ndarray] = [np.zeros((rows, 0))]
    which: list[np.ndarray] = [np.zeros(0, np.int64)]
    slopes: list[np.ndarray] = [np.zeros((rows, 0, 2))]
    by_poses: list[np.ndarray] = [np.zeros((rows, 0, 2, SE2.dof))]
    for body in task.bodies:
        if not body.meets_cable(task.cable.radius):
            continue
        free = free_stations(body, count, task.cable, margin)
        points, at = stations[:, free], poses[:, body.side]
        lack, slope = _shortfall_of(points, body, at, margin + task.cable.radius)
        some = lack.any(axis=0)
        free, points, lack, slope = free[some], points[:, some], lack[:, some], slope[:, some]
        turned = np.zeros((*lack.shape, 2, SE2.dof))
        turned[:, :, body.side] = -SE2.pulled_back(slope, points, at[:, None])
        for found, new in ((short, lack), (which, free), (slopes, slope), (by_poses, turned)):
            found.append(new)
    return np.hstack(short), np.concatenate(which), np.hstack(slopes), np.hstack(by_poses)


def _shortfall_of(
    points: Float[np.ndarray, "t k 2"], body: Body, at: Float[np.ndarray, "t 3"], wanted: float
) -> tuple[Float[np.ndarray, "t k"], Float[np.ndarray, "t k 2"]]:
    """How far points [m] are nearer than `wanted` [m] to a body at a pose, and the slope by them, in the world."""
    short, slope = clearance_shortfall(into_frame(points, at), body.world, wanted)
    angle = at[:, None, 2]
    along, aside = se2.direction(angle), se2.direction(angle + np.pi / 2)
    return short, slope[..., :1] * along + slope[..., 1:] * aside


def span_excess(
    poses: Float[np.ndarray, "t 2 pose"],
    most: float | Float[np.ndarray, "t"],
    least: float,
    group: type[Group] = SE2,
) -> tuple[Float[np.ndarray, "t 2"], Float[np.ndarray, "t 2 2 step"]]:
    """How far [m] the gripper span is above `most` and below `least` [m], and the slopes by the gripper poses."""
    space, dof = group.space, group.dof
    between = poses[:, 1, :space] - poses[:, 0, :space]
    span = np.linalg.norm(between, axis=1)
    over = np.column_stack([span - most, least - span])
    slope = np.zeros((*over.shape, 2, dof))
    unit = between / np.maximum(span, 1e-12)[:, None]
    slope[:, 0, 1, :space], slope[:, 1, 1, :space] = unit, -unit
    slope[:, :, 0] = -slope[:, :, 1]
    return np.maximum(0.0, over), slope * (over > 0)[..., None, None]


def stability_shortfall(
    rod: HeldRod, q: Float[np.ndarray, "t dof"], wanted: float
) -> tuple[Float[np.ndarray, "t"], Float[np.ndarray, "t dof"]]:
    """How far the stability margin is below `wanted`, and the slope by q."""
    margin, slope = rod.stability(q, ceiling=wanted)
    lack = np.maximum(0.0, wanted - margin)
    return lack, -slope * (lack > 0)[:, None]


def turn_excess(stations: Float[np.ndarray, "t s 2"], rod: HeldRod, most: float) -> Float[np.ndarray, "t hinges"]:
    """How far the sine of the turn at each hinge is above `most`."""
    before, after = _half_links(stations)
    sines = np.abs(_cross(before, after)) / (rod.length / (2 * rod.hinges)) ** 2
    return np.maximum(0.0, sines - most)


def turn_excess_slope(
    stations: Float[np.ndarray, "t s 2"], dstations: Float[np.ndarray, "t s 2 dof"], rod: HeldRod, most: float
) -> Float[np.ndarray, "t hinges dof"]:
    """Slopes of `turn_excess` by q."""
    before, after = (part[..., None] for part in _half_links(stations))
    dbefore, dafter = _half_links(dstations)
    sine = _cross(before, after)
    slopes = (_cross(dbefore, after) + _cross(before, dafter)) * np.sign(sine)
    slopes /= (rod.length / (2 * rod.hinges)) ** 2
    return slopes * (turn_excess(stations, rod, most) > 0)[..., None]


def _half_links(stations: Float[np.ndarray, "t s 2 ..."]) -> tuple[np.ndarray, np.ndarray]:
    """The half links before and after each hinge, which are the stations of odd number."""
    halves = np.diff(stations, axis=1)
    return halves[:, ::2], halves[:, 1::2]


def _cross(a: Float[np.ndarray, "t k 2 ..."], b: Float[np.ndarray, "t k 2 ..."]) -> np.ndarray:
    return a[:, :, 0] * b[:, :, 1] - a[:, :, 1] * b[:, :, 0]
