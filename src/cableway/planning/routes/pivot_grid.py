"""The pivot path on a grid: A* over 32 neighbours, then an elastic band.

In the plane this is both faster and nearer to the optimum than sampling. Edges between grid nodes are tested
exactly, so thin walls count. Where no path exists on the grid, finer grids are tried before giving up.

Note:
    Not in the paper, which uses RRT* (`pivot_rrt`); the cost is the same.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from jaxtyping import Float, Int

from cableway.core.compiled import inlined, kernel
from cableway.core.errors import PlanningError
from cableway.core.time_limit import checkpoint
from cableway.geometry import polyline
from cableway.geometry.convex import World, distance_at
from cableway.planning.config import PivotConfig
from cableway.planning.routes import band
from cableway.scene.scene import Scene

REFINEMENTS = 2
"""How often the spacing is halved before a path is said not to exist."""

WORK, WORK_OF_NODE = 6e7, 30
"""Most work of one search: each node counts as much as 30 obstacles, and each obstacle at each node. A table of 1 m x
1 m with 50 obstacles stays below it at every refinement."""

LINK = 3
"""Start and goal are linked to grid nodes at most this many spacings away."""

COARSER = 5
"""Spacings to a cell of the coarse grid."""

NEIGHBOURS = np.array(
    [(i, j) for i in range(-3, 4) for j in range(-3, 4) if math.gcd(i, j) == 1], dtype=np.int64
)  # directions 18 degrees apart at most: paths at most 1.3% too long

NOTHING = np.empty((0, 2))
"""No points that a path must not change sides of."""


def grid_path(
    scene: Scene, start: Float[np.ndarray, "2"], goal: Float[np.ndarray, "2"], radius: float, config: PivotConfig
) -> Float[np.ndarray, "P 2"]:
    """The path of least cost, vertices about `config.resolution` apart, or more where the grid would be too large.

    Args:
        scene: Workspace and obstacles.
        start: (2,) [m], in free space.
        goal: (2,) [m], in free space.
        radius: Distance [m] to keep from everything.
        config: Weights and resolution.

    Raises:
        PlanningError: No path keeps that distance; the message gives the greatest distance that one does keep.
    """
    world, weights = scene.world.arrays, (config.length_weight, config.clearance_weight)
    finest = finest_spacing(scene)
    spacing = max(config.resolution, finest)
    shape = np.zeros(2, np.int64)
    for _ in range(REFINEMENTS + 1):
        shape = np.maximum(2, np.ceil(np.array(scene.size) / spacing).astype(np.int64))
        checkpoint()
        path = _search(world, shape, start, goal, radius, *weights, NEIGHBOURS, LINK)
        if len(path):
            return polish(path, scene, radius, config, spacing)
        if spacing / 2 < finest:
            break
        spacing /= 2
    widest = _widest(world, shape, start, goal, radius)
    where = f", on a grid of {1000 * spacing:.0f} mm, the finest for so large a workspace" if spacing <= finest else ""
    raise PlanningError(
        f"no path of the cable's midpoint keeps {1000 * radius:.1f} mm from the obstacles{where}; "
        + (f"the widest route keeps {1000 * widest:.1f} mm" if widest else "there is no route at all")
    )


def finest_spacing(scene: Scene) -> float:
    """Spacing [m] of the finest grid that is searched."""
    return math.sqrt(math.prod(scene.size) * (WORK_OF_NODE + len(scene.obstacles)) / WORK)


def polish(
    path: Float[np.ndarray, "m 2"],
    scene: Scene,
    radius: float,
    config: PivotConfig,
    spacing: float,
    points: Float[np.ndarray, "k 2"] = NOTHING,
) -> Float[np.ndarray, "P 2"]:
    """A path of no greater cost near `path`, its vertices about `spacing` [m] apart, still keeping `radius`.

    Nothing is cut short round any of `points` [m]: with one in each obstacle the path stays in its homotopy class.
    """
    world, weights = scene.world.arrays, (config.length_weight, config.clearance_weight)
    path = subdivide(path, spacing)
    for scale in (4.0, 2.0, 1.0, 0.5):
        checkpoint()
        band.shortcut(path, world, radius, points, *weights, spacing / 2, 1)
        path = _even(path, scene, radius, spacing)
        for _ in range(3):
            band.relax(path, world, radius, path.copy(), 0.0, *weights, scale * spacing, 3)
    band.shortcut(path, world, radius, points, *weights, spacing / 2, 2)
    return path


def subdivide(path: Float[np.ndarray, "m 2"], spacing: float) -> Float[np.ndarray, "k 2"]:
    """The same polyline with vertices added so that none are more than `spacing` [m] apart."""
    path = polyline.remove_repeated(path)
    count = np.ceil(np.linalg.norm(np.diff(path, axis=0), axis=1) / spacing).astype(int)
    first = np.repeat(np.arange(len(count)), count)
    share = (np.arange(len(first)) - np.repeat(np.cumsum(count) - count, count)) / count[first]
    return np.vstack([path[first] + share[:, None] * (path[first + 1] - path[first]), path[-1:]])


def _even(path: np.ndarray, scene: Scene, radius: float, spacing: float) -> np.ndarray:
    """Vertices at equal arc length, unless that cuts a corner."""
    count = max(2, round(float(polyline.length(path)) / spacing) + 1)
    even = polyline.resample(path, count)
    even[0], even[-1] = path[0], path[-1]
    return even if scene.clearance(even[None], radius)[0] >= 0 else subdivide(path, spacing)


def _widest(world: World, shape: Int[np.ndarray, "2"], start: np.ndarray, goal: np.ndarray, radius: float) -> float:
    """Greatest distance [m] below `radius` that some path on the grid keeps, to 0.1 mm; 0 if there is none."""
    low, high = 0.0, radius
    while high - low > 1e-4:
        checkpoint()
        middle = 0.5 * (low + high)
        if len(_search(world, shape, start, goal, middle, 1.0, 0.0, NEIGHBOURS, LINK)):
            low = middle
        else:
            high = middle
    return low


@kernel
def _search(world, shape, start, goal, radius, length_weight, clearance_weight, neighbours, link):
    """A* from start to goal over the nodes of a grid of shape + 1; (0, 2) if there is no path.

    What is left is at least the straight line where everything is farthest. Node 0 is the start, linked to all nodes
    about it; node 1 + i ny + j is grid node (i, j).
    """
    nx, ny = shape[0] + 1, shape[1] + 1
    hx, hy = world[3][0] / shape[0], world[3][1] / shape[1]
    d = np.full(1 + nx * ny, np.nan)
    rate = np.empty(1 + nx * ny)  # half the cost per metre at a node: an edge costs its length times both ends' rates
    cost = np.full(1 + nx * ny, np.inf)
    parent = np.full(1 + nx * ny, -1, np.int64)
    d[0], cost[0] = distance_at(start[0], start[1], world, 0.0), 0.0
    rate[0] = 0.5 * length_weight + 0.5 * clearance_weight / max(d[0], band.SMALLEST_CLEARANCE)
    d_goal = distance_at(goal[0], goal[1], world, 0.0)
    rate_goal = 0.5 * length_weight + 0.5 * clearance_weight / max(d_goal, band.SMALLEST_CLEARANCE)
    least_rate = length_weight + clearance_weight / _most_distance(world, shape)
    best, last = np.inf, -1
    heap = [(0.0, 0)]
    while len(heap) > 0:
        bound, node = heapq.heappop(heap)
        if bound >= best:
            break
        i, j = (node - 1) // ny, (node - 1) % ny
        x, y = i * hx, j * hy
        if node == 0:
            i, j = round(start[0] / hx), round(start[1] / hy)
            x, y = start[0], start[1]
        here = cost[node]
        if bound > here + least_rate * math.hypot(goal[0] - x, goal[1] - y):
            continue
        if abs(x - goal[0]) <= link * hx and abs(y - goal[1]) <= link * hy:
            total = here + math.hypot(goal[0] - x, goal[1] - y) * (rate[node] + rate_goal)
            if total < best and band.is_free(x, y, d[node], goal[0], goal[1], d_goal, world, radius):
                best, last = total, node
        around = (2 * link + 1) ** 2 if node == 0 else len(neighbours)
        for k in range(around):
            if node == 0:
                a, b = i + k // (2 * link + 1) - link, j + k % (2 * link + 1) - link
            else:
                a, b = i + neighbours[k, 0], j + neighbours[k, 1]
            if a < 0 or a >= nx or b < 0 or b >= ny:
                continue
            other = 1 + a * ny + b
            if cost[other] <= here:
                continue
            ox, oy = a * hx, b * hy
            if np.isnan(d[other]):
                d[other] = distance_at(ox, oy, world, 0.0)
                rate[other] = 0.5 * length_weight + 0.5 * clearance_weight / max(d[other], band.SMALLEST_CLEARANCE)
            if d[other] < radius:
                continue
            total = here + math.hypot(ox - x, oy - y) * (rate[node] + rate[other])
            if total < cost[other] and band.is_free(x, y, d[node], ox, oy, d[other], world, radius):
                cost[other], parent[other] = total, node
                ahead = least_rate * math.hypot(goal[0] - ox, goal[1] - oy)
                heapq.heappush(heap, (total + ahead, other))
    return _trace(parent, last, ny, hx, hy, start, goal)


@inlined
def _most_distance(world, shape):
    """An upper bound of the signed distance anywhere, which changes no faster than position, from a coarse grid."""
    cells = (shape + COARSER - 1) // COARSER
    hx, hy = world[3][0] / cells[0], world[3][1] / cells[1]
    most = 0.0
    for i in range(cells[0]):
        for j in range(cells[1]):
            most = max(most, distance_at((i + 0.5) * hx, (j + 0.5) * hy, world, 0.0))
    return most + 0.5 * math.hypot(hx, hy)


@inlined
def _trace(parent, last, ny, hx, hy, start, goal):
    count, node = 0, last
    while node >= 0:
        count, node = count + 1, parent[node]
    if count == 0:
        return np.empty((0, 2))
    path = np.empty((count + 1, 2))
    path[count, 0], path[count, 1] = goal[0], goal[1]
    node = last
    while node > 0:
        count -= 1
        path[count, 0], path[count, 1] = (node - 1) // ny * hx, (node - 1) % ny * hy
        node = parent[node]
    path[0, 0], path[0, 1] = start[0], start[1]
    return path
