"""A controller that fails, comes late or asks too much: what the loop sends in its place, and what it says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import cycle
from typing import Any

import numpy as np
import pytest
from quasi_static import QuasiStaticPlant, stacked, straight_plan, task_for

from cableway.control.following import LEAST_RATE
from cableway.control.jacobian import JacobianConfig, JacobianFeedback
from cableway.control.limits import exceeds_limits, last_filter
from cableway.control.open_loop import OpenLoop, OpenLoopConfig
from cableway.core.errors import InputError
from cableway.motion.interpolation import rows_at
from cableway.records import Observation, Rollout
from cableway.report import summarize
from cableway.rod.planar import PlanarRod
from cableway.scene.obstacles import Box
from cableway.scene.task import Grippers, Task
from cableway.tracking import Watchdog, track
from cableway.tracking.watchdog import Guard

ROD = PlanarRod(0.3)
BENT = np.array([0.25, 0.2, 0.3, 3.0, 9.0, -1.5])
PLAN = straight_plan(ROD, BENT, BENT + [0.0, 0.16, 0.0, 0.0, 0.0, 0.0], steps=40)
"""Carried 4 mm a step in y, as it is."""
TASK = task_for(PLAN)
STEP = np.array([[0.0, 0.004, 0.0]] * 2)
OPEN = OpenLoopConfig(hold=0.0)

Answer = Callable[[np.ndarray], np.ndarray]


def raising(action: np.ndarray) -> np.ndarray:
    raise ZeroDivisionError("nothing to divide by")


WRONG: dict[str, Answer] = {
    "raises": raising,
    "not finite": lambda action: np.where(np.arange(6).reshape(2, 3) == 4, np.nan, action),
    "out of this world": lambda action: action + 1e300,
    "wrong shape": lambda action: action[0],
    "no array": lambda action: None,  # pyright: ignore[reportAssignmentType]
}


class Faulty(OpenLoop):
    """The plan's own motion, but for some steps, counted from 0."""

    def __init__(self, faults: dict[int, Answer], every: Answer | None = None) -> None:
        super().__init__(OPEN)
        self.faults, self.every, self.asked = faults, every, 0

    def step(self, state: Any, observation: Observation | None) -> tuple[np.ndarray, Any]:
        action, after = super().step(state, observation)
        fault = self.faults.get(self.asked, self.every)
        self.asked += 1
        return (action if fault is None else fault(action)), after


def run(controller: Any, watchdog: Watchdog | None = None, task: Task = TASK) -> Rollout:
    return track(QuasiStaticPlant(task, BENT, ROD), controller, PLAN, watchdog=watchdog)


@pytest.mark.parametrize("fault", WRONG)
def test_one_missed_step_is_coasted_through(fault: str) -> None:
    rollout = run(Faulty({10: WRONG[fault]}))
    assert rollout.status[9:12].tolist() == ["tracking", "failed: coasting", "tracking"]
    np.testing.assert_allclose(rollout.actions[9:12], [STEP, STEP / 2, STEP], atol=1e-12)
    assert rollout.metadata["outcome"] == "settled"
    assert rollout.metadata["watchdog"]["failed"] == 1
    assert rollout.steps < PLAN.steps + 40


def test_three_in_a_row_stop_the_grippers_until_there_is_an_answer() -> None:
    rollout = run(Faulty(dict.fromkeys(range(10, 15), raising)))
    assert rollout.status[9:16].tolist() == [
        "tracking", "failed: coasting", "failed: coasting", *["failed: stopped"] * 3, "tracking",
    ]  # fmt: skip
    moved = rollout.actions[9:16, :, 1] / 0.004
    np.testing.assert_allclose(moved.T, [[1, 0.5, 0.25, 0, 0, 0, 1]] * 2, atol=1e-9)
    np.testing.assert_array_equal(rollout.reference[13:16], [rollout.reference[12]] * 3)


def test_a_controller_with_feedback_arrives_all_the_same() -> None:
    class Feedback(JacobianFeedback):
        asked = -1

        def step(self, state: Any, observation: Observation | None) -> tuple[np.ndarray, Any]:
            self.asked += 1
            if self.asked % 5 in (3, 4):
                raise FloatingPointError
            return super().step(state, observation)

    rollout = run(Feedback(JacobianConfig(hold=0.0)))
    assert sum("failed" in status for status in rollout.status.tolist()) > 15
    assert stacked(rollout.keypoints[-1], TASK.goal) < 0.003
    assert np.linalg.norm(rollout.keypoints - rollout.reference, axis=2).max() < 0.01


def test_a_state_knows_what_was_sent_in_its_place() -> None:
    """Else a controller takes the difference for a delay."""
    state = OpenLoop(OPEN).init(TASK, PLAN)
    observation = Observation(0.0, PLAN.shapes[0], PLAN.poses[0])
    _, state = OpenLoop(OPEN).step(state, observation)
    after = state.overruled(STEP / 2, "late: coasting")
    reached, led_on = (known.tracker.predicted().commanded for known in (state, after))
    np.testing.assert_allclose(led_on - reached, STEP / 2, atol=1e-12)
    assert (after.status, after.index) == ("late: coasting", state.index + 1)
    assert state.overruled(np.zeros((2, 3)), "late: stopped").index == state.index


def test_a_run_whose_controller_is_gone_ends_and_says_why() -> None:
    rollout = run(Faulty({}, every=raising))
    assert rollout.steps == 30
    assert not rollout.actions.any()
    expected = (
        "controller failed: 30 steps in a row were missed; "
        "the first failed with ZeroDivisionError: nothing to divide by (test_watchdog.py, line 41)"
    )
    assert f"{rollout.outcome}: {rollout.detail}" == expected
    report = summarize(TASK, PLAN, rollout)
    assert not report.success
    assert expected in str(report.failure)
    assert any("30 failed" in note for note in report.notes)


def test_what_is_interrupted_stays_interrupted() -> None:
    def interrupt(action: np.ndarray) -> np.ndarray:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(Faulty({3: interrupt}))


@pytest.mark.parametrize("size", [2.0, 1e5])
def test_what_exceeds_the_limits_is_cut_and_said_so(size: float) -> None:
    rng = np.random.default_rng(3)
    slow = replace(TASK, grippers=Grippers(max_step=0.003, max_turn=0.02))
    to_and_fro = cycle([size, -size])
    rollout = run(Faulty({}, every=lambda action: next(to_and_fro) * np.abs(rng.normal(0, 0.001, (2, 3)))), task=slow)
    assert not any(exceeds_limits(action, slow.grippers) for action in rollout.actions)
    cut = [status.endswith("; cut to the limits") for status in rollout.status.tolist()]
    assert sum(cut) == rollout.metadata["watchdog"]["cut"] > 0
    steps = np.linalg.norm(rollout.actions[cut, :, :2], axis=-1).max(axis=1)
    turns = np.abs(rollout.actions[cut, :, 2]).max(axis=1)
    assert (np.isclose(steps, 0.003) | np.isclose(turns, 0.02)).all(), "no more is cut off than must be"


@pytest.mark.parametrize(("made", "rate"), [(0.75, 0.75), (0.5, 0.5), (0.0, LEAST_RATE)])
def test_the_reference_goes_on_as_far_as_the_grippers_do(made: float, rate: float) -> None:
    """Where the last filter lets only a part of the motion pass; but never slower than a least rate."""
    asking, controller = Guard(Watchdog(), OpenLoop(OPEN), TASK, 0.1), OpenLoop(OPEN)
    state = controller.init(TASK, PLAN)
    for step in range(32):
        poses = rows_at(PLAN.poses, state.plan.rows(state.index, 1))[0]
        answer = asking.step(state, Observation(0.1 * step, state.reference, poses), STEP, lambda action: made * action)
        state = answer.state
        np.testing.assert_array_equal(state.tracker.commands.history[-1], answer.action)
    assert state.index == pytest.approx(32 * rate)
    assert state.progress == pytest.approx(32 * rate / PLAN.steps)
    assert state.index > 0, "what waits for something out of reach waits forever"


# ---------------------------------------------------------------- late
class Clock:
    """A clock on which the steps of a `Faulty` that take long are known."""

    def __init__(self, controller: Faulty, slow: dict[int, float]) -> None:
        self.controller, self.slow, self.now = controller, slow, 0.0

    def __call__(self) -> float:
        self.now += self.slow.pop(self.controller.asked - 1, 0.001)
        return self.now


def timed(deadline: float | None, slow: dict[int, float]) -> Rollout:
    controller = Faulty({})
    return run(controller, Watchdog(deadline=deadline, clock=Clock(controller, slow)))


def test_a_step_that_comes_late_is_dropped_only_where_there_is_a_deadline() -> None:
    slow = {5: 0.06, 20: 0.04, 21: 0.2, 22: 0.2, 23: 0.2}
    patient, strict = timed(None, dict(slow)), timed(0.05, dict(slow))
    assert set(patient.status.tolist()) == {"tracking"}
    missed = {step: status for step, status in enumerate(strict.status.tolist()) if status != "tracking"}
    assert missed == {5: "late: coasting", 21: "late: coasting", 22: "late: coasting", 23: "late: stopped"}
    assert strict.metadata["watchdog"] == {
        "deadline": 0.05,
        "late": 4,
        "failed": 0,
        "cut": 0,
        "fallback": 0,
        "reason": None,
    }
    assert strict.solve_time[21] == pytest.approx(0.2)
    np.testing.assert_allclose(strict.actions[5], STEP / 2, atol=1e-12)


def test_a_controller_that_is_always_late_ends_the_run() -> None:
    rollout = timed(0.05, dict.fromkeys(range(99), 0.1))
    assert rollout.metadata["outcome"] == "controller failed"
    assert rollout.detail == "30 steps in a row were missed; all of them were late"


# ---------------------------------------------------------------- coasting never leads into anything
def guard(task: Task) -> Guard:
    return Guard(Watchdog(), Faulty({}, every=raising), task, 0.1)


def coasted(task: Task, before: np.ndarray, row: int = 20, **changed: Any) -> np.ndarray:
    """What is sent after `before` in place of a step that fails, with the cable at a row of the plan."""
    state = OpenLoop(OPEN).init(task, PLAN)
    observation = replace(Observation(0.1 * row, PLAN.shapes[row], PLAN.poses[row]), **changed)
    filtered = partial(last_filter, poses=PLAN.poses[row], task=task, max_span=task.cable.length)
    return guard(task).step(state, observation, before, filtered).action


def test_coasting_passes_the_last_filter() -> None:
    state, observation = OpenLoop(OPEN).init(TASK, PLAN), Observation(2.0, PLAN.shapes[20], PLAN.poses[20])
    assert guard(TASK).step(state, observation, STEP, lambda action: action).action.any()
    assert not guard(TASK).step(state, observation, STEP, np.zeros_like).action.any()


def behind_a_wall(clearance: float, row: int = 20) -> Task:
    """A wall above the cable, so that its highest point has this clearance there; the goal lies elsewhere."""
    top = float(ROD.shapes((BENT + [0.0, 0.004 * row, 0.0, 0.0, 0.0, 0.0])[None])[0][0, :, 1].max())
    wall = Box(center=(0.35, top + TASK.cable.radius + clearance + 0.02), size=(0.68, 0.04))
    return task_for(straight_plan(ROD, BENT, BENT + [0.0, 0.01, 0.0, 0.0, 0.0, 0.0]), (wall,))


def test_coasting_does_not_go_on_towards_an_obstacle() -> None:
    assert coasted(behind_a_wall(0.0075), STEP).any()
    assert not coasted(behind_a_wall(0.0065), STEP).any()
    assert coasted(behind_a_wall(0.001), -STEP).any(), "away from it"


def test_coasting_counts_the_grippers() -> None:
    """The cable is a hair, the grippers are not."""
    wide = replace(behind_a_wall(0.03), grippers=Grippers(radius=0.08))
    assert coasted(behind_a_wall(0.03), STEP).any()
    assert not coasted(wide, STEP).any()


def test_coasting_does_not_pull_the_grippers_apart_nor_push_them_together() -> None:
    axis = np.subtract(*PLAN.poses[20, ::-1, :2])
    apart = np.zeros((2, 3))
    apart[:, :2] = 0.004 * np.array([[-1.0], [1.0]]) * axis / np.linalg.norm(axis)
    gap = float(np.linalg.norm(axis))
    assert not coasted(TASK, apart).any()
    assert np.linalg.norm(np.subtract(*(PLAN.poses[20] + coasted(TASK, -apart))[:, :2])) == pytest.approx(gap - 0.004)
    assert not coasted(replace(TASK, grippers=Grippers(separation=gap)), -apart).any()


def test_what_is_not_seen_is_not_moved() -> None:
    shape, poses = PLAN.shapes[20].copy(), np.full((2, 3), np.nan)
    shape[4] = np.nan
    assert not coasted(TASK, STEP, keypoints=shape).any()
    assert not coasted(TASK, STEP, keypoints=shape[:3]).any()
    assert not coasted(TASK, STEP, poses=poses).any()


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"deadline": 0.0}, "deadline must be finite and positive, got 0.0"),
        ({"deadline": np.nan}, "deadline must be finite and positive"),
        ({"margin": -1.0}, "margin must be finite and not negative"),
    ],
)
def test_settings_are_checked(setting: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Watchdog(**setting)  # pyright: ignore[reportArgumentType]


def test_the_same_faults_give_the_same_run() -> None:
    faults = {4: raising, 5: WRONG["not finite"], 17: raising}
    first, second = run(Faulty(dict(faults))), run(Faulty(dict(faults)))
    np.testing.assert_array_equal(first.actions, second.actions)
    np.testing.assert_array_equal(first.keypoints, second.keypoints)
