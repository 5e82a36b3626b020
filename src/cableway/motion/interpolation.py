"""Rows between rows: a polyline in rod coordinates, or of shapes, at other places along it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.rod.held_rod import HeldRod

FEWEST_ROWS = 8
"""Least number of steps that a motion is resampled to."""


MOST_STATIONS = 200_000
"""Largest number of points of the rod, over all rows, that a motion is resampled to."""


def rows_at(rows: Float[np.ndarray, "t ..."], at: Float[np.ndarray, "k"]) -> Float[np.ndarray, "k ..."]:
    """Rows at fractional indices, held at the ends; coordinates q run straight between rows, through equilibria."""
    at = np.clip(at, 0, len(rows) - 1)
    whole = np.minimum(at.astype(int), max(0, len(rows) - 2))
    share = (at - whole).reshape(-1, *[1] * (rows.ndim - 1))
    first, second = rows[whole], rows[np.minimum(whole + 1, len(rows) - 1)]
    return np.where(share < 1, first + share * (second - first), second)


def subdivided(rows: int, pieces: int) -> Float[np.ndarray, "k"]:
    """Fractional indices of `rows` rows, with each step in `pieces` equal parts."""
    return np.linspace(0, rows - 1, pieces * (rows - 1) + 1)


def evenly_moved(rod: HeldRod, q: Float[np.ndarray, "t dof"], step: float) -> Float[np.ndarray, "k"]:
    """Fractional indices, first and last among them, between which keypoints move at most about `step` [m].

    Or more where that would be too many rows to handle (`MOST_STATIONS`).
    """
    stations = rod.shapes(q)[0]
    moves = np.linalg.norm(np.diff(rod.at_keypoints(stations), axis=0), axis=2).max(1)
    arc = np.concatenate([[0.0], np.cumsum(np.maximum(moves, 1e-6))])
    count = max(FEWEST_ROWS, min(int(np.ceil(arc[-1] / step)), MOST_STATIONS // stations.shape[1]))
    return np.interp(np.linspace(0, arc[-1], count + 1), arc, np.arange(len(q)))
