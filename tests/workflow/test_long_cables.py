"""Cables of more than half a metre: a warning where they swing, and feedback that does not drive the swing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cableway.control.base import ControllerState, Status
from cableway.core.errors import InputError
from cableway.planning.planner import plan as find_plan
from cableway.records import Observation, Plan
from cableway.rod.planar import PlanarRod
from cableway.scene.cable import Cable
from cableway.scene.files.loading import load_task
from cableway.scene.task import CONTROL_STEP
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.table_plant import TableConfig
from cableway.tasks.generation import random_task
from cableway.tasks.scaling import scaled
from cableway.tracking.observed import swing
from cableway.tracking.recovering import Recovery
from cableway.tracking.recovery import Watch
from cableway.tracking.stopping import StopRule, TrackConfig
from cableway.workflow.events import Note
from cableway.workflow.run import SolveOptions
from cableway.workflow.solve import solve


def test_the_frequency_is_that_of_a_clamped_beam() -> None:
    """With the smallest root of cos(x) cosh(x) = 1 found here."""
    low, high = 4.0, 5.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if np.cos(middle) * np.cosh(middle) < 1 else (low, middle)
    cable = Cable(length=1.2, bending_stiffness=2e-3, linear_density=0.05)
    wanted = low**2 / (2 * np.pi) * np.sqrt(2e-3 / (0.05 * 1.2**4))
    assert cable.frequency == pytest.approx(wanted, rel=1e-3)


def test_a_long_rod_has_more_hinges_whatever_its_keypoints() -> None:
    assert [PlanarRod(length, 13).hinges for length in (0.15, 0.3, 0.5, 0.6, 1.2, 2.0)] == [24, 24, 24, 36, 48, 48]
    assert PlanarRod(1.2, 25).hinges == 48
    assert PlanarRod(2.0, 25).hinges == 48


def test_a_cable_that_swings_is_led_to_its_goal_and_named() -> None:
    notes = []
    done = solve(
        scaled(random_task(301, "clutter"), 4.0),
        SolveOptions(),
        on_event=lambda event: notes.append(event.text) if isinstance(event, Note) else None,
    )
    assert done.success
    assert done.rollout is not None
    assert done.rollout.metadata["recovered"] == []
    assert np.linalg.norm(done.rollout.keypoints - done.rollout.reference, axis=2).max() < 0.012
    assert any("first bending mode is at 0.45 Hz" in note for note in notes)
    assert any("first bending mode is at 0.45 Hz" in note for note in done.report.notes)


def test_grippers_take_a_period_of_its_swing_to_come_to_full_speed() -> None:
    """1 / 0.16 Hz for 2 m of the default cable, at 70% of the limit of 0.133 m/s: at most 0.015 m/s^2."""
    task = scaled(random_task(302, "clutter"), 2.0 / 0.3)
    plan = find_plan(task)
    changes = np.diff(plan.poses[:, :, :2], 2, axis=0) / CONTROL_STEP**2
    allowed = task.grippers.max_step / CONTROL_STEP * task.cable.frequency
    assert np.linalg.norm(changes, axis=2).max() <= allowed


def test_slow_grippers_lead_a_cable_that_swings() -> None:
    """At 5 mm/s, a ramp of 6 s would be below the least acceleration that a task may ask for."""
    task = scaled(random_task(302, "clutter"), 2.0 / 0.3)
    assert find_plan(replace(task, grippers=replace(task.grippers, max_step=0.0005))).steps > 0


def test_what_is_put_down_to_a_swing_is_bounded() -> None:
    """However slowly a cable swings, it is no more than 35 mm from its plan by that."""
    slow = replace(random_task(301, "clutter").cable, length=10.0, bending_stiffness=1e-6)
    assert slow.frequency < 1e-3
    assert swing(replace(scaled(random_task(301, "clutter"), 10.0 / 0.3), cable=slow)) < 0.035


def test_a_swing_at_the_end_is_waited_for_and_not_replanned_from() -> None:
    done = solve(scaled(random_task(302, "clutter"), 2.0 / 0.3), SolveOptions())
    assert done.success
    assert done.rollout is not None
    assert done.rollout.metadata["recovered"] == []


def test_what_a_swing_of_that_size_may_be_taken_for() -> None:
    """A cable of 1.2 m may be 7.5 mm farther from its plan and from its goal than one that does not swing."""
    task = scaled(random_task(301, "clutter"), 4.0)
    assert swing(task) == pytest.approx(0.133 / task.cable.frequency / (4 * np.pi**2))
    assert swing(random_task(301, "clutter")) == 0.0
    poses = np.zeros((2, 3))
    plan = Plan(np.stack([task.start, task.goal]), np.stack([poses, poses]))
    for more, told in ((-1e-4, False), (1e-4, True)):
        watch = Watch(Recovery(replan=lambda *_: plan, beside=1.0), CONTROL_STEP)
        off = [task.goal + [0.0, limit + swing(task) + more] for limit in (0.0075, 0.018)]
        assert watch.is_off_goal(Observation(0.0, off[0], poses), plan, task) == told
        assert [watch.is_lost(Observation(0.0, off[1], poses), task.goal[None], task) for _ in range(2)][-1] == told


def test_a_swing_is_waited_for_up_to_three_periods() -> None:
    """Errors that go on falling for longer than the usual five seconds, from one period to the next."""
    plan = Plan(np.zeros((2, 13, 2)), np.zeros((2, 2, 3)))
    steps = {}
    for period in (0.0, 6.0):
        rule = StopRule(TrackConfig(), plan, CONTROL_STEP, period)
        state = ControllerState(status=Status.TRACKING, reference=plan.shapes[1], progress=1.0)
        for step in range(1, 400):
            seen = Observation(0.0, plan.shapes[0] + 0.1 * 0.99**step, plan.poses[0])
            if rule.outcome(state, seen) is not None:
                steps[period] = step
                break
    assert steps == {0.0: 51, 6.0: 181}


def test_a_task_is_scaled_with_all_that_lies_on_the_table() -> None:
    for name in ("multi-obstacle-1", "real-maze"):
        task = load_task(name)
        large = scaled(task, 2.0)
        points = np.random.default_rng(0).uniform(0, task.scene.size, (50, 2))
        np.testing.assert_allclose(large.scene.signed_distance(2 * points), 2 * task.scene.signed_distance(points))
        np.testing.assert_allclose(large.goal, 2 * task.goal)
        assert large.cable.length == 2 * task.cable.length
        assert large.grippers == task.grippers
    with pytest.raises(InputError, match="must be positive and finite"):
        scaled(load_task("maze-1"), 0.0)
    with pytest.raises(InputError, match="has a plug"):
        scaled(load_task("insertion"), 2.0)


def test_a_cable_that_friction_holds_is_named() -> None:
    """mu rho g L^3 / EI = 0.5 * 0.1 * 9.81 * 0.3^3 / 1e-4 = 132, of the plant's cable and table; not of the task's."""
    task = random_task(301, "clutter")
    limp = replace(task.cable, bending_stiffness=1e-4, linear_density=0.1)
    plant = Perturbation(cable=limp, table=TableConfig(friction=0.25, across=2.0))
    assert plant.friction_number(task) == pytest.approx(132.4, abs=0.1)
    done = solve(task, SolveOptions(perturbation=plant, track=False))
    assert any("mu rho g L^3 / EI is 132" in note for note in done.report.notes)
    assert not any("Friction" in note for note in solve(task, SolveOptions(track=False)).report.notes)
