"""What a controller makes of the observations, whatever comes: where the grippers are and what is still under way."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from cableway.estimation.delay import AGES, Age
from cableway.estimation.gating import believed_keypoints
from cableway.geometry.groups import SE2
from cableway.records import Observation
from cableway.scene.cable import Cable
from cableway.scene.task import CONTROL_STEP

HELD_AS_BELIEVED = np.zeros((2, 3))
"""Grasps without any offset."""

TURN_LEVER = 0.1
"""Motion [m] that a turn of 1 rad counts as."""


@dataclass(frozen=True)
class Sight:
    """What is known of the grippers and of the delays.

    Attributes:
        poses: Gripper poses [m, m, rad] at the last control steps, angles running on; their age is that of the
            keypoints.
        sent: Gripper motions sent; their age is the time until the grippers begin them.
        keypoints: (n, 2) [m] as last believed, NaN where none.
        unseen: Control steps since the last keypoint that was believed.
        blind: Control steps since the last gripper poses that were usable.
        started: Whether the grippers were seen yet.
        confidence: (n,) by which each keypoint counts; None where all count the same.
    """

    poses: Age
    sent: Age
    keypoints: Float[np.ndarray, "n 2"]
    unseen: int = 0
    blind: int = 0
    started: bool = False
    confidence: Float[np.ndarray, "n"] | None = None

    @classmethod
    def before(cls, poses: Float[np.ndarray, "2 3"], keypoints: int) -> Sight:
        """Before the first observation, with grippers that stand at `poses`."""
        return cls(Age.of(poses), Age.of(np.zeros((2, 3))), np.full((keypoints, 2), np.nan))

    @property
    def then(self) -> Float[np.ndarray, "2 3"]:
        """Gripper poses when the keypoints were seen."""
        return self.poses.row

    @property
    def speed(self) -> float:
        """Of the faster gripper then [m per control step]."""
        before = self.poses.aged(np.float64(self.poses.value + 1))
        return float(np.linalg.norm((self.then - before)[:, :2], axis=1).max())

    @property
    def commanded(self) -> Float[np.ndarray, "2 3"]:
        """Where the grippers will be when all that was sent is done."""
        return self.poses.rows[-1] + self.sent.newer

    @property
    def way(self) -> Float[np.ndarray, "k 2 3"]:
        """Gripper poses from `then` to `commanded`, both included, at most one control step apart."""
        since, pending = math.ceil(self.poses.value), math.ceil(self.sent.value)
        passed = self.poses.rows[len(self.poses.rows) - since :]
        shares = np.ones(pending)
        if pending:
            shares[0] = 1 - (pending - self.sent.value)
        motions = shares[:, None, None] * self.sent.rows[len(self.sent.rows) - pending :]
        to_come = self.poses.rows[-1] + np.cumsum(motions, axis=0)
        return np.concatenate([self.then[None], passed, to_come])

    def after(self, observation: Observation, grasps: Float[np.ndarray, "2 3"], cable: Cable) -> Sight:
        """With one more observation, whose gripper poses are usable.

        Args:
            observation: What was seen.
            grasps: Where the cable is believed to be in the grippers, see `rod.adapted`.
            cable: What is held.
        """
        if not self.started:
            return replace(self, poses=Age.of(observation.poses), started=True).after(observation, grasps, cable)
        last = self.poses.rows[-1]
        step = SE2.minus(observation.poses, last)
        unlike = np.moveaxis(self.sent.aged(AGES) - step, 0, -1)
        unlike[:, 2] *= TURN_LEVER
        sent = self.sent.judged(np.sum(unlike**2, axis=(0, 1)))
        poses = self.poses.with_row(last + step)
        if observation.taken is not None:
            poses = poses.known((observation.time - observation.taken) / CONTROL_STEP)
        keypoints = believed_keypoints(observation.keypoints, poses.row, cable)
        if observation.confidence is not None:
            keypoints = np.where(observation.confidence[:, None] > 0, keypoints, np.nan)
        shown = np.isfinite(keypoints[[0, -1], 0])
        if shown.any() and observation.taken is None:
            ends = SE2.compose(poses.aged(AGES), grasps)[..., :2]
            poses = poses.judged(np.sum((ends - keypoints[[0, -1]])[:, shown] ** 2, axis=(1, 2)))
        unseen = 0 if np.isfinite(keypoints).any() else self.unseen + 1
        return Sight(poses, sent, keypoints, unseen, started=True, confidence=observation.confidence)

    def blindly(self) -> Sight:
        """After an observation that told nothing: the grippers are taken to do what they were sent."""
        poses = self.poses.with_row(self.poses.rows[-1] + self.sent.row)
        nothing = np.full_like(self.keypoints, np.nan)
        return replace(self, poses=poses, keypoints=nothing, unseen=self.unseen + 1, blind=self.blind + 1)

    def sending(self, action: Float[np.ndarray, "2 3"]) -> Sight:
        """With an action sent."""
        return replace(self, sent=self.sent.with_row(action))
