"""Which marker is which: marks of one colour are named by where the markers are expected."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

APART = 1e3
"""Cost of a mark and a marker that are too far apart to be one: more than any reach."""


def named(
    marks: Float[np.ndarray, "b 2"], expected: Float[np.ndarray, "n 2"], reach: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n 2"]:
    """Where each marker is, NaN where there is no mark for it: no mark has two names, and the sum of the distances is
    least. All is in metres on a table, or in pixels of one picture.

    Nothing is carried over from an earlier frame but what is expected, so that a wrong name does not stay.

    >>> named(np.array([[0.12, 0.0], [0.51, 0.0]]), np.array([[0.1, 0.0], [0.2, 0.0], [0.3, 0.0]]), np.full(3, 0.05))
    array([[0.12, 0.  ],
           [ nan,  nan],
           [ nan,  nan]])

    Args:
        marks: In any order.
        expected: Of the markers.
        reach: Distance of each from there up to which a mark may be it.
    """
    out = np.full_like(expected, np.nan)
    away = cdist(expected, marks)
    cost = np.where(away <= reach[:, None], away, APART)
    rows, columns = linear_sum_assignment(cost)
    for row, column in zip(rows, columns, strict=True):
        if cost[row, column] < APART:
            out[row] = marks[column]
    return out
