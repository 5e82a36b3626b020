"""What a shape costs: shortfalls of the constraints of `motion.validity` against softer limits, and their slopes.

A term is a value that is zero where the constraint holds with room, in its own unit, and its derivative. Trajectory
optimisation, random tasks and controllers weigh them and add up their squares.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.geometry import convex
from cableway.geometry.groups import SE2
from cableway.motion.limits import body_rounding
from cableway.rod.held_rod import HeldRod
from cableway.scene.task import Task

BODY_SPACING = 0.008
"""Distance [m] between the points round a body. A corner between two of them, at clearance d, is nearer by at most
`BODY_SPACING`^2 / (8 d): 0.8 mm at 10 mm."""


def clearance_shortfall(
    points: Float[np.ndarray, "... 2"], world: convex.ConvexWorld, wanted: float
) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "... 2"]]:
    """How far points are nearer than `wanted` [m] to something, and the slope by their position."""
    distance, slope, _ = convex.signed_distance(points, world, wanted)
    short = np.maximum(0.0, wanted - distance)
    return short, -slope * (short > 0)[..., None]


def body_shortfall(
    task: Task, poses: Float[np.ndarray, "t 2 3"], margin: float
) -> tuple[Float[np.ndarray, "t k"], Float[np.ndarray, "t k 2 3"]]:
    """How far points round the bodies lack a clearance of `margin` [m], and the slope by the gripper poses."""
    rod, short, slopes = task.cable.rod, [], []
    for body in task.bodies:
        at = poses[:, body.side]
        points = body.placed(at, BODY_SPACING)
        points = points if points.shape[1] == 1 else points[:, :-1]
        lack, slope = clearance_shortfall(points, task.scene.world, margin + body_rounding(body, task.cable))
        by_poses = np.zeros((*lack.shape, *rod.step_shape))
        by_poses[:, :, body.side] = rod.group.pulled_back(slope, points, at[:, None])
        short.append(lack)
        slopes.append(by_poses)
    return np.concatenate(short, axis=1), np.concatenate(slopes, axis=1)


def span_excess(
    poses: Float[np.ndarray, "t 2 3"], most: float | Float[np.ndarray, "t"], least: float
) -> tuple[Float[np.ndarray, "t 2"], Float[np.ndarray, "t 2 2 3"]]:
    """How far [m] the gripper span is above `most` and below `least` [m], and the slopes by the gripper poses."""
    space, dof = SE2.space, SE2.dof
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
