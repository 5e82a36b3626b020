"""Compiled kernels of the stability of the rod in space; `cableway.rod.spatial` explains the quantities.

Each inner link turns in two ways, along the second and third axis of its frame: 2 (N - 1) numbers v. Energy less load
has the second derivative v'Av + kappa (g.v)^2, A block tridiagonal, where C v = 0 holds the ends. The bordered matrix

    | A - mu h   C'   g       |
    | C          0    0       |
    | g'         0   -1/kappa |

has four negative pivots where the margin is above mu, and more where it is not.
"""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import inlined, kernel
from cableway.rod.spatial_kernels import changes_of, cross, dot, walk

BORDER = 4
"""Three rows that hold the ends, and one of the twist."""

FLAT = 1e-6
"""Part of the largest closure row below which what is left of another one is rounding, as on a straight rod."""

NUDGE = 1e-5
"""Step of the central differences in the derivative of the margin, in units of the coordinates."""


@kernel
def second_variation(q, p, stiff, diagonal, off, closure, twist):
    """Fill A and its borders.

    Args:
        q: (12,).
        p: (3,).
        stiff: (N,) bending stiffness of the hinges by B/L.
        diagonal: (N - 1, 2, 2) gets its blocks on the diagonal.
        off: (N - 1, 2, 2) gets the blocks that couple each inner link to the next one.
        closure: (N - 1, 2, 3) gets what each turn moves the end by.
        twist: (N - 1, 2) gets what it twists the rod by.
    """
    hinges = len(stiff)
    points, none = np.empty((2 * hinges + 1, 3)), np.empty((2 * hinges + 1, 0, 3))
    frames, ends, flat = np.empty((hinges + 1, 2, 3)), np.empty((2, 2, 3)), np.empty((2, 0, 3))
    walk(q, p, stiff, points, none, frames, ends, flat)
    h, middle = 1.0 / hinges, hinges // 2
    axes, force = np.empty((hinges + 1, 3, 3)), np.empty(3)
    for i in range(hinges + 1):
        axes[i, :2] = frames[i]
        cross(frames[i, 0], frames[i, 1], axes[i, 2])
    for k in range(3):
        force[k] = axes[middle, 0, k] * q[6] + axes[middle, 1, k] * q[7] + axes[middle, 2, k] * q[8]
    twist[:] = 0.0
    for i in range(hinges - 1):
        pull = dot(force, axes[i + 1, 0]) + p[2] * (i + 1 - middle) * h * axes[i + 1, 0, 2]
        for r in range(2):
            for k in range(3):
                closure[i, r, k] = h * axes[i + 1, 1 + r, k]
            for s in range(2):
                diagonal[i, r, s] = h * pull if r == s else 0.0
    before, across, after = np.empty((2, 2)), np.empty((2, 2)), np.empty((2, 2))
    change = np.empty((2, 2))
    for j in range(hinges):
        _hinge(axes[j], axes[j + 1], q[9], stiff[j], before, across, after, change)
        for r in range(2):
            if j > 0:
                twist[j - 1, r] += change[0, r]
            if j < hinges - 1:
                twist[j, r] += change[1, r]
            for s in range(2):
                if j > 0:
                    diagonal[j - 1, r, s] += before[r, s]
                if j < hinges - 1:
                    diagonal[j, r, s] += after[r, s]
                if 0 < j < hinges - 1:
                    off[j - 1, r, s] = across[r, s]


@inlined
def _hinge(one, other, tau, stiff, before, across, after, change):
    """Second variation of a hinge between links with axes `one` and `other` (3, 3), and the change of its twist.

    With c = t . t' and k = t x t', along great circles p and p' of the tangents: of the bending energy it is
    2K/(1 + c)^2 (dc)^2 - 2K/(1 + c) ddc, K its stiffness, where dc = p . t' + t . p' and
    ddc = 2 p . p' - c (p . p + p' . p'); of tau times the twist, tau (p . ((t + t') x p')/(1 + c)
    - (p + p') . k dc/(1 + c)^2). The twist changes by (p + p') . k/(1 + c).
    """
    t, u = one[0], other[0]
    c = dot(t, u)
    k, a = np.empty(3), np.empty(3)
    cross(t, u, k)
    fall, curve = 2.0 * stiff / (1.0 + c), 2.0 * stiff / ((1.0 + c) * (1.0 + c))
    lean, roll = 0.5 * tau / ((1.0 + c) * (1.0 + c)), 0.5 * tau / (1.0 + c)
    along = np.empty((2, 2))
    for r in range(2):
        along[0, r], along[1, r] = dot(one[1 + r], u), dot(other[1 + r], t)
        change[0, r], change[1, r] = dot(one[1 + r], k) / (1.0 + c), dot(other[1 + r], k) / (1.0 + c)
    for i in range(3):
        k[i] = t[i] + u[i]
    for s in range(2):
        cross(k, other[1 + s], a)
        for r in range(2):
            same = c * fall if r == s else 0.0
            x, y, z, w = along[0, r], along[0, s], along[1, r], along[1, s]
            before[r, s] = curve * x * y + same - lean * (1.0 + c) * (change[0, r] * y + x * change[0, s])
            after[r, s] = curve * z * w + same - lean * (1.0 + c) * (change[1, r] * w + z * change[1, s])
            across[r, s] = curve * x * w - fall * dot(one[1 + r], other[1 + s]) + roll * dot(one[1 + r], a)
            across[r, s] -= lean * (1.0 + c) * (change[0, r] * w + x * change[1, s])


@kernel
def _bordered(closure, twist, kappa, border, corner):
    """Rows (BORDER, N - 1, 2) that span those of the closure, orthonormal, and the twist; `corner` (BORDER,) their
    diagonal. A row that only repeats others counts as met: zero, with -1 on the diagonal."""
    free = len(twist)
    border[:] = 0.0
    corner[:] = -1.0
    left = np.empty((3, free, 2))
    largest = 0.0
    for k in range(3):
        for i in range(free):
            for r in range(2):
                left[k, i, r] = closure[i, r, k]
        largest = max(largest, math.sqrt(np.sum(left[k] * left[k])))
    for row in range(3):
        best, norm = 0, 0.0
        for k in range(3):
            size = math.sqrt(np.sum(left[k] * left[k]))
            if size > norm:
                best, norm = k, size
        if norm < FLAT * largest:
            break
        border[row] = left[best] / norm
        corner[row] = 0.0
        for k in range(3):
            left[k] -= np.sum(border[row] * left[k]) * border[row]
    border[3] = twist
    corner[3] = -1.0 / kappa


@kernel
def _factor(diagonal, off, border, corner, shift, inverses, solved, schur):
    """Number of negative pivots of the bordered matrix less `shift` on its block diagonal.

    Fills what `_solve` needs: inverses of the pivot blocks, A^-1 times the border, and what is left of the corner.
    """
    free, negative = len(diagonal), 0
    e = np.empty((2, 2))
    for i in range(free):
        for r in range(2):
            for s in range(2):
                e[r, s] = diagonal[i, r, s]
            e[r, r] -= shift
        if i > 0:
            f, g = off[i - 1], inverses[i - 1]
            for r in range(2):
                for s in range(2):
                    for x in range(2):
                        for y in range(2):
                            e[r, s] -= f[x, r] * g[x, y] * f[y, s]
        determinant = e[0, 0] * e[1, 1] - e[0, 1] * e[1, 0]
        if abs(determinant) < 1e-14:
            determinant = -1e-14
        if determinant < 0.0:
            negative += 1
        elif e[0, 0] + e[1, 1] < 0.0:
            negative += 2
        inverses[i, 0, 0], inverses[i, 1, 1] = e[1, 1] / determinant, e[0, 0] / determinant
        inverses[i, 0, 1], inverses[i, 1, 0] = -e[0, 1] / determinant, -e[1, 0] / determinant
    for row in range(BORDER):
        for i in range(free):
            for r in range(2):
                solved[row, i, r] = border[row, i, r]
        _back(off, inverses, solved[row])
    for r in range(BORDER):
        for s in range(BORDER):
            value = corner[r] if r == s else 0.0
            for i in range(free):
                value -= border[r, i, 0] * solved[s, i, 0] + border[r, i, 1] * solved[s, i, 1]
            schur[r, s] = value
    return negative + _negative(schur)


@inlined
def _negative(matrix):
    """Number of negative pivots of a small symmetric matrix, which is left as it is."""
    left, negative = matrix.copy(), 0
    for i in range(len(left)):
        if abs(left[i, i]) < 1e-14:
            left[i, i] = -1e-14
        if left[i, i] < 0.0:
            negative += 1
        for r in range(i + 1, len(left)):
            for s in range(i + 1, len(left)):
                left[r, s] -= left[r, i] * left[i, s] / left[i, i]
    return negative


@kernel
def _back(off, inverses, x):
    """Solve with the factored block tridiagonal matrix, in place: x (N - 1, 2)."""
    free = len(x)
    for i in range(1, free):
        a = inverses[i - 1, 0, 0] * x[i - 1, 0] + inverses[i - 1, 0, 1] * x[i - 1, 1]
        b = inverses[i - 1, 1, 0] * x[i - 1, 0] + inverses[i - 1, 1, 1] * x[i - 1, 1]
        x[i, 0] -= off[i - 1, 0, 0] * a + off[i - 1, 1, 0] * b
        x[i, 1] -= off[i - 1, 0, 1] * a + off[i - 1, 1, 1] * b
    for i in range(free - 1, -1, -1):
        a, b = x[i, 0], x[i, 1]
        if i < free - 1:
            a -= off[i, 0, 0] * x[i + 1, 0] + off[i, 0, 1] * x[i + 1, 1]
            b -= off[i, 1, 0] * x[i + 1, 0] + off[i, 1, 1] * x[i + 1, 1]
        x[i, 0] = inverses[i, 0, 0] * a + inverses[i, 0, 1] * b
        x[i, 1] = inverses[i, 1, 0] * a + inverses[i, 1, 1] * b


@kernel
def _quadratic(q, p, stiff, v, multipliers):
    """N (v'Av + kappa (g.v)^2 + 2 multipliers . C v) at q."""
    hinges = len(stiff)
    free = hinges - 1
    diagonal, off = np.empty((free, 2, 2)), np.empty((free, 2, 2))
    closure, twist = np.empty((free, 2, 3)), np.empty((free, 2))
    second_variation(q, p, stiff, diagonal, off, closure, twist)
    value, turned = 0.0, 0.0
    for i in range(free):
        for r in range(2):
            turned += twist[i, r] * v[i, r]
            for k in range(3):
                value += 2.0 * multipliers[k] * closure[i, r, k] * v[i, r]
            for s in range(2):
                value += v[i, r] * diagonal[i, r, s] * v[i, s]
                if i < free - 1:
                    value += 2.0 * v[i, r] * off[i, r, s] * v[i + 1, s]
    return hinges * (value + p[1] * turned * turned)


@kernel
def stability(q, p, stiff, ceiling, scale, gradient):
    """Margin of q (12,), at most `ceiling`, and its derivative (12,), zero where that is reached.

    The margin is an eigenvalue and stationary in v and in the multipliers, so its slope is that of the quadratic form
    with both held, here by central differences in units of `scale` (12,).
    """
    hinges = len(stiff)
    free = hinges - 1
    diagonal, off = np.empty((free, 2, 2)), np.empty((free, 2, 2))
    closure, twist = np.empty((free, 2, 3)), np.empty((free, 2))
    border, corner = np.empty((BORDER, free, 2)), np.empty(BORDER)
    inverses, solved, schur = np.empty((free, 2, 2)), np.empty((BORDER, free, 2)), np.empty((BORDER, BORDER))
    gradient[:] = 0.0
    second_variation(q, p, stiff, diagonal, off, closure, twist)
    _bordered(closure, twist, p[1], border, corner)
    if _factor(diagonal, off, border, corner, ceiling / hinges, inverses, solved, schur) == BORDER:
        return ceiling
    high = min(ceiling, 64.0)
    while _factor(diagonal, off, border, corner, high / hinges, inverses, solved, schur) == BORDER:
        high *= 2.0
    low = high - 64.0
    while _factor(diagonal, off, border, corner, low / hinges, inverses, solved, schur) > BORDER:
        low = high - 2.0 * (high - low)
    while high - low > 1e-8 * (1.0 + abs(low)):
        middle = 0.5 * (low + high)
        if _factor(diagonal, off, border, corner, middle / hinges, inverses, solved, schur) > BORDER:
            high = middle
        else:
            low = middle
    mu = 0.5 * (low + high)
    v = _eigenvector(diagonal, off, border, corner, (mu + 1e-5) / hinges, inverses, solved, schur)
    multipliers = _multipliers(diagonal, off, closure, twist, p[1], mu / hinges, v)
    changes = np.empty((3, 3))
    changes_of(q[3:6], changes)
    for column in range(3, 12):
        for sign in (1.0, -1.0):
            nudged, nudge = q.copy(), sign * NUDGE * scale[column]
            if column < 6:
                for k in range(3):
                    nudged[3 + k] += nudge * changes[k, column - 3]
            else:
                nudged[column] += nudge
            gradient[column] += _quadratic(nudged, p, stiff, v, multipliers) / (2.0 * nudge)
    return mu


@kernel
def has_margin(q, p, stiff, margin):
    """Whether the stability margin of q (12,) is above `margin`: one factorisation, where `stability` needs many."""
    hinges = len(stiff)
    free = hinges - 1
    diagonal, off = np.empty((free, 2, 2)), np.empty((free, 2, 2))
    closure, twist = np.empty((free, 2, 3)), np.empty((free, 2))
    border, corner = np.empty((BORDER, free, 2)), np.empty(BORDER)
    inverses, solved, schur = np.empty((free, 2, 2)), np.empty((BORDER, free, 2)), np.empty((BORDER, BORDER))
    second_variation(q, p, stiff, diagonal, off, closure, twist)
    _bordered(closure, twist, p[1], border, corner)
    return _factor(diagonal, off, border, corner, margin / hinges, inverses, solved, schur) == BORDER


@kernel
def _eigenvector(diagonal, off, border, corner, shift, inverses, solved, schur):
    """v (N - 1, 2), of length 1, by inverse iteration beside an eigenvalue."""
    free = len(diagonal)
    _factor(diagonal, off, border, corner, shift, inverses, solved, schur)
    v = 1.0 + 0.3 * np.sin(1.7 * np.arange(2.0 * free)).reshape(free, 2)
    for _ in range(4):
        _back(off, inverses, v)
        given = np.empty(BORDER)
        for row in range(BORDER):
            given[row] = -np.sum(border[row] * v)
        along = np.linalg.solve(schur, given)
        for row in range(BORDER):
            v -= along[row] * solved[row]
        v /= math.sqrt(np.sum(v * v))
    return v


@kernel
def _multipliers(diagonal, off, closure, twist, kappa, shift, v):
    """Multipliers (3,) of the closure rows at an eigenvector v: Av + kappa g (g.v) + C' multipliers = shift v."""
    free = len(v)
    left, turned = np.empty((free, 2)), np.sum(twist * v)
    for i in range(free):
        for r in range(2):
            left[i, r] = shift * v[i, r] - kappa * twist[i, r] * turned
            for s in range(2):
                left[i, r] -= diagonal[i, r, s] * v[i, s]
                if i < free - 1:
                    left[i, r] -= off[i, r, s] * v[i + 1, s]
                if i > 0:
                    left[i, r] -= off[i - 1, s, r] * v[i - 1, s]
    normal, onto = np.zeros((3, 3)), np.zeros(3)
    for i in range(free):
        for r in range(2):
            for k in range(3):
                onto[k] += closure[i, r, k] * left[i, r]
                for m in range(3):
                    normal[k, m] += closure[i, r, k] * closure[i, r, m]
    for k in range(3):
        normal[k, k] += FLAT * FLAT * free
    return np.linalg.solve(normal, onto)


@kernel
def batch_stability(q, p, stiff, ceiling, scale):
    """`stability` over rows of q (T, 12): margins (T,) and derivatives (T, 12)."""
    mu, dmu = np.empty(len(q)), np.empty((len(q), 12))
    for t in range(len(q)):
        mu[t] = stability(q[t], p, stiff, ceiling, scale, dmu[t])
    return mu, dmu
