"""What a shape costs: shortfalls of the constraints of `motion.validity` against softer limits, and their slopes.

A term is a value that is zero where the constraint holds with room, in its own unit, and its derivative. Trajectory
optimisation, random tasks and controllers weigh them and add up their squares.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.geometry import convex, se2
from cableway.geometry.groups import SE2
from cableway.motion.limits import BodyPoints
from cableway.rod.held_rod import HeldRod


def clearance_shortfall(
    points: Float[np.ndarray, "... 2"], world: convex.ConvexWorld, wanted: Float[np.ndarray, "..."] | float
) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "... 2"]]:
    """How far points are nearer than `wanted` [m] to something, and the slope by their position."""
    distance, slope, _ = convex.signed_distance(points, world, float(np.max(wanted)))
    short = np.maximum(0.0, wanted - distance)
    return short, -slope * (short > 0)[..., None]


def body_shortfall(
    bodies: BodyPoints, world: convex.ConvexWorld, poses: Float[np.ndarray, "t 2 3"], margin: float
) -> tuple[Float[np.ndarray, "t k"], Float[np.ndarray, "t k 2 3"]]:
    """How far points round the bodies lack a clearance of `margin` [m], and the slope by the gripper poses."""
    at = poses[:, bodies.side]
    x, y = bodies.at.T[..., None]
    points = SE2.position(at) + x * se2.direction(at[..., 2]) + y * se2.direction(at[..., 2] + np.pi / 2)
    lack, slope = clearance_shortfall(points, world, margin + bodies.rounding)
    by_poses = np.zeros((*lack.shape, 2, SE2.dof))
    by_poses[:, np.arange(len(bodies.side)), bodies.side] = SE2.pulled_back(slope, points, at)
    return lack, by_poses


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
