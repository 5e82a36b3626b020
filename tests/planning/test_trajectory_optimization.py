"""Trajectory optimisation lowers a cost whose gradient is exact, and leaves the ends alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import problems
import pytest

from cableway.motion.validity import gripper_spans
from cableway.planning import trajectory_optimization
from cableway.planning.config import PlannerConfig
from cableway.planning.planner import plan as find_plan
from cableway.planning.trajectory_optimization import (
    CLEARANCE_WEIGHTS,
    TAUT,
    TENSION,
    TENSION_SCALE,
    TrajectoryOptimizationConfig,
    _Problem,
    optimize_trajectory,
)
from cableway.scene.clearance import clearances
from cableway.tasks.generation import random_task


@pytest.fixture(scope="module")
def crossing():
    """A sequence that goes straight through a disc, with loads that vary."""
    task = problems.beside_disc()
    q = problems.line_in_q(task.cable.rod, problems.LOW_ARC, problems.HIGH_ARC, 40)
    q[1:-1] += 0.3 * np.random.default_rng(0).normal(size=(38, 6)) * [0.01, 0.01, 0.1, 3, 3, 1]
    return task, q


@pytest.fixture(scope="module")
def moved(crossing):
    task, q = crossing
    return optimize_trajectory(q, task, TrajectoryOptimizationConfig())


def test_gradient_is_that_of_the_cost(crossing, monkeypatch: pytest.MonkeyPatch):
    """The gradient from the Jacobians equals finite differences of the cost, for every term at once."""
    task, q = crossing
    monkeypatch.setattr(trajectory_optimization, "TENSION", float(np.median(q[:, 3])))
    config = TrajectoryOptimizationConfig(stability_wanted=60.0, span_wanted=0.9)
    problem = _Problem(task, config, 1.0, q)
    assert problem._tension(q)[0].any()
    normal = problem.linearise(q)
    assert normal.cost == pytest.approx(problem.cost(q), rel=1e-12)
    rng = np.random.default_rng(1)
    for _ in range(5):
        direction = rng.normal(size=q.shape) * [0.01, 0.01, 0.1, 1, 1, 0.3]
        h = 1e-5
        numeric = (problem.cost(q + h * direction) - problem.cost(q - h * direction)) / (2 * h)
        assert np.sum(normal.gradient * direction) == pytest.approx(numeric, rel=2e-4)


def test_gradient_with_all_limits_of_the_task(crossing):
    """The same where the grippers must stay apart and the cable must not bend sharply."""
    task, q = crossing
    grippers, cable = replace(task.grippers, separation=0.26), replace(task.cable, min_bend_radius=0.11)
    task = replace(task, grippers=grippers, cable=cable)
    problem = _Problem(task, TrajectoryOptimizationConfig(separation_margin=0.02, bend_share=0.5), 1.0, q)
    assert problem._bends(problem.rod.shapes(q)[0]).any()
    assert problem._span(problem.rod.shapes(q)[1])[0][:, 1].any()
    normal = problem.linearise(q)
    assert normal.cost == pytest.approx(problem.cost(q), rel=1e-12)
    direction = np.random.default_rng(1).normal(size=q.shape) * [0.01, 0.01, 0.1, 1, 1, 0.3]
    h = 1e-5
    numeric = (problem.cost(q + h * direction) - problem.cost(q - h * direction)) / (2 * h)
    assert np.sum(normal.gradient * direction) == pytest.approx(numeric, rel=2e-4)


def test_moves_the_cable_out_of_the_way_and_keeps_the_ends(crossing, moved):
    """What went through the disc keeps the margin afterwards; start and goal stay as they were."""
    task, q = crossing
    rod, radius = task.cable.rod, task.cable.radius
    assert task.scene.clearance(rod.shapes(q)[0], radius).min() < -0.05
    assert task.scene.clearance(rod.shapes(moved)[0], radius).min() > 0.008
    assert np.array_equal(moved[[0, -1]], q[[0, -1]])


def test_cost_never_rises(crossing, moved):
    """At the last clearance weight the optimised sequence costs less than the one given."""
    task, q = crossing
    problem = _Problem(task, TrajectoryOptimizationConfig(), CLEARANCE_WEIGHTS[-1], q)
    assert problem.cost(moved) < problem.cost(q)


def test_raises_the_stability_margin():
    """Rows strung out over the wanted gripper span and under the wanted margin are slackened and stabilised."""
    task = problems.free()
    q = problems.line_in_q(task.cable.rod, problems.LOW_ARC, problems.HIGH_ARC, 30)
    q[10:20, 3] = -75.0
    config = TrajectoryOptimizationConfig()
    before = task.cable.rod.stability(q)[0].min()
    after = task.cable.rod.stability(optimize_trajectory(q, task, config))[0].min()
    assert before < 30 < after


def test_same_input_same_output(crossing):
    """Two calls give the same numbers, bit for bit."""
    task, q = crossing
    first, second = (optimize_trajectory(q, task, TrajectoryOptimizationConfig(iterations=5)) for _ in range(2))
    assert not np.array_equal(first, q)
    assert np.array_equal(first, second)


def test_progress_rises_and_can_end_the_refinement(crossing):
    task, q = crossing
    shares: list[float] = []
    optimize_trajectory(q, task, TrajectoryOptimizationConfig(iterations=5), shares.append)
    assert shares[0] == 0
    assert shares == sorted(shares)
    assert shares[-1] == 1

    def enough(share: float) -> None:
        raise TimeoutError

    with pytest.raises(TimeoutError):
        optimize_trajectory(q, task, TrajectoryOptimizationConfig(), enough)


def test_room_is_not_made_by_pulling_the_cable_taut() -> None:
    """In bends of 50 mm; a cable under tension left such a plan by 58 mm, in the simulator it was planned with."""
    plan = find_plan(random_task(5101, "serpentine", width=0.05))
    assert plan.q is not None
    assert plan.q[:, 3].max() < TENSION + 2 * TENSION_SCALE


@pytest.mark.parametrize("seed", [300, 303])
def test_the_cable_is_not_pulled_straight_in_a_narrow_way(seed: int) -> None:
    """The two were: in half of the bends to the length of the cable, with three times as many rows."""
    task = random_task(seed, "serpentine", width=0.05)
    plan = find_plan(task)
    assert gripper_spans(plan.poses).max() < TAUT * task.cable.length
    assert clearances(plan.shapes, plan.poses, task).min() > 0.008


def test_where_no_plan_keeps_the_room_one_with_the_margin_is_made() -> None:
    task = random_task(20039, "maze", width=0.07)
    plan = find_plan(task, config=PlannerConfig(initial_trajectories=("slide-tail",)))
    optimization = plan.metadata["planner"]["projection"]["optimization"]
    assert optimization["room"] == optimization["margin"] == TrajectoryOptimizationConfig().margin
