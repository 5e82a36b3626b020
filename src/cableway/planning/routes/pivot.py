"""The pivot path: where the cable's centre goes, with a trade between length and clearance."""

from __future__ import annotations

from pkgutil import resolve_name

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError, PlanningError
from cableway.core.quantities import limit_text, place, told_apart
from cableway.planning.config import PivotConfig
from cableway.planning.routes import band
from cableway.planning.routes.pivot_grid import grid_path
from cableway.scene.scene import Scene

RRT_STAR = "cableway.tang2025.planning.pivot_rrt_star:rrt_star_path"
"""The paper's method; imported only when it is asked for."""


def pivot_keypoint(keypoints: int) -> int:
    """Index of the keypoint that follows the pivot path: the middle one, for an even number the left of the two.

    >>> pivot_keypoint(13), pivot_keypoint(4)
    (6, 1)
    """
    return (keypoints - 1) // 2


def plan_pivot_path(
    scene: Scene,
    start: Float[np.ndarray, "2"],
    goal: Float[np.ndarray, "2"],
    radius: float,
    config: PivotConfig,
    *,
    seed: int = 0,
) -> Float[np.ndarray, "P 2"]:
    """The path of the cable's centre with the least of k_l length + k_c integral of 1/d (Tang et al., eq. for l).

    Args:
        scene: Workspace and obstacles.
        start: (2,) [m], first vertex of the path.
        goal: (2,) [m], last vertex of the path.
        radius: Distance [m] that the path keeps from obstacles and walls.
        config: Method and weights.
        seed: For RRT*; the grid needs none.

    Returns:
        (P, 2) vertices [m], P >= 2.

    Raises:
        PlanningError: Start or goal is too near an obstacle, or no path keeps `radius`.
        InputError: A coordinate is not finite, or RRT* was asked for where OMPL has no wheel.
        MissingExtraError: RRT* was asked for without the extra `tang2025`.

    Note:
        The paper integrates 1/d over the path parameter in [0, 1]. That is not additive, so no planner can
        minimise it edge by edge; here the integral is over arc length, and k_c has the unit m. d is the signed
        distance of the cable's centre line.
    """
    ends = np.array([start, goal], dtype=float)
    if ends.shape != (2, 2) or not np.isfinite(ends).all():
        raise InputError(f"start and goal of the pivot path must be two finite points, got {start} and {goal}")
    for name, point, distance in zip(("start", "goal"), ends, scene.signed_distance(ends), strict=True):
        if distance < radius:
            raise PlanningError(
                f"the {name} of the pivot path {place(point)} is "
                f"{told_apart(distance, radius)} from the nearest obstacle, less than the {limit_text(radius)} required"
            )
    if np.array_equal(*ends):
        return ends
    if config.method == "grid":
        return grid_path(scene, ends[0], ends[1], radius, config)
    return resolve_name(RRT_STAR)(scene, ends[0], ends[1], radius, config, seed)


def pivot_cost(scene: Scene, path: Float[np.ndarray, "P 2"], config: PivotConfig, step: float = 1e-3) -> float:
    """k_l length + k_c integral of 1/d over arc length [m], by midpoints at most `step` [m] apart."""
    path = np.ascontiguousarray(path, dtype=float)
    return float(band.path_cost(path, scene.world.arrays, config.length_weight, config.clearance_weight, step))
