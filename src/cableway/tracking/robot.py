"""What the loop checks of the robot's messages: that they are new, and that the grippers follow their commands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from cableway.control.limits import shorten
from cableway.estimation.delay import DELAYS, LONGEST_DELAY, DelayEstimator
from cableway.estimation.gating import poses_usable
from cableway.geometry.groups import SE2
from cableway.records import Observation
from cableway.scene.task import Grippers

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

HOLDS = 6
"""Such holds without a sign between them that the gripper follows, after which the robot has failed."""

TRIAL = 0.006
"""Way [m] that the gripper then goes alone, to show that it follows: what is `SHORT` of it is noticed."""


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


class FollowingError:
    """Sees that a gripper does not follow its commands: it stalled, was stopped, or the link is dead.

    Then both hold: where they stand becomes the target. After that the gripper that did not follow goes a little of
    what it missed, alone; the run goes on when it is seen to follow, and the next hold begins if it does not.

    Attributes:
        target: Where they were sent [m, m, rad].
        poses: Where they were when that was last reported.
        short: Whether a gripper was short of its command by more than `SHORT` then.
        error: What is wrong, in a sentence.

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
        self._late, self._tried = 0, 0
        self.error = ""

    def commanded(self, action: Float[np.ndarray, "2 3"]) -> None:
        """A motion was sent."""
        self.target = SE2.plus(self.target, action)
        self._commands = self._commands.appended(self.target)

    def measured(self, observation: Observation) -> None:
        """Gripper poses came, or none that can be used."""
        self._holding = max(0, self._holding - 1)
        if not poses_usable(observation):
            return
        self.poses = SE2.continued(observation.poses, self.poses)
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
        if self._suspicions >= SUSPICIONS and not self._holding:
            side = ("left", "right")[worst]
            off = f"{1000 * away[worst]:.0f} mm and {turned[worst]:.2f} rad"
            self.error = f"the {side} gripper does not follow its commands: it is off by {off}"
            self._missed = self.target if self._missed is None else self._missed
            self._late, self._tried = worst, 0
            self._holds, self._holding = self._holds + 1, self._hold
            self._suspicions, self._behind = 0, 0
            self._rest = self.poses
            self._commands = DelayEstimator.constant(self.target)

    @property
    def holding(self) -> bool:
        """Whether the grippers are to stand where they are."""
        return self._holding > 0

    @property
    def failed(self) -> bool:
        """Whether one did not follow again and again."""
        return self._holds > HOLDS

    @property
    def on_trial(self) -> bool:
        """Whether, after a hold, the gripper that did not follow has yet to show that it does, see `trial`."""
        return self._missed is not None and not self._holding

    def trial(self, grippers: Grippers) -> Float[np.ndarray, "2 3"]:
        """The next motion [m, m, rad] of that gripper alone, within its limits: `TRIAL` at most, then nothing."""
        motion = np.zeros((2, SE2.dof))
        if self._missed is not None and not self._tried:
            self._tried = 1
            way = self._towards(self._missed, grippers)[self._late]
            motion[self._late] = min(1.0, TRIAL / max(float(np.linalg.norm(way[: SE2.space])), TRIAL)) * way
        return motion

    def _try(self) -> None:
        """One message later: the gripper follows, or has had one more to do so."""
        if not self._tried:
            return
        away, turned = SE2.distance(self.poses, self.target)
        if away[self._late] <= TRIAL / 2 and turned[self._late] <= FOLLOWING_ERROR[1] / 2:
            self._missed, self._tried, self._holds = None, 0, 0
        else:
            self._tried += 1

    def stop(self, grippers: Grippers, anew: bool = False) -> Float[np.ndarray, "2 3"]:
        """The motion [m, m, rad] that makes the measured poses the target, within the grippers' limits.

        They are those measured when the hold began: grippers that are measured late would be sent to and fro otherwise.

        Args:
            grippers: The limits.
            anew: Whether a hold begins now.
        """
        if anew:
            self._rest, self._missed = self.poses, None
        return self._towards(self._rest, grippers)

    def _towards(self, poses: Float[np.ndarray, "2 3"], grippers: Grippers) -> Float[np.ndarray, "2 3"]:
        """The motion [m, m, rad] from the target towards other poses, within the grippers' limits."""
        way = SE2.minus(poses, self.target)
        turns = np.clip(way[:, SE2.space :], -grippers.max_turn, grippers.max_turn)
        return np.column_stack([shorten(SE2.position(way), grippers.max_step), turns])
