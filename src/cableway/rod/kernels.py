"""Compiled kernels of the rod; `cableway.rod.planar` explains the quantities and is what to call.

One walk serves the uniform rod and any other (`cableway.rod.material`), which has K modes (K, N) with parameters p (1 +
2K,): length L, factors of the modes of the logarithm of the stiffness, and of those of the turn at rest. A uniform rod
has none.

Station i lies at arc length i L/(2N), i = 0..2N: even stations are the middles of links and the two ends, odd
stations the hinges. Row 2N + 1 of the arrays here is not a station: it holds the two end angles.
"""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import inlined, kernel


@inlined
def _walk(side, load, p, modes, points, jacobian):
    """Go outward from the centre to one end (side +1 right, -1 left) in the centre frame.

    Fills `points` (2N+2, 2) and `jacobian` (2N+2, 2, m) for that half: the derivative by the first m of load (a_x,
    a_y, m), modes of the stiffness and modes of the turn at rest.
    """
    count, hinges = modes.shape
    columns, length, row = jacobian.shape[2], p[0], 0 if side < 0 else 1
    half = length / (2 * hinges)
    end = 2 * hinges + 1
    x, y, angle, station = 0.0, 0.0, 0.0, hinges
    for k in range(columns):
        jacobian[end, row, k] = 0.0
    for step in range(hinges + 1):
        share = 0.5  # of the centre hinge's bend that lies on this side, where a hinge is at the centre
        if step > 0:
            share = 1.0
            c, s = math.cos(angle), math.sin(angle)
            x += side * half * c
            y += side * half * s
            before = station
            station += side
            points[station, 0], points[station, 1] = x, y
            for k in range(columns):
                dangle = jacobian[end, row, k]
                jacobian[station, 0, k] = jacobian[before, 0, k] - side * half * s * dangle
                jacobian[station, 1, k] = jacobian[before, 1, k] + side * half * c * dangle
        if station % 2 == 1:
            hinge = station // 2
            softness, rest = 1.0, 0.0
            if count > 0:
                stiffness = 0.0
                for k in range(count):
                    stiffness += p[1 + k] * modes[k, hinge]
                    rest += p[1 + count + k] * modes[k, hinge]
                softness = math.exp(-stiffness)
            moment = load[2] + (load[0] * y - load[1] * x) / length
            own = (y / length, -x / length, 1.0)
            for k in range(columns):
                rate = (load[0] * jacobian[station, 1, k] - load[1] * jacobian[station, 0, k]) / length
                if k < 3:
                    rate += own[k]
                elif k < 3 + count:
                    rate -= modes[k - 3, hinge] * moment
                rate *= softness
                if k >= 3 + count:
                    rate += modes[k - 3 - count, hinge]
                jacobian[end, row, k] += side * share * rate / hinges
            angle += side * share * ((softness * moment + rest) / hinges)
    points[end, row] = angle


@kernel
def local_shape(load, p, modes, points, jacobian):
    """Stations and end angles in the centre frame, with their derivatives as in `_walk`."""
    hinges = modes.shape[1]
    points[hinges, :] = 0.0
    jacobian[hinges, :, :] = 0.0
    for side in (1, -1):
        _walk(side, load, p, modes, points, jacobian)


@kernel
def held_shape(q, p, modes, stations, dstations, poses, dposes):
    """Stations (2N+1, 2) and gripper poses (2, 3) of q in the world frame, with their derivatives.

    `dstations` (2N+1, 2, m) and `dposes` (2, 3, m) get the derivatives by the first m of q (6,) and p (1 + 2K,): m is
    0, 6 or 7 + 2K.
    """
    hinges, columns = modes.shape[1], dstations.shape[2]
    inner = min(columns, 3) + max(columns - 7, 0)
    points, jacobian = np.empty((2 * hinges + 2, 2)), np.empty((2 * hinges + 2, 2, inner))
    local_shape(q[3:], p, modes, points, jacobian)
    c, s = math.cos(q[2]), math.sin(q[2])
    for i in range(2 * hinges + 1):
        if columns == 0:
            stations[i, 0] = q[0] + c * points[i, 0] - s * points[i, 1]
            stations[i, 1] = q[1] + s * points[i, 0] + c * points[i, 1]
            continue
        rx = c * points[i, 0] - s * points[i, 1]
        ry = s * points[i, 0] + c * points[i, 1]
        stations[i, 0], stations[i, 1] = q[0] + rx, q[1] + ry
        dstations[i, 0, 0], dstations[i, 1, 0] = 1.0, 0.0
        dstations[i, 0, 1], dstations[i, 1, 1] = 0.0, 1.0
        dstations[i, 0, 2], dstations[i, 1, 2] = -ry, rx
        if columns > 6:
            dstations[i, 0, 6], dstations[i, 1, 6] = rx / p[0], ry / p[0]
        for k in range(inner):
            column = 3 + k if k < 3 else 4 + k
            dstations[i, 0, column] = c * jacobian[i, 0, k] - s * jacobian[i, 1, k]
            dstations[i, 1, column] = s * jacobian[i, 0, k] + c * jacobian[i, 1, k]
    for side in range(2):
        i = 2 * hinges * side
        poses[side, 0], poses[side, 1] = stations[i, 0], stations[i, 1]
        poses[side, 2] = q[2] + points[2 * hinges + 1, side]
        for a in range(columns):
            dposes[side, 0, a], dposes[side, 1, a] = dstations[i, 0, a], dstations[i, 1, a]
            dposes[side, 2, a] = 1.0 if a == 2 else 0.0
        for k in range(inner):
            dposes[side, 2, 3 + k if k < 3 else 4 + k] = jacobian[2 * hinges + 1, side, k]


@kernel
def uniform(length, hinges):
    """p (1,) and modes (0, N) of a uniform rod."""
    return np.array([length]), np.empty((0, hinges))


@inlined
def world_shape(q, p, modes, stations, poses):
    """`held_shape` without derivatives."""
    held_shape(q, p, modes, stations, np.empty((len(stations), 2, 0)), poses, np.empty((2, 3, 0)))


@kernel
def batch_shapes(q, p, modes, columns):
    """`held_shape` over rows of q (T, 6): stations, m = `columns` derivatives, poses and their derivatives."""
    rows, count = len(q), 2 * modes.shape[1] + 1
    stations, dstations = np.empty((rows, count, 2)), np.empty((rows, count, 2, columns))
    poses, dposes = np.empty((rows, 2, 3)), np.empty((rows, 2, 3, columns))
    for t in range(rows):
        held_shape(q[t], p, modes, stations[t], dstations[t], poses[t], dposes[t])
    return stations, dstations, poses, dposes


@kernel
def _link_angles(points, jacobian, length, angles, dangles):
    """Angles of the N - 1 free links in the centre frame and their derivative (N-1, m) by the load."""
    hinges = len(angles) + 1
    link = length / hinges
    for i in range(hinges - 1):
        ux = points[2 * i + 3, 0] - points[2 * i + 1, 0]
        uy = points[2 * i + 3, 1] - points[2 * i + 1, 1]
        angles[i] = math.atan2(uy, ux)
        for k in range(dangles.shape[1]):
            vx = jacobian[2 * i + 3, 0, k] - jacobian[2 * i + 1, 0, k]
            vy = jacobian[2 * i + 3, 1, k] - jacobian[2 * i + 1, 1, k]
            dangles[i, k] = (ux * vy - uy * vx) / (link * link)


@inlined
def _factor(diagonal, off, shift, pivots):
    """LDL pivots of tridiag(off, diagonal - shift, off), `off` (N - 2,) beside the diagonal; the number of negative
    ones."""
    negative = 0
    previous = 1.0
    for i in range(len(diagonal)):
        pivot = diagonal[i] - shift
        if i > 0:
            pivot -= off[i - 1] * off[i - 1] / previous
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
        x[i] -= off[i - 1] / pivots[i - 1] * x[i - 1]
    for i in range(n):
        x[i] /= pivots[i]
    for i in range(n - 2, -1, -1):
        x[i] -= off[i] / pivots[i] * x[i + 1]


@inlined
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


@inlined
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


@inlined
def _bending(p, modes, diagonal, off):
    """The Hessian N^2 tridiag of the bending energy by the free link angles: its diagonal (N-1,) and beside (N-2,).

    Returns the largest factor on the stiffness.
    """
    count, hinges = modes.shape
    before, most = 0.0, 0.0
    for hinge in range(hinges):
        stiffness = 0.0
        for k in range(count):
            stiffness += p[1 + k] * modes[k, hinge]
        own = float(hinges * hinges) * math.exp(stiffness)
        if hinge > 0:
            diagonal[hinge - 1] = before + own
        if 0 < hinge < hinges - 1:
            off[hinge - 1] = -own
        before, most = own, max(most, own)
    return most / (hinges * hinges)


@inlined
def _multipliers(ca, cb, rank, residual):
    """Multipliers of the rows of C, ca and cb, that leave the least of `residual`."""
    gaa, gab, gbb = np.dot(ca, ca), np.dot(ca, cb), np.dot(cb, cb)
    ra, rb = np.dot(ca, residual), np.dot(cb, residual)
    if rank == 2:
        determinant = gaa * gbb - gab * gab
        return (gbb * ra - gab * rb) / determinant, (gaa * rb - gab * ra) / determinant
    return (ra / gaa, 0.0) if gaa > gbb else (0.0, rb / gbb)


@kernel
def stability(load, p, modes, ceiling, gradient):
    """The stability margin of one equilibrium; its derivative by (a_x, a_y, m) goes into `gradient` (3,).

    With K v = mu v - C' lambda and C v = 0, |v| = 1:  d mu = v' dK v + 2 lambda' dC v. A margin above `ceiling` is
    not computed: it comes back as `ceiling`, with derivative zero.
    """
    length, hinges = p[0], modes.shape[1]
    free = hinges - 1
    points, no_jacobian = np.empty((2 * hinges + 2, 2)), np.empty((2 * hinges + 2, 2, 0))
    angles, diagonal, off = np.empty(free), np.empty(free), np.empty(free - 1)
    local_shape(load, p, modes, points, no_jacobian)
    _link_angles(points, no_jacobian, length, angles, np.empty((free, 0)))
    ca, cb = -np.sin(angles), np.cos(angles)
    stiffest = _bending(p, modes, diagonal, off)
    diagonal += load[0] * cb - load[1] * ca
    u, w = np.empty(free), np.empty(free)
    rank = _orthonormal_rows(ca, cb, u, w)
    pivots, zu, zw, schur = np.empty(free), np.empty(free), np.empty(free), np.empty(3)

    gradient[:] = 0.0
    if not _any_below(diagonal, off, u, w, rank, ceiling, pivots, zu, zw, schur):
        return ceiling
    jacobian, dangles = np.empty((2 * hinges + 2, 2, 3)), np.empty((free, 3))
    local_shape(load, p, modes, points, jacobian)
    _link_angles(points, jacobian, length, angles, dangles)
    reach = math.sqrt(load[0] ** 2 + load[1] ** 2)
    low, high = -reach, min(ceiling, 160.0 * stiffest + reach)
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
    la, lb = _multipliers(ca, cb, rank, residual)
    turn = v * v * (load[0] * ca + load[1] * cb) + 2.0 * v * (lb * ca - la * cb)
    for k in range(3):
        gradient[k] = np.dot(turn, np.ascontiguousarray(dangles[:, k]))
    gradient[0] += np.dot(v * v, cb)
    gradient[1] -= np.dot(v * v, ca)
    return mu


@kernel
def batch_stability(q, p, modes, ceiling):
    """`stability` over rows of q (T, 6): margins (T,) and derivatives (T, 6)."""
    mu, dmu = np.empty(len(q)), np.zeros((len(q), 6))
    for t in range(len(q)):
        mu[t] = stability(q[t, 3:], p, modes, ceiling, dmu[t, 3:])
    return mu, dmu
