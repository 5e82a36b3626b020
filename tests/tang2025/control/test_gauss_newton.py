"""Least squares in a box: known optima, and a cost that never rises."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from cableway.core.errors import ControlError
from cableway.tang2025.control.gauss_newton import Residual, minimize_in_box, solve_in_box


def residual_of(
    function: Callable[[np.ndarray], np.ndarray], derivative: Callable[[np.ndarray], np.ndarray]
) -> Callable[[np.ndarray], Residual]:
    return lambda x: (function(x), lambda: derivative(x))


rosenbrock = residual_of(
    lambda x: np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]),
    lambda x: np.array([[-20 * x[0], 10.0], [-1.0, 0.0]]),
)


def test_a_linear_problem_meets_its_optimality_conditions() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        matrix, target = rng.normal(size=(40, 8)), rng.normal(size=40)
        bound = rng.uniform(0.02, 0.3, 8)
        x = solve_in_box(matrix, target, -bound, bound)
        gradient = matrix.T @ (matrix @ x + target)
        assert np.abs(x).max() <= bound.max()
        free = np.abs(x) < bound - 1e-9
        assert np.abs(gradient[free]).max(initial=0.0) < 1e-8
        assert (gradient[~free] * np.sign(x[~free])).max(initial=-1.0) < 1e-8


@pytest.mark.parametrize(
    ("bound", "optimum"), [(2.0, [1.0, 1.0]), (0.5, [0.5, 0.25])], ids=["optimum inside", "optimum outside"]
)
def test_a_curved_valley(bound: float, optimum: list[float]) -> None:
    found = minimize_in_box(rosenbrock, np.array([-0.4, 0.4]), np.full(2, bound), iterations=100, tolerance=1e-12)
    np.testing.assert_allclose(found.x, optimum, atol=1e-5)


@pytest.mark.parametrize("iterations", [0, 1, 2, 5])
def test_the_cost_never_rises(iterations: int) -> None:
    rng = np.random.default_rng(1)
    for start in rng.uniform(-2, 2, (20, 2)):
        found = minimize_in_box(rosenbrock, start, np.full(2, 1.5), iterations=iterations, tolerance=0.0)
        residual = rosenbrock(found.x)[0]
        assert found.cost <= found.start_cost
        assert found.cost == pytest.approx(0.5 * residual @ residual)
        assert found.iterations <= iterations


def test_it_stops_at_an_optimum() -> None:
    assert minimize_in_box(rosenbrock, np.ones(2), np.full(2, 2.0), iterations=9, tolerance=1e-3).iterations == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_reported(bad: float) -> None:
    start, bound = np.zeros(2), np.ones(2)
    broken = residual_of(lambda x: np.array([bad, 1.0]), lambda x: np.eye(2))
    with pytest.raises(ControlError, match="cost of the predicted motion is not finite"):
        minimize_in_box(broken, start, bound, iterations=5, tolerance=1e-3)
    broken = residual_of(lambda x: x + 1, lambda x: np.full((2, 2), bad))
    with pytest.raises(ControlError, match="linearised problem holds a number that is not finite"):
        minimize_in_box(broken, start, bound, iterations=5, tolerance=1e-3)
