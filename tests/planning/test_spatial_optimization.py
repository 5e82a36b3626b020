"""The cost of trajectories in space: its slope, and what it moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from spatial_problems import past_a_ball

from cableway.geometry.spatial_convex import signed_distance
from cableway.motion.limits import Margins
from cableway.motion.spatial import SpatialBodies, SpatialFreeSpace, SpatialProblem
from cableway.motion.spatial_kernels import WORLD
from cableway.planning.spatial_optimization import SpatialCost, optimize_in_space
from cableway.planning.spatial_rrt import Trees, anywhere
from cableway.planning.trajectory_optimization import TrajectoryOptimizationConfig
from cableway.robot.free_arms import WANTED
from cableway.robot.free_spatial_arms import CLEARANCES, spatial_room_shortfall
from cableway.robot.spatial_arms import SpatialArms
from cableway.scene.spatial.grippers import SpatialGrippers
from cableway.tasks.space.generation import random_spatial_task

CONFIG = TrajectoryOptimizationConfig(iterations=15)


def with_hands() -> SpatialProblem:
    """The motion past the ball, with a 2F-85 on each side: in the ball, in each other and on the cable."""
    problem = past_a_ball()
    return replace(problem, bodies=SpatialBodies.of(SpatialGrippers(body="2f-85").bodies, problem.radius))


@pytest.mark.parametrize(
    "problem", [past_a_ball(), replace(past_a_ball(), least_bend_radius=0.06), with_hands()], ids=["", "bend", "hands"]
)
def test_the_slope_of_the_cost_is_that_of_finite_differences(problem: SpatialProblem):
    rod, rng = problem.rod, np.random.default_rng(2)
    q = rod.between(problem.start, problem.goal, np.linspace(0, 1, 5))
    q[1:-1] = rod.retract(q[1:-1], rng.normal(0, 0.05, (3, 12)) * rod.units)
    q[2, 9], q[1, 6] = 1.2 * problem.most_twist * rod.twist, 60.0
    cost = SpatialCost(problem, replace(CONFIG, span_wanted=0.6), 1.0, q)
    gradient = cost.linearise(q).gradient
    assert cost.linearise(q).cost == pytest.approx(cost.cost(q))
    for row in (1, 2, 3):
        for k in range(12):
            slope, unit = central_difference(cost, q, row, k), rod.units[k]
            assert slope * unit == pytest.approx(gradient[row, k] * unit, rel=2e-3, abs=2e-2 * abs(gradient).max())


def test_arms_push_rows_to_where_they_can_hold_the_grippers():
    """Of a plan for grippers alone; the slope is that of finite differences there, too."""
    task = random_spatial_task(1, "yu", cell="dual-ur5e")
    problem, arms = SpatialProblem.of(task), SpatialArms(task)
    ways = arms.ways()
    assert not isinstance(ways, str)
    path = Trees(problem, SpatialFreeSpace.of(problem, Margins()), 0.006).search(anywhere(problem), 2000, (0,))[0]
    assert path is not None
    q, held = path[np.linspace(0, len(path) - 1, 25).astype(int)], arms.held(ways[0])

    def short(rows: np.ndarray) -> np.ndarray:
        return spatial_room_shortfall(problem.rod, rows, held, WANTED, sloped=False)[0][1:-1, CLEARANCES]

    before, after = short(q), short(optimize_in_space(q, problem, CONFIG, arms=held))
    assert before.max() > 0.03  # in something by more than 1 cm
    assert after.sum() < 0.2 * before.sum()
    cost = SpatialCost(problem, CONFIG, 1.0, q, held)
    gradient = cost.linearise(q).gradient
    assert cost.linearise(q).cost == pytest.approx(cost.cost(q))
    for row in np.flatnonzero(before.any(axis=1))[:6] + 1:
        for k in range(12):
            slope = central_difference(cost, q, row, k)
            assert slope == pytest.approx(gradient[row, k], rel=2e-3, abs=2e-2 * abs(gradient).max())


def central_difference(cost: SpatialCost, q: np.ndarray, row: int, k: int, step: float = 1e-6) -> float:
    """Slope of a cost by a coordinate of a row."""
    found = []
    for sign in (1, -1):
        moved = q.copy()
        moved[row] = cost.rod.retract(q[row], sign * step * np.eye(12)[k] * cost.rod.units)
        found.append(cost.cost(moved))
    return (found[0] - found[1]) / (2 * step * cost.rod.units[k])


def test_a_cable_that_goes_through_a_ball_is_led_round_it():
    problem = past_a_ball()
    q = problem.rod.between(problem.start, problem.goal, np.linspace(0, 1, 15))
    before, after = (
        signed_distance(problem.rod.shapes(rows)[0], problem.world)[0].min() - problem.radius
        for rows in (q, optimize_in_space(q, problem, CONFIG))
    )
    assert before < -0.02
    assert after > 0.008


def test_hands_that_go_through_a_ball_are_led_round_it():
    """The cable passes below it, and would not move by itself."""
    problem = with_hands()
    q = problem.rod.between(problem.start, problem.goal, np.linspace(0, 1, 15))
    q[:, 1], q[:, 2] = 0.48, 0.22
    before, after = (least_gaps(problem, rows) for rows in (q, optimize_in_space(q, problem, CONFIG)))
    assert before[WORLD] < -0.005
    assert after[WORLD] > 0.006
    assert least_gaps(problem, optimize_in_space(q, past_a_ball(), CONFIG))[WORLD] < 0


def least_gaps(problem: SpatialProblem, q: np.ndarray) -> np.ndarray:
    """Of hands from the world, each other and the cable [m]."""
    stations, poses = problem.rod.shapes(q)
    gaps = problem.bodies.hull_gaps(poses, stations, problem.world, problem.rod.length, np.full(3, np.inf))[0]
    return gaps.min(axis=(0, 1))
