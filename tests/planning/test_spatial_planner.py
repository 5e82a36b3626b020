"""Plans in space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from spatial_problems import ball_plan, ball_task, past_a_ball, walled_task

from cableway.benchmark.suites import make_spatial_task
from cableway.core.errors import InputError, PlanningError
from cableway.geometry.spatial_convex import signed_distance
from cableway.motion.spatial import SpatialProblem
from cableway.planning.config import PlannerConfig
from cableway.planning.planner import plan
from cableway.planning.routes.spatial import blocked, grid_path, slid_shapes
from cableway.planning.spatial_planner import SpatialPlannerConfig
from cableway.planning.spatial_rrt import bursts
from cableway.records import Plan
from cableway.rod.spatial_lag import spatial_lag
from cableway.scene.spatial.grippers import GripperPiece, SpatialGrippers
from cableway.scene.spatial.obstacles import Cuboid
from cableway.scene.spatial.scene import SpatialScene
from cableway.scene.task import CONTROL_STEP


def test_a_plan_leads_from_start_to_goal_and_verifies():
    task, found = ball_task(), ball_plan()
    assert found.verdict is not None
    assert found.verdict.passed
    np.testing.assert_allclose(found.shapes[[0, -1]], [task.keypoints("start"), task.keypoints("goal")], atol=1e-9)
    assert found.poses.shape == (found.steps + 1, 2, 7)


def test_a_plan_is_slow_where_the_cable_would_trail_behind():
    task, found = ball_task(), ball_plan()
    careful = plan(task, config=SpatialPlannerConfig(lag=1e-4))
    trailing = [spatial_lag(task.rod, q).max() * task.cable.damping_time / CONTROL_STEP for q in (found.q, careful.q)]
    assert trailing[1] < 1.05e-4 < trailing[0] < 2e-3
    assert careful.steps > found.steps


def test_hands_are_planned_for():
    """They are 15 cm wide and 20 cm high."""
    task = replace(ball_task(), grippers=replace(ball_task().grippers, body="2f-85"))
    found = plan(task)
    assert found.verdict is not None
    assert found.verdict.passed
    kept = {check.name: check.value for check in found.verdict.checks}
    assert kept["gripper body clearance"] > 0.004
    assert kept["gripper bodies apart"] > 0.004
    assert found.poses.tolist() != ball_plan().poses.tolist()


def test_a_hand_that_fits_through_nothing_is_what_stops_it():
    """A slit of 6 cm through which the cable and balls may pass, and no cube of 10 cm."""
    walls = [Cuboid(center=(0.4, 0.4, z), size=(0.04, 0.9, 0.4)) for z in (0.15, 0.61)]
    scene = SpatialScene((0.8, 0.8, 0.8), tuple(walls))
    task = replace(walled_task(), scene=scene, grippers=SpatialGrippers(radius=0.01))
    cube = GripperPiece(points=np.indices((2, 2, 2)).reshape(3, 8).T * 0.1 + [0.0, -0.05, 0.03])
    hands = replace(task, grippers=replace(task.grippers, body=(cube,)))
    clearance = SpatialPlannerConfig().limits.clearance
    assert blocked(SpatialProblem.of(task), clearance) == ""
    assert blocked(SpatialProblem.of(hands), clearance).startswith("the left gripper cannot pass")


def test_the_same_seed_gives_the_same_plan(tmp_path):
    again = plan(ball_task(), seed=0)
    np.testing.assert_array_equal(again.shapes, ball_plan().shapes)
    again.save(tmp_path / "plan.npz")
    np.testing.assert_array_equal(Plan.load(tmp_path / "plan.npz").poses, again.poses)


def test_where_nothing_can_pass_the_planner_says_what():
    with pytest.raises(PlanningError, match="there is no plan: the middle of the cable cannot pass") as raised:
        plan(walled_task(), config=SpatialPlannerConfig(first=40))
    assert raised.value.outcome == "infeasible"


def test_the_time_limit_ends_the_search():
    with pytest.raises(PlanningError, match="the time limit ran out") as raised:
        plan(walled_task(), expired=lambda: True)
    assert raised.value.outcome == "timed out"


def test_what_there_is_not_in_space_is_refused():
    with pytest.raises(InputError, match="in space there are no requested ways"):
        plan(ball_task(), alternatives=2)  # pyright: ignore
    with pytest.raises(InputError, match="needs a SpatialPlannerConfig, got PlannerConfig"):
        plan(ball_task(), config=PlannerConfig())
    with pytest.raises(InputError, match="needs a PlannerConfig, got SpatialPlannerConfig"):
        plan("single-obstacle-1", config=SpatialPlannerConfig())


def test_a_path_on_the_grid_keeps_its_distance():
    problem = past_a_ball()
    start, goal = np.array([0.15, 0.4, 0.38]), np.array([0.65, 0.4, 0.38])
    path = grid_path(problem, start, goal, 0.03)
    distance = signed_distance(path, problem.world)[0]
    assert distance[1:-1].min() >= 0.03
    np.testing.assert_array_equal(path[[0, -1]], [start, goal])
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    assert 0.5 < length < 0.8


def test_a_sliding_cable_begins_and_ends_as_the_task_does_without_winding_up():
    problem = past_a_ball()
    for reverse in (False, True):
        q = slid_shapes(problem, 0.03, reverse=reverse)
        np.testing.assert_array_equal(q[[0, -1]], [problem.start, problem.goal])
        assert np.abs(q[:, 9] / problem.rod.twist).max() < np.pi
        moved = np.linalg.norm(np.diff(problem.rod.shapes(q)[0], axis=0), axis=2).max()
        assert moved < 0.25 * problem.rod.length


def test_a_heavy_cable_hangs_where_it_slides_and_goes_through_a_window():
    """Of its weights, gamma = 111: on the curve that a light one follows two rows of three would be unstable."""
    task = make_spatial_task("window-20014@0.0612")
    problem, rod = SpatialProblem.of(task), task.rod
    for reverse in (False, True):
        q = slid_shapes(problem, 0.03, reverse=reverse)
        assert np.mean(rod.stability(q)[0] > 0) > 0.9
        stations, _ = rod.shapes(q)
        assert np.mean(signed_distance(stations, problem.world)[0].min(axis=1) > problem.radius) > 0.8
    found = plan(task)
    assert found.metadata["initial_trajectory"] in ("tube", "tube-tail")


def test_bursts_double():
    found = list(bursts(("a", "b"), 10, 40))
    assert found == [("a", 10, 0), ("b", 10, 0), ("a", 20, 1), ("b", 20, 1), ("a", 40, 2), ("b", 40, 2)]
