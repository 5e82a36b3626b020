"""Collect transitions of a simulated cable led at random, the same ones whatever the number of workers."""

from __future__ import annotations

import itertools
import math
import multiprocessing
import signal
from collections import Counter, deque
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from cableway.errors import InputError, SimulationError
from cableway.provenance import describe, versions
from cableway.records import Transitions
from cableway.scene.cable import Cable
from cableway.simulation.chain import Chain
from cableway.simulation.motion import MotionConfig, random_motion, self_crossings
from cableway.simulation.plant import PlantConfig

Progress = Callable[[str, float], None]
"""Called with the name of a stage and the share of it that is done, from 0 to 1."""

CHUNK = 8
"""Episodes a worker takes at a time."""


@dataclass(frozen=True, kw_only=True)
class CollectionConfig:
    """What is collected.

    An episode starts at rest in a random stable shape, in open space without walls, and ends after `episode_steps`
    or before the first of: a sharp bend, grippers almost as far apart as the cable is long, the cable crossing
    itself, a keypoint that jumps.

    Attributes:
        transitions: How many.
        seed: Same seed, same data.
        episode_steps: Most control steps in an episode.
        time_step: MuJoCo's time step [s].
        sharpest_bend: Greatest curvature, as a multiple of 1/length.
        most_stretch: Greatest distance of the grippers, as a share of the cable's length.
        largest_jump: Greatest move of a keypoint in one control step, as a multiple of `motion.max_step`.
        cable: The cable.
        motion: How the grippers move.

    Raises:
        InputError: A value is out of range.
    """

    transitions: int = 60_000
    seed: int = 0
    episode_steps: int = 60
    time_step: float = PlantConfig.time_step
    sharpest_bend: float = 20.0
    most_stretch: float = 0.985
    largest_jump: float = 4.0
    cable: Cable = field(default_factory=Cable)
    motion: MotionConfig = field(default_factory=MotionConfig)

    def __post_init__(self) -> None:
        for name, least in (("transitions", 1), ("seed", 0), ("episode_steps", 1)):
            if getattr(self, name) < least:
                raise InputError(f"collection.{name} must be at least {least}, got {getattr(self, name)!r}")
        for name in ("sharpest_bend", "most_stretch", "largest_jump"):
            if not 0 < getattr(self, name) < math.inf:
                raise InputError(f"collection.{name} must be positive and finite, got {getattr(self, name)!r}")
        PlantConfig(time_step=self.time_step)


class Episode(NamedTuple):
    """What one episode gave.

    Attributes:
        keypoints: (k+1, n, 2) [m].
        poses: (k+1, 2, 3) gripper poses [m, m, rad].
        ended: Why it ended.
    """

    keypoints: Float[np.ndarray, "k+1 n 2"]
    poses: Float[np.ndarray, "k+1 2 3"]
    ended: str


class Collector:
    """Makes the episodes of a collection, each from its number alone."""

    def __init__(self, config: CollectionConfig) -> None:
        self.config = config
        self._chain = Chain(config.cable, None, config.time_step)
        self._substeps = PlantConfig(time_step=config.time_step).substeps

    def episode(self, number: int) -> Episode:
        """Episode `number` of this collection."""
        config, chain, substeps = self.config, self._chain, self._substeps
        rng = np.random.default_rng(np.random.SeedSequence(config.seed, spawn_key=(number,)))
        q, poses = random_motion(chain.rod, config.motion, config.episode_steps, rng)
        chain.place(q)
        start = chain.coordinates[None]
        fraction = np.arange(1, substeps + 1)[:, None, None] / substeps
        path = poses[:-1, None] + fraction * np.diff(poses, axis=0)[:, None]
        try:
            rows = chain.advance(path.reshape(-1, 2, 3))[substeps - 1 :: substeps]
        except SimulationError:
            return Episode(np.empty((1, chain.rod.keypoints, 2)), poses[:1], "diverged")
        coordinates = np.concatenate([start, rows])
        lines = chain.polylines(coordinates)
        keypoints = chain.keypoints(lines)
        count, ended = self._usable(coordinates, lines, keypoints)
        return Episode(keypoints[: count + 1], poses[: count + 1], ended)

    def _usable(
        self,
        coordinates: Float[np.ndarray, "k+1 c"],
        lines: Float[np.ndarray, "k+1 v 2"],
        keypoints: Float[np.ndarray, "k+1 n 2"],
    ) -> tuple[int, str]:
        """Number of control steps before the first bad row, and what is bad there."""
        config, rod = self.config, self._chain.rod
        jumps = np.linalg.norm(np.diff(keypoints, axis=0), axis=-1).max(axis=1)
        bad = {
            "sharp bend": np.abs(coordinates[1:, 3:]).max(axis=1) * rod.hinges > config.sharpest_bend,
            "stretched": np.linalg.norm(lines[1:, -1] - lines[1:, 0], axis=1) > config.most_stretch * rod.length,
            "jump": jumps > config.largest_jump * config.motion.max_step,
            "self-crossing": self_crossings(lines[1:]),
        }
        count = len(coordinates) - 1
        first = {reason: int(np.argmax(rows)) if rows.any() else count for reason, rows in bad.items()}
        reason = min(first, key=lambda name: first[name])
        return (first[reason], reason) if first[reason] < count else (count, "complete")


def collect(config: CollectionConfig, *, progress: Progress | None = None, workers: int = 1) -> Transitions:
    """Simulate episodes until there are enough transitions.

    Args:
        config: What is collected.
        progress: Called with the stage's name and the share that is done.
        workers: Processes that simulate; more than one needs an importable main module (`if __name__ == "__main__"`).

    Returns:
        `config.transitions` transitions, the same for any number of workers; the metadata hold configuration,
        versions, and how episodes ended.

    Raises:
        InputError: `workers` is below 1, or the configuration gives no stable shapes.
        SimulationError: Hardly any episode gives usable transitions.
    """
    if workers < 1:
        raise InputError(f"workers must be at least 1, got {workers!r}")
    kept: list[Episode] = []
    numbers: list[int] = []
    ends: Counter[str] = Counter()
    total = 0
    with _episodes(config, workers) as stream:
        for number, episode in enumerate(stream):
            ends[episode.ended] += 1
            if len(episode.poses) > 1:
                kept.append(episode)
                numbers.append(number)
                total += len(episode.poses) - 1
            if progress is not None:
                progress("collect", min(1.0, total / config.transitions))
            if total >= config.transitions:
                break
            if number >= 100 and total < number:
                raise SimulationError(
                    f"{number + 1} episodes gave only {total} usable transitions; they ended by {dict(ends)}"
                )
    return _transitions(config, kept, numbers, dict(ends))


@contextmanager
def _episodes(config: CollectionConfig, workers: int) -> Iterator[Iterator[Episode]]:
    """All episodes in order, without end, from this process or from `workers` others."""
    firsts = itertools.count(0, CHUNK)
    if workers == 1:
        yield itertools.chain.from_iterable(_chunk(config, first) for first in firsts)
        return
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _ignore_interrupt)
    try:
        yield itertools.chain.from_iterable(_in_flight(pool, config, firsts, 2 * workers))
    except BrokenProcessPool:
        raise SimulationError(
            "a collecting process died: out of memory, stopped from outside, or unable to import the main module "
            "(which needs `if __name__ == '__main__'`)"
        ) from None
    finally:
        pool.shutdown(cancel_futures=True)


def _in_flight(
    pool: ProcessPoolExecutor, config: CollectionConfig, firsts: Iterator[int], ahead: int
) -> Iterator[list[Episode]]:
    """Chunks in order, with `ahead` of them under way."""
    waiting = deque(pool.submit(_chunk, config, first) for first in itertools.islice(firsts, ahead))
    while True:
        chunk = waiting.popleft().result()
        waiting.append(pool.submit(_chunk, config, next(firsts)))
        yield chunk


@lru_cache(maxsize=1)
def _collector(config: CollectionConfig) -> Collector:
    return Collector(config)


def _chunk(config: CollectionConfig, first: int) -> list[Episode]:
    collector = _collector(config)
    return [collector.episode(number) for number in range(first, first + CHUNK)]


def _ignore_interrupt() -> None:
    """In a worker: an interrupt is for the main process, which then stops the workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _transitions(
    config: CollectionConfig, kept: list[Episode], numbers: list[int], ends: dict[str, int]
) -> Transitions:
    steps = [len(episode.poses) - 1 for episode in kept]
    columns = {
        "keypoints": np.concatenate([episode.keypoints[:-1] for episode in kept]),
        "poses": np.concatenate([episode.poses[:-1] for episode in kept]),
        "actions": np.concatenate([np.diff(episode.poses, axis=0) for episode in kept]),
        "next_keypoints": np.concatenate([episode.keypoints[1:] for episode in kept]),
        "episode": np.repeat(numbers, steps),
    }
    metadata = {"seed": config.seed, "config": describe(config), "versions": versions(), "episodes_ended": ends}
    return Transitions(**{name: rows[: config.transitions] for name, rows in columns.items()}, metadata=metadata)
