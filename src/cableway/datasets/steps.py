"""A recording of any rate at the steps of control.

Every coordinate is interpolated linearly between its own nearest values, to steps that count from the first row of each
stretch; nothing is smoothed. Where those values are further apart than a gap that is bridged, the stretch ends.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float

from cableway.core.errors import FileFormatError
from cableway.core.reading import MOST_NUMBERS
from cableway.datasets.transitions import Transitions
from cableway.geometry.groups import SE2
from cableway.scene.task import CONTROL_STEP

TINY = 1e-6
"""Time [s] by which a row may miss a step and is taken for it."""

Shapes = Float[np.ndarray, "k n 2"]
Poses = Float[np.ndarray, "k 2 3"]


def stretches(
    times: Float[np.ndarray, "m"],
    episode: Float[np.ndarray, "m"],
    keypoints: Float[np.ndarray, "m n 2"],
    poses: Float[np.ndarray, "m 2 3"] | None,
    gap: float,
) -> Iterator[tuple[Shapes, Poses | None]]:
    """Shapes and poses at successive steps, two or more, of every stretch without a gap.

    Args:
        times: [s], later in every row of an episode than in the one before.
        episode: Number of the episode of each row.
        keypoints: [m]; NaN where there is none.
        poses: [m, m, rad], likewise; None where there are none at all.
        gap: Longest time between two values that is bridged [s].

    Raises:
        FileFormatError: There are more steps than fit into memory.
    """
    gap, count = gap + TINY, keypoints.shape[1]
    table, turns = keypoints.reshape(len(keypoints), -1), np.zeros(2 * count, bool)
    if poses is not None:
        table = np.column_stack([table, poses.reshape(len(poses), -1)])
        turns = np.append(turns, [False, False, True] * 2)
    breaks = np.flatnonzero((np.diff(episode) != 0) | (np.diff(times) > gap)) + 1
    room = MOST_NUMBERS // table.shape[1]
    for rows in np.split(np.arange(len(table)), breaks):
        since = times[rows] - times[rows[0]]
        steps = CONTROL_STEP * np.arange(int((since[-1] + TINY) / CONTROL_STEP) + 1)
        room -= len(steps)
        if room < 0:
            raise FileFormatError(f"a recording of more than {MOST_NUMBERS:,} numbers at steps of {CONTROL_STEP} s")
        columns = zip(table[rows].T, turns, strict=True)
        values = np.column_stack([_at(steps, since, column, gap, bool(turning)) for column, turning in columns])
        for part in _runs(np.isnan(values)):
            given = None if poses is None else values[part, 2 * count :].reshape(-1, 2, 3)
            yield values[part, : 2 * count].reshape(-1, count, 2), given


def _at(
    steps: Float[np.ndarray, "k"],
    times: Float[np.ndarray, "m"],
    column: Float[np.ndarray, "m"],
    gap: float,
    turning: bool,
) -> Float[np.ndarray, "k"]:
    """One coordinate at the steps; NaN where the values around a step are further apart than `gap`."""
    known = ~np.isnan(column)
    if not known.any():
        return np.full(len(steps), np.nan)
    at, values = times[known], np.unwrap(column[known]) if turning else column[known]
    after = np.searchsorted(at, steps)
    left, right = at[np.maximum(after - 1, 0)], at[np.minimum(after, len(at) - 1)]
    near = np.minimum(np.abs(steps - left), np.abs(steps - right)) <= TINY
    between = (left <= steps) & (steps <= right) & (right - left <= gap)
    return np.where(near | between, np.interp(steps, at, values), np.nan)


def _runs(missing: Bool[np.ndarray, "k c"]) -> Iterator[slice]:
    """Where two or more successive rows miss nothing."""
    edges = np.flatnonzero(np.diff(missing.any(axis=1), prepend=True, append=True))
    yield from (slice(start, end) for start, end in edges.reshape(-1, 2) if end - start > 1)


def transitions(shapes: list[Shapes], poses: list[Poses], longest: int) -> Transitions:
    """Transitions between successive shapes and poses, in episodes of at most `longest`."""
    episodes = [np.arange(len(shape) - 1) // longest for shape in shapes]
    firsts = np.cumsum([0, *(each[-1] + 1 for each in episodes)])
    return Transitions(
        keypoints=np.concatenate([shape[:-1] for shape in shapes]),
        poses=np.concatenate([each[:-1] for each in poses]),
        actions=np.concatenate([SE2.minus(each[1:], each[:-1]) for each in poses]),
        next_keypoints=np.concatenate([shape[1:] for shape in shapes]),
        episode=np.concatenate([each + first for each, first in zip(episodes, firsts[:-1], strict=True)]),
    )
