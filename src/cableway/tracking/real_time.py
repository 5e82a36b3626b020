"""A run on a robot, in real time.

Three threads share it: the sender's sends poses at the robot's rate; the loop's, which is the caller's, goes once
through the control step of `tracking.loop` in every period of its own clock; the controller's computes. An observation
of time t is answered by t + deadline; the motion that answers it begins at t + `lead` and takes one control step, so
that one motion follows the other without a gap as long as all answers come in time.

Garbage of before is collected before anything moves, and what is left is not looked through again during the run: that
takes 0.1 s with models loaded, and a second more where a driver is disconnected with it, in which no thread runs.

Note:
    This is Python: no thread is certain to run when it should, and compiled code that keeps the interpreter's lock
    stops all of them. A robot needs a time-out of its own.
"""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from types import TracebackType
from typing import Annotated, Any, Self

import numpy as np
from jaxtyping import Float

from cableway.control.base import Controller
from cableway.core.checks import Bounds, require_interface
from cableway.core.errors import InputError, SimulationError, TrackingInterrupted, raised, said
from cableway.estimation.gating import poses_usable
from cableway.geometry.groups import SE2
from cableway.outcome import Outcome
from cableway.records import Measurement, Observation, Plan, Rollout
from cableway.scene.clearance import clearances
from cableway.scene.task import CONTROL_STEP, Task
from cableway.tracking.answers import usable_observation
from cableway.tracking.closed_loop import Progress, track
from cableway.tracking.logbook import OnRow
from cableway.tracking.recovering import Recovery
from cableway.tracking.robot import SILENT_CAMERA, SILENT_ROBOT
from cableway.tracking.sender import RATES, Robot, Sender, spread
from cableway.tracking.stopping import TrackConfig
from cableway.tracking.watchdog import Watchdog

MARGIN = 0.01
"""Time [s] between the deadline of an answer and the begin of its motion, for the filter and the loop."""

SWITCHING = 5e-4
"""Time [s] for which the interpreter lets one thread compute while others wait; by default, 5 ms."""


class RealTimePlant:
    """A robot as a plant of the closed loop, which waits for real time. Use it in a `with` statement.

    Args:
        robot: Who is driven.
        rate: Commands a second [Hz].
        deadline: Time [s] after an observation by which its answer must be there.
        control_step: Time [s] between two observations.

    Raises:
        InputError: The rate is out of range, the deadline leaves no time within a control step, or the robot lacks a
            method.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        rate: Annotated[float, Bounds(*RATES)] = 50.0,
        deadline: float = CONTROL_STEP / 2,
        control_step: float = CONTROL_STEP,
    ) -> None:
        if not RATES[0] <= rate <= RATES[1]:
            raise InputError(f"rate must be from {RATES[0]:g} to {RATES[1]:g} Hz, got {rate!r}")
        if not 0 < deadline < control_step:
            raise InputError(
                f"deadline must be above 0 and below the control step of {control_step:g} s, got {deadline!r}"
            )
        require_interface(robot, "the robot", ("task",), {"send": 1, "observe": 0, "stop": 0})
        self.control_step, self._robot, self._rate = control_step, robot, rate
        self._lead = min(deadline + MARGIN, control_step)
        self._sender: Sender | None = None
        self._steps: list[float] = []
        self._slipped, self._closed = 0, False

    @property
    def task(self) -> Task:
        """See `Plant.task`."""
        return self._robot.task

    def __enter__(self) -> Self:
        self._switching = sys.getswitchinterval()
        sys.setswitchinterval(SWITCHING)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        sys.setswitchinterval(self._switching)
        unstopped = self.close()
        if unstopped and error is None:
            raise SimulationError(unstopped)
        if unstopped and error is not None:
            error.add_note(unstopped)

    def close(self) -> str:
        """Stop the robot for good, the first time; a sentence where it could not be stopped, "" otherwise."""
        if self._closed:
            return ""
        self._closed = True
        try:
            if self._sender is None:
                self._robot.stop()
            else:
                self._sender.close()
        except raised() as error:
            return f"the robot could not be stopped: its stop raised {said(error)}"
        return ""

    def reset(self) -> Observation:
        """See `Plant.reset`: the robot is at the start, and is looked at.

        Raises:
            InputError: It answers with no observation of the cable.
            SimulationError: It does not report where its grippers are.
        """
        try:
            answer = self._robot.observe()
        except raised() as error:
            raise SimulationError(f"the robot's driver failed with {said(error)}") from error
        first = usable_observation(answer, self.task.cable.keypoints, "the robot's observe")
        if not poses_usable(first):
            raise SimulationError("the robot reports no gripper poses")
        self._known, self._poses = np.array(self.task.start, float), np.array(first.poses, float)
        self._target = np.array(first.poses, float)
        self._learn(first)
        self._sender = Sender(self._robot, self._rate, self.control_step, first, time.monotonic)
        self._tick = time.monotonic()
        self._steps = [self._tick]
        return first

    def step(self, action: Float[np.ndarray, "2 3"]) -> Observation:
        """See `Plant.step`: the motion begins `lead` after the observation that it answers.

        Raises:
            SimulationError: The robot or the camera has been silent for too long, or the driver failed.
        """
        sender = self._sender
        assert sender is not None
        self._require_alive(sender)
        begin, now = self._tick + self._lead, time.monotonic()
        if now > begin:  # what is not the controller's took too long, such as making a plan ready to be followed
            self._slipped += 1
            begin, self._tick = now, now - self._lead
        self._target = SE2.plus(self._target, action)
        sender.move(self._target, begin)
        self._tick += self.control_step
        time.sleep(max(0.0, self._tick - time.monotonic()))
        self._steps.append(time.monotonic())
        self._require_alive(sender)
        news = sender.news()
        self._learn(news)
        return news

    def measure(self) -> Measurement:
        """See `Plant.measure`: what was observed last, hidden keypoints carried along by the grippers."""
        found = clearances(self._known[None], self._poses[None], self.task)[0]
        return Measurement(self._known, self._poses, self._known, float(found[0]), float(found[1:3].min()))

    def timing(self) -> dict[str, Any]:
        """Plain data on how evenly commands and control steps came [s, Hz]."""
        sent = {} if self._sender is None else self._sender.timing()
        return {**sent, "control_period": spread(np.array(self._steps)), "slipped": self._slipped}

    def _require_alive(self, sender: Sender) -> None:
        if sender.error:
            raise SimulationError(sender.error)
        silent = {
            "the robot's driver has not returned": (sender.alive, SILENT_ROBOT),
            "the robot has reported no new gripper poses": (sender.posed, SILENT_ROBOT),
            "the camera has not seen the cable": (sender.seen, SILENT_CAMERA),
        }
        now = time.monotonic()
        for what, (last, limit) in silent.items():
            if now - last > limit:
                raise SimulationError(f"{what} for {limit:g} s")

    def _learn(self, observation: Observation) -> None:
        """Keep what is known of the cable; keypoints that were not seen move with the grippers that hold its ends."""
        known, share = self._known, np.linspace(0.0, 1.0, len(self._known))[:, None]
        if poses_usable(observation):
            before, self._poses = self._poses, SE2.continued(observation.poses, self._poses)
            left, right = SE2.position(self._poses) - SE2.position(before)
            known = known + (1 - share) * left + share * right
        if np.shape(observation.keypoints) == known.shape:
            known = np.where(np.isfinite(observation.keypoints), observation.keypoints, known)
        self._known = known


def track_in_real_time(
    robot: Robot,
    controller: Controller[Any],
    plan: Plan,
    *,
    rate: float = 50.0,
    deadline: float = CONTROL_STEP / 2,
    config: TrackConfig | None = None,
    recovery: Recovery | None = None,
    watchdog: Watchdog | None = None,
    progress: Progress | None = None,
    on_row: OnRow | None = None,
    seed: int = 0,
) -> Rollout:
    """Lead a robot along a plan: `track`, with commands at the robot's own rate and the controller in its own thread.

    A controller that is late misses its step: the motion under way is finished, and from the second such step in a row
    the measured gripper poses are the target; after `Watchdog.patience` the run ends. A replanning of a recovery, too,
    goes on in a thread while the grippers stand. However the run ends, also by an error, `Robot.stop` is called.

    Args:
        robot: Who is led; at the start of the plan.
        controller: What leads.
        plan: Shapes and gripper poses to follow.
        rate: Commands a second [Hz], 10 to 125 on usual robots.
        deadline: Wall time [s] that the controller has for a step; it adds to the latency of the robot.
        config: As for `track`.
        recovery: As for `track`.
        watchdog: As for `track`; its `deadline` and `threaded` are not used.
        progress: As for `track`.
        on_row: As for `track`; what it takes is missing to the control step.
        seed: For the record.

    Returns:
        As from `track`; `metadata["timing"]` says how evenly commands and control steps came.

    Raises:
        InputError: As for `track` and `RealTimePlant`.
        SimulationError: The robot does not report where its grippers are.
        TrackingInterrupted: As for `track`.
    """
    watchdog = replace(watchdog or Watchdog(), deadline=deadline, threaded=True)
    plant = RealTimePlant(robot, rate=rate, deadline=deadline, control_step=controller.control_step)
    with _collected(), plant:
        try:
            rollout = track(
                plant, controller, plan, config=config, recovery=recovery, watchdog=watchdog, progress=progress,
                on_row=on_row, seed=seed,
            )  # fmt: skip
        except TrackingInterrupted as stop:
            raise TrackingInterrupted(_timed(stop.rollout, plant)) from None
        unstopped = plant.close()
    if unstopped:
        detail = f"{unstopped}; until then: {rollout.outcome}"
        if rollout.outcome is Outcome.PLANT_FAILED:
            detail = f"{rollout.detail}; {unstopped}"
        rollout = replace(
            rollout, metadata={**rollout.metadata, "outcome": Outcome.PLANT_FAILED.value, "detail": detail}
        )
    return _timed(rollout, plant)


@contextmanager
def _collected() -> Iterator[None]:
    """Collect garbage now, and leave what there is by now out of later collections until the end."""
    gc.collect()
    ours = not gc.get_freeze_count()
    gc.freeze()
    try:
        yield
    finally:
        if ours:
            gc.unfreeze()


def _timed(rollout: Rollout, plant: RealTimePlant) -> Rollout:
    return replace(rollout, metadata={**rollout.metadata, "timing": plant.timing()})
