"""Compiled kernel of the estimator: the adapted rod between measured grippers, and its derivative by its parameters.

Arrays are those of `cableway.rod.fitting`; theta is laid out as in `cableway.rod.material`.
"""

from __future__ import annotations

import numpy as np

from cableway.core.compiled import kernel
from cableway.rod.fitting import follow_ends, meet_ends, workspace
from cableway.rod.kernels import held_shape

DAMPING = 1e-9
"""Of the derivative by the ends, where shapes run away."""


@kernel
def predict(q, ends, by_grasps, p, modes, stride, keypoints, by_theta):
    """Keypoints (n, 2) of the rod with end poses `ends` (2, 3), and their derivative (n, 2, p + g) by theta.

    `by_grasps` (6, g) is the derivative of `ends` by the grasps. q (6,) is the first guess and becomes the shape
    found. Returns the largest residual of the ends left.
    """
    left = meet_ends(q, ends, p, modes)
    stations, dstations, poses, dposes = workspace(modes, len(q) + len(p))
    held_shape(q, p, modes, stations, dstations, poses, dposes)
    rows, size, dof = len(by_grasps), by_theta.shape[2], len(q)
    wanted = np.empty((rows, size))
    for row in range(rows):
        for column in range(size):
            if column < len(p):
                wanted[row, column] = -dposes[row // ends.shape[1], row % ends.shape[1], dof + column]
            else:
                wanted[row, column] = by_grasps[row, column - len(p)]
    moved = follow_ends(dposes, p[0], wanted, DAMPING)
    for i in range(len(keypoints)):
        for k in range(keypoints.shape[1]):
            keypoints[i, k] = stations[i * stride, k]
            for column in range(size):
                total = dstations[i * stride, k, dof + column] if column < len(p) else 0.0
                for a in range(dof):
                    total += dstations[i * stride, k, a] * moved[a, column]
                by_theta[i, k, column] = total
    return left
