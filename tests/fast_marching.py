"""Fast marching: the least cost of a path between two points, without a path planner.

The least cost u of the way from a point solves |grad u| = f, f the cost per metre. On a grid it is solved in order of
rising u, each node from its smaller neighbours (Sethian 1996), which is accurate to first order.
"""

from __future__ import annotations

import heapq

import numba
import numpy as np
from jaxtyping import Float

from cableway.planning.config import PivotConfig
from cableway.planning.routes.band import SMALLEST_CLEARANCE
from cableway.scene.scene import Scene

EXACT = 5
"""Nodes about the start whose cost is that of the straight line: there the front is too curved for the grid."""


def least_cost(
    scene: Scene,
    start: Float[np.ndarray, "2"],
    goal: Float[np.ndarray, "2"],
    radius: float,
    config: PivotConfig,
    spacing: float,
) -> float:
    """Least k_l length + k_c integral of 1/d [m] over all paths that keep `radius`; infinite where there is none."""
    counts = [round(size / spacing) + 1 for size in scene.size]
    axes = [np.linspace(0, size, count) for size, count in zip(scene.size, counts, strict=True)]
    distance = scene.signed_distance(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))
    slowness = config.length_weight + config.clearance_weight / np.maximum(distance, SMALLEST_CLEARANCE)
    slowness[distance < radius] = np.inf
    steps = np.array([axis[1] for axis in axes])
    at_start = config.length_weight + config.clearance_weight / float(scene.signed_distance(start))
    cost = _march(slowness, steps, np.asarray(start, float), at_start)
    i, j = (goal / steps).astype(int)
    x, y = goal / steps - (i, j)
    corners = cost[i : i + 2, j : j + 2]
    if not np.isfinite(corners).all():
        return np.inf
    return float(np.array([1 - x, x]) @ corners @ np.array([1 - y, y]))


@numba.njit(cache=False)
def _march(slowness, steps, start, at_start):
    rows, columns = slowness.shape
    cost, final = np.full((rows, columns), np.inf), np.zeros((rows, columns), np.bool_)
    heap = [(0.0, 0)]
    heap.pop()
    middle = round(start[0] / steps[0]), round(start[1] / steps[1])
    for i in range(max(0, middle[0] - EXACT), min(rows, middle[0] + EXACT + 1)):
        for j in range(max(0, middle[1] - EXACT), min(columns, middle[1] + EXACT + 1)):
            away = np.hypot(i * steps[0] - start[0], j * steps[1] - start[1])
            if away <= EXACT * steps[0] and slowness[i, j] < np.inf:
                cost[i, j] = away * 0.5 * (slowness[i, j] + at_start)
                heapq.heappush(heap, (cost[i, j], i * columns + j))
    while len(heap) > 0:
        here, node = heapq.heappop(heap)
        i, j = node // columns, node % columns
        if final[i, j] or here > cost[i, j]:
            continue
        final[i, j] = True
        for di, dj in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            a, b = i + di, j + dj
            if a < 0 or b < 0 or a >= rows or b >= columns or final[a, b] or slowness[a, b] == np.inf:
                continue
            value = _update(cost, final, a, b, slowness[a, b], steps)
            if value < cost[a, b]:
                cost[a, b] = value
                heapq.heappush(heap, (value, a * columns + b))
    return cost


@numba.njit(cache=False)
def _update(cost, final, a, b, slow, steps):
    """Solve ((u - p)/h)^2 + ((u - q)/k)^2 = f^2 for u, p and q the smaller final neighbours on either axis."""
    p, q = np.inf, np.inf
    for side in (-1, 1):
        if 0 <= a + side < cost.shape[0] and final[a + side, b]:
            p = min(p, cost[a + side, b])
        if 0 <= b + side < cost.shape[1] and final[a, b + side]:
            q = min(q, cost[a, b + side])
    h, k = steps
    best = min(p + slow * h, q + slow * k)
    if p < np.inf and q < np.inf:
        across = h * h + k * k
        root = slow * slow * across - (p - q) ** 2
        if root >= 0:
            both = (p * k * k + q * h * h + h * k * np.sqrt(root)) / across
            if both >= max(p, q):
                best = min(best, both)
    return best
