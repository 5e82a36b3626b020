"""The catenary: how a chain without bending stiffness hangs between two points."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

LONGEST_CHORD = 0.95
"""Distance of the ends over the length up to which a catenary is drawn; ends farther apart are brought so near."""

LEAST_SPAN = 0.02
"""Horizontal distance of the ends over the length; ends closer than that are moved so far apart."""

NEWTON_STEPS = 30
"""Enough for rounding alone to be left, for any slack that `LEAST_SPAN` allows."""


def hanging(ends: Float[np.ndarray, "t 2 3"], length: float, count: int) -> Float[np.ndarray, "t n 3"]:
    """Points at equal arc length on the catenaries of a length between pairs of points, z upwards.

    With the horizontal distance h and the height difference v of the ends, the catenary z = a cosh(x / a) of length L
    has sinh(u) / u = sqrt(L^2 - v^2) / h for u = h / (2 a), and its lowest point is a artanh(v / L) before the middle.

    Args:
        ends: (t, 2, 3) first and last points [m].
        length: L [m].
        count: n.

    >>> low = hanging(np.array([[[0.0, 0.0, 0.0], [0.3, 0.0, 0.0]]]), 0.5, 3)[0, 1]
    >>> low.round(4).tolist()
    [0.15, 0.0, -0.1814]
    """
    middle, half = ends.mean(axis=1), (ends[:, 1] - ends[:, 0]) / 2
    chord = 2 * np.linalg.norm(half, axis=1)
    half = half * np.minimum(1.0, LONGEST_CHORD * length / np.maximum(chord, 1e-12))[:, None]
    across, rise = half.copy(), 2 * half[:, 2]
    across[:, 2] = 0.0
    span = 2 * np.linalg.norm(across, axis=1)
    direction = np.where(span[:, None] > 1e-9, 2 * across / np.maximum(span, 1e-9)[:, None], [1.0, 0.0, 0.0])
    span = np.maximum(span, LEAST_SPAN * length)
    u = _half_width(np.sqrt(length**2 - rise**2) / span)
    scale = span / (2 * u)
    start = scale * np.arctanh(rise / length) - span / 2  # from the lowest point
    arc = np.linspace(0.0, length, count)
    x = scale[:, None] * np.arcsinh(np.sinh(start / scale)[:, None] + arc / scale[:, None])
    z = scale[:, None] * (np.cosh(x / scale[:, None]) - np.cosh(start / scale)[:, None])
    points = (x - start[:, None] - span[:, None] / 2)[..., None] * direction[:, None, :]
    points[..., 2] += z - rise[:, None] / 2
    return middle[:, None, :] + points


def _half_width(ratio: Float[np.ndarray, "t"]) -> Float[np.ndarray, "t"]:
    """u > 0 with sinh(u) / u = ratio > 1, by Newton's method: from the first step on from above, as it is convex."""
    u = np.where(ratio < 3, np.sqrt(6 * (ratio - 1)), np.log(2 * ratio) + np.log(np.log(2 * ratio) + 1.0))
    for _ in range(NEWTON_STEPS):
        u = u - (np.sinh(u) - ratio * u) / (np.cosh(u) - ratio)
    return u
