"""Compiled kernels of the rod; `cableway.rod.planar` explains the quantities and is what to call.

Station i lies at arc length i L/(2N), i = 0..2N: even stations are the middles of links and the two ends, odd
stations the hinges. Row 2N + 1 of the arrays here is not a station: it holds the two end angles.
"""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import kernel


@kernel
def _walk(side, load, length, hinges, points, jacobian):
    """Go outward from the centre to one end (side +1 right, -1 left) in the centre frame.

    Fills `points` (2N+2, 2) and `jacobian` (2N+2, 2, 3), the derivative by (a_x, a_y, m), for that half.
    """
    half = length / (2 * hinges)
    x, y, angle = 0.0, 0.0, 0.0
    dx, dy, dangle = np.zeros(3), np.zeros(3), np.zeros(3)
    if hinges % 2 == 1:
        angle = side * load[2] / (2 * hinges)
        dangle[2] = side / (2 * hinges)
    station = hinges
    for _ in range(hinges):
        c, s = math.cos(angle), math.sin(angle)
        x += side * half * c
        y += side * half * s
        for k in range(3):
            dx[k] -= side * half * s * dangle[k]
            dy[k] += side * half * c * dangle[k]
        station += side
        points[station, 0], points[station, 1] = x, y
        jacobian[station, 0, :], jacobian[station, 1, :] = dx, dy
        if station % 2 == 1:
            bend = (load[2] + (load[0] * y - load[1] * x) / length) / hinges
            for k in range(3):
                dbend = (load[0] * dy[k] - load[1] * dx[k]) / length
                if k == 0:
                    dbend += y / length
                elif k == 1:
                    dbend -= x / length
                else:
                    dbend += 1.0
                dangle[k] += side * dbend / hinges
            angle += side * bend
    row = 0 if side < 0 else 1
    points[2 * hinges + 1, row] = angle
    jacobian[2 * hinges + 1, row, :] = dangle


@kernel
def local_shape(load, length, hinges, points, jacobian):
    """Stations and end angles in the centre frame, with their derivative by the load (a_x, a_y, m)."""
    points[hinges, :] = 0.0
    jacobian[hinges, :, :] = 0.0
    _walk(1, load, length, hinges, points, jacobian)
    _walk(-1, load, length, hinges, points, jacobian)


@kernel
def world_shape(q, length, hinges, stations, poses):
    """Stations (2N+1, 2) and gripper poses (2, 3) of q in the world frame."""
    points, jacobian = np.empty((2 * hinges + 2, 2)), np.empty((2 * hinges + 2, 2, 3))
    local_shape(q[3:], length, hinges, points, jacobian)
    c, s = math.cos(q[2]), math.sin(q[2])
    for i in range(2 * hinges + 1):
        stations[i, 0] = q[0] + c * points[i, 0] - s * points[i, 1]
        stations[i, 1] = q[1] + s * points[i, 0] + c * points[i, 1]
    for k in range(2):
        i = 2 * hinges * k
        poses[k, 0], poses[k, 1] = stations[i, 0], stations[i, 1]
        poses[k, 2] = q[2] + points[2 * hinges + 1, k]


@kernel
def world_shape_jacobian(q, length, hinges, stations, dstations, poses, dposes):
    """As `world_shape`, with derivatives by q: (2N+1, 2, 6) and (2, 3, 6)."""
    points, jacobian = np.empty((2 * hinges + 2, 2)), np.empty((2 * hinges + 2, 2, 3))
    local_shape(q[3:], length, hinges, points, jacobian)
    c, s = math.cos(q[2]), math.sin(q[2])
    for i in range(2 * hinges + 1):
        rx = c * points[i, 0] - s * points[i, 1]
        ry = s * points[i, 0] + c * points[i, 1]
        stations[i, 0], stations[i, 1] = q[0] + rx, q[1] + ry
        dstations[i, 0, 0], dstations[i, 1, 0] = 1.0, 0.0
        dstations[i, 0, 1], dstations[i, 1, 1] = 0.0, 1.0
        dstations[i, 0, 2], dstations[i, 1, 2] = -ry, rx
        for k in range(3):
            dstations[i, 0, 3 + k] = c * jacobian[i, 0, k] - s * jacobian[i, 1, k]
            dstations[i, 1, 3 + k] = s * jacobian[i, 0, k] + c * jacobian[i, 1, k]
    for k in range(2):
        i = 2 * hinges * k
        poses[k, :2] = stations[i]
        poses[k, 2] = q[2] + points[2 * hinges + 1, k]
        dposes[k, :2, :] = dstations[i]
        dposes[k, 2, :] = 0.0
        dposes[k, 2, 2] = 1.0
        dposes[k, 2, 3:] = jacobian[2 * hinges + 1, k]


@kernel
def batch_shapes(q, length, hinges):
    """`world_shape` over rows of q (T, 6)."""
    stations, poses = np.empty((len(q), 2 * hinges + 1, 2)), np.empty((len(q), 2, 3))
    for t in range(len(q)):
        world_shape(q[t], length, hinges, stations[t], poses[t])
    return stations, poses


@kernel
def batch_jacobians(q, length, hinges):
    """`world_shape_jacobian` over rows of q (T, 6)."""
    rows, count = len(q), 2 * hinges + 1
    stations, dstations = np.empty((rows, count, 2)), np.empty((rows, count, 2, 6))
    poses, dposes = np.empty((rows, 2, 3)), np.empty((rows, 2, 3, 6))
    for t in range(rows):
        world_shape_jacobian(q[t], length, hinges, stations[t], dstations[t], poses[t], dposes[t])
    return stations, dstations, poses, dposes


@kernel
def _link_angles(load, length, hinges, points, jacobian, angles, dangles):
    """Angles of the N - 1 free links in the centre frame and their derivative (N-1, 3) by the load."""
    local_shape(load, length, hinges, points, jacobian)
    link = length / hinges
    for i in range(hinges - 1):
        ux = points[2 * i + 3, 0] - points[2 * i + 1, 0]
        uy = points[2 * i + 3, 1] - points[2 * i + 1, 1]
        angles[i] = math.atan2(uy, ux)
        for k in range(3):
            vx = jacobian[2 * i + 3, 0, k] - jacobian[2 * i + 1, 0, k]
            vy = jacobian[2 * i + 3, 1, k] - jacobian[2 * i + 1, 1, k]
            dangles[i, k] = (ux * vy - uy * vx) / (link * link)


@kernel
def _factor(diagonal, off, shift, pivots):
    """LDL pivots of tridiag(off, diagonal - shift, off); the number of negative ones."""
    negative = 0
    previous = 1.0
    for i in range(len(diagonal)):
        pivot = diagonal[i] - shift
        if i > 0:
            pivot -= off * off / previous
        if abs(pivot) < 1e-12:
            pivot = -1e-12
        pivots[i] = pivot
        previous = pivot
        if pivot < 0.0:
            negative += 1
    return negative


@kernel
def _solve(pivots, off, x):
    """Solve the factored tridiagonal system in place."""
    n = len(pivots)
    for i in range(1, n):
        x[i] -= off / pivots[i - 1] * x[i - 1]
    for i in range(n):
        x[i] /= pivots[i]
    for i in range(n - 2, -1, -1):
        x[i] -= off / pivots[i] * x[i + 1]


@kernel
def _orthonormal_rows(ca, cb, u, w):
    """Orthonormal rows spanning those of C; returns their rank (1 for a straight rod, which closes sideways only)."""
    gaa, gbb = np.dot(ca, ca), np.dot(cb, cb)
    if gaa > gbb:
        u[:] = ca / math.sqrt(gaa)
        w[:] = cb
    else:
        u[:] = cb / math.sqrt(gbb)
        w[:] = ca
    w -= np.dot(u, w) * u
    norm = math.sqrt(np.dot(w, w))
    if norm < 1e-6 * math.sqrt(gaa + gbb):
        w[:] = 0.0
        return 1
    w /= norm
    return 2


@kernel
def _border(diagonal, off, u, w, rank, shift, pivots, zu, zw, schur):
    """Factor [[K - shift, C'], [C, 0]]: pivots of K, K^-1 C' and C K^-1 C'; the number of negative pivots."""
    negative = _factor(diagonal, off, shift, pivots)
    zu[:], zw[:] = u, w
    _solve(pivots, off, zu)
    schur[0] = np.dot(u, zu)
    if rank == 2:
        _solve(pivots, off, zw)
        schur[1], schur[2] = np.dot(u, zw), np.dot(w, zw)
    else:
        schur[1], schur[2] = 0.0, 1.0
    return negative


@kernel
def _any_below(diagonal, off, u, w, rank, shift, pivots, zu, zw, schur):
    """Whether an eigenvalue on the null space of C lies below `shift`, by the inertia of the bordered matrix."""
    negative = _border(diagonal, off, u, w, rank, shift, pivots, zu, zw, schur)
    if rank == 1:
        return negative + (1 if schur[0] > 0.0 else 0) > 1
    if schur[0] * schur[2] - schur[1] * schur[1] < 0.0:
        negative += 1
    elif schur[0] + schur[2] > 0.0:
        negative += 2
    return negative > 2


@kernel
def stability(load, length, hinges, ceiling, gradient):
    """The stability margin of one equilibrium; its derivative by (a_x, a_y, m) goes into `gradient` (3,).

    With K v = mu v - C' lambda and C v = 0, |v| = 1:  d mu = v' dK v + 2 lambda' dC v. A margin above `ceiling` is
    not computed: it comes back as `ceiling`, with derivative zero.
    """
    free = hinges - 1
    points, jacobian = np.empty((2 * hinges + 2, 2)), np.empty((2 * hinges + 2, 2, 3))
    angles, dangles = np.empty(free), np.empty((free, 3))
    _link_angles(load, length, hinges, points, jacobian, angles, dangles)
    ca, cb = -np.sin(angles), np.cos(angles)
    diagonal = 2.0 * hinges * hinges + load[0] * cb - load[1] * ca
    off = -float(hinges * hinges)
    u, w = np.empty(free), np.empty(free)
    rank = _orthonormal_rows(ca, cb, u, w)
    pivots, zu, zw, schur = np.empty(free), np.empty(free), np.empty(free), np.empty(3)

    gradient[:] = 0.0
    if not _any_below(diagonal, off, u, w, rank, ceiling, pivots, zu, zw, schur):
        return ceiling
    reach = math.sqrt(load[0] ** 2 + load[1] ** 2)
    low, high = -reach, min(ceiling, 160.0 + reach)
    while high - low > 1e-8 * (1.0 + reach):
        middle = 0.5 * (low + high)
        if _any_below(diagonal, off, u, w, rank, middle, pivots, zu, zw, schur):
            high = middle
        else:
            low = middle
    mu = 0.5 * (low + high)

    _border(diagonal, off, u, w, rank, mu + 1e-5, pivots, zu, zw, schur)
    determinant = schur[0] * schur[2] - schur[1] * schur[1]
    v = 1.0 + 0.3 * np.sin(1.7 * np.arange(free))
    for _ in range(4):
        _solve(pivots, off, v)
        ru, rw = np.dot(u, v), np.dot(w, v)
        v -= (schur[2] * ru - schur[1] * rw) / determinant * zu
        if rank == 2:
            v -= (schur[0] * rw - schur[1] * ru) / determinant * zw
        v /= math.sqrt(np.dot(v, v))

    residual = (mu - diagonal) * v
    residual[1:] -= off * v[:-1]
    residual[:-1] -= off * v[1:]
    la, lb = 0.0, 0.0
    gaa, gab, gbb = np.dot(ca, ca), np.dot(ca, cb), np.dot(cb, cb)
    ra, rb = np.dot(ca, residual), np.dot(cb, residual)
    if rank == 2:
        determinant = gaa * gbb - gab * gab
        la = (gbb * ra - gab * rb) / determinant
        lb = (gaa * rb - gab * ra) / determinant
    elif gaa > gbb:
        la = ra / gaa
    else:
        lb = rb / gbb
    turn = v * v * (load[0] * ca + load[1] * cb) + 2.0 * v * (lb * ca - la * cb)
    for k in range(3):
        gradient[k] = np.dot(turn, np.ascontiguousarray(dangles[:, k]))
    gradient[0] += np.dot(v * v, cb)
    gradient[1] -= np.dot(v * v, ca)
    return mu


@kernel
def batch_stability(q, length, hinges, ceiling):
    """`stability` over rows of q (T, 6): margins (T,) and derivatives (T, 6)."""
    mu, dmu = np.empty(len(q)), np.zeros((len(q), 6))
    for t in range(len(q)):
        mu[t] = stability(q[t, 3:], length, hinges, ceiling, dmu[t, 3:])
    return mu, dmu
