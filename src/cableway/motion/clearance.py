"""Clearance of a held cable and of what moves with its grippers, where only keypoints and gripper poses are known."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.geometry import polyline
from cableway.scene.bodies import Body
from cableway.scene.scene import Scene
from cableway.scene.task import Task

PIECES = 4
"""Segments of the cable between two keypoints: 6 mm each on 0.3 m, off the arc by 0.1 mm at a bend of 40 mm radius."""


def cable_clearance(shapes: Float[np.ndarray, "t n 2"], task: Task) -> Float[np.ndarray, "t"]:
    """Clearance [m] of the whole cable's surface through keypoints [m]."""
    return task.scene.clearance(polyline.spline(shapes, PIECES), task.cable.radius)


def body_clearance(body: Body, poses: Float[np.ndarray, "t 2 3"], scene: Scene) -> Float[np.ndarray, "t"]:
    """Clearance [m] of a body with the grippers at `poses` [m, m, rad]."""
    outline = body.placed(poses[:, body.side])
    if outline.shape[-2] == 1:
        return scene.signed_distance(outline[:, 0]) - body.rounding
    return scene.clearance(outline, body.rounding)


def clearances(
    shapes: Float[np.ndarray, "t n 2"], poses: Float[np.ndarray, "t 2 3"], task: Task
) -> Float[np.ndarray, "t c"]:
    """Clearances [m] of the cable and of each of `Task.bodies`, a column each."""
    bodies = [body_clearance(body, poses, task.scene) for body in task.bodies]
    return np.column_stack([cable_clearance(shapes, task), *bodies])
