"""Arms that take the commands of ur-rtde, check them as a controller does, and keep them; and kinematics to go with."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from cableway.core.errors import SimulationError
from cableway.robot.ur_arm import Arm

SHIFT = np.array([[0.2, 0.3, 0.0], [0.5, 0.3, 0.0]])
"""Gripper poses of the table at which all joints are zero."""

MATRIX = np.array([[0.4, -0.1, 0.0], [0.2, 0.3, 0.0], [0.1, 0.0, 1.0]])
"""From shoulder pan, shoulder lift and wrist 3 to a gripper pose."""

MOVED = [0, 1, 5]


class LinearArms:
    """Kinematics that are linear in three joints of each arm; the others stay where they are."""

    def poses(self, joints: np.ndarray) -> np.ndarray:
        return SHIFT + joints[:, MOVED] @ MATRIX.T

    def joints(self, poses: np.ndarray, near: np.ndarray) -> np.ndarray:
        if np.abs(poses[:, :2]).max() > 2.0:
            raise SimulationError("the left arm does not reach (9.0, 9.0)")
        joints = near.copy()
        joints[:, MOVED] = np.linalg.solve(MATRIX, (poses - SHIFT).T).T
        return joints


class RecordingArm:
    """`ArmControl` and `ArmState` at once: goes where it was sent last, at once.

    Attributes:
        sent: Time and joints of each servoJ.
        calls: Names of all calls that are commands, in order.
        broken: What to do instead of stopping; may raise or wait.
        moved: Called with the joints of each servoJ.
    """

    def __init__(self, joints: np.ndarray, period: float, moved: Callable[[list[float]], None] | None = None) -> None:
        self.actual, self.period = [float(value) for value in joints], period
        self.sent: list[tuple[float, list[float]]] = []
        self.calls: list[str] = []
        self.safety, self.mode, self.connected, self.running, self.takes = 1, 7, True, True, True
        self.broken: Callable[[], None] = lambda: None
        self.moved = moved or (lambda joints: None)
        self.stamp: Callable[[], float] = time.monotonic
        self.frequency, self.kicked, self.ended = 0.0, True, False

    def servoJ(
        self, q: list[float], speed: float, acceleration: float, time_: float, lookahead_time: float, gain: float, /
    ) -> bool:
        assert not self.ended, "servoJ after the end"
        assert self.frequency, "servoJ without a watchdog"
        assert self.kicked, "servoJ, and the watchdog was not kicked since the last"
        assert len(q) == 6
        assert all(type(value) is float and math.isfinite(value) and abs(value) <= 2 * math.pi for value in q)
        assert time_ == self.period
        assert 0.03 <= lookahead_time <= 0.2
        assert 100 <= gain <= 2000
        self.calls.append("servoJ")
        self.kicked = False
        if not self.takes or self.safety != 1:
            return False
        self.sent.append((time.monotonic(), q))
        self.actual = q
        self.moved(q)
        return True

    def servoStop(self, a: float, /) -> bool:
        assert a > 0
        self.broken()
        self.calls.append("servoStop")
        return self.safety == 1 and self.running

    def stopJ(self, a: float, asynchronous: bool, /) -> None:
        assert a > 0
        assert not asynchronous
        self.calls.append("stopJ")

    def setWatchdog(self, min_frequency: float, /) -> bool:
        self.frequency = min_frequency
        self.calls.append("setWatchdog")
        return True

    def kickWatchdog(self) -> bool:
        self.kicked = True
        return True

    def isProgramRunning(self) -> bool:
        return self.running

    def isConnected(self) -> bool:
        return self.connected

    def stopScript(self) -> None:
        self.calls.append("stopScript")

    def disconnect(self) -> None:
        self.connected, self.ended = False, True

    def getTimestamp(self) -> float:
        return self.stamp()

    def getActualQ(self) -> list[float]:
        return list(self.actual)

    def getRobotMode(self) -> int:
        return self.mode

    def getSafetyMode(self) -> int:
        return self.safety

    def arm(self, name: str) -> Arm:
        return Arm(name, self, self)

    def speeds(self) -> np.ndarray:
        """Joint speeds [rad/s] between commands, at the period that they were sent for."""
        return np.abs(np.diff([joints for _, joints in self.sent], axis=0)).max(axis=1) / self.period
