"""RRT-Connect among equilibria in space: two trees of the twelve numbers grow from start and goal until they meet.

Samples come from three sources, which solve different tasks: all over the workspace; about a path of the cable's
centre; about the shapes of a cable that slides along a curve. A search that has bad luck takes very long, so searches
are short, begin anew with another seed, and are allowed twice as much in every round.

Note:
    Not in the paper (Tang et al.), whose cables lie on a table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from cableway.core.time_limit import checkpoint
from cableway.geometry import rotations
from cableway.motion.spatial import SpatialFreeSpace, SpatialProblem
from cableway.planning import spatial_rrt_kernels
from cableway.planning.rrt_connect import branch

Sampler = Callable[[np.random.Generator, int], Float[np.ndarray, "k 12"]]
"""Draws k rod coordinates."""

N = TypeVar("N")

SLICE = 20
"""Samples between two looks at the clock; even, because the trees take turns."""

SHORTCUTS = 120
"""Attempts to replace a section of the path by a straight one."""

COARSE = 4.0
"""Steps between the rows that shortcuts join."""

LOAD_SPREAD = (8.0, 8.0, 8.0, 0.8, 2.5, 2.5)
"""Least standard deviation of sampled loads; more where start or goal have more."""

CORRIDOR = 0.15
"""Standard deviation of the cable's centre about a path, in lengths of the cable."""

TUBE = (0.08, 0.08, 0.08, 0.4, 0.4, 0.4, 6.0, 6.0, 6.0, 0.5, 1.5, 1.5)
"""Standard deviations about the shapes of another trajectory [lengths, rad, loads]."""


@dataclass(frozen=True)
class Trees:
    """Search among the free equilibria of a problem.

    Attributes:
        problem: The problem.
        space: What is free.
        step: Largest move of a point of the rod between two shapes that are checked [m].
    """

    problem: SpatialProblem
    space: SpatialFreeSpace
    step: float

    def search(
        self, sampler: Sampler, samples: int, seed: tuple[int, ...]
    ) -> tuple[Float[np.ndarray, "r 12"] | None, int]:
        """A path from start to goal with rows about a step apart, None where the samples are used up; the samples."""
        rng, problem, space = np.random.default_rng(seed), self.problem, self.space.arrays
        rows = samples + 4
        trees, shapes = np.empty((2, rows, 12)), np.empty((2, rows, spatial_rrt_kernels.FEATURES))
        parents, counts = np.full((2, rows), -1), np.ones(2, dtype=np.int64)
        for side, root in enumerate((problem.start, problem.goal)):
            trees[side, 0] = root
            spatial_rrt_kernels.features(trees[side, 0], problem.rod.arrays, shapes[side, 0])
        drawn = np.vstack([sampler(rng, samples - 1), problem.goal])[::-1].copy()
        for first in range(0, samples, SLICE):
            checkpoint()
            few = drawn[first : first + SLICE]
            met = spatial_rrt_kernels.connect(few, trees, shapes, parents, counts, space, self.step)
            if met[0] >= 0:
                before, after = branch(trees[0], parents[0], met[0])[::-1], branch(trees[1], parents[1], met[1])
                return self._shortened(np.vstack([before, after[1:]]), rng), first + len(few)
        return None, samples

    def _shortened(self, path: Float[np.ndarray, "k 12"], rng: np.random.Generator) -> Float[np.ndarray, "r 12"]:
        rod, space = self.problem.rod, self.space.arrays
        path = spatial_rrt_kernels.dense(path, rod.arrays, COARSE * self.step)
        pairs = rng.uniform(size=(SHORTCUTS, 2))
        for first in range(0, SHORTCUTS, SLICE):
            checkpoint()
            path = spatial_rrt_kernels.shortcut(path, pairs[first : first + SLICE], space, self.step)
        return spatial_rrt_kernels.dense(path, rod.arrays, self.step)


def bursts(names: tuple[N, ...], first: int, most: int) -> Iterator[tuple[N, int, int]]:
    """Searches by name in short doubling bursts: the name, the samples and the number of the round."""
    round_number = 0
    while first <= most:
        for name in names:
            yield name, first, round_number
        first, round_number = 2 * first, round_number + 1


def anywhere(problem: SpatialProblem) -> Sampler:
    """Samples all over the workspace, turned in any way."""
    loads, limits = _loads(problem), problem.world.arrays[10]

    def draw(rng: np.random.Generator, count: int) -> np.ndarray:
        place = limits[0] + rng.uniform(0, 1, (count, 3)) * (limits[1] - limits[0])
        return np.column_stack([place, _turns(rng, count), loads(rng, count)])

    return draw


def about_path(problem: SpatialProblem, path: Float[np.ndarray, "P 3"]) -> Sampler:
    """Samples whose centre lies about a path, turned in any way."""
    loads, spread = _loads(problem), CORRIDOR * problem.rod.length

    def draw(rng: np.random.Generator, count: int) -> np.ndarray:
        place = path[rng.integers(len(path), size=count)] + spread * rng.normal(size=(count, 3))
        return np.column_stack([place, _turns(rng, count), loads(rng, count)])

    return draw


def about_shapes(problem: SpatialProblem, q: Float[np.ndarray, "t 12"]) -> Sampler:
    """Samples about the rows of another sequence, at distances from nothing to twice `TUBE`, small ones more often."""
    rod = problem.rod
    units = np.array(TUBE) * np.array([*[rod.length] * 3, *[1.0] * 9])

    def draw(rng: np.random.Generator, count: int) -> np.ndarray:
        spread = 2 * rng.uniform(0, 1, (count, 1)) ** 2 * units
        return rod.retract(q[rng.integers(len(q), size=count)], spread * rng.normal(size=(count, 12)))

    return draw


def _turns(rng: np.random.Generator, count: int) -> Float[np.ndarray, "k 3"]:
    """Rotation vectors of evenly spread rotations."""
    turns = rng.normal(size=(count, 4))
    return rotations.to_vector(turns / np.linalg.norm(turns, axis=1, keepdims=True))


def _loads(problem: SpatialProblem) -> Sampler:
    """Loads about those of start and goal, spread at least by `LOAD_SPREAD`."""
    ends = np.array([problem.start[6:], problem.goal[6:]])
    spread = np.maximum(LOAD_SPREAD, 0.7 * np.abs(ends).max(0))

    def draw(rng: np.random.Generator, count: int) -> np.ndarray:
        middle = ends[rng.integers(2, size=count)] * rng.uniform(0, 1, (count, 1))
        return middle + spread * rng.normal(size=(count, 6))

    return draw
