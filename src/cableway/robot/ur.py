"""Two arms of Universal Robots, each on its own controller, as a robot that `track_in_real_time` drives.

Poses become joint positions by the kinematics that is handed in, and go out by servoJ of `ur-rtde` (extra `ur`); what
the arms report comes back by RTDE.

Note:
    Nothing here has been tried on an arm or on the maker's simulator. The receiving half is tested with a server that
    speaks RTDE, the sending half with an implementation of `ArmControl` that records what it is asked.
"""

from __future__ import annotations

import math
import socket
import struct
import threading
import time
from collections.abc import Callable, Sequence
from typing import Protocol, Self

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError, SimulationError, UnknownNameError, raised
from cableway.core.extras import require
from cableway.core.quantities import quantity
from cableway.records import Observation
from cableway.robot.cell_kinematics import CellKinematics
from cableway.robot.ur_arm import GAIN, JOINTS, LOOKAHEAD, Arm, ArmControl, ArmState, beyond_range
from cableway.scene.arm_models import ARM_MODELS, ArmModel
from cableway.scene.task import Task

RATES = (125.0, 500.0)
"""[Hz] of commands: 500 at most on an e-Series, 125 on a CB3."""

WATCHDOG = 10.0
"""Commands a second [Hz] below which the program on the controller ends by itself, and with it the motion."""

PORT, PATIENCE = 30004, 2.0
"""Of RTDE, and how long [s] to wait for a controller to answer there, or to stop."""

VARIABLES = ("timestamp", "actual_q", "robot_mode", "safety_mode", "runtime_state")
"""What is asked of a controller, by the names of RTDE."""

SIDES = ("left", "right")


class Kinematics(Protocol):
    """Where joints put the grippers on the table, and back; nothing is inherited. Left arm, then right."""

    def poses(self, joints: Float[np.ndarray, "2 6"]) -> Float[np.ndarray, "2 3"]:
        """Gripper poses (x, y, theta) [m, m, rad] in the task's frame at joint positions [rad]."""
        ...

    def joints(self, poses: Float[np.ndarray, "2 3"], near: Float[np.ndarray, "2 6"]) -> Float[np.ndarray, "2 6"]:
        """Joint positions [rad] that lead to gripper poses [m, m, rad], those nearest to `near`.

        Raises:
            CablewayError: An arm cannot get there.
        """
        ...


class Camera(Protocol):
    """Sees the cable; nothing is inherited."""

    def keypoints(self) -> Float[np.ndarray, "n 2"]:
        """Those of the newest frame [m] in the task's frame, NaN where nothing is new. It returns at once."""
        ...


class URRobot:
    """Two arms and a camera as a `tracking.Robot`.

    With the kinematics of a cell, it sends nothing that brings links nearer to each other, to the table or to an
    obstacle than `cell_kinematics.LEAST`; with others, it does not know where links are.

    Args:
        task: What is to be done.
        arms: Left, then right.
        kinematics: Of the two arms on this table.
        camera: Sees the cable.
        rate: Commands a second [Hz]; `track_in_real_time` must be given the same.
        joint_speed: Greatest speed of a joint [rad/s] that is sent, as far as its arm reaches that; a faster command
            ends the run.
        models: What the arms are, by names of `ARM_MODELS`; those of the cell, with its kinematics.
        clock: [s].

    Raises:
        InputError: The rate or the speed is out of range, there are not two arms, or a model is unknown.
    """

    def __init__(
        self,
        task: Task,
        arms: Sequence[Arm],
        kinematics: Kinematics,
        camera: Camera,
        *,
        rate: float = 125.0,
        joint_speed: float = 1.0,
        models: Sequence[str] = ("ur5e", "ur5e"),
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        if not RATES[0] <= rate <= RATES[1]:
            raise InputError(f"the rate of the arms must be from {RATES[0]:g} to {RATES[1]:g} Hz, got {rate!r}")
        if len(arms) != len(SIDES):
            raise InputError(f"two arms are needed, the left and the right one, got {len(arms)}")
        self._models = kinematics.models if isinstance(kinematics, CellKinematics) else _models(models)
        limits = np.array([model.speed_limit for model in self._models])
        if not 0 < joint_speed <= limits.max():
            raise InputError(f"joint_speed must be above 0 and at most {limits.max():.4g} rad/s, got {joint_speed!r}")
        self.task, self.rate, self.arms = task, rate, tuple(arms)
        self._kinematics, self._camera, self._clock = kinematics, camera, clock
        self._speeds = np.minimum(joint_speed, limits)
        self._sent: np.ndarray | None = None
        self._sent_at = self._begun = clock()
        self._stamps = [-math.inf] * len(SIDES)
        self._newest: Observation | None = None
        self._stopped = threading.Event()

    @classmethod
    def connect(
        cls,
        hosts: Sequence[str],
        task: Task,
        kinematics: Kinematics,
        camera: Camera,
        *,
        rate: float = 125.0,
        joint_speed: float = 1.0,
        models: Sequence[str] = ("ur5e", "ur5e"),
        control: Callable[[str, float], ArmControl] | None = None,
    ) -> Self:
        """Connect to the controllers of both arms, and start the program of ur-rtde on them. Nothing moves.

        Args:
            hosts: Address of the left and of the right arm's controller.
            task: As for the class, like `kinematics`, `camera`, `rate`, `joint_speed` and `models`.
            kinematics: See there.
            camera: See there.
            rate: See there.
            joint_speed: See there.
            models: See there.
            control: Makes what takes the commands, from address and rate; by default, ur-rtde's.

        Raises:
            MissingExtraError: ur-rtde is not installed.
            InputError: As for the class, or a controller does not answer.
            SimulationError: An arm cannot move: it is stopped, or has no power.
        """
        require("ur", "the driver of UR arms")
        arms: list[Arm] = []
        try:
            for side, host in zip(SIDES, hosts, strict=True):
                arms.append(_connected(f"{side} arm at {host}", host, rate, control or _control_interface))
            robot = cls(task, arms, kinematics, camera, rate=rate, joint_speed=joint_speed, models=models)
            for arm in arms:
                arm.require_ready()
        except BaseException:
            _disconnect(arms)
            raise
        return robot

    def send(self, poses: Float[np.ndarray, "2 3"]) -> None:
        """See `tracking.Robot.send`.

        Raises:
            SimulationError: An arm is stopped or lost, cannot reach its pose, would have to move too fast or too far
                for it, or to bring a link to something.
        """
        if self._stopped.is_set():
            raise SimulationError("the arms were stopped for good; connect again")
        for arm in self.arms:
            arm.require_ready()
        first = self._sent is None
        before = np.stack([arm.joints() for arm in self.arms]) if self._sent is None else self._sent
        target, now = np.asarray(self._kinematics.joints(poses, before), float), self._clock()
        elapsed = 1 / self.rate if first else min(max(now - self._sent_at, 1 / self.rate), 1 / WATCHDOG)
        self._require_slow(target, before, elapsed, first)
        if isinstance(self._kinematics, CellKinematics) and (fault := self._kinematics.fault(before, target)):
            raise SimulationError(fault)
        for arm, joints in zip(self.arms, target, strict=True):
            if first:
                arm.ask(arm.control.setWatchdog, WATCHDOG)
            arm.ask(arm.control.servoJ, joints.tolist(), 0.0, 0.0, 1 / self.rate, LOOKAHEAD, GAIN)
            arm.ask(arm.control.kickWatchdog)
        self._sent, self._sent_at = target, now

    def observe(self) -> Observation:
        """See `tracking.Robot.observe`: new once both arms have reported anew.

        Raises:
            SimulationError: An arm is stopped or lost.
        """
        for arm in self.arms:
            arm.require_ready()
        stamps = [arm.state.getTimestamp() for arm in self.arms]
        old = any(new <= last for new, last in zip(stamps, self._stamps, strict=True))
        if self._newest is not None and old:
            return self._newest
        self._stamps = stamps
        poses = self._kinematics.poses(np.stack([arm.joints() for arm in self.arms]))
        self._newest = Observation(self._clock() - self._begun, np.asarray(self._camera.keypoints(), float), poses)
        return self._newest

    def stop(self) -> None:
        """See `tracking.Robot.stop`: both arms at the same time, each in a thread of its own.

        Raises:
            SimulationError: One may not have stopped.
        """
        if self._stopped.is_set():
            return
        problems = [f"the {arm.name} did not answer for {PATIENCE:g} s when told to stop" for arm in self.arms]

        def stop(place: int) -> None:
            problems[place] = self.arms[place].stop()

        threads = [threading.Thread(target=stop, args=(place,), daemon=True) for place in range(len(self.arms))]
        for thread in threads:
            thread.start()
        ends = time.monotonic() + PATIENCE
        for thread in threads:
            thread.join(max(0.0, ends - time.monotonic()))
        if found := [problem for problem in problems if problem]:
            raise SimulationError("; ".join(found))
        self._stopped.set()

    def close(self) -> None:
        """Stop, end the programs on the controllers, and disconnect."""
        try:
            self.stop()
        finally:
            self._stopped.set()
            _disconnect(self.arms)

    def _require_slow(self, target: np.ndarray, before: np.ndarray, elapsed: float, first: bool) -> None:
        """Raise a SimulationError where joints are not numbers, out of range, or too fast from those sent before."""
        if target.shape != before.shape or not np.isfinite(target).all():
            raise SimulationError(f"the kinematics found no {before.shape} joint positions for the poses to be sent")
        for side, (arm, to, since) in enumerate(zip(self.arms, target, before, strict=True)):
            if beyond := beyond_range(to[None], self._models[side]):
                raise SimulationError(f"the {arm.name} {beyond}")
            way, most = np.abs(to - since), self._speeds[side]
            worst = int((way / most).argmax())
            if way[worst] <= most[worst] * elapsed:
                continue
            if first:
                raise SimulationError(
                    f"the {arm.name} is not where the run begins: its {JOINTS[worst]} is off by "
                    f"{quantity(float(way[worst]), 'rad')}"
                )
            raise SimulationError(
                f"the {JOINTS[worst]} of the {arm.name} would have to turn at "
                f"{quantity(float(way[worst]) / elapsed, 'rad/s')}, limit {quantity(float(most[worst]), 'rad/s')}"
            )


def _models(names: Sequence[str]) -> tuple[ArmModel, ArmModel]:
    """The models of both arms.

    Raises:
        InputError: There are not two of them, or one is unknown.
    """
    if len(names) != len(SIDES):
        raise InputError(f"two models are needed, of the left and the right arm, got {len(names)}")
    for name in names:
        if name not in ARM_MODELS:
            raise UnknownNameError("model", name, tuple(ARM_MODELS))
    return ARM_MODELS[names[0]], ARM_MODELS[names[1]]


def _connected(name: str, host: str, rate: float, control: Callable[[str, float], ArmControl]) -> Arm:
    """An arm whose controller answers and reports.

    Raises:
        InputError: It does not.
    """
    ends: list[ArmState] = []
    try:
        _greet(host)
        ends.append(_receive_interface(host))
        _await_report(ends[0])
        return Arm(name, control(host, rate), ends[0])
    except raised() as error:
        for end in ends:
            end.disconnect()
        said_first = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        reason = " ".join(said_first.split())[:200] or type(error).__name__
        raise InputError(
            f"no connection to the {name}, port {PORT}: {reason}; its controller must be on, in remote control and in "
            "this network"
        ) from error


def _greet(host: str) -> None:
    """Make sure that a controller speaks RTDE: ur-rtde waits forever for one that does not."""
    with socket.create_connection((host, PORT), PATIENCE) as connection, connection.makefile("rb") as answers:
        connection.sendall(struct.pack(">HBH", 5, ord("V"), 2))
        if answers.read(4) != struct.pack(">HBB", 4, ord("V"), 1):
            raise ConnectionError("it does not speak version 2 of RTDE")


def _await_report(state: ArmState) -> None:
    """Wait for two messages: ur-rtde says that it is connected also where none comes."""
    first, ends = state.getTimestamp(), time.monotonic() + PATIENCE
    while state.getTimestamp() == first:
        if time.monotonic() > ends:
            raise ConnectionError("it sends no data")
        time.sleep(0.01)


def _receive_interface(host: str) -> ArmState:
    from rtde_receive import RTDEReceiveInterface  # pyright: ignore[reportMissingImports]

    return RTDEReceiveInterface(host, -1.0, list(VARIABLES))


def _control_interface(host: str, rate: float) -> ArmControl:
    from rtde_control import RTDEControlInterface  # pyright: ignore[reportMissingImports]

    return RTDEControlInterface(host, rate)


def _disconnect(arms: Sequence[Arm]) -> None:
    """End the programs of ur-rtde and the connections, as far as that goes."""
    for arm in arms:
        for end in (arm.control.stopScript, arm.control.disconnect, arm.state.disconnect):
            try:
                end()
            except raised():
                continue
