"""Laws of a run in real time: a robot gets its commands evenly, whatever controller, camera and driver do."""

from __future__ import annotations

import contextlib
import functools
import gc
import re
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from quasi_static import straight_plan, task_for

from cableway.control.base import Status
from cableway.control.jacobian import JacobianConfig, JacobianFeedback
from cableway.control.open_loop import OpenLoop, OpenLoopConfig
from cableway.core.errors import InputError, PlanningError, SimulationError, TrackingInterrupted
from cableway.outcome import Outcome
from cableway.records import Observation, Plan, RodParameters
from cableway.report import summarize
from cableway.rod.planar import PlanarRod
from cableway.tracking import RealTimePlant, Recovery, TrackConfig, Watchdog, sender, track_in_real_time
from cableway.tracking.thinking import InThread, Late

ROD = PlanarRod(0.3)
BENT = np.array([0.25, 0.2, 0.3, 3.0, 9.0, -1.5])
STEP, RATE = 0.05, 100.0
"""Twice as fast as usual, to save time: control step [s], commands a second."""
PLAN = straight_plan(ROD, BENT, BENT + [0.0, 0.12, 0.0, 0.0, 0.0, 0.0], steps=30)
"""Carried 4 mm a step in y, as it is."""
TASK = task_for(PLAN)
GAP = 0.4
"""[s] between two commands at most, on a machine where others compute too."""


def thrice(test: Callable[..., None]) -> Callable[..., None]:
    """A law of timing holds at least one time in three: others may keep the machine from running a thread at all."""

    @functools.wraps(test)
    def again(*given: Any, **named: Any) -> None:
        for _ in range(2):
            with contextlib.suppress(AssertionError):
                return test(*given, **named)
        return test(*given, **named)

    return again


class Hand:
    """A robot that trails its commands by a first-order lag, and a cable that is carried along as it is.

    Attributes:
        fault: Called with the seconds since the first call of the robot, before each command; may raise or wait.
        dark, mute: From and until when [s] the camera, or the whole robot, reports nothing new.
    """

    def __init__(self, fault: Callable[[float], None] = lambda now: None) -> None:
        self.task, self.fault = TASK, fault
        self.dark = self.mute = (np.inf, np.inf)
        self.poses = self.target = PLAN.poses[0]
        self.times: list[float] = []
        self.sent: list[np.ndarray] = []
        self.stops: list[float] = []
        self._last = 0.0
        self._message: Observation | None = None

    @functools.cached_property
    def begun(self) -> float:
        return time.monotonic()

    @property
    def now(self) -> float:
        return time.monotonic() - self.begun

    def send(self, poses: np.ndarray) -> None:
        self.fault(self.now)
        self._advance()
        self.target = np.array(poses)
        self.times.append(self.now)
        self.sent.append(self.target)

    def observe(self) -> Observation:
        self._advance()
        if self._message is None or not self.mute[0] < self.now < self.mute[1]:
            keypoints = PLAN.shapes[0] + (self.poses - PLAN.poses[0])[:, :2].mean(axis=0)
            if self.dark[0] < self.now < self.dark[1]:
                keypoints = np.full_like(keypoints, np.nan)
            self._message = Observation(self.now, keypoints, self.poses.copy())
        return self._message

    def stop(self) -> None:
        self.stops.append(self.now)
        self.target = self.poses

    def _advance(self) -> None:
        now = self.now
        share = 1 - np.exp(-(now - self._last) / 0.04)
        self.poses, self._last = self.poses + share * (self.target - self.poses), now

    def speeds(self) -> np.ndarray:
        """Greatest speed [m/s] asked for in each window of a control step."""
        times, places = np.array(self.times), np.array(self.sent)[:, :, :2]
        ends = np.searchsorted(times, times + STEP)
        rows = [(i, j) for i, j in enumerate(ends) if j < len(times)]
        return np.array([np.linalg.norm(places[j] - places[i], axis=1).max() / (times[j] - times[i]) for i, j in rows])


class Follower(OpenLoop):
    """The plan's own motion, which hangs at some of its steps, counted from 0."""

    control_step = STEP

    def __init__(self, hangs: dict[int, float] | None = None) -> None:
        super().__init__(OpenLoopConfig(hold=0.0))
        self.hangs, self.asked = hangs or {}, 0

    def step(self, state: Any, observation: Observation | None) -> tuple[np.ndarray, Any]:
        wait = self.hangs.get(self.asked, 0.0)
        self.asked += 1
        time.sleep(wait)
        return super().step(state, observation)


def run(robot: Hand, controller: Follower | None = None, **options: Any):
    options = {"rate": RATE, "deadline": STEP / 2, **options}
    return track_in_real_time(robot, controller or Follower(), PLAN, **options)


@pytest.fixture(scope="module", autouse=True)
def compiled() -> None:
    """What the first run of a process compiles takes longer than some of these runs."""
    run(Hand())


@thrice
def test_commands_come_at_the_robots_rate_and_never_jump() -> None:
    robot = Hand()
    rollout = run(robot)
    assert rollout.outcome is Outcome.SETTLED
    assert np.linalg.norm(robot.poses - PLAN.poses[-1]) < 0.002
    timing = rollout.metadata["timing"]
    assert (timing["rate"], timing["commands"]) == (RATE, len(robot.times))
    assert timing["period"]["median"] == pytest.approx(1 / RATE, rel=0.2)
    assert timing["control_period"]["median"] == pytest.approx(STEP, rel=0.2)
    assert np.diff(robot.times).max() < GAP
    assert robot.speeds().max() < 1.5 * TASK.grippers.max_step / STEP
    jumps = np.linalg.norm(np.diff(np.array(robot.sent)[:, :, :2], axis=0), axis=2).max(axis=1)
    assert np.median(jumps[jumps > 1e-6]) == pytest.approx(0.004 / (STEP * RATE), rel=0.3), "between control steps"
    assert robot.stops, "at the end it stays where it is"
    report = summarize(TASK, PLAN, rollout)
    assert report.timing == timing
    assert any(name == "commands" and "at 100 Hz" in value for name, value in report.rows())


def test_all_that_a_robot_observes_of_the_cable_reaches_the_controller() -> None:
    rod, seen = RodParameters(np.ones(15), np.eye(15)), []

    class Seeing(Hand):
        def observe(self) -> Observation:
            observation = super().observe()
            return replace(observation, taken=observation.time - 0.01, confidence=np.full(13, 0.9), rod=rod)

    class Noting(Follower):
        def step(self, state: Any, observation: Observation | None) -> tuple[np.ndarray, Any]:
            seen.append(observation)
            return super().step(state, observation)

    run(Seeing(), Noting())
    looked = [each for each in seen[1:] if each is not None and np.isfinite(each.keypoints).any()]
    assert looked
    for each in looked:
        assert each.taken is not None
        np.testing.assert_array_equal(each.confidence, 0.9)
        np.testing.assert_array_equal(each.rod.covariance, rod.covariance)


@thrice
def test_a_controller_that_hangs_leaves_no_gap_and_the_grippers_stand_still() -> None:
    robot, controller = Hand(), Follower({10: 1.0})
    rollout = run(robot, controller)
    late = [status for status in rollout.status.tolist() if status.startswith("late")]
    assert late[:3] == ["late: finishing", "late: holding", "late: holding"]
    assert 14 <= len(late) <= 26, "a second, in steps of 50 ms"
    assert np.diff(robot.times).max() < GAP
    times, places = np.array(robot.times), np.array(robot.sent)[:, :, :2]
    hung = (times > 10 * STEP + 0.3) & (times < 10 * STEP + 0.8)
    assert np.ptp(places[hung], axis=0).max() < 0.001, "at rest 0.3 s after the step that was missed"
    assert rollout.metadata["watchdog"]["late"] == len(late)
    assert rollout.outcome is Outcome.SETTLED, "and goes on from where it stood, which open loop does not make up for"
    assert np.linalg.norm(robot.poses - PLAN.poses[-1], axis=1).max() < 1.5 * TASK.grippers.max_step


def test_a_controller_that_hangs_for_good_ends_the_run() -> None:
    robot = Hand()
    rollout = run(robot, Follower({5: 60.0}), watchdog=Watchdog(patience=0.5))
    assert rollout.outcome is Outcome.CONTROLLER_FAILED
    assert robot.now < 10.0
    assert robot.stops


@thrice
def test_a_run_that_gives_no_more_commands_is_stopped_by_the_sender(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever keeps the loop: the sender holds after a control step, and stops the robot after a while."""
    monkeypatch.setattr(sender, "ABANDONED", 0.4)
    robot = Hand()
    with RealTimePlant(robot, rate=RATE, deadline=STEP / 2, control_step=STEP) as plant:
        plant.reset()
        for _ in range(4):
            plant.step(np.array([[0.0, 0.004, 0.0]] * 2))
        before = len(robot.sent)
        time.sleep(0.9)
        assert np.diff(robot.times).max() < GAP
        assert len(robot.stops) == 1
        assert np.ptp(np.array(robot.sent[before + 20 :]), axis=0).max() < 0.001
        with pytest.raises(SimulationError, match=r"no motion came for 0\.4 s"):
            plant.step(np.zeros((2, 3)))


@pytest.mark.parametrize(
    ("silent", "said"),
    [("mute", "the robot has reported no new gripper poses for 0.3 s"), ("dark", "the camera has not seen the cable")],
)
@thrice
def test_silence_stops_the_grippers_and_then_the_run(silent: str, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cableway.tracking.real_time.SILENT_ROBOT", 0.3)
    monkeypatch.setattr("cableway.tracking.real_time.SILENT_CAMERA", 1.5)
    robot = Hand()
    setattr(robot, silent, (0.6, np.inf))
    rollout = run(robot, config=TrackConfig(overtime=5.0))
    assert rollout.outcome is Outcome.PLANT_FAILED
    assert said in rollout.detail
    assert robot.stops
    assert not summarize(TASK, PLAN, rollout).success


@thrice
def test_a_short_silence_is_survived() -> None:
    class Feedback(JacobianFeedback):
        control_step = STEP

    robot = Hand()
    robot.mute = (0.6, 1.0)
    rollout = track_in_real_time(robot, Feedback(JacobianConfig(hold=0.0)), PLAN, rate=RATE, deadline=STEP / 2)
    assert rollout.outcome is Outcome.SETTLED
    assert Status.STOPPED in rollout.status.tolist()
    assert np.linalg.norm(robot.poses - PLAN.poses[-1]) < 0.005


@pytest.mark.parametrize("fault", ["raises", "waits"])
@thrice
def test_a_driver_that_fails_ends_the_run(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(now: float) -> None:
        if now > 0.5:
            if fault == "raises":
                raise ConnectionError("cable unplugged")
            time.sleep(0.8)

    monkeypatch.setattr("cableway.tracking.real_time.SILENT_ROBOT", 0.3)
    robot = Hand(fail)
    rollout = run(robot)
    assert rollout.outcome is Outcome.PLANT_FAILED
    assert ("ConnectionError: cable unplugged" if fault == "raises" else "driver has not returned") in rollout.detail
    assert robot.stops


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (None, "the robot's observe answered with None"),
        (Observation(9.0, PLAN.shapes[0][:5], PLAN.poses[0]), r"the robot's observe reported keypoints of shape \(5"),
        (Observation(9.0, PLAN.shapes[0], PLAN.poses[0] + 0j), "the robot's observe reported gripper poses of type"),
    ],
)  # fmt: skip
def test_a_driver_that_answers_something_else_ends_the_run(answer: Any, said: str) -> None:
    class Confused(Hand):
        def observe(self) -> Observation:
            return answer if self.now > since else super().observe()

    since = 0.5
    robot = Confused()
    rollout = run(robot)
    assert rollout.outcome is Outcome.PLANT_FAILED
    assert re.match(said, rollout.detail)
    assert robot.stops
    since = -1.0
    robot = Confused()
    with pytest.raises(InputError, match=said):
        run(robot)
    assert (robot.sent, len(robot.stops)) == ([], 1)


@pytest.mark.parametrize("lost", [0.5, np.inf], ids=["during the run", "at its end"])
def test_a_robot_that_cannot_be_stopped_loses_no_record(lost: float) -> None:
    class Gone(Hand):
        def stop(self) -> None:
            time.sleep(2 * STEP)  # the run learns of the failure before it is known that this fails, too
            raise ConnectionResetError(104, "gone")

    def fail(now: float) -> None:
        if now > lost:
            raise ConnectionResetError(104, "gone")

    rollout = run(Gone(fail))
    assert rollout.outcome is Outcome.PLANT_FAILED
    assert "could not be stopped" in rollout.detail
    assert "ConnectionResetError: [Errno 104] gone" in rollout.detail
    assert rollout.steps > 5


def test_garbage_of_before_is_collected_before_anything_moves() -> None:
    """A driver of an earlier run may take a second to be disconnected, and would have been when memory filled up."""
    robot, sent, kept = Hand(), [], []

    class Driver:
        def __init__(self) -> None:
            self.itself = self

        def __del__(self) -> None:
            sent.append(len(robot.sent))

    class Collecting(Follower):
        def step(self, state: Any, observation: Observation | None) -> tuple[np.ndarray, Any]:
            gc.collect()
            kept.append(gc.get_freeze_count())
            return super().step(state, observation)

    gc.collect()
    gc.disable()
    try:
        Driver()
        run(robot, Collecting())
    finally:
        gc.enable()
    assert sent == [0]
    assert min(kept) > 0, "what there was is not looked through again"
    assert gc.get_freeze_count() == 0


def test_what_is_no_robot_is_refused() -> None:
    class Driver(Hand):
        stop = None  # pyright: ignore[reportAssignmentType]

    with pytest.raises(InputError, match=r"the robot, of type Driver, lacks stop\(\)"):
        RealTimePlant(Driver())


def test_an_interrupt_stops_the_robot_and_keeps_what_was_tracked() -> None:
    def interrupt(stage: str, share: float) -> None:
        if share > 0.3:
            raise KeyboardInterrupt

    robot = Hand()
    with pytest.raises(TrackingInterrupted) as stopped:
        run(robot, progress=interrupt)
    assert robot.stops
    assert stopped.value.rollout.steps > 5
    assert stopped.value.rollout.outcome is Outcome.INTERRUPTED
    assert "timing" in stopped.value.rollout.metadata


@thrice
def test_grippers_stand_and_get_commands_while_a_new_plan_is_made() -> None:
    def slowly(task: Any, left: Plan) -> Plan:
        time.sleep(0.8)
        raise PlanningError("walled in")

    robot = Hand()
    robot.task = replace(TASK, start=TASK.start + [0.0, 0.05], goal=TASK.goal + [0.0, 0.05])
    aside = Plan(PLAN.shapes + [0.0, 0.05], PLAN.poses + [0.0, 0.05, 0.0])
    recovery = Recovery(replan=slowly, rest=0.1)
    rollout = track_in_real_time(robot, Follower(), aside, rate=RATE, deadline=STEP / 2, recovery=recovery,
                                 config=TrackConfig(overtime=0.0, settle_time=0.0))  # fmt: skip
    stood = [status for status in rollout.status.tolist() if status == "off the plan: stopped"]
    assert len(stood) > 14, "800 ms and 100 ms, in steps of 50 ms"
    assert np.diff(robot.times).max() < GAP


def test_a_computation_that_is_late_is_waited_for_before_another_begins() -> None:
    asked: list[int] = []
    thinker = InThread()

    def slow() -> int:
        asked.append(len(asked))
        time.sleep(0.2)
        return asked[-1]

    for limit in (0.05, 0.05):
        with pytest.raises(Late):
            thinker.answer(slow, limit)
    assert asked == [0]
    assert thinker.answer(slow, 2.0) == 1
    with pytest.raises(ZeroDivisionError):
        thinker.answer(lambda: 1 // 0, 2.0)


@pytest.mark.parametrize(
    ("given", "said"),
    [({"rate": 0.5}, "rate must be from 1 to 1000 Hz"), ({"deadline": 0.05}, "below the control step of 0.05 s")],
)
def test_what_cannot_be_kept_is_refused(given: dict[str, float], said: str) -> None:
    with pytest.raises(InputError, match=said):
        run(Hand(), **given)


def test_a_robot_that_does_not_know_where_it_is_is_not_moved() -> None:
    robot = Hand()
    robot.poses = np.full((2, 3), np.nan)
    with pytest.raises(SimulationError, match="the robot reports no gripper poses"):
        run(robot)
    assert (robot.sent, len(robot.stops)) == ([], 1)
