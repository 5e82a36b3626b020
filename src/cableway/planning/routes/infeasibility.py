"""Why there is no plan: a gap that the grippers or the cable would have to pass, and that is too narrow.

A gripper's disc must go from its place at the start to its place at the goal, and so must a disc as thick as the
cable about the cable's middle, from the equilibria nearest to start and goal, with the clearance that a plan keeps on
either side; near a start or goal that keeps less, with what it keeps there. On a grid, connectivity of the places where
the signed distance is at least r - h/sqrt 2 (h the grid's spacing, r with the clearance) is necessary for that, because
the distance changes no faster than the place. So what is reported is certain; narrower misses than h sqrt 2 go
undetected. For the same reason r + h/sqrt 2 is sufficient, and mostly a coarse grid is enough to see that there is
nothing to report.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from cableway.core.quantities import limit_text, place
from cableway.core.time_limit import checkpoint
from cableway.planning.routes.pivot import pivot_keypoint
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.verification.ends import CLEARANCE_WAY

SPACING, NODES = 0.001, 500_000
"""Of the grid [m], wider where a table would take more nodes than that, or many obstacles too long."""

DISTANCES = 3e8
"""Most distances to obstacles that a grid asks for."""

COARSE = 0.004
"""Spacing of the grid that is looked at first [m]."""

TIE = 1e-6
"""Weight of an edge's wider node against its nearer one."""


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
        wide = f"about {1000 * self.widest:.0f} mm wide" if self.widest > 0 else "closed"
        return (
            f"{self.who} needs a route {limit_text(self.thick + 2 * self.clearance)} wide from start to goal "
            f"({limit_text(self.thick)} and {limit_text(self.clearance)} of clearance on either side), "
            f"and the widest one is {wide} at {place(self.place)}"
        )


@dataclass(frozen=True)
class _Body:
    """What has to get from one place to another, its radius, and the distances of its centre at both [m]."""

    who: str
    radius: float
    start: Float[np.ndarray, "2"]
    goal: Float[np.ndarray, "2"]
    kept: Float[np.ndarray, "2"]


class _Grid:
    """Signed distance at nodes about `spacing` [m] apart; none of the table is farther than `reach` from a node."""

    def __init__(self, scene: Scene, spacing: float) -> None:
        nodes = min(NODES, DISTANCES / (1 + len(scene.obstacles)))
        spacing = max(spacing, math.sqrt(math.prod(scene.size) / nodes))
        counts = np.maximum(2, np.ceil(np.array(scene.size) / spacing).astype(int) + 1)
        self.axes = [np.linspace(0, size, count) for size, count in zip(scene.size, counts, strict=True)]
        self.nodes = np.stack(np.meshgrid(*self.axes, indexing="ij"), axis=-1)
        self.distance, self.reach = scene.signed_distance(self.nodes), spacing / math.sqrt(2)

    def node(self, point: Float[np.ndarray, "2"]) -> tuple[int, int]:
        """The node nearest to a point."""
        i, j = (int(np.argmin(np.abs(axis - x))) for axis, x in zip(self.axes, point, strict=True))
        return i, j

    def wanted(self, body: _Body, clearance: float) -> Float[np.ndarray, "i j"]:
        """Distance [m] that the centre of a body keeps at each node; near an end that keeps less, what that has."""
        wanted = np.full(self.distance.shape, body.radius + clearance)
        for end, kept in zip((body.start, body.goal), body.kept, strict=True):
            if kept < body.radius + clearance:
                near = np.linalg.norm(self.nodes - end, axis=-1) <= CLEARANCE_WAY
                wanted[near] = np.minimum(wanted[near], max(kept, body.radius))
        return wanted


def find_blockage(task: Task, clearance: float = 0.0) -> Blockage | None:
    """The first of left gripper, right gripper and cable that certainly cannot pass; None where all may.

    Args:
        task: The task.
        clearance: What must be kept on either side [m].
    """
    coarse = _Grid(task.scene, COARSE)
    doubtful = [body for body in _bodies(task) if not _passes(coarse, body, clearance)]
    if not doubtful:
        return None
    checkpoint()
    fine = _Grid(task.scene, SPACING)
    for body in doubtful:
        checkpoint()
        narrowest = _narrowest(fine, body, clearance)
        if narrowest is not None:
            half_width, at = narrowest
            return Blockage(body.who, 2 * body.radius, clearance, 2 * max(0.0, half_width), fine.nodes[at])
    return None


def _bodies(task: Task) -> list[_Body]:
    rod, middle = task.cable.rod, pivot_keypoint(task.cable.keypoints)
    shapes = rod.at_keypoints(rod.shapes(np.array([task.start_equilibrium, task.goal_equilibrium]))[0])
    distances = task.scene.signed_distance(shapes)
    return [
        _Body(who, radius, shapes[0, point], shapes[1, point], distances[:, point])
        for who, radius, point in (
            ("the left gripper", task.grippers.radius, 0),
            ("the right gripper", task.grippers.radius, -1),
            ("the cable", task.cable.radius, middle),
        )
    ]


def _passes(grid: _Grid, body: _Body, clearance: float) -> bool:
    """Whether some way along the grid's nodes certainly keeps the distance wherever it goes between them."""
    free = grid.distance >= grid.wanted(body, clearance) + grid.reach
    return _joined(free, grid.node(body.start), grid.node(body.goal))


def _joined(free: np.ndarray, start: tuple[int, int], goal: tuple[int, int]) -> bool:
    """Whether both nodes are free, and free nodes lead from one to the other."""
    labels = np.asarray(ndimage.label(free, structure=np.ones((3, 3)))[0])  # pyright: ignore[reportIndexIssue]
    return bool(labels[start] == labels[goal] != 0)


def _narrowest(grid: _Grid, body: _Body, clearance: float) -> tuple[float, tuple[int, int]] | None:
    """Where none can keep the distance: the least distance on the widest way there is, and the node where that is."""
    distance, start, goal = grid.distance, grid.node(body.start), grid.node(body.goal)
    free = distance >= grid.wanted(body, clearance) - grid.reach
    free[start] = free[goal] = True
    if _joined(free, start, goal):
        return None
    checkpoint()
    path = _widest_way(distance, *(int(np.ravel_multi_index(end, distance.shape)) for end in (start, goal)))
    along = distance.ravel()[path[1:-1]]
    first = int(np.argmin(along))
    wider = np.flatnonzero(along[first:] > along[first] + 1e-9)
    length = int(wider[0]) if len(wider) else 1  # of a place that is as narrow for some way
    at = path[1 + first + (length - 1) // 2]
    i, j = np.unravel_index(at, distance.shape)
    return float(distance[i, j]), (int(i), int(j))


def _widest_way(distance: np.ndarray, start: int, goal: int) -> np.ndarray:
    """Nodes, as indices into the flat grid, of the path whose least distance is greatest.

    It is the one in a spanning tree of the greatest edges, where an edge is as wide as the nearer of its nodes. Of
    equal edges the one that leads away from obstacles is greater, so that the path follows no wall in the open.
    """
    index, flat = np.arange(distance.size).reshape(distance.shape), distance.ravel()
    pairs = [
        (index[:-1], index[1:]),
        (index[:, :-1], index[:, 1:]),
        (index[:-1, :-1], index[1:, 1:]),
        (index[1:, :-1], index[:-1, 1:]),
    ]
    one, other = (np.concatenate([pair[side].ravel() for pair in pairs]) for side in range(2))
    narrowness = 1.0 + flat.max() - np.minimum(flat[one], flat[other]) - TIE * np.maximum(flat[one], flat[other])
    graph = sparse.coo_matrix((narrowness, (one, other)), (flat.size, flat.size))
    tree = csgraph.minimum_spanning_tree(graph)
    before = csgraph.breadth_first_order(tree, start, directed=False, return_predecessors=True)[1]
    path = [goal]
    while path[-1] != start:
        path.append(int(before[path[-1]]))
    return np.array(path)
