"""Compiled kernels of `cableway.control.rod_mpc`: what the adapted rod predicts, and the steps of the optimiser.

Arrays are those of `cableway.rod.fitting`; theta is laid out as in `cableway.rod.material`.

Note:
    Clearance, of bodies from each other and from the cable too, and gripper span are the terms of
    `cableway.motion.terms`, by the same points round the bodies. Here they go row by row into the normal equations,
    without arrays of slopes in between: one optimisation takes a millisecond.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from cableway.core.compiled import inlined, kernel
from cableway.geometry.convex import convex_distance, nearest_obstacle
from cableway.rod.fitting import scaled_shape, scales, workspace
from cableway.rod.least_squares import Rule, add_row, advance, begin

CORRECTION = Rule(least=1e-9, restart=1e-5, most=1e3, fall=1e-4, steps=4.0, max_step=0.5)
"""Few steps, since one optimisation goes on from the last one; a fall of the cost by less than 0.01% is not worth
another."""


class Wanted(NamedTuple):
    """What the shapes of a horizon of H steps are to be.

    Attributes:
        shapes: (H, n, 2) keypoints [m].
        steps: (H, 2, 3) motions of the ends [m, m, rad].
        loads: (H, 3).
        max_span: (H,) greatest distance between the ends [m].
        clearance: (H,) [m].
    """

    shapes: Float[np.ndarray, "H n 2"]
    steps: Float[np.ndarray, "H 2 3"]
    loads: Float[np.ndarray, "H 3"]
    max_span: Float[np.ndarray, "H"]
    clearance: Float[np.ndarray, "H"]


class Limits(NamedTuple):
    """What a task allows; floats all, or the kernels are compiled anew.

    Attributes:
        max_step: Of a gripper in a step [m].
        max_turn: [rad].
        least_span: Least distance of the grippers [m].
        cable_radius: [m].
    """

    max_step: float
    max_turn: float
    least_span: float
    cable_radius: float


class Weights(NamedTuple):
    """Weights of the terms, as `cableway.control.rod_mpc` has them; floats all.

    Attributes:
        tracking: w_s [1/m^2].
        motion: w_m [1/m^2].
        turn_lever: Motion that a turn of 1 rad counts as [m].
        load: w_l.
        clearance: w_c [1/m^2].
        span: w_g [1/m^2].
        limits: w_b [1/m^2].
    """

    tracking: float
    motion: float
    turn_lever: float
    load: float
    clearance: float
    span: float
    limits: float


@inlined
def _add_change(normal, gradient, later, earlier, residual, weight, at):
    """Add one weighted residual: by `later` of the d unknowns from `at` on, less by `earlier` of the d before."""
    add_row(normal, gradient, later, residual, weight, at)
    if at == 0:
        return
    d = len(later)
    for a in range(d):
        wa = weight * earlier[a]
        gradient[at - d + a] -= wa * residual
        for b in range(d):
            if b <= a:
                normal[at - d + a, at - d + b] += wa * earlier[b]
            normal[at + b, at - d + a] -= wa * later[b]


@inlined
def _add_tracking(normal, gradient, stations, dstations, stride, offset, wanted, weight, at):
    """Add the distances of the keypoints, with the offset, from those wanted (n, 2). Returns the cost."""
    cost = 0.0
    for i in range(len(wanted)):
        j = i * stride
        for k in range(wanted.shape[1]):
            residual = stations[j, k] + offset[j, k] - wanted[i, k]
            add_row(normal, gradient, dstations[j, k], residual, weight, at)
            cost += weight * residual * residual
    return cost


@inlined
def _add_clearance(
    normal, gradient, stations, dstations, ends, dends, offset, bodies, world, cable_radius, wanted, weight, rates, at
):
    """Add what the clearance of the inner stations and of the points round the bodies lacks, with the offset.

    Returns the cost.
    """
    last, cost = len(stations) - 1, 0.0
    for j in range(last - 1 + len(bodies.side)):
        place, side, radius, lowest, arm_x, arm_y = j + 1, 0, cable_radius, 0.0, 0.0, 0.0
        if j >= last - 1:
            i = j - (last - 1)
            side, radius, lowest = bodies.side[i], bodies.rounding[i], bodies.lowest[i]
            place = last * side
            c, s = math.cos(ends[side, 2]), math.sin(ends[side, 2])
            arm_x, arm_y = c * bodies.at[i, 0] - s * bodies.at[i, 1], s * bodies.at[i, 0] + c * bodies.at[i, 1]
        x, y = stations[place, 0] + offset[place, 0] + arm_x, stations[place, 1] + offset[place, 1] + arm_y
        distance, gx, gy, _ = nearest_obstacle(x, y, world, wanted + radius, lowest)
        short = wanted - (distance - radius)
        if short > 0.0:
            for a in range(len(rates)):
                turn = dends[side, 2, a]
                rates[a] = -gx * (dstations[place, 0, a] - arm_y * turn) - gy * (dstations[place, 1, a] + arm_x * turn)
            add_row(normal, gradient, rates, short, weight, at)
            cost += weight * short * short
    return cost


@inlined
def _add_meetings(
    normal,
    gradient,
    stations,
    dstations,
    ends,
    dends,
    offset,
    meetings,
    length,
    cable_radius,
    wanted,
    weight,
    rates,
    at,
):
    """Add what bodies lack of clearance from each other and from the cable, with the offset. Returns the cost."""
    last, cost = len(stations) - 1, 0.0
    for m in range(len(meetings.side)):
        side, first, count = meetings.side[m], meetings.begins[m], meetings.begins[m + 1] - meetings.begins[m]
        place, spot, radius, start, arm_x, arm_y = last * side, last * (1 - side), 0.0, 0, 0.0, 0.0
        at_x, at_y = stations[place, 0] + offset[place, 0], stations[place, 1] + offset[place, 1]
        cable = count == 0
        if cable:
            radius = cable_radius
            start = math.ceil((meetings.reach[m] + cable_radius + wanted) * last / length)
            count = last + 1 - start
        elif (
            math.hypot(stations[spot, 0] + offset[spot, 0] - at_x, stations[spot, 1] + offset[spot, 1] - at_y)
            >= meetings.reach[m] + wanted
        ):
            count = 0
        c, s, co, so = math.cos(ends[side, 2]), math.sin(ends[side, 2]), 1.0, 0.0
        if not cable:
            co, so = math.cos(ends[1 - side, 2]), math.sin(ends[1 - side, 2])
        for i in range(count):
            if cable:
                spot = start + i if side == 0 else i
            else:
                px, py = meetings.at[first + i, 0], meetings.at[first + i, 1]
                arm_x, arm_y = co * px - so * py, so * px + co * py
            x, y = (
                stations[spot, 0] + offset[spot, 0] + arm_x - at_x,
                stations[spot, 1] + offset[spot, 1] + arm_y - at_y,
            )
            distance, gx, gy = convex_distance(
                c * x + s * y, c * y - s * x, meetings.outline[m], meetings.counts[m], radius
            )
            short = wanted - distance
            if short > 0.0:
                gx, gy = c * gx - s * gy, s * gx + c * gy
                for a in range(len(rates)):
                    turn, other = dends[side, 2, a], 0.0 if cable else dends[1 - side, 2, a]
                    dx = dstations[spot, 0, a] - arm_y * other - dstations[place, 0, a] + y * turn
                    dy = dstations[spot, 1, a] + arm_x * other - dstations[place, 1, a] - x * turn
                    rates[a] = -gx * dx - gy * dy
                add_row(normal, gradient, rates, short, weight, at)
                cost += weight * short * short
    return cost


@inlined
def _add_motion(normal, gradient, ends, dends, last, dlast, wanted, limits, weights, rates, earlier, at):
    """Add how far the motion of the ends is from the one wanted (2, 3), and beyond its limits. Returns the cost."""
    w_motion, lever, w_limit = weights.motion, weights.turn_lever, weights.limits
    cost = 0.0
    for side in range(2):
        for k in range(3):
            weight = lever * lever if k == 2 else 1.0
            moved = ends[side, k] - last[side, k]
            residual = moved - wanted[side, k]
            _add_change(normal, gradient, dends[side, k], dlast[side, k], residual, w_motion * weight, at)
            cost += w_motion * weight * residual * residual
            if k == 2 and abs(moved) > limits.max_turn:
                over = moved - math.copysign(limits.max_turn, moved)
                _add_change(normal, gradient, dends[side, k], dlast[side, k], over, w_limit * weight, at)
                cost += w_limit * weight * over * over
        dx, dy = ends[side, 0] - last[side, 0], ends[side, 1] - last[side, 1]
        moved = math.hypot(dx, dy)
        if moved > limits.max_step:
            for a in range(len(rates)):
                rates[a] = (dx * dends[side, 0, a] + dy * dends[side, 1, a]) / moved
                earlier[a] = (dx * dlast[side, 0, a] + dy * dlast[side, 1, a]) / moved
            over = moved - limits.max_step
            _add_change(normal, gradient, rates, earlier, over, w_limit, at)
            cost += w_limit * over * over
    return cost


@inlined
def _add_separation(normal, gradient, ends, dends, least, most, weight, rates, at):
    """Add how far the distance between the ends is outside [least, most]. Returns the cost."""
    gx, gy = ends[1, 0] - ends[0, 0], ends[1, 1] - ends[0, 1]
    gap = max(math.hypot(gx, gy), 1e-9)
    wrong = max(gap - most, 0.0) - max(least - gap, 0.0)
    if wrong != 0.0:
        for a in range(len(rates)):
            rates[a] = (gx * (dends[1, 0, a] - dends[0, 0, a]) + gy * (dends[1, 1, a] - dends[0, 1, a])) / gap
        add_row(normal, gradient, rates, wrong, weight, at)
    return weight * wrong * wrong


@inlined
def assemble(q, before, p, modes, stride, offset, wanted, bodies, meetings, world, limits, weights, normal, gradient):
    """Half the sum of the squares over the horizon, its Gauss-Newton matrix (lower) and gradient, see `rod_mpc`.

    Unknowns are counted in units of `scales`.

    Args:
        q: (H, 6) shapes.
        before: (2, 3) end poses of the rod now.
        p, modes, stride: The rod.
        offset: (2N+1, 2) [m] added to every station.
        wanted: `Wanted`.
        bodies: `cableway.motion.limits.BodyPoints`.
        meetings: `cableway.motion.limits.BodyMeetings`.
        world: arrays of `convex.ConvexWorld`.
        limits: `Limits`.
        weights: `Weights`.
        normal: (6H, 6H), changed.
        gradient: (6H,), changed.
    """
    d, scale = q.shape[1], scales(p[0])
    stations, dstations, ends, dends = workspace(modes, d)
    first_load = d - wanted.loads.shape[1]
    last, dlast, rates, earlier = before.copy(), np.zeros_like(dends), np.empty(d), np.empty(d)
    normal[:] = 0.0
    gradient[:] = 0.0
    cost = 0.0
    for t in range(len(q)):
        at = d * t
        scaled_shape(q[t], p, modes, scale, stations, dstations, ends, dends)
        cost += _add_tracking(
            normal, gradient, stations, dstations, stride, offset, wanted.shapes[t], weights.tracking, at
        )
        for k in range(first_load, d):
            residual = (q[t, k] - wanted.loads[t, k - first_load]) / scale[k]
            normal[at + k, at + k] += weights.load
            gradient[at + k] += weights.load * residual
            cost += weights.load * residual * residual
        cost += _add_clearance(
            normal, gradient, stations, dstations, ends, dends, offset, bodies, world, limits.cable_radius,
            wanted.clearance[t], weights.clearance, rates, at,
        )  # fmt: skip
        cost += _add_meetings(
            normal, gradient, stations, dstations, ends, dends, offset, meetings, p[0], limits.cable_radius,
            wanted.clearance[t], weights.clearance, rates, at,
        )  # fmt: skip
        cost += _add_motion(
            normal, gradient, ends, dends, last, dlast, wanted.steps[t], limits, weights, rates, earlier, at
        )
        cost += _add_separation(
            normal, gradient, ends, dends, limits.least_span, wanted.max_span[t], weights.span, rates, at
        )
        last[:] = ends
        dlast[:] = dends
    return 0.5 * cost


@kernel
def optimize(q, before, p, modes, stride, offset, wanted, bodies, meetings, world, limits, weights):
    """Damped least squares on `assemble` from q (H, 6), which it changes."""
    search, units = begin(q.ravel()), np.empty(q.size)
    scale = scales(p[0])
    for a in range(q.size):
        units[a] = scale[a % len(scale)]
    while True:
        cost = assemble(
            search.trial.reshape(q.shape), before, p, modes, stride, offset, wanted, bodies, meetings, world, limits,
            weights, search.trial_normal, search.trial_gradient,
        )  # fmt: skip
        if not advance(search, cost, units, CORRECTION):
            break
    q[:] = search.x.reshape(q.shape)
