"""Laws of the driver of UR arms: what it sends, what it refuses to send, and that it stops both arms."""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
import pytest
from quasi_static import straight_plan, task_for
from recording_arms import LinearArms, RecordingArm

from cableway.control.open_loop import OpenLoop
from cableway.core.errors import InputError, MissingExtraError, SimulationError
from cableway.outcome import Outcome
from cableway.robot import ur
from cableway.robot.ur import URRobot
from cableway.robot.ur_arm import SAFETY
from cableway.rod.planar import PlanarRod
from cableway.tracking import track_in_real_time

BENT = np.array([0.25, 0.2, 0.3, 3.0, 9.0, -1.5])
PLAN = straight_plan(PlanarRod(0.3), BENT, BENT + [0.0, 0.06, 0.0, 0.0, 0.0, 0.0], steps=12)
TASK = task_for(PLAN)
ARMS = LinearArms()
HOME = ARMS.joints(PLAN.poses[0], np.tile([0.0, 0.0, 1.9, -1.2, -1.57, 0.0], (2, 1)))


class Cable:
    """Carried along by the grippers as it is."""

    def __init__(self) -> None:
        self.recorders: list[RecordingArm] = []

    def keypoints(self) -> np.ndarray:
        poses = ARMS.poses(np.array([each.actual for each in self.recorders]))
        return PLAN.shapes[0] + (poses - PLAN.poses[0])[:, :2].mean(axis=0)


class Clock:
    """Time that the test advances."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


def made(clock: Any = None, **options: Any) -> tuple[URRobot, RecordingArm, RecordingArm]:
    """A robot and its two arms, at the start of the plan."""
    rate = options.pop("rate", 125.0)
    left, right = (RecordingArm(joints, 1 / rate) for joints in HOME)
    cable = Cable()
    cable.recorders = [left, right]
    arms = (left.arm("left arm at l"), right.arm("right arm at r"))
    clocks = {} if clock is None else {"clock": clock}
    robot = URRobot(TASK, arms, options.pop("kinematics", ARMS), cable, rate=rate, **clocks, **options)
    return robot, left, right


def test_poses_go_out_as_the_joints_of_both_arms():
    clock = Clock()
    robot, left, right = made(clock)
    for step in range(5):
        poses = PLAN.poses[0] + [0.0, 2e-4 * step, 1e-3 * step]
        robot.send(poses)
        clock.now += 1 / 125
        reached = ARMS.poses(np.array([left.sent[-1][1], right.sent[-1][1]]))
        np.testing.assert_allclose(reached, poses, atol=1e-12)
        np.testing.assert_allclose(robot.observe().poses, poses, atol=1e-12)
    for arm in (left, right):
        assert arm.calls == ["setWatchdog", *["servoJ"] * 5]
        assert arm.frequency == 10.0
        assert arm.sent[0][1][2:5] == [1.9, -1.2, -1.57]


@pytest.mark.parametrize("gap", [0.008, 0.05, 0.1, 10.0])
def test_a_joint_is_never_sent_faster_than_its_limit(gap: float):
    """Until the tenth of a second after which the watchdog ends the program anyway."""
    clock = Clock()
    for share, refused in ((0.98, False), (1.02, True)):
        robot, _, right = made(clock, joint_speed=0.5)
        robot.send(PLAN.poses[0])
        turn = share * 0.5 * min(gap, 0.1)
        joints = HOME.copy()
        joints[1, 5] += turn
        clock.now += gap
        if refused:
            said = "the wrist_3_joint of the right arm at r would have to turn at 29.2 degrees/s, limit 28.6 degrees/s"
            with pytest.raises(SimulationError, match=said):
                robot.send(ARMS.poses(joints))
            assert right.calls.count("servoJ") == 1
        else:
            robot.send(ARMS.poses(joints))
            assert right.sent[-1][1][5] == pytest.approx(joints[1, 5])


def test_arms_that_are_not_where_the_run_begins_are_not_moved():
    robot, left, _ = made()
    left.actual[5] += 0.05
    with pytest.raises(
        SimulationError, match=r"left arm at l is not where the run begins: its wrist_3_joint is off by 2.9"
    ):
        robot.send(PLAN.poses[0])
    assert left.calls == []


@pytest.mark.wrong_types
@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (np.full((2, 6), np.nan), "the kinematics found no"),
        (HOME[:, :5], "the kinematics found no"),
        (HOME + [0.0, 0.0, 6.0, 0.0, 0.0, 0.0], "would have to turn its elbow_joint to 453 degrees, limit 157 degrees"),
        (HOME + [0.0, 0.0, 1.3, 0.0, 0.0, 0.0], "would have to turn its elbow_joint to 183 degrees, limit 157 degrees"),
        (HOME + [0.0, 0.0, 0.0, 9.0, 0.0, 0.0], "turn its wrist_1_joint to 447 degrees, limit 360 degrees"),
    ],
)
def test_what_kinematics_may_not_answer(answer: np.ndarray, said: str):
    class Wrong(LinearArms):
        def joints(self, poses: np.ndarray, near: np.ndarray) -> np.ndarray:
            return answer

    robot, left, right = made(kinematics=Wrong())
    with pytest.raises(SimulationError, match=said):
        robot.send(PLAN.poses[0])
    assert left.calls == right.calls == []


def test_a_pose_out_of_reach_is_said_by_the_kinematics():
    robot, left, _ = made()
    with pytest.raises(SimulationError, match="does not reach"):
        robot.send(PLAN.poses[0] + 9.0)
    assert left.calls == []


@pytest.mark.parametrize("mode", [*SAFETY, 11])
def test_every_stop_of_the_safety_system_is_said(mode: int):
    robot, _, right = made()
    robot.send(PLAN.poses[0])
    right.safety = mode
    said = SAFETY.get(mode, "safety mode 11")
    for act in (robot.observe, lambda: robot.send(PLAN.poses[0])):
        with pytest.raises(SimulationError, match=rf"^the right arm at r .*{said}"):
            act()
    assert right.calls.count("servoJ") == 1
    robot.stop()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"mode": 3}, "is not running (robot mode 3)"),
        ({"running": False}, "the program of ur-rtde on its controller has ended"),
        ({"connected": False}, "the connection is lost"),
        ({"takes": False}, "refused a command"),
        ({"actual": [0.0] * 5}, "reports no positions of its 6 joints"),
        ({"actual": [0.0, np.nan, 0.0, 0.0, 0.0, 0.0]}, "reports no positions of its 6 joints"),
    ],
)
def test_an_arm_that_cannot_be_led_is_said(change: dict[str, Any], said: str):
    robot, left, _ = made()
    for name, value in change.items():
        setattr(left, name, value)
    with pytest.raises(SimulationError) as error:
        robot.send(PLAN.poses[0])
    assert str(error.value).startswith("the left arm at l")
    assert said in str(error.value)


def test_stopping_stops_both_arms_and_for_good():
    robot, left, right = made()
    robot.send(PLAN.poses[0])
    robot.stop()
    robot.stop()
    for arm in (left, right):
        assert arm.calls[-2:] == ["servoStop", "stopJ"]
        assert arm.calls.count("stopJ") == 1
    with pytest.raises(SimulationError, match="stopped for good"):
        robot.send(PLAN.poses[0])
    robot.close()
    assert left.ended
    assert right.calls[-1] == "stopScript"


@pytest.mark.parametrize("fault", ["raises", "hangs", "refuses", "lost"])
def test_one_arm_that_does_not_stop_keeps_the_other_from_nothing(fault: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(ur, "PATIENCE", 0.3)

    def gone() -> None:
        if fault == "raises":
            raise RuntimeError("no answer")
        time.sleep(1.0)

    robot, left, right = made()
    if fault in ("raises", "hangs"):
        left.broken = gone
    elif fault == "refuses":
        left.servoStop = lambda a, /: False
    else:
        left.servoStop, left.connected = lambda a, /: False, False
    said = {
        "raises": "the left arm at l may not have stopped: RuntimeError: no answer",
        "hangs": "the left arm at l did not answer for 0.3 s when told to stop",
        "refuses": "the left arm at l may not have stopped: it refused to",
        "lost": "the left arm at l may not have stopped: it no longer answers",
    }[fault]
    with pytest.raises(SimulationError) as error:
        robot.stop()
    assert str(error.value).startswith(said)
    assert "right" not in str(error.value)
    assert right.calls == ["servoStop", "stopJ"]


def test_an_observation_is_new_once_both_arms_have_reported():
    clock = Clock()
    robot, left, right = made(clock)
    stamps = {"left": 1.0, "right": 50.0}
    left.stamp, right.stamp = lambda: stamps["left"], lambda: stamps["right"]
    first = robot.observe()
    clock.now += 0.01
    assert robot.observe() is first
    stamps["left"] += 0.01
    assert robot.observe() is first
    stamps["right"] += 0.01
    second = robot.observe()
    assert second.time == pytest.approx(first.time + 0.01)


def test_what_cannot_be_a_robot_is_refused():
    left = RecordingArm(HOME[0], 0.008).arm("left arm")
    for options, said in (
        ({"rate": 50.0}, "from 125 to 500 Hz, got 50.0"),
        ({"rate": np.nan}, "from 125 to 500 Hz, got nan"),
        ({"joint_speed": 0.0}, "at most 3.142 rad/s, got 0.0"),
        ({"joint_speed": 4.0}, "at most 3.142 rad/s, got 4.0"),
    ):
        with pytest.raises(InputError, match=said):
            URRobot(TASK, (left, left), ARMS, Cable(), **options)
    with pytest.raises(InputError, match="two arms are needed"):
        URRobot(TASK, (left,), ARMS, Cable())


def test_without_the_extra_one_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "rtde_control", None)
    said = r"^the driver of UR arms needs ur-rtde, which is not installed: pip install 'cableway\[ur\]'$"
    with pytest.raises(MissingExtraError, match=said):
        URRobot.connect(("127.0.0.1", "127.0.0.2"), TASK, ARMS, Cable())


@pytest.mark.parametrize("rate", [125.0, 250.0])
def test_a_run_in_real_time_leads_both_arms_along_the_plan(rate: float):
    robot, left, right = made(rate=rate)
    rollout = track_in_real_time(robot, OpenLoop(), PLAN, rate=rate)
    assert rollout.outcome is Outcome.SETTLED, rollout.detail
    for place, arm in enumerate((left, right)):
        assert len(arm.sent) > 20
        np.testing.assert_allclose(ARMS.poses(np.array([arm.actual] * 2))[place], PLAN.poses[-1, place], atol=1e-3)
        assert arm.calls[-2:] == ["servoStop", "stopJ"]
        assert np.median(arm.speeds()) <= 1.0


def test_in_real_time_a_protective_stop_of_one_arm_ends_the_run_and_stops_the_other():
    robot, left, right = made()
    left.moved = lambda joints: setattr(left, "safety", 3) if len(left.sent) > 40 else None
    rollout = track_in_real_time(robot, OpenLoop(), PLAN, rate=125.0)
    assert rollout.outcome is Outcome.PLANT_FAILED
    assert rollout.detail.startswith("the left arm at l is in a protective stop: clear its cause")
    assert "could not be stopped" not in rollout.detail
    assert right.calls[-2:] == ["servoStop", "stopJ"]
    assert len(right.sent) - len(left.sent) <= 1
    assert rollout.steps < PLAN.steps
