"""What no parameter of the rod, no noise and no latency explains: something that nobody knows holds the cable.

Where parameters can be corrected the residual is small, and where the output offset can follow the innovation is: a
contact makes both large. Frames that are taken now earlier and now later do so, too, and raise the limits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from jaxtyping import Float

from cableway.estimation.delay import LONGEST_DELAY

GAIN = 0.3
"""Share of the newest frame in the low-passed innovation and residual; noise of 2 mm leaves less than 2 mm of them."""

LIMITS = (0.013, 0.015)
"""Innovation and residual, in nominal lengths, that neither parameters nor noise explain: something holds the cable."""

LEAST_LIMITS = (0.004, 0.0045)
"""The same [m] of a short cable."""

STRAY = 2.0
"""The same, times this, up to which a single keypoint of a frame counts; one farther off is most likely a stray."""

JITTER_KEPT = 0.9
"""Share of the jitter so far that still counts one frame later."""

NO_JITTER = 0.003
"""Jitter [m] up to which there is none: noise of 2 mm on the keypoints makes as much of it once in a while."""

STILL = 5e-4
"""Way [m] of a keypoint from frame to frame up to which it does not say when a frame was taken."""


@dataclass(frozen=True, kw_only=True)
class Surprise:
    """What the last frames left unexplained.

    Attributes:
        limits: (2,) of innovation and residual [m].
        differences: (2, n, space) innovation, of prediction and output offset, and residual, of the corrected one
            alone [m], low-passed and smoothed along the cable.
        predicted: (n, space) keypoints of the last corrected prediction [m].
        late: By how many ways from frame to frame the last one was taken later than expected.
        way: The mean way [m] of a keypoint between the last two frames.
        jitter: How far [m] that put the cable, of late, from where the frame before would have had it.
    """

    limits: Float[np.ndarray, "2"]
    differences: Float[np.ndarray, "2 n space"]
    predicted: Float[np.ndarray, "n space"]
    late: float = 0.0
    way: float = 0.0
    jitter: float = 0.0

    @classmethod
    def none(cls, predicted: Float[np.ndarray, "n space"], length: float) -> Self:
        """Before the first frame, of a cable of nominal `length` [m]."""
        limits = np.maximum(LEAST_LIMITS, np.multiply(LIMITS, length))
        return cls(limits=limits, differences=np.zeros((2, *predicted.shape)), predicted=predicted)

    def forgotten(self) -> Self:
        """Of nothing so far."""
        return replace(self, differences=np.zeros_like(self.differences))

    def updated(
        self,
        keypoints: Float[np.ndarray, "n space"],
        expected: Float[np.ndarray, "n space"],
        offset: Float[np.ndarray, "n space"],
        corrected: Float[np.ndarray, "n space"],
    ) -> Self:
        """After a frame.

        Args:
            keypoints: (n, space) [m], NaN where missing.
            expected: (n, space) predicted before it [m].
            offset: (n, space) output offset before it [m].
            corrected: (n, space) predicted with what was learned from it [m].
        """
        way = expected - self.predicted
        late, far = _lateness(keypoints - expected, way), float(np.linalg.norm(way, axis=1).mean())
        # a way that is short says little of when a frame was taken, and may not speak for a long one after it
        differs = abs(late - self.late) * min(far, self.way)
        newest = keypoints - np.stack([expected + offset, corrected])
        strayed = np.linalg.norm(newest, axis=-1) / (STRAY * self.limits[:, None])
        newest /= np.maximum(strayed, 1.0)[..., None]
        return replace(
            self,
            differences=self.differences + GAIN * (_smoothed(newest) - self.differences),
            predicted=corrected,
            late=late,
            way=far,
            jitter=max(differs, JITTER_KEPT * self.jitter),
        )

    def held_at(self, share: float = 1.0) -> tuple[int, Float[np.ndarray, "space"], float] | None:
        """Keypoint at which something that is not known holds the cable, in which direction, and the root mean square
        residual [m]; None where innovation and residual are not both beyond that share of their limits.
        """
        innovations, residuals = np.linalg.norm(self.differences, axis=-1)
        limits = self.limits + max(self.jitter - NO_JITTER, 0.0)
        if (np.array([innovations.max(), residuals.max()]) <= share * limits).any():
            return None
        worst = int(np.argmax(residuals))
        return worst, self.differences[1, worst] / residuals[worst], float(np.sqrt(np.mean(residuals**2)))


def _lateness(differences: Float[np.ndarray, "n space"], way: Float[np.ndarray, "n space"]) -> float:
    """Of how many such ways what is seen is short, by the median of the keypoints that move; 0 where none does."""
    moving = (np.linalg.norm(way, axis=1) > STILL) & np.isfinite(differences[:, 0])
    if not moving.any():
        return 0.0
    shares = -np.sum(differences[moving] * way[moving], axis=1) / np.sum(way[moving] ** 2, axis=1)
    return float(np.clip(np.median(shares), -LONGEST_DELAY, LONGEST_DELAY))


def _smoothed(differences: Float[np.ndarray, "2 n space"]) -> Float[np.ndarray, "2 n space"]:
    """Weighted means of neighbours along the cable, hidden ones left out; zero where all are hidden."""
    visible = np.isfinite(differences[0, :, 0])
    values = np.pad(np.where(visible[:, None], differences, 0.0), ((0, 0), (1, 1), (0, 0)))
    weights = np.pad(visible.astype(float), 1)
    total = values[:, :-2] / 4 + values[:, 1:-1] / 2 + values[:, 2:] / 4
    weight = weights[:-2] / 4 + weights[1:-1] / 2 + weights[2:] / 4
    return total / np.maximum(weight, 0.25)[:, None]
