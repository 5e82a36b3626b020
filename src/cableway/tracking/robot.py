"""What the loop checks of the robot's messages: that they are new, and that the grippers follow their commands."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from cableway.control.limits import ROUNDING, limited
from cableway.core.quantities import quantity
from cableway.estimation.delay import DELAYS, LONGEST_DELAY, DelayEstimator
from cableway.estimation.gating import poses_usable
from cableway.geometry.groups import SE2
from cableway.records import Observation
from cableway.scene.task import Grippers
from cableway.tracking.first_motion import FirstMotion
from cableway.tracking.setup import BENT, OFF, ends_off, off_grippers

FROZEN = 0.002
"""Way [m] of a gripper during which a frame that stays the same bit for bit is taken for frozen."""

FOLLOWING_ERROR = (0.015, 0.15)
"""Distance [m] and turn [rad] of a gripper from its command, as of the delay it follows with, beyond which it does not
follow: a step and a half at most at the default limits."""

SHORT = 0.004
"""The same distance [m] from which it may be that it does not follow."""

SUSPICIONS = 2
"""Control steps in a row in which that is so before it counts."""

HOLD = 0.5
"""Time [s] for which the grippers then stand where they are before the run goes on."""

MOVED = (FROZEN, FROZEN * FOLLOWING_ERROR[1] / FOLLOWING_ERROR[0])
"""Way [m] and turn [rad] beyond which a gripper has moved."""

HOLDS = 6
"""Such holds without a sign between them that the gripper follows, after which the robot has failed."""

FIRST_HOLDS = 1
"""The same of a gripper that has not moved at all since the start: most likely it is not enabled."""

TRIAL = 0.006
"""Way [m] that the gripper then goes alone, to show that it follows: what is `SHORT` of it is noticed."""

REMEMBERED = 50
"""Control steps for which it is known where the grippers were."""

ARRIVED = 1e-4
"""Distance [m] of the command from the end of that way from which it is there."""

SILENT_ROBOT, SILENT_CAMERA = 1.0, 5.0
"""Time [s] without new gripper poses, and without a new frame, after which a run ends: in real time always, otherwise
where none has come since the start. The grippers stand still before that: after 0.3 s and 1 s with the default
controller."""


SEEN_LATE = 2 * LONGEST_DELAY
"""Control steps by which a frame may be late that is compared with the grippers: frames may be rarer than messages."""


class MessageGate:
    """Takes away what a message only repeats.

    A message whose time is not after that of the message before it tells nothing, and a frame that is the same bit for
    bit while a gripper moved by more than `FROZEN` was not taken anew. A clock that jumps back costs one message.
    """

    def __init__(self) -> None:
        self._time = -np.inf
        self._frame: np.ndarray | None = None
        self._poses: np.ndarray | None = None

    def accepted(self, message: Observation) -> Observation:
        """The message without what is stale: NaN in its place."""
        fresh, self._time = message.time > self._time, message.time
        if not fresh:
            nothing = np.full_like(message.keypoints, np.nan, dtype=float)
            return replace(message, keypoints=nothing, poses=np.full((2, SE2.size), np.nan))
        if not poses_usable(message) or not np.isfinite(message.keypoints).any():
            return message
        if self._frame is None or not np.array_equal(message.keypoints, self._frame, equal_nan=True):
            self._frame, self._poses = np.array(message.keypoints), np.array(message.poses)
            return message
        way = SE2.distance(np.asarray(self._poses), message.poses)[0].max()
        return replace(message, keypoints=np.full_like(self._frame, np.nan)) if way > FROZEN else message


UNSEEN = "the camera has not seen the cable"


class Silence:
    """Notes when gripper poses and keypoints came that tell something."""

    def __init__(self) -> None:
        self._last: dict[str, float] = {}
        self._limits = {"the robot has reported no new gripper poses": SILENT_ROBOT, UNSEEN: SILENT_CAMERA}
        self._start: np.ndarray | None = None
        self._begun, self._moved = 0.0, False

    def noted(self, observation: Observation, time: float) -> None:
        """An observation came, `time` [s] after the start."""
        posed = poses_usable(observation)
        if posed and not self._moved:
            self._start = observation.poses if self._start is None else self._start
            self._moved = bool(_elsewhere(observation.poses, self._start).any())
            if self._moved and self._last.pop(UNSEEN, None) is not None:  # only now does it show what was frozen
                self._begun = time
        came = (posed, bool(np.isfinite(observation.keypoints).any()))
        self._last |= {what: time for what, news in zip(self._limits, came, strict=True) if news}

    def lasting(self, time: float, never: bool = False) -> str:
        """What has been missing for too long, in a sentence; "" for nothing.

        Args:
            time: [s] since the start.
            never: Whether only that counts which has not come once, or not once since the grippers began to move.
        """
        for what, limit in self._limits.items():
            silent = time - self._last.get(what, self._begun)
            if silent >= limit - ROUNDING and not (never and what in self._last):
                return f"{what} for {silent:.3g} s"
        return ""


class Attachment:
    """Sees that the cable's ends are not where the grippers are said to be: one of the two reports is wrong.

    An end must be more than `OFF`, or turned by more than `BENT`, from every pose of its gripper in the last
    `SEEN_LATE` control steps, in every frame that shows it, for `SILENT_ROBOT`.

    Args:
        control_step: Time [s] between two observations.
    """

    def __init__(self, control_step: float) -> None:
        self._most = round(SILENT_ROBOT / control_step)
        self._poses: deque[np.ndarray] = deque(maxlen=SEEN_LATE + 1)
        self._off = np.zeros(2, int)

    def lost(self, observation: Observation, reference: Float[np.ndarray, "n 2"]) -> str:
        """A sentence on the end that is elsewhere, after an observation; "" for none.

        Args:
            observation: The newest one.
            reference: (n, 2) where the keypoints should be [m].
        """
        if poses_usable(observation):
            self._poses.append(observation.poses)
        if not self._poses:
            return ""
        apart, turned = ends_off(observation.keypoints, np.array(self._poses), reference)
        shown = np.isfinite(apart)
        self._off = np.where(shown, np.where((apart > OFF) | (turned > BENT), self._off + 1, 0), self._off)
        lasting = shown & (self._off >= self._most)
        return off_grippers(np.where(lasting, apart, np.nan), np.where(lasting, turned, np.nan))


class FollowingError:
    """Sees that a gripper does not follow its commands: it stalled, was stopped, or the link is dead.

    Then both hold: where they stand becomes the target. After that the gripper that did not follow goes alone: a little
    back the way it came, and a little of what it missed ahead of where it stood. The other one goes back first, as it
    came, where they would be farther apart than they have been. The run goes on when the gripper is seen to follow, and
    the next hold begins if it does not. One that follows back but not ahead has something in its way.

    Attributes:
        target: Where they were sent [m, m, rad].
        poses: Where they were when that was last reported.
        short: Whether a gripper was short of its command by more than `SHORT` then.
        failed: Whether there is no use in going on: a gripper did not follow again and again, has not moved at all, or
            goes elsewhere than it is sent.
        error: What is wrong, in a sentence.
        obstructed: The gripper, 0 or 1, that has something in its way; None for none.
        came_from: Where the grippers were, before the last hold, when the one that did not follow was last `TRIAL` from
            where it stands; None for nowhere.

    Args:
        poses: Where the grippers stand [m, m, rad].
        control_step: Time [s] between two commands.
    """

    def __init__(self, poses: Float[np.ndarray, "2 3"], control_step: float) -> None:
        self.target = np.array(poses, float)
        self._commands = DelayEstimator.constant(self.target)
        self.poses = self._rest = self.target
        self.short = False
        self._hold = round(HOLD / control_step)
        self._suspicions, self._holding, self._holds, self._behind = 0, 0, 0, 0
        self._missed: Float[np.ndarray, "2 3"] | None = None
        self._late, self._tried, self._answered = 0, 0, 0
        self._ends: list[Float[np.ndarray, "2 3"]] = []
        self._past, self._widest = deque[np.ndarray](maxlen=REMEMBERED), 0.0
        self.came_from: Float[np.ndarray, "2 3"] | None = None
        self.obstructed: int | None = None
        self._start, self._moved = self.target, np.zeros(2, bool)
        self._motion = FirstMotion(self.target)
        self.error, self.failed = "", False

    def commanded(self, action: Float[np.ndarray, "2 3"]) -> None:
        """A motion was sent."""
        self.target = SE2.plus(self.target, action)
        self._commands = self._commands.appended(self.target)
        self._motion.commanded(self.target)

    def measured(self, observation: Observation) -> None:
        """Gripper poses came, or none that can be used."""
        self._holding = max(0, self._holding - 1)
        if not poses_usable(observation):
            return
        self.poses = SE2.continued(observation.poses, self.poses)
        self._moved |= _elsewhere(self.poses, self._start)
        if self._missed is None:
            self._past.append(self.poses)
        self._widest = max(self._widest, _span(self.poses))
        if self._missed is None and not self.short and _elsewhere(self.poses, self._rest)[self._late]:
            self._holds = 0
        if mistake := self._motion.mistake(self.poses):
            self.error, self.failed = mistake, True
        away, turned = SE2.distance(self.poses, self._commands.delayed)
        self.short = bool((away > SHORT).any())
        apart = np.linalg.norm(SE2.position(SE2.minus(self._commands.at(DELAYS), self.poses)), axis=-1)
        # distances added up, not squares: no delay makes up for one gripper of two that stands still
        self._commands = self._commands.updated(apart.sum(axis=1) ** 2)
        self._behind = self._behind + 1 if self.short else 0
        self._try()
        worst = int(np.argmax(np.maximum(away / FOLLOWING_ERROR[0], turned / FOLLOWING_ERROR[1])))
        lost = away[worst] > FOLLOWING_ERROR[0] or turned[worst] > FOLLOWING_ERROR[1]
        lost = lost or max(self._behind, self._tried) > LONGEST_DELAY
        self._suspicions = self._suspicions + 1 if lost else 0
        if len(self._ends) == 1 and self._answered and self._tried > self._answered + SUSPICIONS:
            self.obstructed, self._suspicions = self._late, 0
        if self._suspicions >= SUSPICIONS and not self._holding and not self.failed:
            self._begin_hold(worst, f"{quantity(away[worst])} and {quantity(turned[worst], 'rad')}")

    def _begin_hold(self, worst: int, off: str) -> None:
        """Make where the grippers are the target for a while; the robot has failed where that is of no use."""
        self.error = f"the {('left', 'right')[worst]} gripper does not follow its commands: it is off by {off}"
        if not self._moved[worst]:
            self.error += " and has not moved since the start"
        self._missed = self.target if self._missed is None else self._missed
        self._late, self._tried, self._answered = worst, 0, 0
        self._holds, self._holding = self._holds + 1, self._hold
        self.failed = self._holds > (HOLDS if self._moved[worst] else FIRST_HOLDS)
        self._suspicions, self._behind = 0, 0
        self._rest = self.poses
        apart = (past for past in reversed(self._past) if SE2.distance(past, self._rest)[0][worst] > TRIAL)
        self.came_from = next(apart, None)
        self._ends = self._trials(self._missed)
        self._commands = DelayEstimator.constant(self.target)

    @property
    def holding(self) -> bool:
        """Whether the grippers are to stand where they are."""
        return self._holding > 0

    @property
    def on_trial(self) -> bool:
        """Whether, after a hold, the gripper that did not follow has yet to show that it does, see `trial`."""
        return self._missed is not None and not self._holding

    def trial(self, grippers: Grippers) -> Float[np.ndarray, "2 3"]:
        """The next motion [m, m, rad] of a trial, within the grippers' limits."""
        if not self._ends:
            return np.zeros((2, SE2.dof))
        self._tried = max(self._tried, 1)
        return self.towards(self._ends[0], grippers)

    @property
    def ahead(self) -> Float[np.ndarray, "2"]:
        """Unit vector from where the gripper that did not follow stood to where it was sent."""
        way = SE2.position(SE2.minus(self.target if self._missed is None else self._missed, self._rest))[self._late]
        return way / max(float(np.linalg.norm(way)), 1e-12)

    def _trials(self, missed: Float[np.ndarray, "2 3"]) -> list[Float[np.ndarray, "2 3"]]:
        """Where the grippers are sent one after the other [m, m, rad], to see whether the late one follows."""
        rest, late, ahead = self._rest, self._late, _part(self._rest, missed, self._late)
        if self.came_from is None:
            return [_one(rest, ahead, late)]
        before = _part(rest, self.came_from, late)
        back = _one(rest, before, late)
        if _span(back) <= self._widest:
            return [back, _one(back, ahead, late)]
        return [_one(rest, before, 1 - late), before, _one(before, ahead, late)]

    def _try(self) -> None:
        """One message later: the gripper follows, or has had one more to do so."""
        if not self._tried:
            return
        away, turned = SE2.distance(self.poses, self.target)
        sent = (SE2.distance(self._ends[0], self.target)[0] < ARRIVED).all() or self._tried > SUSPICIONS
        if not sent or away[self._late] > TRIAL / 2 or turned[self._late] > FOLLOWING_ERROR[1] / 2:
            self._tried += 1
            return
        went_back = SE2.distance(self.poses, self._rest)[0][self._late] > TRIAL / 2  # not if the last filter kept it
        self._ends, self._answered, self._tried = self._ends[1:], self._tried if went_back else 0, 0
        if not self._ends:
            self._missed, self._answered, self._holds = None, 0, 0

    def forget(self) -> None:
        """Nothing is held or tried any more."""
        self.obstructed, self._missed, self._ends = None, None, []
        self._tried, self._answered, self._holding, self._behind = 0, 0, 0, 0

    def stop(self, grippers: Grippers, anew: bool = False) -> Float[np.ndarray, "2 3"]:
        """The motion [m, m, rad] that makes the measured poses the target, within the grippers' limits.

        They are those measured when the hold began: grippers that are measured late would be sent to and fro otherwise.

        Args:
            grippers: The limits.
            anew: Whether a hold begins now.
        """
        if anew:
            self._rest, self._missed, self._ends = self.poses, None, []
        return self.towards(self._rest, grippers)

    def towards(self, poses: Float[np.ndarray, "2 3"], grippers: Grippers) -> Float[np.ndarray, "2 3"]:
        """The motion [m, m, rad] from the target towards other poses, within the grippers' limits."""
        return limited(SE2.minus(poses, self.target), grippers.max_step, grippers.max_turn)


def _elsewhere(poses: Float[np.ndarray, "2 3"], before: Float[np.ndarray, "2 3"]) -> np.ndarray:
    """Which grippers have moved."""
    moves, turns = SE2.distance(poses, before)
    return (moves > MOVED[0]) | (turns > MOVED[1])


def _one(poses: Float[np.ndarray, "2 3"], others: Float[np.ndarray, "2 3"], side: int) -> Float[np.ndarray, "2 3"]:
    """The same poses but of one gripper."""
    return np.where(np.arange(2)[:, None] == side, others, poses)


def _part(poses: Float[np.ndarray, "2 3"], others: Float[np.ndarray, "2 3"], side: int) -> Float[np.ndarray, "2 3"]:
    """Poses on the way to others, of which one gripper has gone `TRIAL`, or all if that is less."""
    way = SE2.minus(others, poses)
    return SE2.plus(poses, min(1.0, TRIAL / max(float(np.linalg.norm(SE2.position(way)[side])), TRIAL)) * way)


def _span(poses: Float[np.ndarray, "2 3"]) -> float:
    """Distance [m] between the grippers."""
    return float(np.linalg.norm(np.subtract(*SE2.position(poses))))
