"""The pivot path by RRT*, with OMPL: the paper's planner.

OMPL's wheels are for Linux only, and this is the one module that imports it. Edges and their costs are tested and
integrated exactly as on the grid, by compiled kernels.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError, PlanningError
from cableway.core.quantities import limit_text
from cableway.geometry import convex
from cableway.planning.config import PivotConfig
from cableway.planning.routes import band
from cableway.planning.routes.pivot_grid import subdivide
from cableway.scene.scene import Scene

try:
    from ompl import base, geometric, util
except ImportError as error:
    raise InputError(
        "pivot method 'rrt_star' needs OMPL, which is published for Linux only; use method 'grid'"
    ) from error

REACH = 0.1
"""Longest edge of the tree [m]: a third of the usual cable."""


def rrt_star_path(
    scene: Scene,
    start: Float[np.ndarray, "2"],
    goal: Float[np.ndarray, "2"],
    radius: float,
    config: PivotConfig,
    seed: int,
) -> Float[np.ndarray, "P 2"]:
    """The best path that RRT* finds in `config.iterations` iterations, vertices at most `config.resolution` apart.

    Args:
        scene: Workspace and obstacles.
        start: (2,) [m], in free space.
        goal: (2,) [m], in free space.
        radius: Distance [m] to keep from everything.
        config: Weights and iterations.
        seed: The same seed gives the same path.

    Raises:
        PlanningError: RRT* found no path, or one that does not keep `radius`.
    """
    level = util.getLogLevel()
    util.setLogLevel(util.LogLevel.LOG_NONE)
    try:
        util.RNG.setSeed(seed + 1)  # 0 would draw a seed from the clock
        path = _solve(scene, start, goal, radius, config)
    finally:
        util.setLogLevel(level)
    if path is None:
        raise PlanningError(
            f"RRT* found no path for the cable's centre that keeps {limit_text(radius)} from the obstacles in "
            f"{config.iterations} iterations"
        )
    path[0], path[-1] = start, goal
    if scene.clearance(path[None], radius)[0] < 0:
        raise PlanningError(f"RRT* returned a path that does not keep {limit_text(radius)} from the obstacles")
    return subdivide(path, config.resolution)


def _solve(
    scene: Scene, start: np.ndarray, goal: np.ndarray, radius: float, config: PivotConfig
) -> Float[np.ndarray, "k 2"] | None:
    space = base.RealVectorStateSpace(2)
    bounds = base.RealVectorBounds(2)
    for axis in range(2):
        bounds.setLow(axis, 0.0)
        bounds.setHigh(axis, float(scene.size[axis]))
    space.setBounds(bounds)
    information = base.SpaceInformation(space)
    validity, motion, objective = _answers(scene, radius, config)
    checks = validity(information), motion(information)
    information.setStateValidityChecker(checks[0])
    information.setMotionValidator(checks[1])
    information.setup()
    problem = base.ProblemDefinition(information)
    problem.setStartAndGoalStates(_state(space, start), _state(space, goal), 1e-9)
    problem.setOptimizationObjective(objective(information))
    planner = geometric.RRTstar(information)
    planner.setRange(REACH)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(base.PlannerTerminationCondition(lambda: bool(planner.numIterations() >= config.iterations)))
    if not problem.hasExactSolution():
        return None
    path: Any = problem.getSolutionPath()
    return np.array([[state[0], state[1]] for state in path.getStates()])


def _state(space: base.RealVectorStateSpace, point: np.ndarray) -> base.State:
    state: Any = space.allocState()
    state[0], state[1] = float(point[0]), float(point[1])
    return state


def _answers(scene: Scene, radius: float, config: PivotConfig) -> tuple[type[Any], type[Any], type[Any]]:
    """What OMPL asks: whether a point and a whole edge keep the radius, and what an edge costs."""
    world = scene.world.arrays
    # steps of twice the resolution are enough for edges that are only compared
    weights = config.length_weight, config.clearance_weight, 2 * config.resolution

    class Validity(base.StateValidityChecker):
        def isValid(self, state: Any) -> bool:
            return bool(convex.distance_at(state[0], state[1], world, 0.0) >= radius)  # OMPL takes only a real `bool`

    class Motion(base.MotionValidator):
        def checkMotion(self, s1: Any, s2: Any) -> bool:
            return bool(convex.segment_clearance(s1[0], s1[1], s2[0], s2[1], world, radius, 0.0)[1] < 0)

    class Objective(base.OptimizationObjective):
        def stateCost(self, state: Any) -> base.Cost:
            return base.Cost(0.0)

        def motionCost(self, s1: Any, s2: Any) -> base.Cost:
            return base.Cost(float(band.segment_cost(s1[0], s1[1], s2[0], s2[1], world, *weights)))

    return Validity, Motion, Objective
