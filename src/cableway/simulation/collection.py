"""Collect transitions of a simulated cable led at random into a data set on disk.

Each episode follows from the configuration and its number alone. Workers simulate chunks of episodes; the main process
takes them in order and writes a shard whenever a fixed range of episodes is complete. So the files do not depend on the
number of workers, on where they run, or on interruptions, and no more than a shard and the chunks under way are in
memory.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import logging
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np

from cableway.core.errors import SimulationError
from cableway.core.executors import open_executor
from cableway.core.provenance import describe, required_versions
from cableway.datasets.manifest import CABLE, Manifest, Shard, columns_for
from cableway.datasets.writing import DatasetWriter, Origin, open_writer
from cableway.scene.files.loading import load_planar_task
from cableway.scene.scene import Scene
from cableway.simulation.episodes import CollectionConfig, Collector, Episode

LOGGER = logging.getLogger(__name__)

Progress = Callable[[str, float], None]
"""Called with the name of a stage and the share of it that is done, from 0 to 1."""

CHUNK = 10
"""Most episodes that a worker takes at a time."""

TRIAL = 100
"""Episodes after which a collection that gives less than one transition for each is given up."""


class Collected(NamedTuple):
    """What a collection left.

    Attributes:
        manifest: Of the data set.
        made: How many of its shards were made now; the others were there already.
    """

    manifest: Manifest
    made: int


def collect(
    config: CollectionConfig,
    folder: Path | str,
    *,
    progress: Progress | None = None,
    workers: int | None = 1,
    executor: str = "local",
) -> Collected:
    """Simulate episodes until there are enough transitions, and write them to a folder, shard by shard.

    A folder that holds part of the same data set is completed; damaged shards are made again. The files are the same,
    byte for byte, whatever `workers` and `executor` are and however often it was interrupted.

    Args:
        config: What is collected.
        folder: Where the data set goes; made if missing.
        progress: Called with the stage's name and the share that is done.
        workers: Simulations at a time, None for as many as there are cores; more than one local worker needs an
            importable main module (`if __name__ == "__main__"`).
        executor: "local" or "ray".

    Raises:
        InputError: `folder` holds another data set, `workers` or `executor` cannot be used, or the configuration gives
            no stable shapes.
        SimulationError: Hardly any episode gives usable transitions.
        StorageError: There is no room for the next shard; what is complete stays.
    """
    job = _Job.of(config)
    LOGGER.info("collection: %s", json.dumps(job.origin.config))
    with open_executor(executor, workers) as pool, open_writer(Path(folder), job.origin) as writer:
        missing = (first for first in itertools.count(0, config.shard_episodes) if writer.shard(first) is None)
        chunks = ((job, *chunk) for first in missing for chunk in _chunks(first, config.shard_episodes))
        return _write(job, writer, pool.in_order(_simulate, chunks), progress or (lambda stage, share: None))


def _write(job: _Job, writer: DatasetWriter, chunks: Iterator[list[Episode]], progress: Progress) -> Collected:
    """Take shards in order until there are enough transitions: those that are there, and those made of `chunks`."""
    config, number, done, made = job.config, 0, 0, 0
    ended: Counter[str] = Counter()
    while done < config.transitions:
        first = number * config.shard_episodes
        shard = writer.shard(first)
        if shard is None:
            made += 1
            shard = _make_shard(job, writer, number, done, chunks, progress)
        number, done = number + 1, done + shard.transitions
        ended.update(shard.ended)
        progress("collect", done / config.transitions)
        if done < config.transitions and done < first + shard.episodes >= TRIAL:
            _give_up(done, ended)
    return Collected(writer.finish(), made)


def _make_shard(
    job: _Job, writer: DatasetWriter, number: int, done: int, chunks: Iterator[list[Episode]], progress: Progress
) -> Shard:
    """Write the shard of that number, cut off where there are enough transitions; `done` are in those before it."""
    config, total = job.config, done
    first = number * config.shard_episodes
    episodes: list[Episode] = []
    sizes = [len(chunk) for chunk in _chunks(first, config.shard_episodes)]
    for chunk in itertools.islice(chunks, len(sizes)):
        for episode in chunk:
            if total < config.transitions:
                episodes.append(episode)
                total += len(episode.poses) - 1
        progress("collect", min(1.0, total / config.transitions))
        if total >= config.transitions:
            break
        if total < len(episodes) >= TRIAL:
            _give_up(total, Counter(episode.ended for episode in episodes))
    ended = Counter(episode.ended for episode in episodes)
    return writer.add(number, first, ended, _columns(episodes, first, config.transitions - done, config.drawn))


def _give_up(transitions: int, ended: Counter[str]) -> NoReturn:
    raise SimulationError(
        f"{ended.total()} episodes gave only {transitions} usable transitions; reasons for their ends: {dict(ended)}"
    )


def _columns(episodes: list[Episode], first: int, most: int, drawn: tuple[str, ...]) -> dict[str, np.ndarray]:
    """The first `most` transitions of successive episodes, with the fields of the cable that were drawn."""
    steps = [len(episode.poses) - 1 for episode in episodes]
    columns = {
        "keypoints": np.concatenate([episode.keypoints[:-1] for episode in episodes]),
        "poses": np.concatenate([episode.poses[:-1] for episode in episodes]),
        "actions": np.concatenate([np.diff(episode.poses, axis=0) for episode in episodes]),
        "next_keypoints": np.concatenate([episode.keypoints[1:] for episode in episodes]),
        "episode": np.repeat(np.arange(first, first + len(episodes)), steps),
    }
    for name in drawn:
        values = np.array([getattr(episode.cable, name) for episode in episodes])
        columns[CABLE + name] = np.repeat(values, steps, axis=0)
    return {name: rows[:most] for name, rows in columns.items()}


# ------------------------------------------------------------------------------------------------ in the workers
@dataclass(frozen=True)
class _Job:
    """A collection as workers get it: with the scene, since they may not have the task's file."""

    config: CollectionConfig = field(compare=False)
    scene: Scene | None = field(compare=False)
    origin: Origin = field(compare=False)
    identity: str

    @classmethod
    def of(cls, config: CollectionConfig) -> _Job:
        scene = None if config.task is None else load_planar_task(config.task).scene
        resolved: dict[str, Any] = {**describe(config), "scene": describe(scene)}
        columns = columns_for(config.cable_at(np.random.default_rng(config.seed)), config.drawn)
        origin = Origin(config.seed, resolved, required_versions(), columns)
        return cls(config, scene, origin, hashlib.sha256(json.dumps(resolved).encode()).hexdigest())


def _chunks(first: int, count: int) -> Iterator[tuple[int, int]]:
    """Begin and end of each chunk of `count` episodes from number `first` on."""
    for begin in range(first, first + count, CHUNK):
        yield begin, min(begin + CHUNK, first + count)


@lru_cache(maxsize=1)
def _collector(job: _Job) -> Collector:
    return Collector(job.config, job.scene)


def _simulate(job: _Job, begin: int, end: int) -> list[Episode]:
    collector = _collector(job)
    episodes = [collector.episode(number) for number in range(begin, end)]
    LOGGER.debug("episodes %d to %d ended: %s", begin, end - 1, ", ".join(each.ended for each in episodes))
    return episodes
