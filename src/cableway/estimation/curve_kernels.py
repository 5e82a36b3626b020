"""Compiled kernels of `curve_filter`: points of unknown arc length beside the rod's centre line, and what they say.

The centre line is C1 and passes through the middles of the rod's links, along them: over hinge j it is the quadratic
curve B(t) = (1 - t)^2 s_2j + 2 t (1 - t) s_2j+1 + t^2 s_2j+2 of three stations (`cableway.rod.kernels`), with j + t
from 0 to N. It is linear in the stations, and so in their derivatives.
"""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import inlined, kernel
from cableway.rod.kernels import held_shape
from cableway.rod.least_squares import add_row, advance, begin, clear

PIECES = 4
"""Straight pieces of each curve among which the nearest one to a point is looked for."""


@inlined
def _weights(t):
    """Of the three stations at t, and of the derivative by t."""
    u = 1.0 - t
    return (u * u, 2.0 * t * u, t * t), (-2.0 * u, 2.0 * (u - t), 2.0 * t)


@kernel
def place(stations, at, points, normals):
    """Write points (m, 2) of the centre line at places `at` (m,) from 0 to N, and their normals, to the left."""
    for i in range(len(at)):
        j = min(int(at[i]), (len(stations) - 1) // 2 - 1)
        weights, rates = _weights(at[i] - j)
        x, y, along, up = 0.0, 0.0, 0.0, 0.0
        for k in range(3):
            sx, sy = stations[2 * j + k, 0], stations[2 * j + k, 1]
            x, y = x + weights[k] * sx, y + weights[k] * sy
            along, up = along + rates[k] * sx, up + rates[k] * sy
        size = math.sqrt(along * along + up * up)
        points[i, 0], points[i, 1] = x, y
        normals[i, 0], normals[i, 1] = -up / size, along / size


@kernel
def match(points, stations, at):
    """Write the place `at` (k,) from 0 to N on the centre line that is nearest to each of the points (k, 2)."""
    hinges = (len(stations) - 1) // 2
    line = np.empty((hinges * PIECES + 1, 2))
    place(stations, np.arange(len(line)) / PIECES, line, np.empty_like(line))
    for i in range(len(points)):
        best = np.inf
        for piece in range(len(line) - 1):
            ax, ay = line[piece, 0], line[piece, 1]
            ux, uy = line[piece + 1, 0] - ax, line[piece + 1, 1] - ay
            px, py = points[i, 0] - ax, points[i, 1] - ay
            share = min(max((px * ux + py * uy) / (ux * ux + uy * uy), 0.0), 1.0)
            distance = (px - share * ux) ** 2 + (py - share * uy) ** 2
            if distance < best:
                best = distance
                at[i] = (piece + share) / PIECES


@kernel
def held(x, modes, poses, units, stations, by_x, theta, rates):
    """The rod of coordinates x = (q, p), whose ends say how the grippers at `poses` (2, 3) hold it.

    So no shape has to be looked for between grippers, and none that is lost at a fold: every x is an equilibrium, and
    theta = (p, grasps) follows from it, the grasps by the ends in the frames of the grippers.

    Args:
        x: (d + r,).
        modes: (K, N).
        poses: (2, 3) of the grippers [m, m, rad].
        units: (d + r,) of x.
        stations: (2N + 1, 2) [m], where to.
        by_x: (2N + 1, 2, d + r) their derivative by x in its units, where to.
        theta: (p,), where to.
        rates: (p, d + r) its derivative, the same.
    """
    d, r = 6, len(x) - 6
    full, dfull = np.empty((len(stations), 2, len(x))), np.empty((2, 3, len(x)))
    ends = np.empty((2, 3))
    held_shape(x[:d], x[d:], modes, stations, full, ends, dfull)
    for i in range(len(stations)):
        for k in range(2):
            for a in range(len(x)):
                by_x[i, k, a] = full[i, k, a] * units[a]
    rates[:] = 0.0
    for a in range(r):
        theta[a], rates[a, d + a] = x[d + a], units[d + a]
    for side in range(2):
        row, c, s = r + 3 * side, math.cos(poses[side, 2]), math.sin(poses[side, 2])
        dx, dy = ends[side, 0] - poses[side, 0], ends[side, 1] - poses[side, 1]
        theta[row], theta[row + 1] = c * dx + s * dy, c * dy - s * dx
        theta[row + 2] = ends[side, 2] - poses[side, 2]
        for a in range(len(x)):
            ux, uy = dfull[side, 0, a] * units[a], dfull[side, 1, a] * units[a]
            rates[row, a], rates[row + 1, a] = c * ux + s * uy, c * uy - s * ux
            rates[row + 2, a] = dfull[side, 2, a] * units[a]


@kernel
def gate(points, stations, by_x, covariance, bounds, at, residuals):
    """Write where points belong on the centre line, and how far they are from it.

    Args:
        points: (k, 2) measured [m].
        stations: (2N + 1, 2) predicted [m].
        by_x: (2N + 1, 2, m) their derivative.
        covariance: (m, m) of what they were differentiated by.
        bounds: Standard deviation [m] of a point beside what is predicted; the distance, in standard deviations of
            both, from which on a point is of something else; the least and the largest such distance [m].
        at: Places (k,) on the centre line, where to.
        residuals: Distances (k,) from it, to the left [m], where to; NaN for those of something else.
    """
    deviation, sigmas, least, most = bounds
    size = by_x.shape[2]
    feet, normals, row = np.empty_like(points), np.empty_like(points), np.empty(size)
    match(points, stations, at)
    place(stations, at, feet, normals)
    for i in range(len(points)):
        residuals[i] = np.nan
        nx, ny = normals[i, 0], normals[i, 1]
        dx, dy = points[i, 0] - feet[i, 0], points[i, 1] - feet[i, 1]
        _slope(at[i], nx, ny, by_x, row)
        variance = deviation * deviation
        for a in range(size):
            for b in range(size):
                variance += row[a] * covariance[a, b] * row[b]
        reach = min(max(sigmas * math.sqrt(variance), least), most)
        if dx * dx + dy * dy <= reach * reach:
            residuals[i] = nx * dx + ny * dy


@inlined
def _slope(at, nx, ny, by_x, row):
    """Write how the place `at` of the centre line moves along a normal."""
    j = min(int(at), (len(by_x) - 1) // 2 - 1)
    weights, _ = _weights(at - j)
    for a in range(len(row)):
        row[a] = 0.0
        for k in range(3):
            row[a] += weights[k] * (nx * by_x[2 * j + k, 0, a] + ny * by_x[2 * j + k, 1, a])


@kernel
def fit(x, modes, poses, units, expected, root, points, weights, marks, of, weight, outlier, rule):
    """Move x to the rod that points, marks and what is expected of theta make most likely. Returns the normal matrix
    (m, m) there, its lower triangle.

    A point counts by its distance from the centre line across it, a mark by that from its station along both axes, far
    ones less (Huber).

    Args:
        x: (m,), see `held`, as are `modes`, `poses` and `units`.
        modes: The same.
        poses: The same.
        units: The same.
        expected: (p,) of theta.
        root: (p, p) R of its information R'R.
        points: (k, 2) [m].
        weights: (k,) 1 / variance [1/m^2].
        marks: (b, 2) points of known arc length [m].
        of: (b,) the stations that they are.
        weight: 1 / variance of a mark [1/m^2].
        outlier: Distance [m] from which on a point counts less.
        rule: When the search ends.
    """
    hinges, size, count = modes.shape[1], len(x), len(expected)
    stations, by_x = np.empty((2 * hinges + 1, 2)), np.empty((2 * hinges + 1, 2, size))
    theta, rates, whole, row = np.empty(count), np.empty((count, size)), np.empty((count, size)), np.empty(size)
    at, feet, normals = np.empty(len(points)), np.empty_like(points), np.empty_like(points)
    search = begin(x)
    while True:
        held(search.trial, modes, poses, units, stations, by_x, theta, rates)
        clear(search)
        cost, off = 0.0, root @ (theta - expected)
        whole[:] = root @ rates
        for i in range(count):
            add_row(search.trial_normal, search.trial_gradient, whole[i], off[i], 1.0, 0)
            cost += off[i] * off[i]
        match(points, stations, at)
        place(stations, at, feet, normals)
        for i in range(len(points)):
            nx, ny = normals[i, 0], normals[i, 1]
            residual = nx * (feet[i, 0] - points[i, 0]) + ny * (feet[i, 1] - points[i, 1])
            far = max(1.0, abs(residual) / outlier)
            _slope(at[i], nx, ny, by_x, row)
            add_row(search.trial_normal, search.trial_gradient, row, residual, weights[i] / far, 0)
            cost += weights[i] * (residual * residual if far == 1.0 else outlier * (2.0 * abs(residual) - outlier))
        for i in range(len(marks)):
            for k in range(2):
                residual = stations[of[i], k] - marks[i, k]
                far = max(1.0, abs(residual) / outlier)
                add_row(search.trial_normal, search.trial_gradient, by_x[of[i], k], residual, weight / far, 0)
                cost += weight * (residual * residual if far == 1.0 else outlier * (2.0 * abs(residual) - outlier))
        if not advance(search, 0.5 * cost, units, rule):
            break
    x[:] = search.x
    return search.normal
