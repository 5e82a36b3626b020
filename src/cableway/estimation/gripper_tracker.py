"""Gripper tracking: where the grippers were when a frame was taken, and where they will be after all commands."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from cableway.estimation.delay import DELAYS, DelayEstimator
from cableway.estimation.gating import gated_keypoints
from cableway.geometry.groups import SE2
from cableway.records import Observation, RodParameters
from cableway.scene.cable import Cable
from cableway.scene.task import CONTROL_STEP

NOMINAL_GRASPS = np.zeros((2, SE2.size))
"""Grasps without any offset."""

TURN_LEVER = 0.1
"""Motion [m] that a turn of 1 rad counts as."""


@dataclass(frozen=True)
class GripperTracker:
    """The state of the gripper tracker.

    Attributes:
        poses: Measured gripper poses [m, m, rad]; angles run on from those of the plan's start. Its delay is the
            latency of frames.
        commands: Gripper motions sent. Its delay is the actuation latency.
        keypoints: (n, 2) [m] of the last frame, NaN where missing or rejected.
        steps_without_keypoints: Control steps since the last frame with a keypoint.
        steps_without_poses: Control steps since the last usable gripper poses.
        started: Whether gripper poses were measured yet.
        confidence: (n,) by which each keypoint counts; None where all count the same.
        undated: Whether the last frame has keypoints, but neither its time nor an end of the cable.
        rod: What is known of the cable by that frame; see `Observation`.
    """

    poses: DelayEstimator
    commands: DelayEstimator
    keypoints: Float[np.ndarray, "n 2"]
    steps_without_keypoints: int = 0
    steps_without_poses: int = 0
    started: bool = False
    confidence: Float[np.ndarray, "n"] | None = None
    undated: bool = False
    rod: RodParameters | None = None

    @classmethod
    def at_rest(cls, poses: Float[np.ndarray, "2 3"], keypoints: int) -> GripperTracker:
        """Before the first observation, with grippers that stand at `poses`."""
        nothing = np.full((keypoints, SE2.space), np.nan)
        return cls(DelayEstimator.constant(poses), DelayEstimator.constant(np.zeros((2, SE2.dof))), nothing)

    @property
    def at_frame(self) -> Float[np.ndarray, "2 3"]:
        """Gripper poses when the last frame was taken."""
        return self.poses.delayed

    @property
    def speed(self) -> float:
        """Of the faster gripper then [m per control step]."""
        before = self.poses.at(np.float64(self.poses.delay + 1))
        return float(np.linalg.norm(SE2.position(self.at_frame) - SE2.position(before), axis=1).max())

    @property
    def commanded(self) -> Float[np.ndarray, "2 3"]:
        """Gripper poses once all commands are carried out."""
        return SE2.plus(self.poses.history[-1], self.commands.newer)

    @property
    def path(self) -> Float[np.ndarray, "k 2 3"]:
        """Gripper poses from `at_frame` to `commanded`, both included, at most one control step apart."""
        since, pending = math.ceil(self.poses.delay), math.ceil(self.commands.delay)
        passed = self.poses.history[len(self.poses.history) - since :]
        shares = np.ones(pending)
        if pending:
            shares[0] = 1 - (pending - self.commands.delay)
        motions = shares[:, None, None] * self.commands.history[len(self.commands.history) - pending :]
        to_come = SE2.plus(self.poses.history[-1], np.cumsum(motions, axis=0))
        return np.concatenate([self.at_frame[None], passed, to_come])

    def updated(
        self, observation: Observation, grasps: Float[np.ndarray, "2 3"], cable: Cable, hidden: bool = False
    ) -> GripperTracker:
        """After an observation whose gripper poses are usable.

        Args:
            observation: What was measured.
            grasps: Estimated poses of the cable's ends in the gripper frames, see `rod.material`.
            cable: The nominal cable.
            hidden: Whether few keypoints are enough, see `gated_keypoints`.
        """
        if not self.started:
            measured = SE2.continued(observation.poses, self.poses.history[-1])
            started = replace(self, poses=DelayEstimator.constant(measured), started=True)
            return started.updated(observation, grasps, cable, hidden)
        last = self.poses.history[-1]
        step = SE2.minus(observation.poses, last)
        differences = np.moveaxis(self.commands.at(DELAYS) - step, 0, -1)
        differences[:, SE2.space :] *= TURN_LEVER
        commands = self.commands.updated(np.sum(differences**2, axis=(0, 1)))
        poses = self.poses.appended(SE2.plus(last, step))
        if observation.taken is not None:
            poses = poses.known((observation.time - observation.taken) / CONTROL_STEP)
        keypoints = gated_keypoints(observation.keypoints, poses.delayed, cable, hidden)
        if observation.confidence is not None:
            keypoints = np.where(observation.confidence[:, None] > 0, keypoints, np.nan)
        visible = np.isfinite(keypoints[[0, -1], 0])
        if visible.any() and observation.taken is None:
            ends = SE2.position(SE2.compose(poses.at(DELAYS), grasps))
            poses = poses.updated(np.sum((ends - keypoints[[0, -1]])[:, visible] ** 2, axis=(1, 2)))
        seen = bool(np.isfinite(keypoints).any())
        missing = 0 if seen else self.steps_without_keypoints + 1
        undated = seen and not visible.any() and observation.taken is None
        return GripperTracker(
            poses, commands, keypoints, missing, started=True, confidence=observation.confidence, undated=undated,
            rod=observation.rod,
        )  # fmt: skip

    def predicted(self) -> GripperTracker:
        """After a control step without a usable observation: the grippers are taken to carry out their commands."""
        return replace(
            self,
            poses=self.poses.appended(SE2.plus(self.poses.history[-1], self.commands.delayed)),
            keypoints=np.full_like(self.keypoints, np.nan),
            steps_without_keypoints=self.steps_without_keypoints + 1,
            steps_without_poses=self.steps_without_poses + 1,
            undated=False,
            rod=None,
        )

    def dated(self, residuals: Float[np.ndarray, "A"]) -> GripperTracker:
        """With squared residuals [m^2] of the last frame's keypoints for each of `DELAYS`."""
        return replace(self, poses=self.poses.updated(residuals))

    def commanding(self, action: Float[np.ndarray, "2 3"]) -> GripperTracker:
        """With an action sent."""
        return replace(self, commands=self.commands.appended(action))
