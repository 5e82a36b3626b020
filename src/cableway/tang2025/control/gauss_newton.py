"""Nonlinear least squares in a box by Gauss-Newton steps that never make the cost rise.

Note:
    `cableway.rod.least_squares` knows no bounds; the paper's actions have them, and damping in their place would make
    the gripper limits soft.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear

from cableway.core.errors import ControlError

Residual = tuple[Float[np.ndarray, "m"], Callable[[], Float[np.ndarray, "m a"]]]
"""Residuals at a point, and a function that gives their derivative there."""

HALVINGS = 4
"""Shorter steps tried before a Gauss-Newton direction is given up."""


@dataclass(frozen=True)
class Solution:
    """Where the iterations ended.

    Attributes:
        x: (a,) the point.
        cost: Half the sum of squared residuals there.
        start_cost: The same at the start.
        iterations: Linear problems solved.
    """

    x: Float[np.ndarray, "a"]
    cost: float
    start_cost: float
    iterations: int


def minimize_in_box(
    evaluate: Callable[[Float[np.ndarray, "a"]], Residual],
    start: Float[np.ndarray, "a"],
    bound: Float[np.ndarray, "a"],
    *,
    iterations: int,
    tolerance: float,
) -> Solution:
    """Lessen half the sum of squared residuals over |x| <= bound, from `start`.

    Each iteration solves the linearised problem in the box and goes along its step, halved until the true cost
    falls; where it does not fall, or falls by less than `tolerance` of itself, that is the end.

    Args:
        evaluate: Residuals at x with their derivative.
        start: First point, moved into the box where outside.
        bound: Half the width of the box.
        iterations: Most linear problems to solve.
        tolerance: Relative fall of the cost that is not worth another iteration.

    Raises:
        ControlError: A residual or a derivative is not finite, or a factorisation failed.
    """
    x = np.clip(start, -bound, bound)
    residual, derivative = evaluate(x)
    cost = start_cost = _finite_cost(residual)
    solved = 0
    while solved < iterations and cost > 0.0:
        step = solve_in_box(derivative(), residual, -bound - x, bound - x)
        solved += 1
        for halving in range(HALVINGS + 1):
            trial = np.clip(x + 0.5**halving * step, -bound, bound)
            trial_residual, trial_derivative = evaluate(trial)
            trial_cost = 0.5 * float(trial_residual @ trial_residual)
            if trial_cost < cost:
                break
        else:
            break
        fall = (cost - trial_cost) / cost
        x, residual, derivative, cost = trial, trial_residual, trial_derivative, trial_cost
        if fall < tolerance:
            break
    return Solution(x, cost, start_cost, solved)


def _finite_cost(residual: np.ndarray) -> float:
    cost = 0.5 * float(residual @ residual)
    if not np.isfinite(cost):
        raise ControlError("the cost of the predicted motion is not finite")
    return cost


def solve_in_box(
    jacobian: Float[np.ndarray, "m a"],
    residual: Float[np.ndarray, "m"],
    lower: Float[np.ndarray, "a"],
    upper: Float[np.ndarray, "a"],
) -> Float[np.ndarray, "a"]:
    """The x in [lower, upper] that makes |jacobian x + residual| least.

    The rows are first condensed to as many as there are unknowns, by the Cholesky factor of the normal equations;
    SciPy's active-set method does the rest.

    Raises:
        ControlError: A number is not finite, or the columns of the derivative depend on each other.
    """
    if not (np.isfinite(jacobian).all() and np.isfinite(residual).all()):
        raise ControlError("the linearised problem holds a number that is not finite")
    try:
        # np.einsum and not a QR factorisation: the threads of BLAS cost up to 200 ms a call on a busy machine
        factor = np.linalg.cholesky(np.einsum("ka,kb->ab", jacobian, jacobian))
        target = solve_triangular(factor, -np.einsum("ka,k->a", jacobian, residual), lower=True)
        return lsq_linear(factor.T, target, bounds=(lower, upper), method="bvls").x
    except np.linalg.LinAlgError as error:
        raise ControlError(f"the linearised problem could not be solved ({error})") from None
