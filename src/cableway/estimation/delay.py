"""How old what is seen is, and which actions are still under way: told by comparing it with what was sent."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

OLDEST = 6
"""Greatest age that is recognised, in control steps."""

PARTS = 4
"""Ages told apart in one control step."""

AGES = np.arange(OLDEST * PARTS + 1) / PARTS

KEPT = 0.97
"""Share of what was found before that still counts one control step later."""

CLEARER = 0.8
"""Share of the misses at the present age below which another age is taken."""

RESOLUTION = 2e-4
"""Miss [m] that counts as none."""


@dataclass(frozen=True)
class Age:
    """Rows of the last control steps, and which of them, by age, explain best what is seen.

    Attributes:
        rows: (R, 2, 3) gripper poses or motions [m, m, rad], now last.
        misses: (A,) squared misses [m^2] of each of `AGES`, summed up.
        value: The age taken, in control steps.
    """

    rows: Float[np.ndarray, "R 2 3"]
    misses: Float[np.ndarray, "A"]
    value: float = 0.0

    @classmethod
    def of(cls, row: Float[np.ndarray, "2 3"]) -> Age:
        """With the same row at all times before."""
        return cls(np.repeat(np.asarray(row, float)[None], OLDEST + 3, axis=0), np.zeros(len(AGES)))

    def with_row(self, row: Float[np.ndarray, "2 3"]) -> Age:
        """One control step later."""
        return replace(self, rows=np.concatenate([self.rows[1:], row[None]]))

    def aged(self, age: float | Float[np.ndarray, "A"]) -> Float[np.ndarray, "... 2 3"]:
        """The row of an age, between two of them in proportion."""
        whole = np.floor(age).astype(int)
        share = (age - whole)[..., None, None]
        return (1 - share) * self.rows[-1 - whole] + share * self.rows[-2 - whole]

    @property
    def row(self) -> Float[np.ndarray, "2 3"]:
        """The row of the age taken."""
        return self.aged(np.float64(self.value))

    @property
    def newer(self) -> Float[np.ndarray, "2 3"]:
        """The sum of all rows newer than that."""
        whole = int(self.value)
        newer = self.rows[len(self.rows) - whole :].sum(axis=0)
        return newer + (self.value - whole) * self.rows[-1 - whole]

    def known(self, age: float) -> Age:
        """With an age that is known [control steps] and need not be found."""
        return replace(self, value=float(np.clip(age, 0.0, OLDEST)))

    def judged(self, misses: Float[np.ndarray, "A"]) -> Age:
        """After an observation that each of `AGES` misses by so much [m^2]."""
        total = KEPT * self.misses + misses + RESOLUTION**2
        best, present = int(np.argmin(total)), round(self.value * PARTS)
        value = float(AGES[best]) if total[best] < CLEARER * total[present] else self.value
        return replace(self, misses=total, value=value)
