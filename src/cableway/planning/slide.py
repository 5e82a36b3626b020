"""An initial trajectory without optimisation: the cable slides along one curve, one end leading.

The curve is the start cable, a path from its leading end to the trailing end of the goal cable, and the goal cable.
Every shape on it has the cable's length, whatever the clutter.

Note:
    Not in the paper (Tang et al.). Where the path turns back sharply the shapes are no shapes of a cable; the
    projection makes them so.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from jaxtyping import Float

from cableway.geometry import polyline
from cableway.planning.config import PivotConfig
from cableway.planning.routes import band
from cableway.planning.routes.pivot import pivot_keypoint, plan_pivot_path
from cableway.planning.routes.pivot_grid import polish
from cableway.scene.clearance import PIECES
from cableway.scene.task import Task

End = Literal["head", "tail"]

ROW_STEP = 0.012
"""Advance along the curve from shape to shape [m]: half a keypoint spacing of a 0.3 m cable."""


def slide(
    task: Task,
    leading: End,
    config: PivotConfig,
    *,
    seed: int = 0,
    route: Float[np.ndarray, "P 2"] | None = None,
) -> Float[np.ndarray, "r n 2"]:
    """Shapes of a cable that slides from start to goal.

    Args:
        task: The task.
        leading: "head": the right end goes first; "tail": the left end.
        config: How the path between the two cables is found.
        seed: For that path.
        route: (P, 2) path of the cable's middle [m], whose homotopy class the cable keeps; without it, the shortest
            path between the two cables is taken.

    Returns:
        (R+1, n, 2) keypoints [m], at equal travel along the curve.

    Raises:
        PlanningError: No path leads from one cable to the other.
    """
    start, goal = (task.start, task.goal) if leading == "head" else (task.start[::-1], task.goal[::-1])
    radius = max(task.cable.radius, task.grippers.radius)
    if route is None:
        path = plan_pivot_path(task.scene, start[-1], goal[0], radius, config, seed=seed)
    else:
        middle = pivot_keypoint(len(start))
        there = middle if leading == "head" else len(start) - 1 - middle
        loose = np.vstack([start[:there:-1], route, goal[there::-1]])
        points = band.reference_points(task.scene.world)
        path = polish(loose, task.scene, radius, config, config.resolution, points)
    curve = polyline.remove_repeated(np.vstack([polyline.spline(start, PIECES), path, polyline.spline(goal, PIECES)]))
    first, last = (float(polyline.length(polyline.spline(shape, PIECES))) for shape in (start, goal))
    travel = float(polyline.length(curve)) - last
    shares = np.linspace(0.0, 1.0, max(8, int(np.ceil(travel / ROW_STEP))) + 1)
    along = np.linspace(0.0, 1.0, len(start))
    shapes = np.array([polyline.point_at(curve, f * travel + along * ((1 - f) * first + f * last)) for f in shares])
    shapes[0], shapes[-1] = start, goal
    if leading == "tail":
        shapes = shapes[:, ::-1]
    return np.ascontiguousarray(shapes)
