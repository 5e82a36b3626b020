"""Plans of a run under way are made for the cable as it is estimated by now, and before it folds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from quasi_static import GOAL, START, QuasiStaticPlant, straight_plan, task_for

from cableway.control.rod_mpc import RodMPC
from cableway.core.errors import PlanningError, PlanningInterrupted
from cableway.outcome import Outcome
from cableway.records import Plan
from cableway.rod.inverse import nearest_shapes
from cableway.rod.material import ROD
from cableway.rod.planar import PlanarRod
from cableway.scene.cable import EstimatedCable
from cableway.scene.clearance import clearances
from cableway.scene.obstacles import Disc
from cableway.scene.scene import Scene
from cableway.scene.task import CONTROL_STEP, Task
from cableway.tracking.closed_loop import _advance
from cableway.tracking.loop import Loop
from cableway.tracking.recovering import Recovery
from cableway.tracking.recovery import FORESEEN, Watch
from cableway.tracking.stopping import TrackConfig
from cableway.tracking.watchdog import Watchdog

UNIFORM = PlanarRod(0.3)
Q = START + np.linspace(0, 1, 41)[:, None] * (GOAL - START)
PLAN = replace(straight_plan(UNIFORM, steps=40), q=Q)
TASK = task_for(PLAN)
CURLED = (0.6, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0)
"""Stiffer to the right, with a rest curvature that changes sign."""
FOLDING = (0.6, 0.8, 0.6, 1.6, 2.7, 3.2, -1.3, 0.3)
"""So far from uniform that it does not stay in the shapes nearest to the plan's."""


def begun(modes: tuple[float, ...], updates: int = 20, task: Task = TASK) -> Loop:
    """A run that begins, with an estimate of the cable."""
    loop = Loop(QuasiStaticPlant(task, START, UNIFORM), RodMPC(), PLAN, TrackConfig(), Watchdog())
    theta = loop.state.estimate.theta.copy()
    theta[ROD][1:] = modes
    loop.state = replace(loop.state, estimate=replace(loop.state.estimate, theta=theta, updates=updates))
    return loop


def same(task: Task, left: Plan) -> Plan:
    return left


def watch(replan: Callable[[Task, Plan], Plan] = same, **settings: Any) -> Watch:
    return Watch(Recovery(replan=replan, **settings), CONTROL_STEP)


def looks(loop: Loop, times: int) -> int:
    """How many of some looks ahead find something wrong."""
    watching = watch(foresight=CONTROL_STEP)
    return sum(watching.foresees(loop) for _ in range(times))


def test_a_fold_on_the_rest_of_the_plan_is_foreseen_a_few_times() -> None:
    assert looks(begun(FOLDING), 1) == 1
    assert looks(begun((0.0,) * 8), 3) == 0
    assert looks(begun(CURLED), 3) == 0
    assert looks(begun(FOLDING), 10) == FORESEEN
    assert looks(begun(FOLDING, updates=3), 3) == 0  # nothing is known yet
    passed = begun(FOLDING)
    passed.plan = replace(PLAN, q=None)
    assert looks(passed, 3) == 0  # shapes of no rod


def test_what_the_estimated_cable_would_touch_is_foreseen() -> None:
    """A disc in the room between the shapes of the two cables."""
    rod = TASK.cable.estimated(0.3, CURLED).rod
    curled = rod.at_keypoints(rod.shapes(nearest_shapes(rod, Q, PLAN.shapes))[0])
    apart = curled - PLAN.shapes
    far = np.linalg.norm(apart, axis=2)[..., None]
    centers = (PLAN.shapes + (0.01 + TASK.cable.radius + far / 2) * apart / far).reshape(-1, 2)
    scenes = [Scene(obstacles=(Disc(center=(float(x), float(y)), radius=0.01),)) for x, y in centers]
    kept = np.array([clearances(PLAN.shapes, PLAN.poses, TASK.in_scene(scene)).min() for scene in scenes])
    assert kept.max() > 5e-4
    beside = TASK.in_scene(scenes[int(np.argmax(kept))])
    assert looks(begun((0.0,) * 8, task=beside), 1) == 0
    assert looks(begun(CURLED, task=beside), 1) == 1


def test_the_new_plan_is_for_the_estimated_cable_and_else_for_the_nominal_one() -> None:
    asked: list[Task] = []

    def replan(task: Task, left: Plan) -> Plan:
        asked.append(task)
        if isinstance(task.cable, EstimatedCable):
            raise PlanningError("there is none")
        return left

    lost = begun(CURLED)
    assert watch(replan, rest=0.2).recover(lost, Outcome.LEFT_PLAN) is None
    assert [task.cable for task in asked] == [TASK.cable.estimated(0.3, CURLED), TASK.cable]
    assert asked[0].equilibrium_distances[1] < 1e-6
    np.testing.assert_array_equal(asked[1].goal, TASK.goal)

    asked.clear()
    staying = begun(CURLED)
    assert watch(replan, rest=0.2).recover(staying, None) is None
    assert [task.cable for task in asked] == [TASK.cable.estimated(0.3, CURLED)]
    assert staying.plan is PLAN


def test_the_loop_looks_ahead_before_it_moves() -> None:
    asked: list[Task] = []

    def replan(task: Task, left: Plan) -> Plan:
        asked.append(task)
        return left

    for modes, times in ((FOLDING, 1), ((0.0,) * 8, 0)):
        asked.clear()
        loop = begun(modes)
        assert _advance(loop, watch(replan, foresight=CONTROL_STEP, rest=0.2)) is None
        assert len(asked) == times


def test_a_run_goes_on_with_what_was_estimated_towards_the_goal_of_the_task() -> None:
    def replan(task: Task, left: Plan) -> Plan:
        return replace(left, shapes=np.concatenate([left.shapes[:-1], task.goal[None]]))

    loop = begun(CURLED)
    estimator, theta = loop.state.estimator, loop.state.estimate.theta
    assert watch(replan, rest=0.2).recover(loop, Outcome.LEFT_PLAN) is None
    cable = TASK.cable.estimated(0.3, CURLED)
    assert loop.state.task.cable == cable
    assert loop.state.task.goal != pytest.approx(TASK.goal, abs=1e-6)
    np.testing.assert_array_equal(loop.plan.shapes[-1], TASK.goal)
    assert loop.state.estimator is estimator  # whose prior is the nominal cable, not the estimate itself
    np.testing.assert_array_equal(loop.state.estimate.theta, theta)
    moved = RodMPC().in_scene(loop.state, TASK.in_scene(Scene(obstacles=(Disc(center=(0.6, 0.6), radius=0.02),))))
    assert moved.task.cable == cable
    assert len(moved.task.scene.obstacles) == 1


def test_an_interrupted_search_is_not_followed_by_another() -> None:
    asked: list[Task] = []

    def replan(task: Task, left: Plan) -> Plan:
        asked.append(task)
        raise PlanningInterrupted("from the keyboard", None, Outcome.INTERRUPTED)

    ending = watch(replan, rest=0.2).recover(begun(CURLED), Outcome.LEFT_PLAN)
    assert ending is not None
    assert ending.outcome is Outcome.INTERRUPTED
    assert len(asked) == 1
