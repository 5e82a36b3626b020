"""Damped least squares (Levenberg 1944, Marquardt 1963): one rule for damping, acceptance and the end.

For residuals r(x) with the derivative J the step s solves (J'J + d D) s = -J'r, where D is the diagonal of J'J or, with
`Rule.absolute`, the unit matrix. A step that lowers the cost 1/2 r'r is taken and d falls; any other is undone and d
rises. A problem says what its residuals are in a loop of its own, since compiled code cannot be handed functions:

    search = begin(x)
    while True:
        cost = ...                # at search.trial; fills search.trial_normal (lower) and search.trial_gradient
        if not advance(search, cost, units, RULE):
            break

then search.x is the best point, and cost(search) its cost. `judge` alone is for problems that solve their systems
themselves, as sparse ones do.

Note:
    These are solved elsewhere, each for the reason that its docstring gives: square systems in many rows at once
    (`cableway.rod.inverse.meet_poses`), boxes (`cableway.tang2025.control.gauss_newton`), what JAX traces
    (`cableway.tang2025.models`), the fits that the frozen random tasks are made of (`cableway.tasks.motion`), a start
    beside an obstacle (`cableway.scene.task`; by SciPy), where a camera stands (`cableway.perception.hand_eye`; by
    SciPy, with OpenCV's lens), and the judge's own rod (`cableway.verification.follower`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from cableway.core.compiled import inlined, kernel

LEAST_PIVOT = 1e-14
"""Squares of pivots below that are rounding."""


class Rule(NamedTuple):
    """When a step is taken, how the damping d follows, and when the search ends.

    All numbers are floats: a rule of other types would be compiled for anew.

    Attributes:
        first: d at the start.
        shrink: By what d is divided after a step that is taken, and
        least: how small it may become.
        grow: By what d is multiplied after a step that is undone, and
        restart: how large it is at least before that.
        most: d at which the search gives up.
        fall: Fall of the cost, as a share of it, that ends the search.
        enough: Cost that ends the search.
        small: Largest number of a step that ends the search once it was tried.
        steps: Most steps that are taken, and
        trials: most that are tried, whether taken or not.
        max_step: Largest number of a step; a longer one is shortened.
        absolute: Whether d is added to the diagonal of J'J rather than multiplied with it.
    """

    first: float = 1e-9
    shrink: float = 10.0
    least: float = 1e-12
    grow: float = 10.0
    restart: float = 1e-9
    most: float = 1e6
    fall: float = 0.0
    enough: float = 0.0
    small: float = 0.0
    steps: float = np.inf
    trials: float = np.inf
    max_step: float = np.inf
    absolute: bool = False


class Search(NamedTuple):
    """Arrays of a search in m unknowns.

    Attributes:
        x: (m,) the best point.
        trial: (m,) the point to be evaluated next.
        normal: (m, m) J'J at `x`, lower triangle.
        gradient: (m,) J'r at `x`.
        trial_normal: (m, m) the same at `trial`.
        trial_gradient: (m,) the same at `trial`.
        factor: (m, m) Cholesky's factor.
        step: (m,) from `x` to `trial`, in units of the unknowns.
        state: What `judge` keeps: `fresh_state`.
    """

    x: Float[np.ndarray, "m"]
    trial: Float[np.ndarray, "m"]
    normal: Float[np.ndarray, "m m"]
    gradient: Float[np.ndarray, "m"]
    trial_normal: Float[np.ndarray, "m m"]
    trial_gradient: Float[np.ndarray, "m"]
    factor: Float[np.ndarray, "m m"]
    step: Float[np.ndarray, "m"]
    state: Float[np.ndarray, "6"]


COST, DAMPING, TAKEN, TRIED, LARGEST, DONE = range(6)
"""Places in the state: least cost, d, steps taken, steps tried, largest number of the last step, 1 at the end."""


@kernel
def fresh_state():
    """The state of a search before its first point is evaluated."""
    return np.array([np.inf, 0.0, -1.0, -1.0, np.inf, 0.0])


@kernel
def judge(state, cost, rule):
    """Take or undo a step that led to `cost`. Returns whether it is taken.

    The first call judges the start, which is taken as it is; one without a finite cost ends the search.
    """
    best, first = state[COST], state[TAKEN] < 0.0
    taken = cost < best
    if first:
        state[DAMPING] = rule.first
        ended = not taken
    elif taken:
        state[DAMPING] = max(state[DAMPING] / rule.shrink, rule.least)
        ended = best - cost < rule.fall * cost
    else:
        state[DAMPING] = max(state[DAMPING], rule.restart) * rule.grow
        ended = state[DAMPING] >= rule.most
    if taken or first:
        state[COST] = cost
        state[TAKEN] += 1.0
    state[TRIED] += 1.0
    ended = ended or state[TAKEN] >= rule.steps or state[TRIED] >= rule.trials
    if ended or state[COST] < rule.enough or state[LARGEST] < rule.small:
        state[DONE] = 1.0
    return taken


@inlined
def begin(x):
    """A search from x (m,)."""
    m = len(x)
    matrices = np.zeros((m, m)), np.zeros((m, m)), np.zeros((m, m))
    return Search(
        x.copy(), x.copy(), matrices[0], np.zeros(m), matrices[1], np.zeros(m), matrices[2], np.zeros(m), fresh_state()
    )


@kernel
def advance(search, cost, units, rule):
    """Judge the trial point, and make the next one; unknowns are counted in `units` (m,). False at the end."""
    x, trial, normal, gradient, trial_normal, trial_gradient, factor, step, state = search
    if judge(state, cost, rule):
        for a in range(len(x)):
            x[a], gradient[a] = trial[a], trial_gradient[a]
            for b in range(a + 1):
                normal[a, b] = trial_normal[a, b]
    if state[DONE] > 0.0:
        return False
    damping = state[DAMPING]
    factorize(normal, 0.0 if rule.absolute else damping, damping if rule.absolute else 0.0, factor)
    for a in range(len(x)):
        step[a] = -gradient[a]
    substitute(factor, step)
    largest = 1e-30
    for value in step:
        largest = max(largest, abs(value))
    state[LARGEST] = largest
    share = min(1.0, rule.max_step / largest)
    for a in range(len(x)):
        trial[a] = x[a] + share * units[a] * step[a]
    return True


@inlined
def clear(search):
    """Set the normal equations of the trial point to zero, to add rows to them."""
    for a in range(len(search.x)):
        search.trial_gradient[a] = 0.0
        for b in range(a + 1):
            search.trial_normal[a, b] = 0.0


@kernel
def add_row(normal, gradient, rates, residual, weight, at):
    """Add one weighted residual whose derivative by the unknowns from `at` on is `rates`."""
    for a in range(len(rates)):
        wa = weight * rates[a]
        gradient[at + a] += wa * residual
        for b in range(a + 1):
            normal[at + a, at + b] += wa * rates[b]


@kernel
def factorize(normal, relative, absolute, factor):
    """Cholesky's factor (lower) of `normal`, with more on the diagonal: a share of it, and a constant."""
    for a in range(len(normal)):
        for b in range(a + 1):
            value = normal[a, b] * (1.0 + relative) if a == b else normal[a, b]
            for c in range(b):  # a call of BLAS costs more than rows as short as these
                value -= factor[a, c] * factor[b, c]
            factor[a, b] = math.sqrt(max(value + absolute, LEAST_PIVOT)) if a == b else value / factor[b, b]


@kernel
def substitute(factor, x):
    """Solve the factored system in place."""
    for a in range(len(x)):
        for c in range(a):
            x[a] -= factor[a, c] * x[c]
        x[a] /= factor[a, a]
    for a in range(len(x) - 1, -1, -1):
        for c in range(a + 1, len(x)):
            x[a] -= factor[c, a] * x[c]
        x[a] /= factor[a, a]
