"""Whether a start or goal in space is one that the cable and the grippers can have in their scene."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
from jaxtyping import Float

from cableway.core.errors import TaskError
from cableway.core.quantities import limit_text, place, quantity, size_text, told_apart
from cableway.geometry.spatial_convex import WALLS, Solid, SpatialWorld, chain_distance, hull_distance
from cableway.geometry.spatial_convex_kernels import self_distance
from cableway.scene.bodies import LEFT
from cableway.scene.grippers import SIDES
from cableway.scene.spatial.cable import SpatialCable
from cableway.scene.spatial.grippers import SpatialBody, SpatialGrippers
from cableway.scene.spatial.scene import SpatialScene

FAR = 1e6
"""Of walls that are none [m]."""

BENT = 0.02
"""Relative error of a bend radius: a chain turns at its hinges alone."""


def end_faults(
    end: str, q: Float[np.ndarray, "12"], scene: SpatialScene, cable: SpatialCable, grippers: SpatialGrippers
) -> Iterator[TaskError]:
    """Why the cable and the grippers cannot be at the equilibrium q; `end` ("start" or "goal") names it.

    Outside the workspace, unstable, the cable in an obstacle, a wall, the table, itself or a gripper, bent or twisted
    too much; grippers in anything, or too near to each other.
    """
    stations, poses = (each[0] for each in cable.rod.shapes(np.array(q)[None]))
    if not scene.contains(stations).all():
        i = int(np.argmin(np.minimum(stations, scene.size - stations).min(axis=1)))
        below = stations[i, 2] < 0 and scene.contains(np.abs(stations[[i]])).all()
        where = f"goes through the table by {quantity(-stations[i, 2])}" if below else "lies outside the workspace"
        yield TaskError(f"at {place(stations[i])} {where} of {size_text(scene.size)}", (end,), at=_seen(stations[i]))
    yield from _bent(end, np.array(q), stations, cable)
    yield from _cable_overlaps(end, stations, scene, cable)
    for side, _ in enumerate(SIDES):
        held = [body for body in grippers.bodies if body.side == side]
        yield from _gripper_overlaps(end, held, poses[side], scene)
        yield from _on_cable(end, held, stations, poses[side], cable)
    yield from _grippers_meet(end, poses, grippers)


def kept_at(
    q: Float[np.ndarray, "12"], scene: SpatialScene, cable: SpatialCable, bodies: Sequence[SpatialBody]
) -> dict[str, float]:
    """What the cable and the grippers keep at the equilibrium q; see `SpatialDraft.kept`."""
    row = np.array(q)[None]
    stations, poses = cable.rod.shapes(row)
    clear = [body_clearance(body, poses[0, body.side], scene) for body in bodies]
    return {
        "cable_clearance": float(chain_distance(stations, scene.world)[0][0]) - cable.radius,
        "gripper_clearance": min(clear),
        "stability": float(cable.rod.stability(row)[0][0]),
        "twist": abs(float(q[9])) / cable.twist_ratio,
        "span": float(np.linalg.norm(poses[0, 1, :3] - poses[0, 0, :3])),
    }


def body_clearance(body: SpatialBody, pose: Float[np.ndarray, "7"], scene: SpatialScene) -> float:
    """Distance [m] of a body from obstacles and walls, negative by the depth where it overlaps one."""
    points = body.placed(pose)
    least = float(np.minimum(points, np.array(scene.size) - points).min())
    for solid in scene.world.solids:
        low, high = points.min(axis=0) - least, points.max(axis=0) + least
        if (solid.bounds[:3] <= high).all() and (solid.bounds[3:] >= low).all():
            least = min(least, hull_distance(points, solid))
    return least - body.radius


def _bent(
    end: str, q: Float[np.ndarray, "12"], stations: Float[np.ndarray, "s 3"], cable: SpatialCable
) -> Iterator[TaskError]:
    margin = float(cable.rod.stability(q[None])[0][0])
    if not margin > 0:
        problem = f"is not a stable shape of the cable: its stability margin is {margin:.3g}, and it would snap away"
        yield TaskError(problem, (end,), at=_seen(stations[len(stations) // 2]))
    twist = abs(float(q[9])) / cable.twist_ratio
    if twist > cable.max_twist * (1 + 1e-9):
        problem = f"is twisted by {told_apart(twist, cable.max_twist, 'rad')}"
        yield TaskError(f"{problem}, more than cable.max_twist {limit_text(cable.max_twist, 'rad')}", (end,))
    links = np.diff(np.concatenate([stations[:1], stations[1::2], stations[-1:]]), axis=0)
    t = links / np.linalg.norm(links, axis=1, keepdims=True)
    turns = np.arccos(np.clip(np.sum(t[1:] * t[:-1], axis=1), -1, 1))
    i = int(np.argmax(turns))
    radius = cable.length / cable.rod.hinges / max(float(turns[i]), 1e-12)
    if radius < cable.min_bend_radius * (1 - BENT):
        bend = told_apart(radius, cable.min_bend_radius)
        problem = f"bends to a radius of {bend}, below cable.min_bend_radius {limit_text(cable.min_bend_radius)}"
        yield TaskError(problem, (end,), at=_seen(stations[2 * i + 1]))
    gap = self_distance(stations, math.ceil(math.pi * cable.radius * (len(stations) - 1) / cable.length) + 1)
    if gap < 2 * cable.radius:
        problem = f"touches itself: its centre line comes within {quantity(gap)} of itself"
        yield TaskError(f"{problem}, less than twice cable.radius {limit_text(cable.radius)}", (end,))


def _cable_overlaps(
    end: str, stations: Float[np.ndarray, "s 3"], scene: SpatialScene, cable: SpatialCable
) -> Iterator[TaskError]:
    inside = stations[scene.contains(stations)]
    if len(inside) < len(stations):
        return
    distance, solid, at = scene.nearest(stations)
    depth = cable.radius - distance
    if depth > 0:
        yield TaskError(f"overlaps {scene.name_of(solid)} by {quantity(depth)}, near {place(at)}", (end,), at=at)


def _gripper_overlaps(
    end: str, bodies: Sequence[SpatialBody], pose: Float[np.ndarray, "7"], scene: SpatialScene
) -> Iterator[TaskError]:
    """The wall and the obstacle in which the bodies of a gripper are deepest."""
    depths: dict[int, float] = {}
    for body in bodies:
        points = body.placed(pose)
        outward = np.concatenate([-points.min(axis=0), points.max(axis=0) - np.array(scene.size)]) + body.radius
        wall = int(np.argmax(outward))
        found = {len(scene.obstacles) + wall: float(outward[wall])}
        low, high = points.min(axis=0) - body.radius, points.max(axis=0) + body.radius
        for index, solid in enumerate(scene.world.solids):
            if (solid.bounds[:3] <= high).all() and (solid.bounds[3:] >= low).all():
                found[index] = body.radius - hull_distance(points, solid)
        for index, depth in found.items():
            depths[index] = max(depth, depths.get(index, 0.0))
    count = len(scene.obstacles)
    for among in (range(count, count + len(WALLS)), range(count)):
        index = max(among, key=lambda index: depths.get(index, 0.0), default=0)
        if (depth := depths.get(index, 0.0)) > 0:
            problem = f"has its {bodies[0].name} in {scene.name_of(index)} by {quantity(depth)}"
            yield TaskError(problem, (end,), at=_seen(pose))


def _on_cable(
    end: str, bodies: Sequence[SpatialBody], stations: Float[np.ndarray, "s 3"], pose: Float[np.ndarray, "7"],
    cable: SpatialCable,
) -> Iterator[TaskError]:  # fmt: skip
    """Where a gripper stands on the cable, but for the part that it holds."""
    deepest = 0.0
    for body in bodies:
        first = math.ceil(body.held_arc(cable.radius) / cable.length * (len(stations) - 1)) + 1
        free = (stations if body.side == LEFT else stations[::-1])[first:]
        if len(free) > 1:
            away = float(chain_distance(free[None], unbounded([body.solid(pose)]))[0][0])
            away -= 0.0 if len(body.points) == 1 else body.radius
            deepest = max(deepest, cable.radius - away)
    if deepest > 0:
        problem = f"has its {bodies[0].name} on the cable, in it by {quantity(deepest)}"
        yield TaskError(problem, (end,), at=_seen(pose))


def _grippers_meet(end: str, poses: Float[np.ndarray, "2 7"], grippers: SpatialGrippers) -> Iterator[TaskError]:
    gap, least = float(np.linalg.norm(poses[1, :3] - poses[0, :3])), grippers.least_span
    if gap < least:
        needed = "grippers.separation" if grippers.separation == least else "two of grippers.radius,"
        problem = f"has its grippers {told_apart(gap, least)} apart, less than {needed} {limit_text(least)}"
        yield TaskError(problem, (end,), at=_seen(poses[:, :3].mean(axis=0)))
    left, right = ([body for body in grippers.bodies if body.side == side] for side, _ in enumerate(SIDES))
    deepest = 0.0
    for one, other in product(left, right):
        if len(one.points) == len(other.points) == 1 or gap > one.reach + other.reach:
            continue
        hull, solid = (one, other) if len(one.points) > 1 else (other, one)
        away = hull_distance(hull.placed(poses[hull.side]), solid.solid(poses[solid.side])) - hull.radius
        away -= 0.0 if len(solid.points) == 1 else solid.radius
        deepest = max(deepest, -away)
    if deepest > 0:
        problem = f"has its {left[0].name} in its {right[0].name} by {quantity(deepest)}"
        yield TaskError(problem, (end,), at=_seen(poses[0]))


def unbounded(solids: Sequence[Solid]) -> SpatialWorld:
    """Solids without walls."""
    return SpatialWorld.of(solids, np.full(3, 2 * FAR), np.full(3, -FAR))


def _seen(point: Float[np.ndarray, "..."]) -> tuple[float, float, float]:
    x, y, z = point[:3]
    return float(x), float(y), float(z)
