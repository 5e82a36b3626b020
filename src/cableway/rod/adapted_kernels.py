"""Compiled kernels of a rod that is not uniform; `cableway.rod.adapted` explains the quantities.

The recursion is that of `cableway.rod.kernels`, station for station, with a compliance and a bend at rest for each
hinge. Parameters p (1 + 2K,): length L, K modes of the logarithm of the stiffness, K modes of the turn at rest.
"""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import kernel

LOAD_SCALE = (10.0, 10.0, 3.0)
"""Units of (a_x, a_y, m) in which steps are measured."""


@kernel
def _walk(side, load, p, modes, points, jacobian):
    """Go outward from the centre to one end (side +1 right, -1 left) in the centre frame, in lengths of the rod.

    Fills `points` (2N+2, 2) and `jacobian` (2N+2, 2, 3 + 2K), the derivative by load and modes, for that half. The
    last row holds the end angles.
    """
    count, hinges = modes.shape
    columns = 3 + 2 * count
    half = 1.0 / (2 * hinges)
    x, y, angle = 0.0, 0.0, 0.0
    dx, dy, dangle = np.zeros(columns), np.zeros(columns), np.zeros(columns)
    station = hinges
    share = 0.5  # of the centre hinge's bend that lies on this side, where a hinge is at the centre
    for step in range(hinges + 1):
        if step > 0:
            c, s = math.cos(angle), math.sin(angle)
            x += side * half * c
            y += side * half * s
            for k in range(columns):
                dx[k] -= side * half * s * dangle[k]
                dy[k] += side * half * c * dangle[k]
            station += side
            share = 1.0
        points[station, 0], points[station, 1] = x, y
        for k in range(columns):
            jacobian[station, 0, k], jacobian[station, 1, k] = dx[k], dy[k]
        if station % 2 == 1:
            hinge = station // 2
            softness, rest = 0.0, 0.0
            for k in range(count):
                softness -= p[1 + k] * modes[k, hinge]
                rest += p[1 + count + k] * modes[k, hinge]
            softness = math.exp(softness)
            moment = load[2] + load[0] * y - load[1] * x
            scale = side * share / hinges
            for k in range(columns):
                dangle[k] += scale * softness * (load[0] * dy[k] - load[1] * dx[k])
            dangle[0] += scale * softness * y
            dangle[1] -= scale * softness * x
            dangle[2] += scale * softness
            for k in range(count):
                dangle[3 + k] -= scale * softness * modes[k, hinge] * moment
                dangle[3 + count + k] += scale * modes[k, hinge]
            angle += scale * (softness * moment + rest)
    row = 0 if side < 0 else 1
    points[2 * hinges + 1, row] = angle
    for k in range(columns):
        jacobian[2 * hinges + 1, row, k] = dangle[k]


@kernel
def adapted_shape(q, p, modes, stations, dstations, poses, dposes):
    """Stations (2N+1, 2) and end poses (2, 3) of q, with derivatives by (q, p): (2N+1, 2, 7 + 2K), (2, 3, 7 + 2K)."""
    count, hinges = modes.shape
    points, jacobian = np.empty((2 * hinges + 2, 2)), np.zeros((2 * hinges + 2, 2, 3 + 2 * count))
    _walk(1, q[3:], p, modes, points, jacobian)
    _walk(-1, q[3:], p, modes, points, jacobian)
    c, s, length = math.cos(q[2]), math.sin(q[2]), p[0]
    for i in range(2 * hinges + 1):
        ux = c * points[i, 0] - s * points[i, 1]
        uy = s * points[i, 0] + c * points[i, 1]
        stations[i, 0], stations[i, 1] = q[0] + length * ux, q[1] + length * uy
        dstations[i, 0, 0], dstations[i, 1, 0] = 1.0, 0.0
        dstations[i, 0, 1], dstations[i, 1, 1] = 0.0, 1.0
        dstations[i, 0, 2], dstations[i, 1, 2] = -length * uy, length * ux
        dstations[i, 0, 6], dstations[i, 1, 6] = ux, uy
        for k in range(3 + 2 * count):
            column = 3 + k if k < 3 else 4 + k
            dstations[i, 0, column] = length * (c * jacobian[i, 0, k] - s * jacobian[i, 1, k])
            dstations[i, 1, column] = length * (s * jacobian[i, 0, k] + c * jacobian[i, 1, k])
    for k in range(2):
        i = 2 * hinges * k
        for m in range(2):
            poses[k, m] = stations[i, m]
            for a in range(7 + 2 * count):
                dposes[k, m, a] = dstations[i, m, a]
        poses[k, 2] = q[2] + points[2 * hinges + 1, k]
        for a in range(7 + 2 * count):
            dposes[k, 2, a] = 1.0 if a == 2 else 0.0
        for a in range(3 + 2 * count):
            dposes[k, 2, 3 + a if a < 3 else 4 + a] = jacobian[2 * hinges + 1, k, a]


@kernel
def workspace(modes):
    """Empty arrays for `adapted_shape`."""
    count, hinges = modes.shape
    columns = 7 + 2 * count
    return (
        np.empty((2 * hinges + 1, 2)),
        np.empty((2 * hinges + 1, 2, columns)),
        np.empty((2, 3)),
        np.empty((2, 3, columns)),
    )


@kernel
def scales(length):
    """Units of q in which steps are measured."""
    return np.array([length, length, 1.0, LOAD_SCALE[0], LOAD_SCALE[1], LOAD_SCALE[2]])


@kernel
def factorize(normal, damping, factor):
    """Cholesky's factor (lower) of `normal`, whose diagonal is made larger by the share `damping`."""
    for a in range(len(normal)):
        for b in range(a + 1):
            total = normal[a, b] * (1.0 + damping) if a == b else normal[a, b]
            for c in range(b):
                total -= factor[a, c] * factor[b, c]
            factor[a, b] = math.sqrt(max(total, 1e-14)) if a == b else total / factor[b, b]


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


@kernel
def end_rates(dposes, length, scale, rates):
    """Derivative (6, 6) of the end poses, in lengths and radians, by q in units of `scale`."""
    for row in range(6):
        for a in range(6):
            unit = 1.0 if row % 3 == 2 else length
            rates[row, a] = dposes[row // 3, row % 3, a] / unit * scale[a]


@kernel
def meet_ends(q, ends, p, modes, iterations):
    """Levenberg-Marquardt from q (6,), which it changes, to the shape with end poses `ends` (2, 3).

    Angles count as they are, not modulo a turn. Returns the residual left, in lengths and radians.
    """
    stations, dstations, poses, dposes = workspace(modes)
    scale, trial = scales(p[0]), q.copy()
    rates, normal, factor = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    step, residual, gradient = np.empty(6), np.empty(6), np.empty(6)
    adapted_shape(q, p, modes, stations, dstations, poses, dposes)
    cost = _end_residual(poses, ends, p[0], residual)
    damping = 1e-9
    for _ in range(iterations):
        if cost < 1e-20:
            break
        end_rates(dposes, p[0], scale, rates)
        _normal_equations(rates, residual, normal, gradient)
        changed = np.inf
        while not changed < cost and damping < 1e6:
            factorize(normal, damping, factor)
            for a in range(6):
                step[a] = -gradient[a]
            substitute(factor, step)
            for a in range(6):
                trial[a] = q[a] + scale[a] * step[a]
            adapted_shape(trial, p, modes, stations, dstations, poses, dposes)
            changed = _end_residual(poses, ends, p[0], residual)
            damping = max(damping / 10.0, 1e-12) if changed < cost else max(damping, 1e-9) * 10.0
        if not changed < cost:
            break
        for a in range(6):
            q[a] = trial[a]
        cost = changed
    return math.sqrt(cost)


@kernel
def _normal_equations(rates, residual, normal, gradient):
    for a in range(6):
        gradient[a] = 0.0
        for row in range(6):
            gradient[a] += rates[row, a] * residual[row]
        for b in range(a + 1):
            normal[a, b] = 0.0
            for row in range(6):
                normal[a, b] += rates[row, a] * rates[row, b]


@kernel
def _end_residual(poses, ends, length, residual):
    total = 0.0
    for side in range(2):
        for k in range(3):
            error = (poses[side, k] - ends[side, k]) / (1.0 if k == 2 else length)
            residual[3 * side + k] = error
            total += error * error
    return total


@kernel
def add_row(normal, gradient, rates, residual, weight, at):
    """Add one weighted residual that depends on the six unknowns from `at` on."""
    for a in range(6):
        wa = weight * rates[a]
        gradient[at + a] += wa * residual
        for b in range(a + 1):
            normal[at + a, at + b] += wa * rates[b]


@kernel
def scaled_shape(q, p, modes, scale, stations, dstations, poses, dposes):
    """`adapted_shape` with the derivatives by q in units of `scale` (6,)."""
    adapted_shape(q, p, modes, stations, dstations, poses, dposes)
    for a in range(6):
        for k in range(2):
            for i in range(len(stations)):
                dstations[i, k, a] *= scale[a]
            for m in range(3):
                dposes[k, m, a] *= scale[a]


@kernel
def clear(normal, gradient):
    """Set a square matrix and a vector of its size to zero."""
    for a in range(len(gradient)):
        gradient[a] = 0.0
        for b in range(len(gradient)):
            normal[a, b] = 0.0


@kernel
def copy(source, target):
    """Write one matrix over another."""
    for a in range(source.shape[0]):
        for b in range(source.shape[1]):
            target[a, b] = source[a, b]


@kernel
def longest_of(step):
    """Largest size of its numbers; never zero."""
    longest = 1e-30
    for value in step:
        longest = max(longest, abs(value))
    return longest


@kernel
def fit_shapes(q, wanted, p, modes, stride, pull, iterations, keypoints, ends):
    """Move each row of q (H, 6) to the shape nearest to keypoints `wanted` (H, n, 2), by Gauss-Newton steps.

    A pull on the change of the load keeps it where keypoints cannot tell; weight `pull` [m^2]. Fills `keypoints`
    (H, n, 2) and `ends` (H, 2, 3) of the shapes found.
    """
    stations, dstations, poses, dposes = workspace(modes)
    scale = scales(p[0])
    normal, gradient, factor, step = np.empty((6, 6)), np.empty(6), np.empty((6, 6)), np.empty(6)
    for t in range(len(q)):
        for iteration in range(iterations + 1):
            scaled_shape(q[t], p, modes, scale, stations, dstations, poses, dposes)
            if iteration == iterations:
                break
            clear(normal, gradient)
            for i in range(wanted.shape[1]):
                for k in range(2):
                    residual = stations[i * stride, k] - wanted[t, i, k]
                    add_row(normal, gradient, dstations[i * stride, k], residual, 1.0, 0)
            for a in range(3, 6):
                normal[a, a] += pull
            factorize(normal, 1e-9, factor)
            for a in range(6):
                step[a] = -gradient[a]
            substitute(factor, step)
            longest = longest_of(step)
            for a in range(6):
                q[t, a] += min(1.0, 0.3 / longest) * scale[a] * step[a]
            if longest < 1e-5:
                scaled_shape(q[t], p, modes, scale, stations, dstations, poses, dposes)
                break
        for i in range(wanted.shape[1]):
            keypoints[t, i, 0], keypoints[t, i, 1] = stations[i * stride, 0], stations[i * stride, 1]
        copy(poses, ends[t])
