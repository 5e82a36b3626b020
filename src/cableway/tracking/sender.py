"""Sends gripper poses at the rate of a robot, from a thread and a clock of its own, whatever the rest of a run does.

A command is a motion over one control step, which is sent as poses between its ends. Where no further one has come when
it is over, the grippers hold still where they were measured; where none comes for long, the robot is stopped for good.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float

from cableway.core.errors import CablewayError, SimulationError, raised, said
from cableway.estimation.gating import poses_usable
from cableway.geometry.groups import SE2
from cableway.motion.time_parametrization import gripper_effort
from cableway.records import Observation
from cableway.scene.task import Grippers, Task
from cableway.tracking.answers import usable_observation

LATE = 1.5
"""Period, in units of the wanted one, from which on a command counts as late."""

ABANDONED = 3.0
"""Time [s] without a motion from the run after which the robot is stopped for good."""

RATES = (1.0, 1000.0)
"""[Hz] that can be asked for; 10 to 125 Hz is usual, and Python keeps no more than some hundreds."""


class Robot(Protocol):
    """Two grippers and a camera, as they are driven in real time; nothing is inherited.

    Units, frames and order are those of `docs/conventions.md`. `send` and `observe` are called in turn at the robot's
    rate, from one thread; neither may wait longer than a fraction of a period. Both may raise any error; the run then
    ends, and `stop` is called.
    """

    @property
    def task(self) -> Task:
        """As for `tracking.plant.Plant`."""
        ...

    def send(self, poses: Float[np.ndarray, "2 3"]) -> None:
        """Make these poses (x, y, theta) [m, m, rad] of the left and the right gripper the target, from now on."""
        ...

    def observe(self) -> Observation:
        """The newest that is known; `time` [s] is that of the robot's message and differs from message to message.

        Keypoints are NaN where the camera has nothing new. Angles may be off by whole turns.
        """
        ...

    def stop(self) -> None:
        """Come to rest at once and stay there. The run is over; it may be called more than once, from any thread."""
        ...


@dataclass(frozen=True)
class _Motion:
    """From one pair of gripper poses to another, from a time [s] on, for so long [s]."""

    begin: float
    length: float
    start: Float[np.ndarray, "2 3"]
    end: Float[np.ndarray, "2 3"]

    def at(self, now: float) -> Float[np.ndarray, "2 3"]:
        return SE2.between(self.start, self.end, min(max((now - self.begin) / self.length, 0.0), 1.0))


class Sender:
    """Sends to a robot until it is closed.

    Args:
        robot: Who takes the commands.
        rate: Commands a second [Hz].
        control_step: Time [s] that a motion takes.
        first: Observation with which the run begins; the grippers stay there until there is a motion.
        clock: [s].
    """

    def __init__(
        self, robot: Robot, rate: float, control_step: float, first: Observation, clock: Callable[[], float]
    ) -> None:
        self._robot, self._period, self._step, self._clock = robot, 1.0 / rate, control_step, clock
        self._lock, self._closed = threading.Lock(), threading.Event()
        now, start = clock(), np.array(first.poses, float)
        self._motion = self._before = _Motion(now, control_step, start, start)
        self._given = self.alive = self.posed = self.seen = now
        self._holding, self._newest, self._news = True, first, first
        self.error = ""
        self.sent: list[float] = []
        self._thread = threading.Thread(target=self._run, name="cableway sender", daemon=True)
        self._thread.start()

    def move(self, target: Float[np.ndarray, "2 3"], begin: float) -> None:
        """Go to poses, from a time [s] on, in one control step, or as much longer as the limits ask for."""
        with self._lock:
            start, self._before = self._at(begin), self._motion
            self._motion = _Motion(begin, self._step * _steps(start, target, self._robot.task.grippers), start, target)
            self._given, self._holding = begin, False

    def news(self) -> Observation:
        """What was observed since the last call; NaN in place of what was not."""
        with self._lock:
            news, self._news = self._news, _nothing(self._newest)
            return replace(news, time=self._newest.time)

    def close(self) -> None:
        """End the thread and stop the robot."""
        self._closed.set()
        self._thread.join(1.0)
        self._robot.stop()

    def _run(self) -> None:
        due = self._clock()
        try:
            while not self._closed.is_set():
                self._tick(self._clock())
                due += self._period
                due += self._period * max(0, math.floor((self._clock() - due) / self._period))  # skips what is over
                self._closed.wait(max(0.0, due - self._clock()))
        except CablewayError as error:
            self._fail(str(error))
        except raised() as error:
            self._fail(f"the robot's driver failed with {said(error)}")

    def _tick(self, now: float) -> None:
        with self._lock:
            if now > self._given + self._step + ABANDONED:
                raise SimulationError(f"no motion came for {ABANDONED:g} s")
            if not self._holding and now > self._motion.begin + self._motion.length + self._step:
                self._hold(now)
            poses = self._at(now)
        self._robot.send(poses)
        self.sent.append(now)
        observation = usable_observation(self._robot.observe(), len(self._newest.keypoints), "the robot's observe")
        with self._lock:
            self.alive = self._clock()
            self._take(observation, self.alive)

    def _at(self, now: float) -> Float[np.ndarray, "2 3"]:
        """What is to be sent at a time [s]; until the newest motion begins, the one before it goes on."""
        return (self._before if now < self._motion.begin else self._motion).at(now)

    def _hold(self, now: float) -> None:
        """Make the measured poses the target, at no more than the grippers' greatest speed."""
        here = self._at(now)
        measured = SE2.continued(self._newest.poses, here) if poses_usable(self._newest) else here
        length = self._step * _steps(here, measured, self._robot.task.grippers)
        self._motion, self._holding = _Motion(now, length, here, measured), True

    def _take(self, observation: Observation, now: float) -> None:
        if observation.time == self._newest.time:
            return
        news = replace(self._news, time=observation.time)
        if poses_usable(observation):
            self.posed, news = now, replace(news, poses=np.array(observation.poses))
        if np.isfinite(observation.keypoints).any():
            self.seen = now
            news = replace(
                news, keypoints=np.array(observation.keypoints), taken=observation.taken,
                confidence=observation.confidence, rod=observation.rod,
            )  # fmt: skip
        self._newest, self._news = observation, news

    def _fail(self, why: str) -> None:
        self.error = why
        try:
            self._robot.stop()
        except raised():
            return  # `close` tries again, and says so where it fails

    def timing(self) -> dict[str, Any]:
        """Plain data on how even the commands came."""
        sent = np.array(self.sent)
        late = int((np.diff(sent) > LATE * self._period).sum())
        return {"rate": 1.0 / self._period, "commands": len(sent), "period": spread(sent), "late": late}


def spread(times: Float[np.ndarray, "k"]) -> dict[str, float] | None:
    """Median, 95th percentile and worst of the periods between times [s]; None where there are none."""
    if len(times) < 2:
        return None
    median, p95, worst = np.percentile(np.diff(times), [50, 95, 100])
    return {"median": float(median), "p95": float(p95), "worst": float(worst)}


def _steps(start: Float[np.ndarray, "2 3"], end: Float[np.ndarray, "2 3"], limits: Grippers) -> float:
    """Control steps that a motion needs, at least one."""
    return max(1.0, float(gripper_effort(np.stack([start, end]), limits.max_step, limits.max_turn)[0]))


def _nothing(like: Observation) -> Observation:
    """An observation of nothing."""
    return Observation(like.time, np.full_like(like.keypoints, np.nan, dtype=float), np.full((2, SE2.size), np.nan))
