"""RRT-Connect among equilibria: two trees of rod equilibria grow from start and goal until they meet.

Every straight line in rod coordinates q is a line of equilibria, so an edge is checked at shapes a few millimetres
apart for clearance, stability, slack and self-crossing. Samples come from three sources, which solve different tasks:
all over the workspace; about a path of the cable's centre; about the shapes of another trajectory. Their loads
follow the task's own start and goal.

Note:
    Not in the paper (Tang et al.). RRT-Connect is Kuffner & LaValle 2000; in these coordinates it is Bretl &
    McCarthy 2014.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float

from cableway.core.checks import Bounds, Checked
from cableway.core.deprecation import renamed
from cableway.core.errors import PlanningError
from cableway.core.time_limit import checkpoint
from cableway.motion.interpolation import rows_at
from cableway.motion.limits import Margins
from cableway.motion.validity import FreeSpace, task_ends
from cableway.planning import rrt_connect_kernels
from cableway.scene.task import Task

Sampler = Callable[[np.random.Generator, int], Float[np.ndarray, "k 6"]]
"""Draws k rod coordinates."""

BATCH, SLICE = 200, 4
"""Samples between two reports of progress, and samples or shortcuts between two looks at the clock: an even number,
because the trees take turns."""

SHORTCUTS = 100
"""Attempts to replace a section of the path by a straight one."""

TUBE_STEP = 0.012
"""Largest move of a keypoint between the shapes that a tube is laid about [m]."""

MARGINS = Margins()
"""What shapes keep; less where start or goal keep less."""

LOAD_SPREAD = (8.0, 8.0, 2.0)
"""Least standard deviation of sampled loads (a_x, a_y, m); more where start or goal have more."""

CORRIDOR = 0.05
"""Standard deviation [m] of the cable's centre about a path."""

TUBE = (0.03, 0.03, 0.4, 6.0, 6.0, 1.5)
"""Standard deviations about the shapes of another trajectory [m, m, rad, -, -, -]."""


@dataclass(frozen=True, kw_only=True)
class RRTConnectConfig(Checked):
    """How trees of equilibria grow.

    Attributes:
        samples: Most samples, over both trees.
        step: Largest move of a point of the rod between two shapes that are checked [m].
    """

    samples: Annotated[int, Bounds(1, 10**7)] = 6000
    step: Annotated[float, Bounds(1e-4, 1)] = 0.006


def anywhere(task: Task) -> Sampler:
    """Samples all over the workspace, at any angle."""
    loads = _loads(task)

    def draw(rng: np.random.Generator, count: int) -> np.ndarray:
        place = rng.uniform(0, 1, (count, task.cable.rod.group.space)) * task.scene.size
        return np.column_stack([place, _angles(task, rng, count), loads(rng, count)])

    return draw


def about_path(task: Task, path: Float[np.ndarray, "P 2"]) -> Sampler:
    """Samples whose centre lies about a path, at any angle."""
    loads = _loads(task)

    def draw(rng: np.random.Generator, count: int) -> np.ndarray:
        place = path[rng.integers(len(path), size=count)] + CORRIDOR * rng.normal(size=(count, path.shape[1]))
        return np.column_stack([place, _angles(task, rng, count), loads(rng, count)])

    return draw


def about_shapes(q: Float[np.ndarray, "t d"]) -> Sampler:
    """Samples about the rows of another sequence, at distances from nothing to twice `TUBE`."""

    def draw(rng: np.random.Generator, count: int) -> np.ndarray:
        spread = rng.uniform(0, 2, (count, 1)) * np.array(TUBE)
        return q[rng.integers(len(q), size=count)] + spread * rng.normal(size=(count, q.shape[1]))

    return draw


def rrt_connect_path(
    task: Task,
    sampler: Sampler,
    config: RRTConnectConfig,
    *,
    seed: int | tuple[int, ...] = 0,
    progress: Callable[[float], None] | None = None,
    ends: tuple[Float[np.ndarray, "d"], Float[np.ndarray, "d"]] | None = None,
) -> Float[np.ndarray, "r d"]:
    """A path among free stable equilibria from start to goal.

    Args:
        task: The task.
        sampler: Where samples come from.
        config: Configuration.
        seed: Same seed, same path.
        progress: Called with the share of the samples that are used up; it may raise to stop the search.
        ends: Free equilibria to begin and end at, with angles that run on, in place of the task's start and goal.

    Returns:
        q (R+1, d), from one end to the other, neighbours at most about `config.step` apart.

    Raises:
        PlanningError: The samples are used up.
    """
    rng = np.random.default_rng(seed)
    rod, space = task.cable.rod, FreeSpace.of(task, MARGINS).arrays
    start, goal = task_ends(task) if ends is None else ends
    rows = config.samples + 4
    trees, shapes = np.empty((2, rows, rod.dof)), np.empty((2, rows, 2 * rrt_connect_kernels.FEATURES))
    parents, counts = np.full((2, rows), -1), np.ones(2, dtype=np.int64)
    for side, root in enumerate((start, goal)):
        trees[side, 0] = root
        rrt_connect_kernels.features(root, rod.arrays, shapes[side, 0])
    for first in range(0, config.samples, BATCH):
        if progress is not None:
            progress(first / config.samples)
        samples = np.vstack([sampler(rng, BATCH - 1), goal]) if first == 0 else sampler(rng, BATCH)
        for few in _sliced(samples):
            met = rrt_connect_kernels.connect(few, trees, shapes, parents, counts, space, config.step)
            if met[0] < 0:
                continue
            path = np.vstack([branch(trees[0], parents[0], met[0])[::-1], branch(trees[1], parents[1], met[1])[1:]])
            for pairs in _sliced(rng.uniform(size=(SHORTCUTS, 2))):
                path = rrt_connect_kernels.shortcut(path, pairs, space, config.step)
            return _dense(path, task, config.step)
    raise PlanningError(f"RRT-Connect found no path with {config.samples} samples")


def _sliced(rows: Float[np.ndarray, "k d"]) -> Iterator[Float[np.ndarray, "_ d"]]:
    """A few rows after the other, as long as there is time."""
    for first in range(0, len(rows), SLICE):
        checkpoint()
        yield rows[first : first + SLICE]


def _angles(task: Task, rng: np.random.Generator, count: int) -> np.ndarray:
    """Angles of the centre all around, about that of the start."""
    return task.start_equilibrium[task.cable.rod.group.space] + rng.uniform(-np.pi, np.pi, count)


def _loads(task: Task) -> Sampler:
    """Loads about those of start and goal, spread at least by `LOAD_SPREAD`."""
    loads = task.cable.rod.loads
    ends = np.array([task.start_equilibrium[loads], task.goal_equilibrium[loads]])
    spread = np.maximum(LOAD_SPREAD, np.abs(ends).max(0))

    def draw(rng: np.random.Generator, count: int) -> np.ndarray:
        middle = ends[rng.integers(2, size=count)] * rng.uniform(0, 1, (count, 1))
        return middle + spread * rng.normal(size=(count, ends.shape[1]))

    return draw


def branch(tree: np.ndarray, parents: np.ndarray, node: int) -> np.ndarray:
    """Rows from a node back to the root."""
    rows = []
    while node >= 0:
        rows.append(tree[node])
        node = parents[node]
    return np.array(rows)


def _dense(path: np.ndarray, task: Task, step: float) -> np.ndarray:
    """The path with rows at most about `step` apart."""
    rod = task.cable.rod
    points = rod.at_keypoints(rod.shapes(path)[0])
    moves = np.linalg.norm(np.diff(points, axis=0), axis=2).max(1)
    counts = np.maximum(
        1, np.ceil(np.maximum(moves, np.abs(np.diff(path[:, rod.group.space])) * rod.length / 2) / step)
    ).astype(int)
    at = np.concatenate([[0.0], *(i + np.arange(1, n + 1) / n for i, n in enumerate(counts))])
    return rows_at(path, at)


__getattr__ = renamed(__name__, {"ExploreConfig": "RRTConnectConfig", "explore": "rrt_connect_path"})
