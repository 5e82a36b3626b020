"""Compiled kernels of `cableway.verification.spatial_follower`: Newton's method on the chain, and how stable it is.

At a hinge conj(a) b = c + r. With turns u and v of the links before and after it about their own axes,

    dr = A u + B v,    A = ([r] - c)/2,    B = ([r] + c)/2,    [r] y = r x y,

and with the moment m = 4N K r, K = diag(kappa, 1, 1), the second derivative of the energy has the blocks

    4N A'K A - m.r/4,    4N B'K B - m.r/4,    4N A'K B + (c [m] + r m' + m r' - m.r)/4

of the one link, of the other and between them. A load p on the direction of a link, in the link's own axes, adds
(p e_x' + e_x p')/2 - p_x.

The second derivative is banded: row j holds its columns j to j + 5. It is split into L D L' without pivoting, so that
the signs of D tell how many of its eigenvalues are negative.
"""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import kernel

ITERATIONS = 30
"""Most Newton steps to an equilibrium; four are usual."""

LARGEST_TURN = 0.3
"""Of a link in one Newton step [rad]."""

LEVEL = 1e-9
"""Norm of the slope of the energy [B/L] and of the gap [L] below which a shape counts as solved."""

MARGIN_STEP = 1e-5
"""Within which the margin is found."""

BANDS = 6

TINY = 1e-300
"""What stands for a pivot that is zero."""


@kernel
def derivatives(rows, force, links, stiffness, hanging, right, band):
    """Slope and second derivative of the energy with its constraint, by turns [rad] of the inner links.

    Args:
        rows: (links, 4) unit quaternions.
        force: (3,) that closes the chain.
        links: (links,) their lengths.
        stiffness: (3,) 4N of the turns about a hinge's axes.
        hanging: (links,) weight on a link's direction.
        right: (3 inner, 4) for the slope, then the derivative of the closure.
        band: (3 inner, BANDS) for the second derivative.
    """
    inner = len(rows) - 2
    right[:], band[:] = 0.0, 0.0
    axes, load = np.empty((3, 3)), np.empty(3)
    for i in range(inner):
        w, x, y, z = rows[i + 1]
        axes[0] = w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)
        axes[1] = 2 * (x * y - w * z), w * w - x * x + y * y - z * z, 2 * (y * z + w * x)
        axes[2] = 2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z
        length, at = links[i + 1], 3 * i
        for k in range(3):
            load[k] = axes[k, 2] * hanging[i + 1]
            for j in range(3):
                load[k] += length * axes[k, j] * force[j]
            right[at + 1, 1 + k], right[at + 2, 1 + k] = -length * axes[2, k], length * axes[1, k]
        right[at + 1, 0], right[at + 2, 0] = -load[2], load[1]
        band[at, 1], band[at, 2] = load[1] / 2, load[2] / 2
        band[at + 1, 0], band[at + 2, 0] = -load[0], -load[0]
    r, m, before, after = np.empty(3), np.empty(3), np.zeros((3, 3)), np.zeros((3, 3))
    for i in range(inner + 1):  # the hinge between links i and i + 1, which have the places i - 1 and i
        a, b = rows[i], rows[i + 1]
        c = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
        r[0] = a[0] * b[1] - a[1] * b[0] - a[2] * b[3] + a[3] * b[2]
        r[1] = a[0] * b[2] - a[2] * b[0] - a[3] * b[1] + a[1] * b[3]
        r[2] = a[0] * b[3] - a[3] * b[0] - a[1] * b[2] + a[2] * b[1]
        along = 0.0
        for k in range(3):
            m[k] = stiffness[k] * r[k]
            along += m[k] * r[k] / 4
            before[k, k], after[k, k] = -c / 2, c / 2
            j, h = (k + 1) % 3, (k + 2) % 3
            before[h, j] = after[h, j] = r[k] / 2
            before[j, h] = after[j, h] = -r[k] / 2
        for p in range(3):
            for k in range(3):
                if i > 0:
                    right[3 * i - 3 + p, 0] += before[k, p] * m[k]
                if i < inner:
                    right[3 * i + p, 0] += after[k, p] * m[k]
            for q in range(3):
                own, its, across = 0.0, 0.0, (r[p] * m[q] + m[p] * r[q]) / 4
                if p == q:
                    own, its, across = -along, -along, across - along
                else:  # c [m] / 4
                    across += (c if (q - p) % 3 == 2 else -c) * m[3 - p - q] / 4
                for k in range(3):
                    own += before[k, p] * stiffness[k] * before[k, q]
                    its += after[k, p] * stiffness[k] * after[k, q]
                    across += before[k, p] * stiffness[k] * after[k, q]
                if i > 0 and q >= p:
                    band[3 * i - 3 + p, q - p] += own
                if i < inner and q >= p:
                    band[3 * i + p, q - p] += its
                if 0 < i < inner:
                    band[3 * i - 3 + p, 3 + q - p] += across


@kernel
def eliminate(band, right):
    """Split a banded matrix into L D L', in place, `right` (n, k) becoming L^-1 right; how many of D are negative."""
    negative = 0
    for j in range(len(band)):
        if abs(band[j, 0]) < TINY:
            band[j, 0] = TINY
        pivot = band[j, 0]
        if pivot < 0.0:
            negative += 1
        for i in range(1, min(BANDS, len(band) - j)):
            share = band[j, i] / pivot
            for k in range(i, BANDS):
                band[j + i, k - i] -= share * band[j, k]
            for k in range(right.shape[1]):
                right[j + i, k] -= share * right[j, k]
        for i in range(1, BANDS):
            band[j, i] /= pivot
    return negative


@kernel
def settle(rows, force, chord, links, stiffness, hanging):
    """Newton's method from and into `rows` and `force`, the ends `chord` (3,) apart [L]; whether it arrives."""
    free = 3 * (len(rows) - 2)
    right, band, step = np.empty((free, 4)), np.empty((free, BANDS)), np.empty(free)
    gap, matrix = np.empty(3), np.empty((3, 3))
    for _ in range(ITERATIONS):
        derivatives(rows, force, links, stiffness, hanging, right, band)
        gap[:] = -chord
        for i in range(len(rows)):
            w, x, y, z = rows[i]
            gap[0] += links[i] * (w * w + x * x - y * y - z * z)
            gap[1] += links[i] * 2 * (x * y + w * z)
            gap[2] += links[i] * 2 * (x * z - w * y)
        squared = gap[0] ** 2 + gap[1] ** 2 + gap[2] ** 2
        for j in range(free):
            squared += right[j, 0] ** 2
        if squared < LEVEL**2:
            return True
        eliminate(band, right)
        matrix[:] = 0.0
        for j in range(free):
            for k in range(3):
                share = right[j, 1 + k] / band[j, 0]
                gap[k] -= share * right[j, 0]
                for h in range(3):
                    matrix[k, h] += share * right[j, 1 + h]
        pull = np.linalg.solve(matrix, gap)
        largest, total = LARGEST_TURN, 0.0
        for j in range(free - 1, -1, -1):
            value = right[j, 0]
            for k in range(3):
                value += right[j, 1 + k] * pull[k]
            step[j] = -value / band[j, 0]
            for i in range(1, min(BANDS, free - j)):
                step[j] -= band[j, i] * step[j + i]
            largest, total = max(largest, abs(step[j])), total + abs(step[j])
        if not total < math.inf:
            return False
        share = LARGEST_TURN / largest
        for i in range(len(rows) - 2):
            _turn(rows[i + 1], share * step[3 * i : 3 * i + 3])
        force += share * pull
    return False


@kernel
def _turn(row, turn):
    """Turn a link about its own axes, in place."""
    w, x, y, z = row
    a, b, c = turn[0] / 2, turn[1] / 2, turn[2] / 2
    row[0], row[1] = w - x * a - y * b - z * c, x + w * a + y * c - z * b
    row[2], row[3] = y + w * b + z * a - x * c, z + w * c + x * b - y * a
    size = math.sqrt(row[0] ** 2 + row[1] ** 2 + row[2] ** 2 + row[3] ** 2)
    for k in range(4):
        row[k] /= size


@kernel
def margin(rows, force, links, stiffness, hanging):
    """N times the least eigenvalue of the second derivative on turns that keep the ends, N the number of hinges; 0
    where it is not positive.

    By bisection: bordered by the three rows of the closure, the matrix less a number has three negative eigenvalues,
    and one more for each that is below that number.
    """
    free, hinges = 3 * (len(rows) - 2), len(rows) - 1
    right, band = np.empty((free, 4)), np.empty((free, BANDS))
    derivatives(rows, force, links, stiffness, hanging, right, band)
    low, high, found = 0.0, math.inf, 0.0
    while high - low > MARGIN_STEP:
        shifted = band.copy()
        shifted[:, 0] -= found / hinges
        if _below(shifted, right.copy()) > 0:
            high = found
        else:
            low = found
        if high == 0.0:
            return 0.0
        found = max(1.0, 2.0 * low) if high == math.inf else (low + high) / 2
    return low


@kernel
def _below(band, right):
    """How many eigenvalues are negative on what the closure, in the last three columns of `right`, allows."""
    count, matrix = eliminate(band, right), np.zeros((3, 3))
    for j in range(len(band)):
        for k in range(3):
            for h in range(3):
                matrix[k, h] -= right[j, 1 + k] * right[j, 1 + h] / band[j, 0]
    for k in range(3):
        pivot = matrix[k, k]
        if pivot <= TINY:  # one that is zero is of a row that says nothing
            count += 1
        for h in range(k + 1, 3):
            if abs(pivot) > TINY:
                for i in range(k + 1, 3):
                    matrix[h, i] -= matrix[h, k] * matrix[k, i] / pivot
    return count - 3
