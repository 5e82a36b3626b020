"""Delay estimation: which delay of frames or commands explains best what was measured."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

LONGEST_DELAY = 6
"""Greatest delay that is recognised, in control steps."""

PARTS = 4
"""Delays tried per control step."""

DELAYS = np.arange(LONGEST_DELAY * PARTS + 1) / PARTS

FORGETTING = 0.97
"""Share of the residuals so far that still counts one control step later."""

SWITCH = 0.8
"""Share of the present delay's residual below which another delay replaces it."""

RESOLUTION = 2e-4
"""Residual [m] that counts as none."""


@dataclass(frozen=True)
class DelayEstimator:
    """Gripper poses or motions of the last control steps, and the delay that explains the measurements best.

    Attributes:
        history: (R, 2, 3) gripper poses or motions [m, m, rad], the newest last.
        residuals: (A,) squared residuals [m^2] of each of `DELAYS`, summed up.
        delay: The present estimate, in control steps.
    """

    history: Float[np.ndarray, "R 2 3"]
    residuals: Float[np.ndarray, "A"]
    delay: float = 0.0

    @classmethod
    def constant(cls, row: Float[np.ndarray, "2 3"]) -> DelayEstimator:
        """With the same row at all times before."""
        return cls(np.repeat(np.asarray(row, float)[None], LONGEST_DELAY + 3, axis=0), np.zeros(len(DELAYS)))

    def appended(self, row: Float[np.ndarray, "2 3"]) -> DelayEstimator:
        """One control step later."""
        return replace(self, history=np.concatenate([self.history[1:], row[None]]))

    def corrected(self, row: Float[np.ndarray, "2 3"]) -> DelayEstimator:
        """With another newest row."""
        return replace(self, history=np.concatenate([self.history[:-1], row[None]]))

    def at(self, delay: float | Float[np.ndarray, "A"]) -> Float[np.ndarray, "... 2 3"]:
        """The row of so many control steps ago, linear between two of them."""
        whole = np.floor(delay).astype(int)
        share = (delay - whole)[..., None, None]
        return (1 - share) * self.history[-1 - whole] + share * self.history[-2 - whole]

    @property
    def delayed(self) -> Float[np.ndarray, "2 3"]:
        """The row at the estimated delay."""
        return self.at(np.float64(self.delay))

    @property
    def newer(self) -> Float[np.ndarray, "2 3"]:
        """The sum of all rows newer than that."""
        whole = int(self.delay)
        newer = self.history[len(self.history) - whole :].sum(axis=0)
        return newer + (self.delay - whole) * self.history[-1 - whole]

    def known(self, delay: float) -> DelayEstimator:
        """With a delay [control steps] that was measured and need not be estimated."""
        return replace(self, delay=float(np.clip(delay, 0.0, LONGEST_DELAY)))

    def updated(self, residuals: Float[np.ndarray, "A"]) -> DelayEstimator:
        """After a measurement that has these squared residuals [m^2] for each of `DELAYS`."""
        total = FORGETTING * self.residuals + residuals + RESOLUTION**2
        best, present = int(np.argmin(total)), round(self.delay * PARTS)
        delay = float(DELAYS[best]) if total[best] < SWITCH * total[present] else self.delay
        return replace(self, residuals=total, delay=delay)
