"""Compiled kernels of `cableway.control.rod_mpc`: what the adapted rod predicts, and the steps of the optimiser.

Arrays are those of `cableway.rod.adapted_kernels`; theta is laid out as in `cableway.rod.adapted`.
"""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import kernel
from cableway.estimation.rod_kernels import factorize_squared
from cableway.geometry.convex import nearest_obstacle
from cableway.rod.adapted_kernels import (
    adapted_shape,
    add_row,
    clear,
    copy,
    end_rates,
    factorize,
    longest_of,
    scaled_shape,
    scales,
    substitute,
    workspace,
)


@kernel
def _add_change(normal, gradient, later, earlier, residual, weight, at):
    """Add one weighted residual: by `later` of the six unknowns from `at` on, less by `earlier` of the six before."""
    add_row(normal, gradient, later, residual, weight, at)
    for a in range(6):
        wa = weight * earlier[a]
        gradient[at - 6 + a] -= wa * residual
        for b in range(6):
            if b <= a:
                normal[at - 6 + a, at - 6 + b] += wa * earlier[b]
            normal[at + b, at - 6 + a] -= wa * later[b]


@kernel
def _add_tracking(normal, gradient, stations, dstations, stride, offset, wanted, weight, at):
    """Add the distances of the keypoints, with the offset, from those wanted (n, 2). Returns the cost."""
    cost = 0.0
    for i in range(len(wanted)):
        j = i * stride
        for k in range(2):
            residual = stations[j, k] + offset[j, k] - wanted[i, k]
            add_row(normal, gradient, dstations[j, k], residual, weight, at)
            cost += weight * residual * residual
    return cost


@kernel
def _add_clearance(normal, gradient, stations, dstations, offset, world, limits, weight, rates, at):
    """Add what the clearance of the stations, with the offset, lacks; the ends are the grippers. Returns the cost."""
    _, _, cable_radius, gripper_radius, threshold, _ = limits
    cost = 0.0
    for j in range(len(stations)):
        radius = gripper_radius if j == 0 or j == len(stations) - 1 else cable_radius
        x, y = stations[j, 0] + offset[j, 0], stations[j, 1] + offset[j, 1]
        distance, gx, gy, _ = nearest_obstacle(x, y, world, threshold + radius)
        short = threshold - (distance - radius)
        if short > 0.0:
            for a in range(6):
                rates[a] = -gx * dstations[j, 0, a] - gy * dstations[j, 1, a]
            add_row(normal, gradient, rates, short, weight, at)
            cost += weight * short * short
    return cost


@kernel
def _add_motion(normal, gradient, ends, dends, last, dlast, wanted, limits, weights, rates, earlier, at):
    """Add how far the motion of the ends is from the one wanted (2, 3), and beyond its limits. Returns the cost."""
    max_step, max_turn = limits[0], limits[1]
    w_motion, lever, w_limit = weights[1], weights[2], weights[6]
    cost = 0.0
    for side in range(2):
        for k in range(3):
            weight = lever * lever if k == 2 else 1.0
            moved = ends[side, k] - last[side, k]
            residual = moved - wanted[side, k]
            _add_change(normal, gradient, dends[side, k], dlast[side, k], residual, w_motion * weight, at)
            cost += w_motion * weight * residual * residual
            if k == 2 and abs(moved) > max_turn:
                over = moved - math.copysign(max_turn, moved)
                _add_change(normal, gradient, dends[side, k], dlast[side, k], over, w_limit * weight, at)
                cost += w_limit * weight * over * over
        dx, dy = ends[side, 0] - last[side, 0], ends[side, 1] - last[side, 1]
        moved = math.hypot(dx, dy)
        if moved > max_step:
            for a in range(6):
                rates[a] = (dx * dends[side, 0, a] + dy * dends[side, 1, a]) / moved
                earlier[a] = (dx * dlast[side, 0, a] + dy * dlast[side, 1, a]) / moved
            over = moved - max_step
            _add_change(normal, gradient, rates, earlier, over, w_limit, at)
            cost += w_limit * over * over
    return cost


@kernel
def _add_separation(normal, gradient, ends, dends, least, most, weight, rates, at):
    """Add how far the distance between the ends is outside [least, most]. Returns the cost."""
    gx, gy = ends[1, 0] - ends[0, 0], ends[1, 1] - ends[0, 1]
    gap = max(math.hypot(gx, gy), 1e-9)
    wrong = max(gap - most, 0.0) - max(least - gap, 0.0)
    if wrong != 0.0:
        for a in range(6):
            rates[a] = (gx * (dends[1, 0, a] - dends[0, 0, a]) + gy * (dends[1, 1, a] - dends[0, 1, a])) / gap
        add_row(normal, gradient, rates, wrong, weight, at)
    return weight * wrong * wrong


@kernel
def assemble(
    q, before, p, modes, stride, offset, wanted, steps, loads, longest, world, limits, weights, normal, gradient
):
    """Half the sum of the squares over the horizon, its Gauss-Newton matrix (lower) and gradient, see `rod_mpc`.

    The first six unknowns stand for the shape now, which is given; their rows are zero.

    Args:
        q: (H, 6) shapes.
        before: (2, 3) end poses of the rod now.
        p, modes, stride: The rod.
        offset: (2N+1, 2) [m] added to every station.
        wanted: (H, n, 2) [m].
        steps: (H, 2, 3) wanted motions of the ends.
        loads: (H, 3) wanted loads.
        longest: (H,) [m] greatest distance between the ends.
        world: arrays of `convex.ConvexWorld`.
        limits: largest step, turn; radius of cable, of grippers; clearance wanted; least distance of the grippers.
        weights: tracking, motion, lever of turns, load, clearance, separation, limits.
        normal: (6 + 6H, 6 + 6H), changed.
        gradient: (6 + 6H,), changed.
    """
    w_track, w_load, w_clear, w_apart = weights[0], weights[3], weights[4], weights[5]
    stations, dstations, ends, dends = workspace(modes)
    last, dlast, rates, earlier = before.copy(), np.zeros((2, 3, 6)), np.empty(6), np.empty(6)
    scale = scales(p[0])
    clear(normal, gradient)
    cost = 0.0
    for t in range(len(q)):
        at = 6 + 6 * t
        scaled_shape(q[t], p, modes, scale, stations, dstations, ends, dends)
        cost += _add_tracking(normal, gradient, stations, dstations, stride, offset, wanted[t], w_track, at)
        for k in range(3):
            residual = (q[t, 3 + k] - loads[t, k]) / scale[3 + k]
            normal[at + 3 + k, at + 3 + k] += w_load
            gradient[at + 3 + k] += w_load * residual
            cost += w_load * residual * residual
        cost += _add_clearance(normal, gradient, stations, dstations, offset, world, limits, w_clear, rates, at)
        cost += _add_motion(normal, gradient, ends, dends, last, dlast, steps[t], limits, weights, rates, earlier, at)
        cost += _add_separation(normal, gradient, ends, dends, limits[5], longest[t], w_apart, rates, at)
        copy(ends, last)
        for side in range(2):
            for k in range(3):
                for a in range(6):
                    dlast[side, k, a] = dends[side, k, a]
    return 0.5 * cost


@kernel
def optimize(
    q, before, p, modes, stride, offset, wanted, steps, loads, longest, world, limits, weights, iterations, tolerance
):
    """Levenberg-Marquardt on `assemble` from q (H, 6), which it changes. Returns the cost at the start and the end."""
    size = 6 + q.size
    normal, gradient, step = np.empty((size, size)), np.empty(size), np.empty(q.size)
    trial_normal, trial_gradient = np.empty((size, size)), np.empty(size)
    factor, scale, trial = np.empty((q.size, q.size)), scales(p[0]), q.copy()
    start, cost, damping, first = 0.0, np.inf, 1e-9, True
    for _ in range(iterations + 1):
        trial_cost = np.inf
        while not trial_cost < cost and damping < 1e3:
            if not first:
                factorize(normal[6:, 6:], damping, factor)
                for a in range(q.size):
                    step[a] = -gradient[6 + a]
                substitute(factor, step)
                share = min(1.0, 0.5 / longest_of(step))
                for a in range(q.size):
                    trial[a // 6, a % 6] = q[a // 6, a % 6] + share * scale[a % 6] * step[a]
            trial_cost = assemble(
                trial, before, p, modes, stride, offset, wanted, steps, loads, longest, world, limits, weights,
                trial_normal, trial_gradient,
            )  # fmt: skip
            if first and not trial_cost < np.inf:
                return trial_cost, trial_cost
            damping = max(damping / 10.0, 1e-9) if trial_cost < cost else max(damping, 1e-5) * 10.0
        if not trial_cost < cost:
            break
        small = cost - trial_cost < tolerance * cost and not first
        if first:
            start, first = trial_cost, False
        cost = trial_cost
        copy(trial, q)
        copy(trial_normal, normal)
        for a in range(size):
            gradient[a] = trial_gradient[a]
        if small:
            break
    return start, cost


@kernel
def motion_jacobian(q, p, modes, stride, n):
    """Derivative (2n, 6) of the keypoints [m] by the end poses (x, y, theta left, right) [m, m, rad] at the shape q.

    Near a fold, where shapes run away, it is that of the nearest motions that the rod can make.
    """
    stations, dstations, ends, dends = workspace(modes)
    adapted_shape(q, p, modes, stations, dstations, ends, dends)
    scale, rates, factor, moved = scales(p[0]), np.empty((6, 6)), np.empty((6, 6)), np.empty(6)
    end_rates(dends, p[0], scale, rates)
    factorize_squared(rates, 1e-4, factor)
    found = np.zeros((2 * n, 6))
    for row in range(6):
        for a in range(6):
            moved[a] = rates[row, a] / (1.0 if row % 3 == 2 else p[0])
        substitute(factor, moved)
        for i in range(n):
            for k in range(2):
                for a in range(6):
                    found[2 * i + k, row] += dstations[i * stride, k, a] * scale[a] * moved[a]
    return found
