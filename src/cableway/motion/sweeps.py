"""Sweeps: shapes along a motion, so near to each other that what none of them touches is not touched in between."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.motion.interpolation import rows_at, subdivided
from cableway.motion.time_parametrization import at_equal_effort
from cableway.rod.held_rod import HeldRod

MEASURED = 4
"""Parts of a row between which the move of the rod is measured."""


def swept_shapes(rod: HeldRod, q: Float[np.ndarray, "t dof"], step: float) -> Float[np.ndarray, "k s space"]:
    """Stations [m] of shapes along a motion, no station more than `step` [m] from one shape to the next."""
    fine = subdivided(len(q), MEASURED)
    lines = rod.shapes(rows_at(q, fine))[0]
    moves = np.linalg.norm(np.diff(lines, axis=0), axis=2).max(1)
    return rod.shapes(rows_at(q, at_equal_effort(fine, moves / step)))[0]
