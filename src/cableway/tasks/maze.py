"""Mazes drawn as spanning trees: between any two cells there is one way."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.geometry import polyline
from cableway.scene.obstacles import Box, Obstacle
from cableway.tasks.passages import way_between
from cableway.tasks.placement import box_between
from cableway.tasks.setup import Draft, Setup

Cell = tuple[int, int]
Opened = set[frozenset[Cell]]
"""Pairs of neighbouring cells with no wall between them."""

WALL = 0.012
"""Thickness [m] of the walls."""

ROUNDING = 0.45
"""Radius of the curve's corners, in widths of a lane."""


def maze(rng: np.random.Generator, width: float) -> Draft:
    """A maze with lanes of `width` [m], solvable because a motion was led along its one way from start to goal."""
    setup = Setup()
    counts = tuple(int((size - WALL) / (width + WALL)) for size in setup.size)
    pitch = np.array(setup.size) / counts
    opened = _spanning_tree(rng, counts)
    route = _route(rng, counts, opened)
    middles = (np.array(route) + 0.5) * pitch
    walls = _walls(counts, opened, pitch)
    lane = float(pitch.min() - WALL)
    q = way_between(rng, setup, walls, _rounded(middles, ROUNDING * lane), lane, whole=False)
    description = f"A maze of {counts[0]} x {counts[1]} cells, its lanes {1000 * lane:.0f} mm wide."
    return Draft(setup=setup, obstacles=tuple(walls), motion=q, description=description)


def _spanning_tree(rng: np.random.Generator, counts: tuple[int, ...]) -> Opened:
    """A random depth-first tree over the cells: long lanes, few forks."""
    stack = [(int(rng.integers(counts[0])), int(rng.integers(counts[1])))]
    seen, opened = set(stack), set()
    while stack:
        free = [cell for cell in _neighbours(stack[-1], counts) if cell not in seen]
        if not free:
            stack.pop()
            continue
        chosen = free[int(rng.integers(len(free)))]
        opened.add(frozenset((stack[-1], chosen)))
        seen.add(chosen)
        stack.append(chosen)
    return opened


def _neighbours(cell: Cell, counts: tuple[int, ...]) -> list[Cell]:
    i, j = cell
    around = ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1))
    return [(a, b) for a, b in around if 0 <= a < counts[0] and 0 <= b < counts[1]]


def _route(rng: np.random.Generator, counts: tuple[int, ...], opened: Opened) -> list[Cell]:
    """The way from a random cell to the cell farthest from it."""
    first = (int(rng.integers(counts[0])), int(rng.integers(counts[1])))
    ways, last = {first: [first]}, first
    queue = [first]
    for cell in queue:
        last = cell
        for other in _neighbours(cell, counts):
            if other not in ways and frozenset((cell, other)) in opened:
                ways[other] = [*ways[cell], other]
                queue.append(other)
    return ways[last]


def _walls(counts: tuple[int, ...], opened: Opened, pitch: np.ndarray) -> list[Obstacle]:
    """The walls between cells that are not joined, neighbours in line made one."""
    walls: list[Obstacle] = []
    for axis in (0, 1):
        for line in range(1, counts[axis]):
            closed = [not _open(axis, line, k, opened) for k in range(counts[1 - axis])]
            walls += [_wall(axis, line, run, pitch) for run in _runs(closed)]
    return walls


def _open(axis: int, line: int, k: int, opened: Opened) -> bool:
    """Whether the cells on both sides of a grid line across `axis` are joined at place k along it."""
    before, after = ((line - 1, k), (line, k)) if axis == 0 else ((k, line - 1), (k, line))
    return frozenset((before, after)) in opened


def _runs(flags: list[bool]) -> list[tuple[int, int]]:
    """Beginnings and ends of the runs of true flags."""
    edges = np.flatnonzero(np.diff([False, *flags, False]))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _wall(axis: int, line: int, run: tuple[int, int], pitch: np.ndarray) -> Box:
    """A wall on a grid line across `axis`; it reaches half its thickness beyond the ends that are no table walls."""
    along = 1 - axis
    low, high = np.zeros(2), np.zeros(2)
    low[axis], high[axis] = line * pitch[axis] - WALL / 2, line * pitch[axis] + WALL / 2
    low[along], high[along] = run[0] * pitch[along], run[1] * pitch[along]
    return box_between(low, high)


def _rounded(points: Float[np.ndarray, "k 2"], radius: float) -> Float[np.ndarray, "m 2"]:
    """A polyline whose corners are rounded from `radius` [m] before them to as far after them."""
    curve = [points[0]]
    for before, corner, after in zip(points[:-2], points[1:-1], points[2:], strict=True):
        a = corner + radius * (before - corner) / np.linalg.norm(before - corner)
        b = corner + radius * (after - corner) / np.linalg.norm(after - corner)
        t = np.linspace(0, 1, 15)[:, None]
        curve.extend((1 - t) ** 2 * a + 2 * t * (1 - t) * corner + t**2 * b)
    curve.append(points[-1])
    fine = polyline.remove_repeated(np.array(curve))
    return polyline.resample(fine, 2 + int(polyline.length(fine) / 0.004))
