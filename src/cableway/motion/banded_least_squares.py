"""Levenberg-Marquardt over rows of rod coordinates of which the first, and often the last, stay.

Smoothness couples rows at most two apart, so the normal matrix has blocks on five diagonals, square in the rod's
coordinates, and each step is one banded Cholesky solution. Planners of the plane and of space share it, and control.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float
from scipy.linalg import LinAlgError, solveh_banded

from cableway.core.compiled import kernel
from cableway.rod.held_rod import HeldRod
from cableway.rod.least_squares import DAMPING, DONE, TRIED, Rule, fresh_state, judge

BANDS = 3
"""Block diagonals of the normal matrix from the middle one up: smoothness couples rows at most two apart."""

INNER = slice(1, -1)
"""All rows but the first and the last."""

STAGE = Rule(first=1e-3, shrink=4.0, least=1e-9, grow=6.0, restart=0.0, most=1e9)
"""How the damping follows in each stage."""


@dataclass
class Normal:
    """Gradient (T+1, d) and the blocks (T+1, d, d) of the normal matrix on the diagonal and the two above it."""

    cost: float
    gradient: Float[np.ndarray, "t d"]
    blocks: tuple[
        Float[np.ndarray, "t d d"],
        Float[np.ndarray, "t-1 d d"],
        Float[np.ndarray, "t-2 d d"],
    ]


class Problem(Protocol):
    """A cost of rows of rod coordinates."""

    @property
    def rod(self) -> HeldRod:
        """Whose coordinates they are."""
        ...

    def cost(self, q: Float[np.ndarray, "t d"]) -> float:
        """The cost alone, for trial steps."""
        ...

    def linearise(self, q: Float[np.ndarray, "t d"]) -> Normal:
        """Cost, gradient and Gauss-Newton blocks at q."""
        ...


def squared_differences(rows: int, order: int) -> tuple[Float[np.ndarray, "t"], ...]:
    """Diagonals 0, 1, 2, ... of D' D, where D takes the differences of an order between rows."""
    stencil = np.diff(np.eye(order + 1), n=order, axis=0)[0]
    bands = tuple(np.zeros(rows - k) for k in range(BANDS))
    for k, band in enumerate(bands[: order + 1]):
        for i in range(order + 1 - k):
            band[i : i + rows - order] += stencil[i] * stencil[i + k]
    return bands


def band_product(bands: tuple[np.ndarray, ...], x: Float[np.ndarray, "t k"]) -> Float[np.ndarray, "t k"]:
    """Product of a symmetric banded matrix, given by its diagonals 0, 1, 2, ..., with x."""
    out = bands[0][:, None] * x
    for d, band in enumerate(bands[1:], start=1):
        out[:-d] += band[:, None] * x[d:]
        out[d:] += band[:, None] * x[:-d]
    return out


def band_form(bands: tuple[np.ndarray, ...], x: Float[np.ndarray, "t k"]) -> float:
    """Half of x' A x of a symmetric banded matrix A."""
    return 0.5 * float(np.sum(x * band_product(bands, x)))


def levenberg_marquardt(
    q: Float[np.ndarray, "t d"],
    problem: Problem,
    iterations: int,
    tolerance: float,
    progress: Callable[[float], None] = lambda _: None,
    free: slice = INNER,
) -> Float[np.ndarray, "t d"]:
    """The rows moved to a local minimum of the problem's cost; by default the first and the last one stay.

    Args:
        q: Rod coordinates of the rows.
        problem: The cost.
        iterations: Most steps that are tried.
        tolerance: Relative fall of the cost that ends it.
        progress: Called with the share that is done; it may raise to stop.
        free: The rows that move.
    """
    most = iterations
    rule = STAGE._replace(fall=tolerance, trials=float(most))
    state, normal = fresh_state(), problem.linearise(q)
    judge(state, normal.cost, rule)
    while not state[DONE]:
        progress(state[TRIED] / most)
        trial = q.copy()
        trial[free] = problem.rod.retract(q[free], _solve(normal, state[DAMPING], free))
        if judge(state, problem.cost(trial), rule):
            q, normal = trial, problem.linearise(trial)
    return q


def _solve(normal: Normal, damping: float, free: slice) -> Float[np.ndarray, "k d"]:
    """Solve (H + damping diag H) step = -gradient on the free rows; NaN where H is not positive definite."""
    diagonal, above, further = (block[free] for block in normal.blocks)
    gradient = normal.gradient[free]
    count, dof = gradient.shape
    banded = np.zeros((BANDS * dof, count * dof))
    _fill_bands(diagonal, above, further, banded)
    banded[-1] += damping * np.maximum(banded[-1], 1e-9)
    try:
        return -solveh_banded(banded, gradient.ravel(), check_finite=False).reshape(count, dof)
    except LinAlgError:
        return np.full((count, dof), np.nan)


@kernel
def _fill_bands(diagonal, above, further, banded):
    """Write blocks (t, d, d), (t-1, d, d), (t-2, d, d) into the upper banded form (3 d, d t) of `solveh_banded`."""
    dof = diagonal.shape[1]
    last = len(banded) - 1
    for i in range(dof):
        for j in range(dof):
            for t in range(len(diagonal) if j >= i else 0):
                banded[last + i - j, dof * t + j] = diagonal[t, i, j]
            for t in range(len(above)):
                banded[last - dof + i - j, dof * (t + 1) + j] = above[t, i, j]
            for t in range(len(further)):
                banded[last - 2 * dof + i - j, dof * (t + 2) + j] = further[t, i, j]
