"""Compiled searches for equilibria nearest to keypoints or between given ends; `cableway.rod.inverse` is what to call.

Rods are those of `cableway.rod.kernels`: parameters p (1 + 2K,) and modes (K, N).
"""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import inlined, kernel
from cableway.rod.kernels import held_shape
from cableway.rod.least_squares import COST, Rule, add_row, advance, begin, clear, factorize, substitute

LOAD_UNITS = (10.0, 10.0, 3.0)
"""Units of (a_x, a_y, m) in which steps are measured."""

LOADS = 3
"""From this coordinate on q holds the load."""

EXACT = Rule(
    first=1e-3, shrink=5.0, restart=0.0, most=1e12, fall=1e-13, small=1e-10, steps=100.0, trials=100.0, absolute=True
)
"""For a fit to the last digit, from far away: where keypoints do not determine the loads, only the damping does."""

PULL = 1e-8
"""Weight [m^2] of the change of the load in a fit that goes on from another rod's shape."""

CLOSER = 1e-6
"""By how much, in squared lengths of the rod, one of two fits must be nearer to be another shape than the other one."""

QUICK = Rule(least=1e-9, restart=1e-5, most=1e3, small=1e-5, steps=100.0, max_step=0.3)
"""For a fit that goes on from one near by; most take few steps. The pull lets the load of a rod far from the uniform
one change little by little."""

MEETING = Rule(enough=1e-20, steps=100.0)
"""For ends that can be met."""


@kernel
def workspace(modes, columns):
    """Empty arrays for `held_shape` with so many derivatives."""
    hinges = modes.shape[1]
    return (
        np.empty((2 * hinges + 1, 2)),
        np.empty((2 * hinges + 1, 2, columns)),
        np.empty((2, 3)),
        np.empty((2, 3, columns)),
    )


@kernel
def scales(length):
    """Units of q in which steps are measured."""
    return np.array([length, length, 1.0, LOAD_UNITS[0], LOAD_UNITS[1], LOAD_UNITS[2]])


@inlined
def scaled_shape(q, p, modes, scale, stations, dstations, poses, dposes):
    """`held_shape` with the derivatives by q in units of `scale`."""
    held_shape(q, p, modes, stations, dstations, poses, dposes)
    for a in range(len(scale)):
        for k in range(2):
            for i in range(len(dstations)):
                dstations[i, k, a] *= scale[a]
        for k in range(3):
            for side in range(2):
                dposes[side, k, a] *= scale[a]


@kernel
def fit_shape(q, wanted, p, modes, stride, pull, rule):
    """Move q (6,) to the equilibrium nearest to keypoints (n, 2).

    A pull on the change of the load in each step, of weight `pull` in squared lengths, keeps it where keypoints do not
    determine it. Returns half the squared stacked distance, in squared lengths of the rod.
    """
    stations, dstations, poses, dposes = workspace(modes, len(q))
    search, scale, length, rates = begin(q), scales(p[0]), p[0], np.empty(len(q))
    while True:
        held_shape(search.trial, p, modes, stations, dstations, poses, dposes)
        clear(search)
        cost = 0.0
        for i in range(len(wanted)):
            for k in range(wanted.shape[1]):
                residual = (stations[i * stride, k] - wanted[i, k]) / length
                for a in range(len(q)):
                    rates[a] = dstations[i * stride, k, a] * (scale[a] / length)
                add_row(search.trial_normal, search.trial_gradient, rates, residual, 1.0, 0)
                cost += residual * residual
        for a in range(LOADS, len(q)):
            search.trial_normal[a, a] += pull
        if not advance(search, 0.5 * cost, scale, rule):
            break
    q[:] = search.x
    return search.state[COST]


@kernel
def meet_ends(q, ends, p, modes):
    """Move q (6,) to the shape with end poses `ends` (2, 3).

    Angles count as they are, not modulo a turn. Returns the residual left, in lengths and radians.
    """
    stations, dstations, poses, dposes = workspace(modes, len(q))
    search, scale = begin(q), scales(p[0])
    rates = np.empty((ends.size, len(q)))
    while True:
        held_shape(search.trial, p, modes, stations, dstations, poses, dposes)
        end_rates(dposes, p[0], scale, rates)
        clear(search)
        cost = 0.0
        for row in range(ends.size):
            side, k = row // ends.shape[1], row % ends.shape[1]
            residual = (poses[side, k] - ends[side, k]) / end_unit(row, p[0])
            add_row(search.trial_normal, search.trial_gradient, rates[row], residual, 1.0, 0)
            cost += residual * residual
        if not advance(search, cost, scale, MEETING):
            break
    q[:] = search.x
    return math.sqrt(search.state[COST])


@kernel
def end_unit(row, length):
    """Unit of a number of the end poses, which are counted in lengths and radians."""
    return 1.0 if row % 3 == 2 else length


@kernel
def end_rates(dposes, length, scale, rates):
    """Derivative (6, 6) of the end poses, in lengths and radians, by q in units of `scale`."""
    for row in range(len(rates)):
        for a in range(len(scale)):
            rates[row, a] = dposes[row // 3, row % 3, a] / end_unit(row, length) * scale[a]


@inlined
def follow_ends(dposes, length, changes, damping):
    """Changes (d, m) of q that follow changes (6, m) of the end poses [m, rad]; `damping` [1] keeps them finite."""
    scale = scales(length)
    d = len(scale)
    rates, normal, factor, moved = np.empty((len(changes), d)), np.zeros((d, d)), np.empty((d, d)), np.zeros(d)
    end_rates(dposes, length, scale, rates)
    for row in range(len(changes)):
        add_row(normal, moved, rates[row], 0.0, 1.0, 0)
    factorize(normal, 0.0, damping, factor)
    followed = np.empty((d, changes.shape[1]))
    for column in range(changes.shape[1]):
        for a in range(d):
            moved[a] = 0.0
            for row in range(len(changes)):
                moved[a] += rates[row, a] * changes[row, column] / end_unit(row, length)
        substitute(factor, moved)
        for a in range(d):
            followed[a, column] = scale[a] * moved[a]
    return followed


@kernel
def fit_along(q, near, wanted, p, modes, stride):
    """The equilibria (t, 6) nearest to keypoints `wanted` (t, n, 2) of another rod.

    Each is looked for from that rod's q (t, 6), and from what was found for the row before, the first one from `near`
    (6,): from afar a fit may end at another shape than the nearest.
    """
    found, pull = np.empty_like(q), PULL / p[0] ** 2
    starts, costs = np.empty((2, q.shape[1])), np.empty(2)
    for t in range(len(q)):
        for a in range(q.shape[1]):
            starts[0, a] = q[t, a]
            starts[1, a] = near[a] if t == 0 else found[t - 1, a] + (q[t, a] - q[t - 1, a])
        for start in range(2):
            costs[start] = fit_shape(starts[start], wanted[t], p, modes, stride, pull, QUICK)
        best = 1 if costs[1] < costs[0] - CLOSER else 0
        for a in range(q.shape[1]):
            found[t, a] = starts[best, a]
    return found
