"""Curves as chords."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError

MOST_POINTS = 4000
"""Of one outline; so many take seconds."""


def arc_steps(radius: float, turn: float, tolerance: float) -> int:
    """Chords of an arc that turns by so much [rad], none farther than `tolerance` from it.

    >>> arc_steps(0.1, 3.14159, 0.0005)
    16

    Raises:
        InputError: They are more than `MOST_POINTS`.
    """
    half = math.acos(1 - tolerance / radius) if radius > tolerance else 1.0
    return _bounded(abs(turn) / (2 * half))


def bezier(controls: Float[np.ndarray, "k 2"], tolerance: float) -> Float[np.ndarray, "m 2"]:
    """Ends of chords along a Bézier curve of degree 1 to 3, its start left out, none farther than `tolerance` from it.

    A chord over a step h of the parameter is at most |B''| h²/8 away, and |B''| at most d (d - 1) times the largest
    second difference of the control points.

    Raises:
        InputError: They are more than `MOST_POINTS`, or a number is not finite.

    >>> bezier(np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 0.0]]), 0.2).tolist()
    [[1.0, 0.5], [2.0, 0.0]]
    """
    if not np.isfinite(controls).all():
        raise InputError("a curve has a number that is not finite")
    degree = len(controls) - 1
    bend = np.linalg.norm(np.diff(controls, 2, axis=0), axis=1).max() if degree > 1 else 0.0
    steps = _bounded(math.sqrt(degree * (degree - 1) * float(bend) / (8 * tolerance)))
    t = np.arange(1, steps + 1)[:, None] / steps
    return np.asarray(
        sum(math.comb(degree, i) * t**i * (1 - t) ** (degree - i) * controls[i] for i in range(degree + 1))
    )


def _bounded(steps: float) -> int:
    if not steps <= MOST_POINTS:
        raise InputError(f"a curve takes more than {MOST_POINTS} chords at this tolerance")
    return max(1, math.ceil(steps))
