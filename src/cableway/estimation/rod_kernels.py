"""Compiled kernels of the estimator: the adapted rod between measured grippers, and its derivative by its parameters.

Arrays are those of `cableway.rod.adapted_kernels`; theta is laid out as in `cableway.rod.adapted`.
"""

from __future__ import annotations

import math

import numpy as np

from cableway.core.compiled import kernel
from cableway.rod.adapted_kernels import (
    adapted_shape,
    end_rates,
    factorize,
    meet_ends,
    scales,
    substitute,
    workspace,
)

MEETING = 100
"""Most steps in which a shape is brought between the grippers."""


@kernel
def held(poses, grasps):
    """End poses (2, 3) of a rod whose grippers are at `poses` (2, 3), held with offsets `grasps` (6,)."""
    ends = np.empty((2, 3))
    for k in range(2):
        c, s = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        ends[k, 0] = poses[k, 0] + c * grasps[3 * k] - s * grasps[3 * k + 1]
        ends[k, 1] = poses[k, 1] + s * grasps[3 * k] + c * grasps[3 * k + 1]
        ends[k, 2] = poses[k, 2] + grasps[3 * k + 2]
    return ends


@kernel
def predict(q, poses, theta, modes, stride, keypoints, by_theta):
    """Keypoints (n, 2) of the rod held at gripper `poses`, and their derivative (n, 2, p) by theta.

    q (6,) is the first guess and becomes the shape found. Returns the largest residual of the ends left.
    """
    count = len(modes)
    p, grasps = theta[: 1 + 2 * count], theta[1 + 2 * count :]
    left = meet_ends(q, held(poses, grasps), p, modes, MEETING)
    stations, dstations, ends, dends = workspace(modes)
    adapted_shape(q, p, modes, stations, dstations, ends, dends)
    n, size = len(keypoints), len(theta)
    # of the residual "end of the rod less where the grasp has it"
    residual_rates = np.zeros((6, size))
    for row in range(6):
        for a in range(len(p)):
            residual_rates[row, a] = dends[row // 3, row % 3, 6 + a]
    for k in range(2):
        c, s = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        at, row = len(p) + 3 * k, 3 * k
        residual_rates[row, at], residual_rates[row, at + 1] = -c, s
        residual_rates[row + 1, at], residual_rates[row + 1, at + 1] = -s, -c
        residual_rates[row + 2, at + 2] = -1.0
    scale, rates, factor, moved = scales(p[0]), np.empty((6, 6)), np.empty((6, 6)), np.empty(6)
    end_rates(dends, p[0], scale, rates)
    factorize_squared(rates, 1e-9, factor)
    for column in range(size):
        for a in range(6):
            moved[a] = 0.0
            for row in range(6):
                moved[a] -= rates[row, a] * residual_rates[row, column] / (1.0 if row % 3 == 2 else p[0])
        substitute(factor, moved)
        for i in range(n):
            for k in range(2):
                total = dstations[i * stride, k, 6 + column] if column < len(p) else 0.0
                for a in range(6):
                    total += dstations[i * stride, k, a] * scale[a] * moved[a]
                by_theta[i, k, column] = total
    for i in range(n):
        keypoints[i, 0], keypoints[i, 1] = stations[i * stride, 0], stations[i * stride, 1]
    return left


@kernel
def factorize_squared(rates, added, factor):
    """Cholesky's factor of rates' rates + added, (6, 6)."""
    normal = np.zeros((6, 6))
    for a in range(6):
        normal[a, a] = added
        for b in range(a + 1):
            for row in range(6):
                normal[a, b] += rates[row, a] * rates[row, b]
    factorize(normal, 0.0, factor)
