"""Compiled fit of rod coordinates to keypoints; `cableway.rod.inverse` is what to call."""

from __future__ import annotations

import numpy as np

from cableway.core.compiled import kernel
from cableway.rod.kernels import world_shape, world_shape_jacobian

ITERATIONS = 100
"""Most trial steps of one fit; a fit takes some ten."""


@kernel
def fit(keypoints, q, length, hinges, stride):
    """Levenberg-Marquardt from q (6,), which it changes, to the equilibrium nearest to keypoints (n, 2).

    Returns half the squared stacked distance, in squared lengths of the rod.
    """
    scale = np.array([length, length, 1.0, 10.0, 10.0, 3.0])
    stations, dstations = np.empty((2 * hinges + 1, 2)), np.empty((2 * hinges + 1, 2, 6))
    poses, dposes = np.empty((2, 3)), np.empty((2, 3, 6))
    normal, gradient = np.empty((6, 6)), np.empty(6)
    damping = 1e-3
    world_shape(q, length, hinges, stations, poses)
    cost = _half_square(stations, keypoints, length, stride)
    fresh = True
    for _ in range(ITERATIONS):
        if fresh:
            world_shape_jacobian(q, length, hinges, stations, dstations, poses, dposes)
            _normal_equations(stations, dstations, keypoints, scale / length, length, stride, normal, gradient)
        step = damped_step(normal, gradient, damping)
        trial = q + scale * step
        world_shape(trial, length, hinges, stations, poses)
        changed = _half_square(stations, keypoints, length, stride)
        fresh = changed < cost
        small = np.abs(step).max() < 1e-10
        if fresh:
            small = small or cost - changed < 1e-13 * cost
            cost = changed
            q[:] = trial
            damping = max(damping / 5.0, 1e-12)
        else:
            damping *= 10.0
        if small or damping > 1e12:
            break
    return cost


@kernel
def _half_square(stations, keypoints, length, stride):
    total = 0.0
    for i in range(len(keypoints)):
        for k in range(2):
            total += ((stations[i * stride, k] - keypoints[i, k]) / length) ** 2
    return 0.5 * total


@kernel
def _normal_equations(stations, dstations, keypoints, scale, length, stride, normal, gradient):
    normal[:] = 0.0
    gradient[:] = 0.0
    for i in range(len(keypoints)):
        for k in range(2):
            residual = (stations[i * stride, k] - keypoints[i, k]) / length
            row = dstations[i * stride, k] * scale
            gradient += row * residual
            for a in range(6):
                for b in range(a + 1):
                    normal[a, b] += row[a] * row[b]


@kernel
def damped_step(normal, gradient, damping):
    """Solve (normal + damping) step = -gradient by Cholesky's factors; the lower triangle of `normal` is used."""
    factor, step = np.zeros((6, 6)), -gradient
    for a in range(6):
        for b in range(a + 1):
            value = normal[a, b] - np.dot(factor[a, :b], factor[b, :b])
            factor[a, b] = np.sqrt(max(value + damping, 1e-30)) if a == b else value / factor[b, b]
    for a in range(6):
        step[a] = (step[a] - np.dot(factor[a, :a], step[:a])) / factor[a, a]
    for a in range(5, -1, -1):
        for b in range(a + 1, 6):
            step[a] -= factor[b, a] * step[b]
        step[a] /= factor[a, a]
    return step
