"""Laws of what the driver of UR arms receives: by ur-rtde, from processes that speak RTDE as controllers do."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from quasi_static import straight_plan, task_for
from recording_arms import LinearArms, RecordingArm

from cableway.control.open_loop import OpenLoop
from cableway.core.errors import InputError, SimulationError
from cableway.outcome import Outcome
from cableway.robot import ur
from cableway.robot.ur import URRobot
from cableway.rod.planar import PlanarRod
from cableway.tracking import track_in_real_time

pytest.importorskip("rtde_receive", reason="ur-rtde is not installed: pip install 'cableway[ur]'")
if sys.platform != "linux":
    pytest.skip("needs the addresses 127.x.y.z of Linux", allow_module_level=True)

BENT = np.array([0.25, 0.2, 0.3, 3.0, 9.0, -1.5])
PLAN = straight_plan(PlanarRod(0.3), BENT, BENT + [0.0, 0.06, 0.0, 0.0, 0.0, 0.0], steps=12)
TASK = task_for(PLAN)
ARMS = LinearArms()
HOME = ARMS.joints(PLAN.poses[0], np.tile([0.0, 0.0, 1.9, -1.2, -1.57, 0.0], (2, 1)))
SOON = 10.0
"""[s] within which what was told must arrive, on a machine where others compute too."""


class StandIn:
    """A process that speaks RTDE at an address of its own."""

    def __init__(self, place: int) -> None:
        pid = os.getpid()
        self.address = f"127.{1 + pid // 200 % 250}.{1 + pid % 200}.{1 + place}"
        script = Path(__file__).parents[1] / "rtde_server.py"
        pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self.process = subprocess.Popen([sys.executable, str(script), self.address], **pipes)
        self._lock = threading.Lock()
        assert self._answer() == "ready\n"

    def tell(self, **changes: Any) -> None:
        assert self.process.stdin is not None
        with self._lock:
            self.process.stdin.write(json.dumps(changes) + "\n")
            self.process.stdin.flush()
            assert self._answer() == "done\n"

    def end(self) -> None:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        self.process.wait(10)
        self.process.stdout.close()

    def _answer(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline()


@pytest.fixture
def controllers() -> Iterator[tuple[StandIn, StandIn]]:
    """Two stand-ins at the start of the plan."""
    both = StandIn(0), StandIn(1)
    for joints, each in zip(HOME, both, strict=True):
        each.tell(actual_q=joints.tolist())
    yield both
    for each in both:
        each.end()


class Cable:
    """Carried along by the grippers as it is."""

    robot: URRobot

    def keypoints(self) -> np.ndarray:
        poses = ARMS.poses(np.stack([arm.joints() for arm in self.robot.arms]))
        return PLAN.shapes[0] + (poses - PLAN.poses[0])[:, :2].mean(axis=0)


def connected(controllers: tuple[StandIn, StandIn], **options: Any) -> tuple[URRobot, list[RecordingArm]]:
    """A robot whose commands move the joints that the stand-ins report."""
    recorders: list[RecordingArm] = []

    def control(host: str, rate: float) -> RecordingArm:
        place = [each.address for each in controllers].index(host)
        stand_in = controllers[place]
        recorders.append(RecordingArm(HOME[place], 1 / rate, lambda joints: stand_in.tell(actual_q=joints)))
        return recorders[-1]

    cable = Cable()
    hosts = [each.address for each in controllers]
    cable.robot = URRobot.connect(hosts, TASK, ARMS, cable, control=control, **options)
    return cable.robot, recorders


def soon(happened: Callable[[], bool]) -> bool:
    """Whether something happens before long."""
    ends = time.monotonic() + SOON
    while not happened():
        if time.monotonic() > ends:
            return False
        time.sleep(0.01)
    return True


def complaint(act: Callable[[], Any]) -> str:
    """What is raised before long when something is done again and again; "" where nothing is."""
    said: list[str] = []

    def raises() -> bool:
        try:
            act()
        except SimulationError as error:
            said.append(str(error))
        return bool(said)

    return said[0] if soon(raises) else ""


def test_what_the_controllers_report_is_what_is_observed(controllers: tuple[StandIn, StandIn]):
    robot, _ = connected(controllers)
    first = robot.observe()
    np.testing.assert_allclose(first.poses, PLAN.poses[0], atol=1e-12)
    np.testing.assert_allclose(first.keypoints, PLAN.shapes[0], atol=1e-12)
    moved = HOME + 0.1 * np.arange(12).reshape(2, 6)
    for joints, each in zip(moved, controllers, strict=True):
        each.tell(actual_q=joints.tolist())
    wanted = ARMS.poses(moved)
    assert soon(lambda: np.allclose(robot.observe().poses, wanted, atol=1e-12))
    assert robot.observe().time > first.time
    robot.close()


def test_a_controller_that_falls_silent_reports_nothing_new_and_then_is_lost(controllers: tuple[StandIn, StandIn]):
    robot, _ = connected(controllers)
    controllers[1].tell(answer=False)
    time.sleep(0.1)
    last = robot.observe()
    assert robot.observe() is last
    controllers[1].tell(close=True)

    lost = f"the right arm at {controllers[1].address} no longer answers: the connection is lost"
    assert complaint(robot.observe) == lost
    robot.close()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"safety_mode": 3}, "is in a protective stop"),
        ({"safety_mode": 7}, "is stopped by its emergency stop"),
        ({"robot_mode": 5}, "is not running (robot mode 5)"),
    ],
)
def test_an_arm_that_cannot_move_is_said_before_and_after_connecting(
    controllers: tuple[StandIn, StandIn], change: dict[str, int], said: str
):
    robot, recorders = connected(controllers)
    robot.send(PLAN.poses[0])
    controllers[0].tell(**change)

    assert said in complaint(lambda: robot.send(PLAN.poses[0]))
    robot.close()
    assert all("servoStop" in each.calls for each in recorders)
    with pytest.raises(SimulationError, match=re.escape(f"the left arm at {controllers[0].address} {said}")):
        connected(controllers)


def test_a_run_in_real_time_follows_the_plan_through_the_protocol(controllers: tuple[StandIn, StandIn]):
    robot, _ = connected(controllers)
    rollout = track_in_real_time(robot, OpenLoop(), PLAN, rate=robot.rate)
    robot.close()
    assert rollout.outcome is Outcome.SETTLED, rollout.detail
    np.testing.assert_allclose(rollout.poses[-1], PLAN.poses[-1], atol=2e-3)


def test_a_protective_stop_in_real_time_ends_the_run(controllers: tuple[StandIn, StandIn]):
    robot, recorders = connected(controllers)

    def stop_it() -> None:
        while "servoJ" not in recorders[0].calls:
            time.sleep(0.01)
        time.sleep(0.5)
        controllers[0].tell(safety_mode=3)

    threading.Thread(target=stop_it, daemon=True).start()
    rollout = track_in_real_time(robot, OpenLoop(), PLAN, rate=robot.rate)
    robot.close()
    assert rollout.outcome is Outcome.PLANT_FAILED
    assert "is in a protective stop" in rollout.detail
    assert all("servoStop" in each.calls for each in recorders)


def refusal(hosts: tuple[str, str], control: Callable[[str, float], RecordingArm] | None = None) -> str:
    with pytest.raises(InputError) as error:
        URRobot.connect(hosts, TASK, ARMS, Cable(), control=control)
    text = str(error.value)
    assert "\n" not in text
    assert text.endswith("its controller must be on, in remote control and in this network")
    return text


def test_connections_that_fail_are_said_in_a_sentence(
    controllers: tuple[StandIn, StandIn], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(ur, "PATIENCE", 0.5)
    left, right = controllers
    nobody = right.address.rsplit(".", 1)[0] + ".77"
    recorders: list[RecordingArm] = []

    def control(host: str, rate: float) -> RecordingArm:
        if host == right.address:
            raise RuntimeError("the robot is not in remote control")
        recorders.append(RecordingArm(HOME[0], 1 / rate))
        return recorders[-1]

    assert refusal((nobody, nobody)).startswith(
        f"no connection to the left arm at {nobody}, port 30004: Connection refused; "
    )
    assert "right arm" in refusal((left.address, right.address), control)
    assert "the robot is not in remote control; " in refusal((left.address, right.address), control)
    assert all(each.ended for each in recorders), "what was connected is disconnected again"
    left.tell(answer=False)
    assert "timed out; " in refusal((left.address, right.address))
    left.tell(answer=True, accept=False)
    assert "does not speak version 2 of RTDE; " in refusal((left.address, right.address))
    left.tell(accept=True, start=False)
    assert ": it sends no data; " in refusal((left.address, right.address))
    with socket.create_server((nobody, ur.PORT)) as other:
        threading.Thread(target=lambda: other.accept()[0].close(), daemon=True).start()
        assert f"no connection to the left arm at {nobody}" in refusal((nobody, nobody))
