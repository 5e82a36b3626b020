"""A motion at other times than its rows: a curve through them, or close by, that asks no more than they do."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def smoothed(
    rows: Float[np.ndarray, "t ..."], at: Float[np.ndarray, "k"], derivative: int = 0
) -> Float[np.ndarray, "k ..."]:
    """The uniform cubic B-spline whose control points are the rows, at rest in the first before and in the last after.

    Its velocity, acceleration and jerk are convex combinations of the first, second and third differences of the rows,
    those from and to rest included: a limit that the rows keep, the curve keeps at every rate. It begins in the first
    row at -1 and ends in the last one at t; at the time of a row between it is a sixth of the second difference there
    off (de Boor 1978).

    >>> smoothed(np.array([0.0, 0.0, 6.0, 6.0]), np.array([-1.0, 1.0, 1.5, 4.0])).tolist()
    [0.0, 1.0, 3.0, 6.0]
    >>> smoothed(np.array([0.0, 0.0, 6.0, 6.0]), np.array([-1.0, 1.0, 1.5, 4.0]), derivative=1).tolist()
    [0.0, 3.0, 4.5, 0.0]

    Args:
        rows: At equal times; angles that run on.
        at: Fractional indices of rows, from -1 to t.
        derivative: 0 for the curve, 1 or 2 for its first or second derivative, per row.
    """
    padded = np.concatenate([rows[:1], rows[:1], rows, rows[-1:], rows[-1:]])
    first = np.clip(np.floor(at).astype(int), -1, len(rows) - 1)
    u = (at - first).reshape(-1, *(1,) * (rows.ndim - 1))
    weights = (
        ((1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3),
        (-3 * (1 - u) ** 2, 9 * u**2 - 12 * u, -9 * u**2 + 6 * u + 3, 3 * u**2),
        (6 * (1 - u), 18 * u - 12, 6 - 18 * u, 6 * u),
    )[derivative]
    parts = [weight / 6 * padded[first + 1 + place] for place, weight in enumerate(weights)]
    return np.sum(parts, axis=0)
