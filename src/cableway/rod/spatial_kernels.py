"""Compiled kernels of the rod in space; `cableway.rod.spatial` explains the quantities and is what to call.

Parameters p (3,): length L, twisting stiffness kappa = C/B, weight gamma = rho A g L^3/B; and `stiff` (N,), the bending
stiffness of each hinge by B/L, which is N for a uniform rod. N is even, so a link has its middle at the rod's centre.
Stations are those of the planar rod: 2N + 1 of them.

Derivatives are by small steps of q: columns 0-2 move the centre, 3-5 turn it about the world's axes, 6-8 and 9-11
change force and moment in the centre's frame.
"""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import inlined, kernel

INNER = 9
"""Columns that a walk carries: all but those that move the centre."""

SMALL = 1e-4
"""Angle [rad] below which the first terms of a series are exact."""


@inlined
def cross(a, b, out):
    """a x b (3,)."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@inlined
def dot(a, b):
    """a . b of (3,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _series(v, linear, square, out):
    """1 + linear [v] + square [v]^2, with [v] w = v x w."""
    size = dot(v, v)
    for i in range(3):
        for j in range(3):
            out[i, j] = square * v[i] * v[j]
        out[i, i] += 1.0 - square * size
    out[0, 1] -= linear * v[2]
    out[1, 0] += linear * v[2]
    out[0, 2] += linear * v[1]
    out[2, 0] -= linear * v[1]
    out[1, 2] -= linear * v[0]
    out[2, 1] += linear * v[0]


@kernel
def rotation(v, out):
    """The matrix (3, 3) of a rotation vector (Rodrigues)."""
    angle = math.sqrt(dot(v, v))
    if angle < SMALL:
        _series(v, 1.0 - angle * angle / 6.0, 0.5 - angle * angle / 24.0, out)
    else:
        _series(v, math.sin(angle) / angle, (1.0 - math.cos(angle)) / (angle * angle), out)


@kernel
def turns_of(v, out):
    """The matrix (3, 3) from changes of a rotation vector to small turns about the world's axes."""
    angle = math.sqrt(dot(v, v))
    if angle < SMALL:
        _series(v, 0.5, 1.0 / 6.0, out)
    else:
        _series(v, (1.0 - math.cos(angle)) / angle**2, (angle - math.sin(angle)) / angle**3, out)


@kernel
def changes_of(v, out):
    """The inverse of `turns_of`."""
    angle = math.sqrt(dot(v, v))
    if angle < SMALL:
        _series(v, -0.5, 1.0 / 12.0, out)
    else:
        _series(v, -0.5, 1.0 / angle**2 - 0.5 / (angle * math.tan(0.5 * angle)), out)


@kernel
def quaternion(tangent, across, out):
    """The unit quaternion (w, x, y, z), w not negative, of the frame with these first two axes (Shepperd 1978)."""
    third = np.empty(3)
    cross(tangent, across, third)
    xx, yy, zz = tangent[0], across[1], third[2]
    trace = xx + yy + zz
    if trace > max(xx, max(yy, zz)):
        out[0] = 1.0 + trace
        out[1], out[2], out[3] = across[2] - third[1], third[0] - tangent[2], tangent[1] - across[0]
    elif xx >= yy and xx >= zz:
        out[0], out[1] = across[2] - third[1], 1.0 + xx - yy - zz
        out[2], out[3] = tangent[1] + across[0], third[0] + tangent[2]
    elif yy >= zz:
        out[0], out[1] = third[0] - tangent[2], tangent[1] + across[0]
        out[2], out[3] = 1.0 + yy - xx - zz, across[2] + third[1]
    else:
        out[0], out[1] = tangent[1] - across[0], third[0] + tangent[2]
        out[2], out[3] = across[2] + third[1], 1.0 + zz - xx - yy
    norm = math.sqrt(out[0] * out[0] + dot(out[1:], out[1:]))
    if out[0] < 0.0:
        norm = -norm
    for k in range(4):
        out[k] /= norm


@inlined
def _turn(side, stiff, tau, t, m, d, rates, dt, dm, dtau, spin, w, dw, a, b):
    """Go over a hinge: the tangent t, the frame's second axis d, and their changes `dt` and `spin` by `rates` columns.

    t' = ((1 - |w|^2) t + 2 w) / (1 + |w|^2) solves m = 2 stiff t x t'/(1 + t.t') + tau (t + t')/(1 + t.t').
    """
    share = 1.0 / (tau * tau + 4.0 * stiff * stiff)
    cross(t, m, a)
    for k in range(3):
        w[k] = share * (tau * (m[k] - tau * t[k]) - side * 2.0 * stiff * a[k])
    square = dot(w, w)
    for k in range(3):
        b[k] = ((1.0 - square) * t[k] + 2.0 * w[k]) / (1.0 + square)  # t'
    about = 1.0 + dot(t, b)
    for column in range(rates):
        change = dtau[column]
        cross(dt[column], m, a)
        for k in range(3):
            dw[k] = change * (m[k] - 2.0 * tau * t[k]) + tau * (dm[column, k] - tau * dt[column, k])
            dw[k] -= side * 2.0 * stiff * a[k] + 2.0 * tau * change * w[k]
        cross(t, dm[column], a)
        dsquare = 0.0
        for k in range(3):
            dw[k] = share * (dw[k] - side * 2.0 * stiff * a[k])
            dsquare += 2.0 * w[k] * dw[k]
        onto = dot(spin[column], t) + dot(spin[column], b)
        for k in range(3):
            dt[column, k] = ((1.0 - square) * dt[column, k] - dsquare * (t[k] + b[k]) + 2.0 * dw[k]) / (1.0 + square)
        cross(b, dt[column], a)
        onto = (onto - dot(a, t)) / about
        for k in range(3):
            spin[column, k] = a[k] + onto * b[k]
    # the least turn from t to t' takes d along
    lift = dot(d, b) / about
    for k in range(3):
        d[k] -= lift * (t[k] + b[k])
    for k in range(3):
        t[k] = b[k]


@inlined
def _advance(side, half, weight, at, force, t, m, point, rates, dforce, dt, dm, dpoint, a, n):
    """Go along half a link, whose middle is at `at` along the rod: m' = -t x n and x' = t."""
    n[0], n[1], n[2] = force[0], force[1], force[2] + weight * at
    cross(t, n, a)
    for k in range(3):
        m[k] -= side * half * a[k]
        point[k] += side * half * t[k]
    for column in range(rates):
        cross(dt[column], n, a)
        for k in range(3):
            dm[column, k] -= side * half * a[k]
            dpoint[column, k] += side * half * dt[column, k]
        cross(t, dforce[column], a)
        for k in range(3):
            dm[column, k] -= side * half * a[k]


@inlined
def _loads(q, turn, force, moment, dforce, dtau):
    """The centre's frame, force and moment in the world's axes, and the changes of force and twisting moment."""
    rotation(q[3:6], turn)
    for k in range(3):
        force[k] = turn[k, 0] * q[6] + turn[k, 1] * q[7] + turn[k, 2] * q[8]
        moment[k] = turn[k, 0] * q[9] + turn[k, 1] * q[10] + turn[k, 2] * q[11]
    if len(dtau) > 0:
        dtau[6] = 1.0
        axis = np.zeros(3)
        for k in range(3):
            for column in range(3):
                dforce[3 + column, k] = turn[k, column]
            axis[:] = 0.0
            axis[k] = 1.0
            cross(axis, force, dforce[k])


@kernel
def walk(q, p, stiff, points, rates, frames, ends, end_rates):
    """Go outward from the centre to both ends, in lengths of the rod and the world's axes.

    Args:
        q: (12,).
        p: (3,).
        stiff: (N,).
        points: (2N + 1, 3) gets the stations relative to the centre.
        rates: (2N + 1, c, 3) gets their derivatives by the first c of `INNER` columns: c is 0 or `INNER`.
        frames: (N + 1, 2, 3) gets the tangent of each link and its second axis, carried without twist.
        ends: (2, 2, 3) gets the same of the grippers, with the twist.
        end_rates: (2, c, 3) gets the rotation [rad] of the grippers by each column, about the world's axes.
    """
    columns, hinges = rates.shape[1], len(stiff)
    kappa, weight = p[1], p[2]
    half, tau, middle = 0.5 / hinges, q[9], hinges // 2
    turn, force, moment = np.empty((3, 3)), np.empty(3), np.empty(3)
    t, d, m, x = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    a, b, w, dw = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    dt, dm, dx = np.zeros((columns, 3)), np.zeros((columns, 3)), np.zeros((columns, 3))
    dforce, spin, dtau = np.zeros((columns, 3)), np.zeros((columns, 3)), np.zeros(columns)
    _loads(q, turn, force, moment, dforce, dtau)
    points[hinges, :] = 0.0
    rates[hinges, :, :] = 0.0
    for row in range(2):
        side = 2 * row - 1
        dx[:] = 0.0
        dt[:] = 0.0
        dm[:] = 0.0
        spin[:] = 0.0
        for k in range(3):
            t[k], d[k], m[k], x[k] = turn[k, 0], turn[k, 1], moment[k], 0.0
        for column in range(min(columns, 3)):
            spin[column, column] = 1.0
            cross(spin[column], t, dt[column])
            cross(spin[column], m, dm[column])
            for k in range(3):
                dm[6 + column, k] = turn[k, column]
        frames[middle, 0], frames[middle, 1] = t, d
        for step in range(middle):
            at = side * (2 * step + 0.5) * half
            _advance(side, half, weight, at, force, t, m, x, columns, dforce, dt, dm, dx, a, b)
            points[hinges + side * (2 * step + 1)] = x
            rates[hinges + side * (2 * step + 1)] = dx
            hinge = middle + step if row else middle - 1 - step
            _turn(side, stiff[hinge], tau, t, m, d, columns, dt, dm, dtau, spin, w, dw, a, b)
            _advance(side, half, weight, at + side * half, force, t, m, x, columns, dforce, dt, dm, dx, a, b)
            points[hinges + side * (2 * step + 2)] = x
            rates[hinges + side * (2 * step + 2)] = dx
            frames[middle + side * (step + 1), 0], frames[middle + side * (step + 1), 1] = t, d
        angle = side * tau / (2.0 * kappa)
        c, s = math.cos(angle), math.sin(angle)
        cross(t, d, a)
        for k in range(3):
            ends[row, 0, k], ends[row, 1, k] = t[k], c * d[k] + s * a[k]
        for column in range(columns):
            for k in range(3):
                end_rates[row, column, k] = spin[column, k] + side * dtau[column] / (2.0 * kappa) * t[k]


@kernel
def held_shape(q, p, stiff, stations, dstations, poses, dposes):
    """Stations (2N+1, 3) and gripper poses (2, 7) of q, and their derivatives by the first 0 or 12 columns.

    `dstations` (2N+1, 3, m), and `dposes` (2, 6, m) for steps of the poses.
    """
    hinges, columns = len(stiff), dstations.shape[2]
    count = 2 * hinges + 1
    inner = INNER if columns > 0 else 0
    points, rates = np.empty((count, 3)), np.empty((count, inner, 3))
    frames, ends, end_rates = np.empty((hinges + 1, 2, 3)), np.empty((2, 2, 3)), np.empty((2, inner, 3))
    walk(q, p, stiff, points, rates, frames, ends, end_rates)
    length = p[0]
    for i in range(count):
        for k in range(3):
            stations[i, k] = q[k] + length * points[i, k]
            for column in range(inner):
                dstations[i, k, 3 + column] = length * rates[i, column, k]
            for column in range(min(columns, 3)):
                dstations[i, k, column] = 1.0 if column == k else 0.0
    for side in range(2):
        i = 2 * hinges * side
        quaternion(ends[side, 0], ends[side, 1], poses[side, 3:])
        for k in range(3):
            poses[side, k] = stations[i, k]
            for column in range(columns):
                dposes[side, k, column] = dstations[i, k, column]
                dposes[side, 3 + k, column] = end_rates[side, column - 3, k] if column > 2 else 0.0


@kernel
def batch_shapes(q, p, stiff, columns):
    """`held_shape` over rows of q (T, 12): stations, derivatives, poses and their derivatives."""
    rows, count = len(q), 2 * len(stiff) + 1
    stations, dstations = np.empty((rows, count, 3)), np.empty((rows, count, 3, columns))
    poses, dposes = np.empty((rows, 2, 7)), np.empty((rows, 2, 6, columns))
    for t in range(rows):
        held_shape(q[t], p, stiff, stations[t], dstations[t], poses[t], dposes[t])
    return stations, dstations, poses, dposes
