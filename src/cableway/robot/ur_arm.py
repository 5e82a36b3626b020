"""One arm of Universal Robots: its joints, what it reports, how it is asked and stopped."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float

from cableway.core.errors import SimulationError, raised, said
from cableway.core.quantities import limit_text, quantity
from cableway.scene.arm_models import JOINT_NAMES as JOINTS
from cableway.scene.arm_models import ArmModel

LOOKAHEAD, GAIN = 0.1, 300.0
"""Of servoJ, the maker's defaults [s, 1]: the arm is led smoothly, and lags by the first."""

SERVO_DECELERATION, JOINT_DECELERATION = 10.0, 2.0
"""Of servoStop and stopJ, the defaults of ur-rtde [rad/s²]."""

RUNNING = 7
"""`robot_mode` of an arm that is powered, with its brakes released."""

SAFE = (1, 2)
"""`safety_mode`: normal and reduced."""

SAFETY = {
    3: "is in a protective stop: clear its cause, then unlock it on the pendant",
    4: "is in recovery mode: a joint is beyond a safety limit",
    5: "is in a safeguard stop: a door or a light curtain is open",
    6: "is stopped by the emergency stop of the system",
    7: "is stopped by its emergency stop",
    8: "reports a safety violation",
    9: "reports a safety fault",
    12: "is in a safeguard stop of automatic mode",
    13: "is stopped by the three-position enabling device",
}
"""What else `safety_mode` says."""


def joint_names(count: int) -> tuple[str, ...]:
    """What the joints of an arm are called: as the maker does, if there are six.

    >>> joint_names(2)
    ('joint_1', 'joint_2')
    """
    return JOINTS if count == len(JOINTS) else tuple(f"joint_{k + 1}" for k in range(count))


def beyond_range(joints: Float[np.ndarray, "k 6"], model: ArmModel) -> str:
    """Which joint of an arm would be beyond its range at one of these positions [rad], said of the arm; "" for none."""
    turned, most = np.abs(joints).max(axis=0), np.array(model.position_limit)
    worst = int((turned - most).argmax())
    if turned[worst] <= most[worst]:
        return ""
    to, limit = quantity(float(turned[worst]), "rad"), limit_text(float(most[worst]), "rad")
    return f"would have to turn its {JOINTS[worst]} to {to}, limit {limit}"


class ArmControl(Protocol):
    """What is called of `rtde_control.RTDEControlInterface`, with its names and units."""

    def servoJ(  # noqa: D102
        self, q: list[float], speed: float, acceleration: float, time: float, lookahead_time: float, gain: float, /
    ) -> bool: ...
    def servoStop(self, a: float, /) -> bool: ...  # noqa: D102
    def stopJ(self, a: float, asynchronous: bool, /) -> None: ...  # noqa: D102
    def setWatchdog(self, min_frequency: float, /) -> bool: ...  # noqa: D102
    def kickWatchdog(self) -> bool: ...  # noqa: D102
    def isConnected(self) -> bool: ...  # noqa: D102
    def isProgramRunning(self) -> bool: ...  # noqa: D102
    def stopScript(self) -> None: ...  # noqa: D102
    def disconnect(self) -> None: ...  # noqa: D102


class ArmState(Protocol):
    """What is called of `rtde_receive.RTDEReceiveInterface`, with its names and units."""

    def getTimestamp(self) -> float: ...  # noqa: D102
    def getActualQ(self) -> Sequence[float]: ...  # noqa: D102
    def getRobotMode(self) -> int: ...  # noqa: D102
    def getSafetyMode(self) -> int: ...  # noqa: D102
    def isConnected(self) -> bool: ...  # noqa: D102
    def disconnect(self) -> None: ...  # noqa: D102


@dataclass(frozen=True)
class Arm:
    """An arm and the connections to its controller.

    Attributes:
        name: What messages call it, such as "left arm at 192.168.0.10".
        control: Takes commands.
        state: Reports.
    """

    name: str
    control: ArmControl
    state: ArmState

    def joints(self) -> Float[np.ndarray, "6"]:
        """Measured joint positions [rad].

        Raises:
            SimulationError: It reports none.
        """
        joints = np.array(self.state.getActualQ(), float)
        if joints.shape != (len(JOINTS),) or not np.isfinite(joints).all():
            raise SimulationError(f"the {self.name} reports no positions of its {len(JOINTS)} joints")
        return joints

    def fault(self) -> str:
        """Why it cannot move, said of the arm; "" where it can."""
        if not self.state.isConnected():
            return "no longer answers: the connection is lost"
        if (mode := self.state.getSafetyMode()) not in SAFE:
            return SAFETY.get(mode, f"is not in normal operation (safety mode {mode})")
        if (mode := self.state.getRobotMode()) != RUNNING:
            return f"is not running (robot mode {mode}): power it on and release its brakes on the pendant"
        if not self.control.isConnected():
            return "takes no commands: the connection is lost"
        if not self.control.isProgramRunning():
            return "takes no commands: the program of ur-rtde on its controller has ended"
        return ""

    def require_ready(self) -> None:
        """Make sure that it can move.

        Raises:
            SimulationError: It cannot.
        """
        if fault := self.fault():
            raise SimulationError(f"the {self.name} {fault}")

    def ask(self, call: Callable[..., bool], *arguments: Any) -> None:
        """Have a command carried out.

        Raises:
            SimulationError: It was refused, or raised.
        """
        try:
            taken = call(*arguments)
        except raised() as error:
            raise SimulationError(f"the {self.name} refused a command with {said(error)}") from error
        if not taken:
            raise SimulationError(f"the {self.name} {self.fault() or 'refused a command'}")

    def stop(self) -> str:
        """Bring it to rest; why that is not certain, "" where it is. A stop by its safety system counts."""
        try:
            done = self.control.servoStop(SERVO_DECELERATION)
            self.control.stopJ(JOINT_DECELERATION, False)
        except raised() as error:
            return f"the {self.name} may not have stopped: {said(error)}"
        if done or (self.state.isConnected() and self.fault()):
            return ""
        return f"the {self.name} may not have stopped: it {self.fault() or 'refused to'}"
