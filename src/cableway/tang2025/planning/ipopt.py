"""Ipopt, as carried by CasADi: the one place that calls it.

The problem is to minimise f(x) with lower <= x <= upper and row_lower <= A x <= row_upper, A sparse. Value, gradient
and Hessian come as plain functions of NumPy arrays, so no derivative is made symbolically.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi
import numpy as np
import scipy.sparse
from jaxtyping import Float, Int

from cableway.core.errors import PlanningError

CONVERGED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
"""Return codes after which the last iterate is a local minimum."""

STOPPED = ("Maximum_Iterations_Exceeded", "Search_Direction_Becomes_Too_Small")
"""Return codes after which the last iterate is taken, if it is feasible, although it is no local minimum."""

OPTIONS = {
    "print_time": False,
    "no_nlp_grad": True,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.mu_strategy": "adaptive",
    "ipopt.tol": 1e-6,
    "ipopt.acceptable_tol": 1e-4,
    "ipopt.bound_push": 1e-4,
    "ipopt.bound_frac": 1e-4,
    "ipopt.slack_bound_push": 1e-4,
    "ipopt.slack_bound_frac": 1e-4,
}


@dataclass(frozen=True)
class Objective:
    """A function of m numbers with exact derivatives.

    Attributes:
        value: x (m,) -> f.
        gradient: x (m,) -> (m,).
        hessian: x (m,) -> (h,) the entries of the Hessian's upper triangle at `rows`, `columns`.
        rows: (h,) row of each entry, at most its column; no entry twice.
        columns: (h,).
    """

    value: Callable[[np.ndarray], float]
    gradient: Callable[[np.ndarray], np.ndarray]
    hessian: Callable[[np.ndarray], np.ndarray]
    rows: Int[np.ndarray, "h"]
    columns: Int[np.ndarray, "h"]


@dataclass(frozen=True)
class LinearLimits:
    """Bounds on x and on A x.

    Attributes:
        lower: (m,).
        upper: (m,).
        matrix: A (r, m).
        row_lower: (r,).
        row_upper: (r,).
    """

    lower: Float[np.ndarray, "m"]
    upper: Float[np.ndarray, "m"]
    matrix: scipy.sparse.csr_array
    row_lower: Float[np.ndarray, "r"]
    row_upper: Float[np.ndarray, "r"]

    def violation(self, x: Float[np.ndarray, "m"]) -> float:
        """The most by which x breaks a bound."""
        rows = self.matrix @ x
        parts = (self.lower - x, x - self.upper, self.row_lower - rows, rows - self.row_upper)
        return max(float(part.max(initial=0.0)) for part in parts)


@dataclass(frozen=True)
class Minimum:
    """What Ipopt found.

    Attributes:
        x: (m,) the last iterate; feasible.
        status: Ipopt's return code.
        iterations: How many it took.
    """

    x: Float[np.ndarray, "m"]
    status: str
    iterations: int

    @property
    def converged(self) -> bool:
        """Whether x is a local minimum."""
        return self.status in CONVERGED


def minimize(
    objective: Objective,
    limits: LinearLimits,
    start: Float[np.ndarray, "m"],
    iterations: int,
    tolerance: float = 1e-6,
) -> Minimum:
    """A local minimum near `start`, or the last iterate where Ipopt stops before, as when the iterations are used up.

    Args:
        objective: f with its derivatives.
        limits: Bounds.
        start: First guess; need not be feasible.
        iterations: Most iterations.
        tolerance: Most by which the answer may break a bound.

    Raises:
        PlanningError: Ipopt failed, or its answer is not feasible; the message names its return code.
    """
    x = casadi.MX.sym("x", len(start))
    matrix = limits.matrix.tocoo()
    sparsity, order = _sparsity(matrix.row, matrix.col, (len(limits.row_lower), len(start)))
    linear = casadi.DM(sparsity, matrix.data[order])
    value = _value(objective, len(start))
    derivatives = {
        "grad_f": _gradient(objective, len(start)),
        "hess_lag": _hessian(objective, len(start), len(limits.row_lower)),
    }
    try:
        solver = casadi.nlpsol(
            "solver",
            "ipopt",
            {"x": x, "f": value(x), "g": casadi.mtimes(linear, x)},
            {**OPTIONS, **derivatives, "ipopt.max_iter": iterations},
        )
        answer = solver(x0=start, lbx=limits.lower, ubx=limits.upper, lbg=limits.row_lower, ubg=limits.row_upper)
    except RuntimeError as error:
        raise PlanningError(f"Ipopt failed: {error}") from error
    stats = solver.stats()
    found = Minimum(answer["x"].full().ravel(), stats["return_status"], stats["iter_count"])
    usable = found.status in CONVERGED + STOPPED and np.isfinite(found.x).all()
    if not usable or limits.violation(found.x) > tolerance:
        raise PlanningError(f"Ipopt found no feasible answer ({found.status})")
    return found


def _sparsity(rows: np.ndarray, columns: np.ndarray, shape: tuple[int, int]) -> tuple[casadi.Sparsity, np.ndarray]:
    """CasADi's pattern, and the order in which it takes the entries (column by column)."""
    order = np.lexsort((rows, columns))
    starts = np.concatenate([[0], np.cumsum(np.bincount(columns, minlength=shape[1]))])
    return casadi.Sparsity(*shape, starts.tolist(), rows[order].tolist()), order


class _Function(casadi.Callback):
    """A NumPy function as CasADi wants it. It must be kept alive for as long as the solver."""

    def __init__(
        self,
        name: str,
        inputs: list[casadi.Sparsity],
        outputs: list[casadi.Sparsity],
        function: Callable[..., list[np.ndarray | float]],
    ) -> None:
        casadi.Callback.__init__(self)
        self._inputs, self._outputs, self._function = inputs, outputs, function
        self.construct(name, {})

    def get_n_in(self) -> int:
        """How many arguments CasADi passes."""
        return len(self._inputs)

    def get_n_out(self) -> int:
        """How many results it expects."""
        return len(self._outputs)

    def get_sparsity_in(self, i: int) -> casadi.Sparsity:
        """Shape of argument i."""
        return self._inputs[i]

    def get_sparsity_out(self, i: int) -> casadi.Sparsity:
        """Pattern of result i."""
        return self._outputs[i]

    def eval(self, arg: Sequence[casadi.DM]) -> list[casadi.DM]:
        """Call the function on plain vectors."""
        values = self._function(*(entry.full().ravel() for entry in arg))
        return [casadi.DM(pattern, value) for pattern, value in zip(self._outputs, values, strict=True)]


def _value(objective: Objective, m: int) -> _Function:
    return _Function("value", [_dense(m)], [_dense(1)], lambda x: [np.array([objective.value(x)])])


def _gradient(objective: Objective, m: int) -> _Function:
    def evaluate(x: np.ndarray, _: np.ndarray) -> list:
        return [np.array([objective.value(x)]), objective.gradient(x)]

    return _Function("gradient", [_dense(m), _dense(0)], [_dense(1), _dense(m)], evaluate)


def _hessian(objective: Objective, m: int, rows: int) -> _Function:
    """Hessian of the Lagrangian: the constraints are linear, so only f counts."""
    pattern, order = _sparsity(objective.rows, objective.columns, (m, m))

    def evaluate(x: np.ndarray, _: np.ndarray, factor: np.ndarray, __: np.ndarray) -> list:
        return [factor[0] * objective.hessian(x)[order]]

    return _Function("hessian", [_dense(m), _dense(0), _dense(1), _dense(rows)], [pattern], evaluate)


def _dense(size: int) -> casadi.Sparsity:
    return casadi.Sparsity.dense(size, 1 if size else 0)
