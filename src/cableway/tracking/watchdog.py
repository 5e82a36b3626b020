"""What the loop does when a controller answers too late, fails, or answers with what is no motion.

Such an answer is dropped, and with it the controller's new state. In its place the grippers go half as far as in the
control step before, in the same directions: a cable that is led at a steady pace is not jerked to a stop by one missed
step, and grippers that coast so come to rest within one more step of their own, however often it happens. They do so
only where that is safe, as far as can be judged without the controller: they may not come farther apart, nor nearer to
each other than the task allows; and with the cable moved as its nominal rod would be (`motion_jacobian`), neither cable
nor grippers may come nearer to an obstacle than a margin, unless they are nearer already and it leads them away. Where
the cable was not fully observed, nothing is moved. After a few such steps in a row the grippers stand still until the
controller answers again; where it does not for long, the run ends.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.control.base import Controller, ControllerState, Status
from cableway.control.limits import within_limits
from cableway.core.checks import Checked, NotNegative, Positive
from cableway.core.errors import ControlError, raised, said
from cableway.estimation.gating import FAR, poses_usable
from cableway.geometry.groups import SE2
from cableway.motion.validity import gripper_spans
from cableway.outcome import Outcome
from cableway.records import Observation
from cableway.rod.inverse import fit_keypoints, motion_jacobian
from cableway.scene.clearance import clearances
from cableway.scene.task import Task
from cableway.tracking.stopping import Ending
from cableway.tracking.thinking import AtOnce, InThread, Late

COASTING = 2
"""Missed steps in a row in which the grippers may still move."""

COASTED = 0.5
"""Share of the previous motion with which a missed step coasts."""

Hold = Callable[[bool], Float[np.ndarray, "2 3"]]
"""Makes a motion, see `Guard.step`."""

Filter = Callable[[Float[np.ndarray, "2 3"]], Float[np.ndarray, "2 3"]]
"""What of an action [m, m, rad] may leave for the plant, see `last_filter`."""

CUT = "; cut to the limits"
"""How the status of a step ends in which the controller asked for more than the grippers' limits."""


@dataclass(frozen=True, kw_only=True)
class Watchdog(Checked):
    """When a controller's step counts as missed, and for how long that is tolerated.

    Attributes:
        deadline: Wall time [s] after which a step counts as late; never where None. A simulated plant waits, and a run
            with a deadline is not the same twice, so there is none by default.
        margin: Clearance [m] of cable and gripper discs down to which the grippers may still move.
        patience: Time [s] of missed steps in a row after which the run ends.
        threaded: Whether the controller computes in a thread of its own, so that a step that hangs is missed at its
            deadline: for a plant that does not wait. Missed steps then hold instead of coasting.
        clock: Returns wall time [s].

    Raises:
        InputError: A value is out of range.
    """

    deadline: Positive[float] | None = None
    margin: NotNegative[float] = 0.005
    patience: NotNegative[float] = 3.0
    threaded: bool = False
    clock: Callable[[], float] = time.perf_counter


@dataclass(frozen=True)
class Answer:
    """What is done in a control step.

    Attributes:
        action: (2, 3) gripper motion [m, m, rad].
        state: Of the controller, after it.
        status: How it came about.
        seconds: Wall time [s] that the controller took.
    """

    action: Float[np.ndarray, "2 3"]
    state: ControllerState
    status: str
    seconds: float


class Guard:
    """Asks a controller, and answers in its place where it must.

    Args:
        watchdog: When it must.
        controller: Who is asked.
        task: Scene and limits; another one may be put in its place.
        control_step: Time [s] between two steps.
    """

    def __init__(self, watchdog: Watchdog, controller: Controller[Any], task: Task, control_step: float) -> None:
        self._watchdog, self._controller, self.task = watchdog, controller, task
        self.thinker = InThread() if watchdog.threaded else AtOnce()
        self._most = max(1, math.ceil(watchdog.patience / control_step))
        self._missed = 0
        self._late, self._failed, self._cut, self._fallback = 0, 0, 0, 0
        self._reason: str | None = None
        clearances(task.start[None], np.zeros((1, *task.cable.rod.end_shape)), task)  # compiles what it needs

    @property
    def outcome(self) -> Ending | None:
        """How the run ended, if the controller ended it."""
        if self._missed < self._most:
            return None
        reason = self._reason or ("its computation failed" if self._fallback else "all of them were late")
        return Ending(Outcome.CONTROLLER_FAILED, f"{self._missed} steps in a row were missed; {reason}")

    def record(self) -> dict[str, Any]:
        """Plain data on what was missed."""
        return {
            "deadline": self._watchdog.deadline,
            "late": self._late,
            "failed": self._failed,
            "cut": self._cut,
            "fallback": self._fallback,
            "reason": self._reason,
        }

    def step(
        self,
        state: ControllerState,
        observation: Observation,
        before: Float[np.ndarray, "2 3"],
        filtered: Filter,
        hold: Hold = lambda anew: np.zeros((2, SE2.dof)),
    ) -> Answer:
        """One control step: a motion that has passed the last filter whatever the controller does, or a stop.

        Args:
            state: Of the controller, before it.
            observation: The newest one.
            before: (2, 3) what was sent in the control step before [m, m, rad].
            filtered: The last filter.
            hold: Returns (2, 3) the motion that makes the measured poses the target [m, m, rad]; told whether those
                measured now, or those at the last call that was told so.
        """
        begun, deadline = self._watchdog.clock(), self._watchdog.deadline
        try:
            step = self.thinker.answer(lambda: self._controller.step(state, observation), deadline)
            action, after = _usable(*step)
        except Late:
            self._late += 1
            return self._holding(state, hold, self._watchdog.clock() - begun)
        except raised() as error:  # whatever it is, the grippers need a command
            self._failed += 1
            self._reason = self._reason or f"the first failed with {said(error)}"
            return self._missing("failed", state, observation, before, filtered, self._watchdog.clock() - begun)
        seconds = self._watchdog.clock() - begun
        if deadline is not None and seconds > deadline:
            self._late += 1
            return self._missing("late", state, observation, before, filtered, seconds)
        unanswered = after.status in (Status.FAILED, Status.UNEXPLAINED)
        self._missed = self._missed + 1 if unanswered else 0
        if after.status == Status.UNEXPLAINED:
            self._reason = "no cable of the model can be held as the grippers hold it"
        self._fallback += after.status == Status.FAILED
        sent = filtered(action)
        if np.array_equal(sent, action):
            return Answer(action, after, str(after.status), seconds)
        self._cut += 1
        return Answer(sent, after.cut(sent, _made(sent, action)), f"{after.status}{CUT}", seconds)

    def _missing(
        self, why: str, state: ControllerState, observation: Observation, before: np.ndarray, filtered: Filter,
        seconds: float,
    ) -> Answer:  # fmt: skip
        """What is done in place of a missed step."""
        self._missed += 1
        action = np.zeros(self.task.cable.rod.step_shape)
        if self._missed <= COASTING and poses_usable(observation):
            coasted = filtered(within_limits(COASTED * before, observation.poses, self.task.grippers, max_span=0.0))
            action = coasted if self._sees(observation) and self.is_safe(coasted, observation) else action
        status = f"{why}: {'coasting' if action.any() else 'stopped'}"
        return Answer(action, state.overruled(action, status), status, seconds)

    def _holding(self, state: ControllerState, hold: Hold, seconds: float) -> Answer:
        """What is done while the controller still computes: the motion under way is finished, then nothing moves."""
        self._missed += 1
        finishing = self._missed == 1
        action = np.zeros(self.task.cable.rod.step_shape) if finishing else hold(self._missed == 2)
        status = f"late: {'finishing' if finishing else 'holding'}"
        return Answer(action, state.overruled(action, status, waits=True), status, seconds)

    def _sees(self, observation: Observation) -> bool:
        """Whether all of the cable was observed."""
        keypoints = observation.keypoints
        return np.shape(keypoints) == self.task.start.shape and bool(np.isfinite(keypoints).all())

    def is_safe(self, action: Float[np.ndarray, "2 3"], observation: Observation, margin: float | None = None) -> bool:
        """Whether an action leads neither cable nor grippers nearer to anything than they may, as far as is seen.

        Args:
            action: (2, 3) what would be sent [m, m, rad].
            observation: The newest one.
            margin: Clearance [m] down to which they may come; that of the watchdog where None.
        """
        poses, keypoints = observation.poses, observation.keypoints
        if not (self._sees(observation) and poses_usable(observation)):
            return True
        rod = self.task.cable.rod
        moves = motion_jacobian(rod, fit_keypoints(rod, keypoints)[0]) @ action.ravel()
        moved = keypoints + moves.reshape(keypoints.shape)
        ends = np.stack([poses, SE2.plus(poses, action)])
        now, then = clearances(np.stack([keypoints, moved]), ends, self.task)
        span, span_after = gripper_spans(ends)
        apart = span_after >= min(self.task.grippers.least_span, span)
        kept = self._watchdog.margin if margin is None else margin
        return bool(apart) and bool((then >= np.minimum(kept, now)).all())


def _made(sent: Float[np.ndarray, "2 3"], action: Float[np.ndarray, "2 3"]) -> float:
    """Share of an action's way that is made by what was sent in its place; all of one that only turns."""
    made, wanted = SE2.position(sent), SE2.position(action)
    return float(np.clip(np.sum(made * wanted) / np.sum(wanted**2), 0.0, 1.0)) if wanted.any() else 1.0


def _usable(action: Any, state: ControllerState) -> tuple[Float[np.ndarray, "2 3"], ControllerState]:
    """A controller's answer, if it is one.

    Raises:
        ControlError: It is not.
    """
    if np.shape(action) != (2, SE2.dof) or not (np.abs(action) < FAR).all():
        raise ControlError(f"the action must be 2 x 3 numbers below {FAR:g}, got {np.asarray(action).tolist()!r:.200}")
    if not (np.isfinite(state.reference).all() and math.isfinite(state.progress)):
        raise ControlError("the state's reference or progress is not finite")
    return np.asarray(action, float), state
