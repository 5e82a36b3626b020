"""A learned model that is adapted while it controls: from which frames, and when."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from cableway.datasets.transitions import Transitions
from cableway.geometry.groups import SE2
from cableway.records import Estimate
from cableway.tang2025.models.adaptation import (
    AdaptationConfig,
    AdaptationState,
    adapt,
    compile_adaptation,
    start_adaptation,
)
from cableway.tang2025.models.learned import LearnedModel

Frame = tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "2 3"]]
"""Keypoints (n, 2) [m], NaN where hidden, with gripper poses (2, 3) [m, m, rad] of the same time."""


@dataclass(frozen=True)
class Learning:
    """A model in use and the frames since it was last adapted.

    Attributes:
        state: The model, with all that it was adapted to.
        every: Frames between two adaptations.
        frames: Those since the last one; the first was the last one before it.
    """

    state: AdaptationState
    every: int
    frames: tuple[Frame, ...] = ()

    @classmethod
    def of(cls, model: LearnedModel, config: AdaptationConfig | None, every: int, keypoints: int) -> Learning:
        """Before the first frame; compiles what an adaptation needs.

        Args:
            model: As it was trained.
            config: How it is adapted; as `start_adaptation` has it where None.
            every: Frames between two adaptations.
            keypoints: Of the cable.
        """
        state = start_adaptation(model, config=config)
        compile_adaptation(state, keypoints)
        return cls(state, every)

    def seeing(self, frame: Frame) -> Learning:
        """With one more frame; adapted where it is time."""
        frames = (*self.frames, frame)
        if len(frames) <= self.every:
            return replace(self, frames=frames)
        transitions = _transitions(frames)
        state = self.state if transitions is None else adapt(self.state, transitions)
        return replace(self, state=state, frames=frames[-1:])

    def estimates(self) -> dict[str, Estimate]:
        """How often the model was changed, and how often a change was no better, for the record."""
        counts = {"model changes taken": self.state.accepted, "model changes refused": self.state.refused}
        return {name: Estimate(float(count), 0.0, 0.0, 1.0) for name, count in counts.items()}


def _transitions(frames: tuple[Frame, ...]) -> Transitions | None:
    """From each complete frame to the next where that is complete too; None where there are none."""
    keypoints, poses = np.array([frame[0] for frame in frames]), np.array([frame[1] for frame in frames])
    whole = np.all(np.isfinite(keypoints), axis=(1, 2))
    rows = np.flatnonzero(whole[:-1] * whole[1:])
    if not len(rows):
        return None
    return Transitions(
        keypoints[rows],
        poses[rows],
        SE2.minus(poses[rows + 1], poses[rows]),
        keypoints[rows + 1],
        np.zeros(len(rows), int),
    )
