"""The planner keeps the plug clear: its terms, its search, and the plan that comes of it."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from cableway.motion.limits import BodyPoints, Margins
from cableway.motion.terms import body_shortfall
from cableway.motion.validity import FreeSpace
from cableway.planning.planner import plan
from cableway.planning.trajectory_optimization import TrajectoryOptimizationConfig, _Problem
from cableway.records import Plan
from cableway.scene.files.loading import load_task
from cableway.scene.task import Task
from cableway.verification import verify_plan


@pytest.fixture(scope="module")
def task() -> Task:
    return load_task("insertion")


@pytest.fixture(scope="module")
def found(task: Task) -> Plan:
    return plan(task)


def near_obstacles(task: Task) -> np.ndarray:
    """Poses with the plug at, in and away from obstacles."""
    rng = np.random.default_rng(5)
    return rng.uniform([0.1, 0.1, -3.0], [0.6, 0.6, 3.0], (40, 2, 3))


def test_the_slope_of_the_shortfall_is_that_of_differences(task: Task):
    poses, h, bodies = near_obstacles(task), 1e-6, BodyPoints.of(task)
    short, slope = body_shortfall(bodies, task.scene.world, poses, 0.02)
    assert (short[:, 2:] > 0).any(axis=1).sum() > 10
    for side, k in product(range(2), range(3)):
        step = np.zeros((2, 3))
        step[side, k] = h
        ahead, behind = (body_shortfall(bodies, task.scene.world, poses + sign * step, 0.02)[0] for sign in (1, -1))
        smooth = (short > 1e-4) & (ahead > 0) & (behind > 0)
        numeric = (ahead - behind) / (2 * h)
        assert np.quantile(np.abs(numeric - slope[..., side, k])[smooth], 0.95) < 1e-4


def test_the_gradient_of_the_refinement_has_the_plug_in_it(task: Task):
    q = np.linspace(task.start_equilibrium, task.goal_equilibrium, 30)
    problem = _Problem(task, TrajectoryOptimizationConfig(), 1.0, q)
    normal = problem.linearise(q)
    assert normal.cost == pytest.approx(problem.cost(q), rel=1e-12)
    bare = replace(task, plug=None, port=None)
    assert normal.cost > _Problem(bare, TrajectoryOptimizationConfig(), 1.0, q).cost(q)
    direction, h = np.random.default_rng(1).normal(size=q.shape) * [0.01, 0.01, 0.1, 1, 1, 0.3], 1e-6
    numeric = (problem.cost(q + h * direction) - problem.cost(q - h * direction)) / (2 * h)
    assert np.sum(normal.gradient * direction) == pytest.approx(numeric, rel=2e-3)


def test_the_search_refuses_what_the_plug_touches_and_no_more(task: Task):
    bare = replace(task, plug=None, port=None)
    rod, ends = task.cable.rod, np.array([task.start_equilibrium, task.goal_equilibrium])
    about = np.random.default_rng(2).normal(size=(200, 6)) * [0.05, 0.05, 0.4, 0.0, 0.0, 0.0]
    q = ends[np.arange(200) % 2] + about
    allowed, also_bare = (FreeSpace.of(t, Margins()).are_free(q).tolist() for t in (task, bare))
    assert task.plug is not None
    plug = task.scene.clearance(task.plug.body.placed(rod.shapes(q)[1][:, 1], 0.04), 0.0)
    assert [a and c >= Margins().clearance for a, c in zip(also_bare, plug, strict=True)] == allowed
    assert sum(also_bare) > sum(allowed)


def test_a_plan_keeps_the_plug_clear(task: Task, found: Plan):
    (check,) = [check for check in verify_plan(found, task).checks if check.name == "plug clearance"]
    assert check.passed
    assert check.value > 0.004


def test_without_the_plug_the_way_is_another_that_the_plug_could_not_go(task: Task):
    bare = plan(replace(task, plug=None, port=None))
    assert {check.name for check in verify_plan(bare, task).failures()} == {"plug clearance"}
