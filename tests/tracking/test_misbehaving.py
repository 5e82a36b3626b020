"""Plants that misbehave: the run ends in good order, the record is kept, and the sentence says what the plant did."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from quasi_static import GOAL, START, QuasiStaticPlant, straight_plan, task_for

from cableway.control.base import Controller
from cableway.control.jacobian import JacobianFeedback
from cableway.control.open_loop import OpenLoop
from cableway.control.rod_mpc import RodMPC
from cableway.core.errors import (
    Cancelled,
    InputError,
    PlanningError,
    PressedError,
    SimulationError,
    TrackingInterrupted,
)
from cableway.judge import judge
from cableway.outcome import Outcome
from cableway.records import Measurement, Observation, Plan, RodParameters, Rollout
from cableway.rod.planar import PlanarRod
from cableway.tracking import Recovery, TrackConfig, Watchdog, insert_plug, track
from cableway.tracking.answers import AnsweringPlant
from cableway.tracking.loop import Loop

ROD = PlanarRod(0.3)
PLAN = straight_plan(ROD, steps=60)
TASK = task_for(PLAN)
LATER = 20
"""Control step from which on a plant misbehaves: the grippers are on their way."""

Answers = Callable[[Any], Any]
Moves = Callable[[np.ndarray], np.ndarray]


def raising(error: BaseException) -> Answers:
    def answer(_: Any) -> Any:
        raise error

    return answer


class Speechless(Exception):
    def __str__(self) -> str:
        raise OSError("no words")


class Misbehaving(QuasiStaticPlant):
    """A plant whose answers, or motions, are not what they should be.

    Args:
        what: Which method misbehaves: reset, step or measure.
        answers: What it answers in place of what it should.
        since: Control step from which on it does.
        moves: What it does in place of an action.
    """

    def __init__(
        self, what: str = "", answers: Answers = lambda it: it, since: int = LATER, moves: Moves = lambda action: action
    ) -> None:
        super().__init__(TASK, START, ROD)
        self.what, self.answers, self.since, self.moves = what, answers, since, moves

    def reset(self) -> Observation:
        return self._answer("reset", super().reset())

    def step(self, action: np.ndarray) -> Observation:
        return self._answer("step", super().step(self.moves(action)))

    def measure(self) -> Measurement:
        return self._answer("measure", super().measure())

    def _answer(self, what: str, proper: Any) -> Any:
        return self.answers(proper) if what == self.what and self._step >= self.since else proper


def knowing(**wrong: np.ndarray) -> Answers:
    rod = RodParameters(**{"mean": np.ones(15), "covariance": np.eye(15)} | wrong)
    return lambda it: replace(it, rod=rod)


WRONG: dict[str, Answers] = {
    "raised ConnectionResetError: [Errno 104] gone": raising(ConnectionResetError(104, "gone")),
    "raised TimeoutError": raising(TimeoutError()),
    "raised ValueError: on two lines": raising(ValueError("on two\nlines")),
    "raised GeneratorExit": raising(GeneratorExit()),
    "raised CancelledError": raising(asyncio.CancelledError()),
    "raised Speechless": raising(Speechless()),
    "answered with None": lambda it: None,
    "answered with a value of type list": lambda it: [it],
    "answered with a value of type dict": vars,
    "reported keypoints of shape (5, 2), not (13, 2)": lambda it: replace(it, keypoints=it.keypoints[:5]),
    "reported keypoints of type complex128": lambda it: replace(it, keypoints=it.keypoints + 0j),
    "reported keypoints of type NoneType": lambda it: replace(it, keypoints=None),
    "reported keypoints of type list, not real numbers": lambda it: replace(it, keypoints=[[0.0, 1.0], [2.0]]),
}  # fmt: skip
SEEN: dict[str, Answers] = {
    "reported gripper poses of shape (1, 3), not (2, 3)": lambda it: replace(it, poses=it.poses[:1]),
    "reported gripper poses of type object": lambda it: replace(it, poses=it.poses.astype(object)),
    "reported a time that is not finite": lambda it: replace(it, time=np.nan),
    "reported a time of type str": lambda it: replace(it, time="now"),
    "reported a confidence of shape (4,), not (13,)": lambda it: replace(it, confidence=np.ones(4)),
    "reported a time of the frame of type str": lambda it: replace(it, taken="now"),
    "reported a rod as a value of type list": lambda it: replace(it, rod=[1.0]),
    "reported a rod with a mean of shape (3,), not (15,)": knowing(mean=np.ones(3)),
    "reported a rod that is not finite": knowing(covariance=np.full((15, 15), np.nan)),
    "reported a rod whose length or one of whose variances": knowing(mean=-np.ones(15)),
    "reported a rod whose length": knowing(covariance=np.zeros((15, 15))),
    "reported a rod with a covariance that is none": knowing(covariance=2 * np.ones((15, 15)) - 1.5 * np.eye(15)),
}
MEASURED: dict[str, Answers] = {
    "reported keypoints that are not finite": lambda it: replace(it, keypoints=it.keypoints * np.nan),
    "reported poses of shape (1, 3), not (2, 3)": lambda it: replace(it, poses=it.poses[:1]),
    "reported centreline of type NoneType": lambda it: replace(it, centreline=None),
    "reported clearance that is not finite": lambda it: replace(it, clearance=np.nan),
    "reported clearance that is not finite, or beyond 1e+06": lambda it: replace(it, clearance=1e9),
    "reported gripper_clearance of shape (2,), not ()": lambda it: replace(it, gripper_clearance=np.ones(2)),
    "reported joints of shape (6,), not (2, 6)": lambda it: replace(it, joints=np.zeros(6)),
    "reported joints of type list, not real numbers": lambda it: replace(it, joints=[[0.0, 1.0], [2.0]]),
    "reported joints that are not finite": lambda it: replace(it, joints=np.full((2, 7), np.nan)),
}
CASES = [
    *(("step", said) for said in WRONG | SEEN),
    *(("measure", said) for said in WRONG | MEASURED),
]


def wrong(what: str, said: str, since: int) -> Misbehaving:
    return Misbehaving(what, (WRONG | (MEASURED if what == "measure" else SEEN))[said], since)


def refusing(task: Any, left: Plan) -> Plan:
    raise PlanningError("walled in")


@pytest.mark.parametrize(("what", "said"), CASES)
def test_a_run_ends_with_what_was_recorded_and_says_what_the_plant_did(what: str, said: str) -> None:
    rollout = track(wrong(what, said, LATER), OpenLoop(), PLAN)
    assert (rollout.outcome, rollout.steps) == (Outcome.PLANT_FAILED, LATER - 1)
    assert rollout.detail.startswith(f"the plant's {what} {said}")
    assert "\n" not in rollout.detail
    assert rollout.status[-1].endswith("; then the plant failed")


def test_what_the_step_touched_that_failed_is_on_record() -> None:
    """A contact counts as one, too, where the plant cannot go on from it."""
    plant = Misbehaving("step", raising(PressedError("pressed in", -0.005)))
    rollout = track(plant, OpenLoop(), PLAN)
    assert (rollout.outcome, rollout.detail) == (Outcome.PLANT_FAILED, "pressed in")
    assert rollout.clearance[-1] == rollout.least_clearance == -0.005
    assert judge(TASK, rollout)[0] is Outcome.CONTACT


@pytest.mark.parametrize(("what", "said"), CASES)
def test_so_it_does_while_a_new_plan_is_looked_for(what: str, said: str) -> None:
    """The cable does not lie at the plan's start, so that the run begins with a recovery."""
    recovery = Recovery(replan=refusing, start=0.0)
    rollout = track(wrong(what, said, 4), OpenLoop(), PLAN, recovery=recovery)
    assert (rollout.outcome, rollout.steps) == (Outcome.PLANT_FAILED, 3)
    assert rollout.detail.startswith(f"the plant's {what} {said}")


def test_so_it_does_on_the_way_back() -> None:
    loop = Loop(AnsweringPlant(wrong("step", "answered with None", LATER)), OpenLoop(), PLAN, TrackConfig(), Watchdog())
    for _ in range(LATER - 3):
        assert loop.step() is None
    ending = loop.back_off(10)
    assert ending is not None
    assert ending.outcome is Outcome.PLANT_FAILED
    assert "answered with None" in ending.detail


@pytest.mark.parametrize("said", WRONG | SEEN)
def test_a_plant_that_cannot_look_before_anything_moved_is_refused(said: str) -> None:
    plant = wrong("reset", said, 0)
    with pytest.raises(SimulationError if "raised" in said else InputError) as refused:
        track(plant, OpenLoop(), PLAN)
    assert str(refused.value).startswith(f"the plant's reset {said}")
    assert plant._step == 0


@pytest.mark.parametrize("said", WRONG | MEASURED)
def test_and_so_is_one_that_cannot_measure(said: str) -> None:
    with pytest.raises(SimulationError if "raised" in said else InputError) as refused:
        track(wrong("measure", said, 0), OpenLoop(), PLAN)
    assert str(refused.value).startswith(f"the plant's measure {said}")


def test_numbers_that_no_record_can_hold_are_not_seen(tmp_path: Path) -> None:
    """Whatever a camera or a robot reports, the record of the run can be read again."""
    far = Misbehaving("step", lambda it: replace(it, keypoints=1e300 + it.keypoints, poses=it.poses * [1, 1, 1e9]))
    rollout = track(far, OpenLoop(), PLAN)
    rollout.save(tmp_path / "rollout.npz")
    assert np.isnan(Rollout.load(tmp_path / "rollout.npz").observed[LATER:]).all()


@pytest.mark.parametrize("points", [0, 1])
def test_a_centreline_is_a_line(points: int) -> None:
    plant = Misbehaving("measure", lambda it: replace(it, centreline=it.centreline[:points]), 0)
    with pytest.raises(InputError, match=f"the plant's measure reported a centreline of {points} points, fewer than 2"):
        track(plant, OpenLoop(), PLAN)


def test_a_centreline_keeps_its_number_of_points() -> None:
    rollout = track(Misbehaving("measure", lambda it: replace(it, centreline=it.centreline[:7])), OpenLoop(), PLAN)
    assert (rollout.outcome, rollout.steps) == (Outcome.PLANT_FAILED, LATER - 1)
    assert "reported centreline of shape (7, 2), not (49, 2)" in rollout.detail


def test_a_task_that_can_no_longer_be_read_ends_the_run() -> None:
    class Hanging(QuasiStaticPlant):
        def __getattribute__(self, name: str) -> Any:
            if name == "task" and object.__getattribute__(self, "__dict__").get("_step", 0) >= LATER:
                raise OSError("no answer")
            return super().__getattribute__(name)

        def measure(self) -> Measurement:
            return Measurement(self._keypoints(), self._poses, self._stations, 0.1, 0.1)

    rollout = track(Hanging(TASK, START, ROD), OpenLoop(), PLAN)
    assert (rollout.outcome, rollout.steps) == (Outcome.PLANT_FAILED, LATER)
    assert re.fullmatch(
        r"the plant's task raised OSError: no answer \(test_misbehaving\.py, line \d+\)", rollout.detail
    )


def test_an_interrupt_and_errors_of_the_package_keep_their_meaning() -> None:
    with pytest.raises(TrackingInterrupted) as stopped:
        track(Misbehaving("step", raising(KeyboardInterrupt())), OpenLoop(), PLAN)
    assert stopped.value.rollout.steps == LATER - 1
    rollout = track(Misbehaving("step", raising(Cancelled("enough"))), OpenLoop(), PLAN)
    assert (rollout.outcome, rollout.detail, rollout.steps) == (Outcome.INTERRUPTED, "enough", LATER - 1)
    rollout = track(Misbehaving("step", raising(SimulationError("came loose"))), OpenLoop(), PLAN)
    assert (rollout.outcome, rollout.detail) == (Outcome.PLANT_FAILED, "came loose")
    with pytest.raises(InputError, match="no such cable"):
        track(Misbehaving("reset", raising(InputError("no such cable")), 0), OpenLoop(), PLAN)


def test_an_insertion_ends_as_any_run_does() -> None:
    plant = wrong("step", "answered with None", 1)
    plant.reset()
    with pytest.raises(SimulationError, match="the plant's step answered with None"):
        insert_plug(plant, PLAN)


def test_lists_and_other_types_of_real_numbers_are_taken() -> None:
    def plainly(it: Any) -> Any:
        single = {"keypoints": it.keypoints.astype(np.float32), "poses": it.poses.tolist(), "time": np.float32(it.time)}
        return replace(it, **single, confidence=[1] * 13)

    rollout = track(Misbehaving("step", plainly), OpenLoop(), PLAN)
    assert rollout.outcome is Outcome.SETTLED
    assert rollout.observed.dtype == float


@pytest.mark.parametrize(("least", "outcome"), [(0.2, Outcome.SETTLED), (0.1, Outcome.TIMED_OUT)])
def test_a_cable_with_a_keypoint_in_doubt_has_not_settled(least: float, outcome: Outcome) -> None:
    plant = Misbehaving("step", lambda it: replace(it, confidence=np.array([*12 * [1.0], least])))
    assert track(plant, OpenLoop(), PLAN).outcome is outcome


def test_neither_side_changes_what_the_other_keeps() -> None:
    class Reusing(QuasiStaticPlant):
        def step(self, action: np.ndarray) -> Observation:
            self._poses = self._poses.copy()
            observation = super().step(action)
            action[:] = np.nan
            self.kept = getattr(self, "kept", observation)
            self.kept.keypoints[:], self.kept.poses[:] = observation.keypoints, observation.poses
            return replace(self.kept, time=observation.time)

    proper = track(QuasiStaticPlant(TASK, START, ROD), OpenLoop(), PLAN)
    rollout = track(Reusing(TASK, START, ROD), OpenLoop(), PLAN)
    np.testing.assert_array_equal(rollout.observed, proper.observed)
    np.testing.assert_array_equal(rollout.actions, proper.actions)


# ---------------------------------------------------------------- what is no plant and no controller
@pytest.mark.parametrize(
    ("given", "said"),
    [
        (QuasiStaticPlant, "the plant must be an object, got the class QuasiStaticPlant itself"),
        (object(), r"the plant, of type object, lacks task, control_step, reset\(\), step\(\), measure\(\)"),
    ],
)
def test_what_is_no_plant_is_refused(given: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        track(given, OpenLoop(), PLAN)


def test_a_controller_that_takes_other_arguments_is_refused() -> None:
    class Old(OpenLoop):
        def step(self, state: Any) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
            return super().step(state, None)

    with pytest.raises(InputError, match=r"Old.step\(state.*\) .*must take 2 arguments"):
        track(QuasiStaticPlant(TASK, START, ROD), Old(), PLAN)


@pytest.mark.parametrize("step", ["fast", None, np.nan, 0.0])
def test_a_control_step_is_a_time(step: Any) -> None:
    plant = QuasiStaticPlant(TASK, START, ROD, control_step=step)
    with pytest.raises(InputError, match=r"the plant('s| has a) control_step"):
        track(plant, OpenLoop(), PLAN)


# ---------------------------------------------------------------- grippers that go elsewhere, or nowhere
CONTROLLERS: tuple[Callable[[], Controller[Any]], ...] = (OpenLoop, JacobianFeedback, RodMPC)

ELSEWHERE: dict[str, Moves] = {
    "gripper moves as if y pointed downwards": lambda action: action * [1, -1, 1],
    "gripper moves as if x pointed to the left": lambda action: action * [-1, 1, 1],
    "gripper turns the other way round": lambda action: action * [1, 1, -1],
    "gripper moves as if y pointed downwards: ": lambda action: action * [1, -1, -1],
    "the right gripper moves as if its frame were turned by 180 degrees": lambda at: at * [[1, 1, 1], [-1, -1, 1]],
    "gripper moves as if x and y were exchanged": lambda action: action[:, [1, 0, 2]],
    "as if left and right were exchanged": lambda action: action[::-1].copy(),
}


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("said", ELSEWHERE)
def test_grippers_that_go_elsewhere_are_stopped_within_a_centimetre(
    said: str, controller: Callable[[], Controller[Any]]
) -> None:
    rollout = track(Misbehaving(moves=ELSEWHERE[said]), controller(), PLAN)
    assert rollout.outcome is Outcome.PLANT_FAILED
    assert said in rollout.detail
    assert np.linalg.norm((rollout.poses - rollout.poses[0])[..., :2], axis=2).max() < 0.01


def test_so_they_are_where_only_the_reports_are_exchanged() -> None:
    rollout = track(Misbehaving("step", lambda it: replace(it, poses=it.poses[::-1]), 0), OpenLoop(), PLAN)
    assert "the grippers are reported as if left and right were exchanged" in rollout.detail
    assert np.linalg.norm((rollout.poses - rollout.poses[0])[..., :2], axis=2).max() < 0.01


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("moving", [[[0], [0]], [[0], [1]], [[1], [0]]], ids=["neither", "right", "left"])
def test_a_gripper_that_never_moves_ends_the_run(moving: Any, controller: Callable[[], Controller[Any]]) -> None:
    rollout = track(Misbehaving(moves=lambda action: action * moving), controller(), PLAN)
    assert rollout.outcome is Outcome.PLANT_FAILED
    assert "gripper does not follow its commands" in rollout.detail
    assert "has not moved since the start" in rollout.detail
    assert rollout.times[-1] < 4.0
    assert np.linalg.norm((rollout.poses - rollout.poses[0])[..., :2], axis=2).max() < 0.015


def test_a_slow_plan_does_not_end_while_a_gripper_stands() -> None:
    """Stops that are far apart in time are in a row where the gripper has not moved in between."""
    slow = straight_plan(ROD, START, START + 0.2 * (GOAL - START), steps=300)

    class Jammed(QuasiStaticPlant):
        def step(self, action: np.ndarray) -> Observation:
            return super().step(np.where(np.array([[self._step < 120], [True]]), action, 0.0))

    rollout = track(Jammed(task_for(slow), START, ROD), OpenLoop(), slow)
    assert rollout.outcome is Outcome.PLANT_FAILED
    assert "the left gripper does not follow its commands" in rollout.detail


class Echo(QuasiStaticPlant):
    """Its grippers stand still and are reported where they were sent.

    Args:
        noise: Standard deviation of the keypoints [m].
    """

    def __init__(self, noise: float) -> None:
        super().__init__(TASK, START, ROD)
        self.noise, self.rng, self.sent = noise, np.random.default_rng(0), PLAN.poses[0]

    def step(self, action: np.ndarray) -> Observation:
        self.sent, observation = self.sent + action, super().step(0.0 * action)
        noise = self.rng.normal(0.0, self.noise, observation.keypoints.shape)
        return replace(observation, poses=self.sent, keypoints=observation.keypoints + noise)


@pytest.mark.parametrize("controller", [OpenLoop, JacobianFeedback])
@pytest.mark.parametrize(
    ("noise", "said"),
    [(0.0, "the camera has not seen the cable for 5 s"), (0.001, "from where the left gripper is reported")],
)
def test_a_cable_that_stays_behind_its_grippers_ends_the_run(
    noise: float, said: str, controller: Callable[[], Controller[Any]]
) -> None:
    rollout = track(Echo(noise), controller(), PLAN)
    assert rollout.outcome is Outcome.PLANT_FAILED
    assert said in rollout.detail
    assert rollout.times[-1] < 7.0


@pytest.mark.parametrize("late", [3, 6, 9])
def test_a_cable_that_is_seen_late_is_at_its_grippers(late: int) -> None:
    class Late(QuasiStaticPlant):
        def reset(self) -> Observation:
            self.frames = []
            return super().reset()

        def step(self, action: np.ndarray) -> Observation:
            observation = super().step(action)
            self.frames.append(observation.keypoints)
            return replace(observation, keypoints=self.frames[max(0, len(self.frames) - 1 - late)])

    assert track(Late(TASK, START, ROD), OpenLoop(), PLAN).outcome is Outcome.SETTLED


# ---------------------------------------------------------------- what never comes
BLIND: dict[str, tuple[Answers, str, float]] = {
    "keypoints": (lambda it: replace(it, keypoints=np.nan * it.keypoints), "the camera has not seen the cable", 5.0),
    "poses": (lambda it: replace(it, poses=np.nan * it.poses), "the robot has reported no new gripper poses", 1.0),
    "time": (lambda it: replace(it, time=0), "the robot has reported no new gripper poses", 1.0),
}


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("missing", BLIND)
def test_what_never_comes_is_named_within_seconds(missing: str, controller: Callable[[], Controller[Any]]) -> None:
    answers, said, after = BLIND[missing]
    rollout = track(Misbehaving("step", answers, 0), controller(), PLAN)
    assert (rollout.outcome, rollout.detail) == (Outcome.PLANT_FAILED, f"{said} for {after:g} s")
    assert rollout.times[-1] == pytest.approx(after)


def test_a_run_that_waits_until_its_time_is_over_says_for_what() -> None:
    dark = Misbehaving("step", lambda it: replace(it, keypoints=np.full((13, 2), np.nan)))
    rollout = track(dark, JacobianFeedback(), PLAN, config=TrackConfig(overtime=5.0))
    assert rollout.outcome is Outcome.TIMED_OUT
    assert rollout.detail == "the camera has not seen the cable for 9.1 s"


def test_joints_are_kept_where_every_measurement_since_the_start_has_them() -> None:
    plant = AnsweringPlant(
        Misbehaving("measure", lambda it: replace(it, joints=np.full((2, 7), float(it.clearance))), 0)
    )
    assert plant.joints is None
    plant.reset()
    rows = [plant.measure().joints for _ in range(2)]
    np.testing.assert_array_equal(plant.joints, np.array(rows))
    plant.reset()
    assert plant.joints is None
    late = AnsweringPlant(Misbehaving("measure", lambda it: replace(it, joints=np.zeros((2, 6))), 1))
    late.reset()
    late.measure()
    late.step(np.zeros((2, 3)))
    assert late.measure().joints is not None
    assert late.joints is None, "the first measurement had none"
