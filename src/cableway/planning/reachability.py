"""Why there is no plan: a gap that the grippers or the cable would have to pass, and that is too narrow.

A gripper's disc must go from its place at the start to its place at the goal, and so must a disc as thick as the
cable about the cable's middle, from the equilibria nearest to start and goal, with the clearance that a plan keeps on
either side. On a grid, connectivity of the places where the signed distance is at least r - h/sqrt 2 (h the grid's
spacing, r with the clearance) is necessary for that, because the distance changes no faster than the place. So what is
reported is certain; narrower misses than h sqrt 2 are not seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from cableway.planning.pivot import pivot_keypoint
from cableway.scene.task import Task

SPACING, NODES = 0.001, 500_000
"""Of the grid [m], wider where a table would take more nodes than that."""


@dataclass(frozen=True)
class Blockage:
    """A way that is too narrow.

    Attributes:
        who: What would have to pass.
        thick: Its width [m].
        clearance: What it has to keep on either side [m].
        widest: Width [m] of the narrowest place on the widest way there is, to the grid's precision; 0 for none.
        place: (2,) [m] where that is.
    """

    who: str
    thick: float
    clearance: float
    widest: float
    place: Float[np.ndarray, "2"]

    def __str__(self) -> str:
        x, y = self.place
        wide = f"about {1000 * self.widest:.0f} mm wide" if self.widest > 0 else "closed"
        return (
            f"{self.who} needs a way {1000 * (self.thick + 2 * self.clearance):.0f} mm wide from start to goal "
            f"({1000 * self.thick:.0f} mm and {1000 * self.clearance:.0f} mm of clearance on either side), "
            f"and the widest one is {wide} at ({x:.3f}, {y:.3f})"
        )


def find_blockage(task: Task, clearance: float = 0.0) -> Blockage | None:
    """The first of left gripper, right gripper and cable that certainly cannot pass; None where all may.

    Args:
        task: The task.
        clearance: What must be kept on either side [m].
    """
    spacing = max(SPACING, math.sqrt(math.prod(task.scene.size) / NODES))
    counts = np.maximum(2, np.ceil(np.array(task.scene.size) / spacing).astype(int) + 1)
    axes = [np.linspace(0, size, count) for size, count in zip(task.scene.size, counts, strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    distance = task.scene.signed_distance(nodes)
    rod, middle = task.cable.rod, pivot_keypoint(task.cable.keypoints)
    start, goal = rod.at_keypoints(rod.shapes(np.array([task.start_fit[0], task.goal_fit[0]]))[0])
    for who, keypoint, radius in (
        ("the left gripper", 0, task.grippers.radius),
        ("the right gripper", -1, task.grippers.radius),
        ("the cable", middle, task.cable.radius),
    ):
        ends = [_node(point, axes) for point in (start[keypoint], goal[keypoint])]
        blocked = _narrowest(distance, ends, radius + clearance - spacing / np.sqrt(2))
        if blocked is not None:
            half_width, at = blocked
            return Blockage(who, 2 * radius, clearance, 2 * max(0.0, half_width), nodes[at])
    return None


def _node(point: np.ndarray, axes: list[np.ndarray]) -> tuple[int, int]:
    i, j = (int(np.argmin(np.abs(axis - x))) for axis, x in zip(axes, point, strict=True))
    return i, j


def _narrowest(distance: np.ndarray, ends: list[tuple[int, int]], least: float) -> tuple[float, tuple[int, int]] | None:
    """Where no way keeps `least`: the least distance on the widest way there is, and the node where that is."""
    free = distance >= least
    for end in ends:
        free[end] = True
    labels = np.asarray(ndimage.label(free, structure=np.ones((3, 3)))[0])  # pyright: ignore[reportIndexIssue]
    if labels[ends[0]] == labels[ends[1]]:
        return None
    path = _widest_way(distance, *(int(np.ravel_multi_index(end, distance.shape)) for end in ends))
    at = path[1:-1][np.argmin(distance.ravel()[path[1:-1]])]
    i, j = np.unravel_index(at, distance.shape)
    return float(distance[i, j]), (int(i), int(j))


def _widest_way(distance: np.ndarray, start: int, goal: int) -> np.ndarray:
    """Nodes, as indices into the flat grid, of the path whose least distance is greatest.

    It is the one in a spanning tree of the greatest edges, where an edge is as wide as the nearer of its nodes.
    """
    index, flat = np.arange(distance.size).reshape(distance.shape), distance.ravel()
    pairs = [
        (index[:-1], index[1:]),
        (index[:, :-1], index[:, 1:]),
        (index[:-1, :-1], index[1:, 1:]),
        (index[1:, :-1], index[:-1, 1:]),
    ]
    one, other = (np.concatenate([pair[side].ravel() for pair in pairs]) for side in range(2))
    narrowness = 1.0 + flat.max() - np.minimum(flat[one], flat[other])
    graph = sparse.coo_matrix((narrowness, (one, other)), (flat.size, flat.size))
    tree = csgraph.minimum_spanning_tree(graph)
    before = csgraph.breadth_first_order(tree, start, directed=False, return_predecessors=True)[1]
    path = [goal]
    while path[-1] != start:
        path.append(int(before[path[-1]]))
    return np.array(path)
