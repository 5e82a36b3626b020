"""Compiled kernels of `curve_filter`: points of unknown arc length beside the rod's centre line, and what they say.

The centre line is C1 and passes through the middles of the rod's links, along them: over hinge j it is the quadratic
curve B(t) = (1 - t)^2 s_2j + 2 t (1 - t) s_2j+1 + t^2 s_2j+2 of three stations (`cableway.rod.kernels`), with j + t
from 0 to N. It is linear in the stations, and so in their derivatives.
"""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import inlined, kernel

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
def gather(points, stations, by_theta, prior, covariance, gate, information, gradient, at, residuals):
    """What points say of theta, in units of its prior.

    A point counts by its distance from the centre line across it. All points over one hinge together count as one.

    Args:
        points: (k, 2) measured [m].
        stations: (2N + 1, 2) predicted [m].
        by_theta: (2N + 1, 2, p) their derivative.
        prior: (p,) standard deviations.
        covariance: (p, p) of theta, in units of the prior.
        gate: Standard deviation [m] of a point beside what theta explains; the distance, in standard deviations of
            both, from which on a point is of something else; the least and the largest such distance [m]; the distance,
            in the first of them, from which on a point counts less.
        information: Where to (p, p), from zero.
        gradient: Where to (p,), from zero.
        at: Places (k,) on the centre line, where to.
        residuals: Distances (k,) from it, to the left [m], where to; NaN for those of something else.
    """
    deviation, sigmas, least, most, outlier = gate
    hinges, size = (len(stations) - 1) // 2, len(prior)
    feet, normals = np.empty_like(points), np.empty_like(points)
    match(points, stations, at)
    place(stations, at, feet, normals)
    rows, counts = np.empty((len(points), size)), np.zeros(hinges)
    for i in range(len(points)):
        residuals[i] = np.nan
        nx, ny = normals[i, 0], normals[i, 1]
        dx, dy = points[i, 0] - feet[i, 0], points[i, 1] - feet[i, 1]
        j = min(int(at[i]), hinges - 1)
        weights, _ = _weights(at[i] - j)
        variance = deviation * deviation
        for a in range(size):
            rate = 0.0
            for k in range(3):
                rate += weights[k] * (nx * by_theta[2 * j + k, 0, a] + ny * by_theta[2 * j + k, 1, a])
            rows[i, a] = rate * prior[a]
        for a in range(size):
            for b in range(size):
                variance += rows[i, a] * covariance[a, b] * rows[i, b]
        reach = min(max(sigmas * math.sqrt(variance), least), most)
        if dx * dx + dy * dy <= reach * reach:
            residuals[i] = nx * dx + ny * dy
            counts[j] += 1.0
    for i in range(len(points)):
        residual = residuals[i]
        if not (0.0 < at[i] < hinges) or residual != residual:
            continue
        far = max(1.0, abs(residual) / (outlier * deviation))
        weight = 1.0 / (counts[min(int(at[i]), hinges - 1)] * far * deviation * deviation)
        for a in range(size):
            weighted = weight * rows[i, a]
            gradient[a] += weighted * residual
            for b in range(size):
                information[a, b] += weighted * rows[i, b]
