"""The cost of trajectories in space: its slope, and what it moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from spatial_problems import past_a_ball

from cableway.geometry.spatial_convex import signed_distance
from cableway.planning.spatial_optimization import SpatialCost, optimize_in_space
from cableway.planning.trajectory_optimization import TrajectoryOptimizationConfig

CONFIG = TrajectoryOptimizationConfig(iterations=15)


@pytest.mark.parametrize("bend_radius", [0.0, 0.06])
def test_the_slope_of_the_cost_is_that_of_finite_differences(bend_radius):
    problem = replace(past_a_ball(), least_bend_radius=bend_radius)
    rod, rng = problem.rod, np.random.default_rng(2)
    q = rod.between(problem.start, problem.goal, np.linspace(0, 1, 5))
    q[1:-1] = rod.retract(q[1:-1], rng.normal(0, 0.05, (3, 12)) * rod.units)
    q[2, 9], q[1, 6] = 1.2 * problem.most_twist * rod.twist, 60.0
    cost = SpatialCost(problem, replace(CONFIG, span_wanted=0.6), 1.0, q)
    gradient = cost.linearise(q).gradient
    assert cost.linearise(q).cost == pytest.approx(cost.cost(q))
    step = 1e-6
    for row in (1, 2, 3):
        for k in range(12):
            found = []
            for sign in (1, -1):
                moved = q.copy()
                moved[row] = rod.retract(q[row], sign * step * np.eye(12)[k] * rod.units)
                found.append(cost.cost(moved))
            slope = (found[0] - found[1]) / (2 * step)
            assert slope == pytest.approx(gradient[row, k] * rod.units[k], rel=2e-3, abs=2e-2 * abs(gradient).max())


def test_a_cable_that_goes_through_a_ball_is_led_round_it():
    problem = past_a_ball()
    q = problem.rod.between(problem.start, problem.goal, np.linspace(0, 1, 15))
    before, after = (
        signed_distance(problem.rod.shapes(rows)[0], problem.world)[0].min() - problem.radius
        for rows in (q, optimize_in_space(q, problem, CONFIG))
    )
    assert before < -0.02
    assert after > 0.008
