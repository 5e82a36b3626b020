"""Clearance of a held cable and of what moves with its grippers, where only keypoints and gripper poses are known."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely
from jaxtyping import Float, Int

from cableway.geometry import polyline
from cableway.geometry.convex import polyline_distance, signed_distance
from cableway.scene.bodies import LEFT, Body, body_pairs, held_arc, into_frame, outer_bodies
from cableway.scene.cable import Cable
from cableway.scene.scene import Scene
from cableway.scene.task import Task

PIECES = 4
"""Segments of the cable between two keypoints: 6 mm each on 0.3 m, off the arc by 0.1 mm at a bend of 40 mm radius."""


def cable_clearance(shapes: Float[np.ndarray, "t n 2"], task: Task) -> Float[np.ndarray, "t"]:
    """Clearance [m] of the whole cable's surface through keypoints [m]."""
    return task.scene.clearance(polyline.spline(shapes, PIECES), task.cable.radius)


def body_clearance(body: Body, poses: Float[np.ndarray, "t 2 3"], scene: Scene) -> Float[np.ndarray, "t"]:
    """Clearance [m] of a body with the grippers at `poses` [m, m, rad], from all that is as high as it is low."""
    held, lowest = poses[:, body.side], body.heights[0]
    outline = body.placed(held)
    if outline.shape[-2] == 1:
        return scene.signed_distance(outline[:, 0], lowest) - body.rounding
    return np.minimum(scene.clearance(outline, body.rounding, lowest), _from_inside(body, held, scene))


def _from_inside(body: Body, held: Float[np.ndarray, "t 3"], scene: Scene) -> Float[np.ndarray, "t"]:
    """Clearance [m] of the first vertex of every obstacle, grown as it is, from a body at `held` [m, m, rad].

    An obstacle that stands inside the outline touches none of its sides.
    """
    tall = [solid for solid in scene.obstacles if solid.height is None or solid.height > body.heights[0]]
    if not tall:
        return np.full(len(held), np.inf)
    points = into_frame(np.array([solid.vertices[0] for solid in tall]), held)
    return (signed_distance(points, body.world)[0] - [solid.rounding for solid in tall]).min(axis=1)


def bodies_gap(pairs: Sequence[tuple[Body, Body]], poses: Float[np.ndarray, "t 2 3"]) -> Float[np.ndarray, "t"]:
    """Least distance [m] between pairs of bodies; infinite where there are none."""
    gap = np.full(len(poses), np.inf)
    for a, b in pairs:
        for one, other in ((a, b), (b, a)):
            lines = into_frame(one.placed(poses[:, one.side]), poses[:, other.side])
            gap = np.minimum(gap, polyline_distance(lines, other.world)[0] - one.rounding)
    return gap


def cable_gap(
    bodies: Sequence[Body],
    lines: Float[np.ndarray, "t m 2"],
    poses: Float[np.ndarray, "t 2 3"],
    cable: Cable,
    margin: float = 0.0,
) -> Float[np.ndarray, "t"]:
    """Least distance [m] of the cable's surface from bodies that could meet it; infinite where there are none.

    Args:
        bodies: The bodies.
        lines: The cable's centre lines [m], vertices at equal arc length.
        poses: Of the grippers [m, m, rad].
        cable: The cable.
        margin: Clearance [m] with which the cable leaves the gripper that holds it; what comes before is left out.
    """
    radius, gap = cable.radius, np.full(len(poses), np.inf)
    for body in bodies:
        if not body.meets_cable(radius):
            continue
        free = lines[:, free_stations(body, lines.shape[1], cable, margin)]
        if free.shape[1] > 1:
            points = into_frame(free, poses[:, body.side])
            gap = np.minimum(gap, polyline_distance(points, body.world)[0] - radius)
    return gap


def free_stations(body: Body, count: int, cable: Cable, margin: float) -> Int[np.ndarray, "k"]:
    """Which of `count` points at equal arc length along a cable lie beyond what the gripper of a body holds.

    See `cableway.scene.bodies.held_arc`.
    """
    first = math.ceil(held_arc(body, cable.radius, margin) * (count - 1) / cable.length)
    return np.arange(first, count) if body.side == LEFT else np.arange(count - first)


def pieces_clearance(
    lines: Float[np.ndarray, "t m 2"], poses: Float[np.ndarray, "t 2 3"], task: Task
) -> Float[np.ndarray, "t"]:
    """Clearance [m] of what grippers have beyond their discs, from the scene, each other and the cable along `lines`.

    Infinite where they have nothing.
    """
    pieces = task.grippers.pieces
    if not pieces:
        return np.full(len(poses), np.inf)
    found = [body_clearance(body, poses, task.scene) for body in outer_bodies(pieces, task.scene.heights)]
    apart, off = bodies_gap(body_pairs(pieces), poses), cable_gap(pieces, lines, poses, task.cable)
    return np.min([*found, apart, off], axis=0)


def clearances(
    shapes: Float[np.ndarray, "t n 2"], poses: Float[np.ndarray, "t 2 3"], task: Task, margin: float = 0.0
) -> Float[np.ndarray, "t c"]:
    """Clearances [m] of the cable, of each of `Task.outer_bodies`, and of bodies from each other and the cable.

    A column each; those of what cannot meet are left out. `margin` [m] as for `cable_gap`.
    """
    lines = polyline.spline(shapes, PIECES)
    found = [task.scene.clearance(lines, task.cable.radius)]
    found += [body_clearance(body, poses, task.scene) for body in task.outer_bodies]
    others = [bodies_gap(task.body_pairs, poses), cable_gap(task.bodies, lines, poses, task.cable, margin)]
    return np.column_stack([*found, *(gap for gap in others if np.isfinite(gap).all())])


def lowest_above(place: shapely.Polygon, poses: Sequence[Float[np.ndarray, "2 3"]], bodies: Sequence[Body]) -> float:
    """Height [m] of the lowest body, more than a disc, of grippers at some poses above a place; infinite without."""
    placed = ((body.heights[0], body.placed(at[body.side])) for at in poses for body in bodies)
    above = (low for low, line in placed if len(line) > 1 and shapely.Polygon(line).intersects(place))
    return min(above, default=math.inf)
