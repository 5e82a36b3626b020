"""Episodes of a collection: a simulated cable led at random until its shape is no longer wanted."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from cableway.errors import InputError, SimulationError
from cableway.scene.cable import Cable
from cableway.scene.scene import Scene
from cableway.simulation.chain import Chain
from cableway.simulation.motion import MotionConfig, Surroundings, random_motion, self_crossings
from cableway.simulation.plant import PlantConfig


@dataclass(frozen=True, kw_only=True)
class CollectionConfig:
    """What is collected.

    An episode starts at rest in a random stable shape and ends after `episode_steps` or before the first of: a sharp
    bend, grippers almost as far apart as the cable is long, the cable crossing itself, a keypoint that jumps, the
    cable touching something.

    Attributes:
        transitions: How many.
        seed: Same seed, same data.
        episode_steps: Most control steps in an episode.
        time_step: MuJoCo's time step [s].
        sharpest_bend: Greatest curvature, as a multiple of 1/length.
        most_stretch: Greatest distance of the grippers, as a share of the cable's length.
        largest_jump: Greatest move of a keypoint in one control step, as a multiple of `motion.max_step`.
        shard_episodes: Episodes whose transitions go into one file.
        task: A task, by its name in the catalogue or its file, near whose obstacles and walls the cable is led; open
            space without walls where None.
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
    shard_episodes: int = 500
    task: str | None = None
    cable: Cable = field(default_factory=Cable)
    motion: MotionConfig = field(default_factory=MotionConfig)

    def __post_init__(self) -> None:
        for name, least in (("transitions", 1), ("seed", 0), ("episode_steps", 1), ("shard_episodes", 1)):
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
    """Makes the episodes of a collection, each from its number alone.

    Args:
        config: What is collected.
        scene: Where, or None for open space without walls.
    """

    def __init__(self, config: CollectionConfig, scene: Scene | None = None) -> None:
        self.config = config
        self._surroundings = None if scene is None else Surroundings(scene, config.cable.radius)
        self._chain = Chain(config.cable, scene, config.time_step)
        self._substeps = PlantConfig(time_step=config.time_step).substeps

    def episode(self, number: int) -> Episode:
        """Episode `number` of this collection."""
        config, chain, substeps = self.config, self._chain, self._substeps
        rng = np.random.default_rng(np.random.SeedSequence(config.seed, spawn_key=(number,)))
        q, poses = random_motion(chain.rod, config.motion, config.episode_steps, rng, self._surroundings)
        chain.place(q)
        start = chain.coordinates[None]
        fraction = np.arange(1, substeps + 1)[:, None, None] / substeps
        path = poses[:-1, None] + fraction * np.diff(poses, axis=0)[:, None]
        try:
            rows = chain.advance(path.reshape(-1, 2, 3))
        except SimulationError:
            return Episode(np.empty((1, chain.rod.keypoints, 2)), poses[:1], "diverged")
        coordinates = np.concatenate([start, rows[substeps - 1 :: substeps]])
        lines = chain.polylines(coordinates)
        keypoints = chain.keypoints(lines)
        count, ended = self._usable(coordinates, lines, keypoints, self._touching(rows))
        return Episode(keypoints[: count + 1], poses[: count + 1], ended)

    def _usable(
        self,
        coordinates: Float[np.ndarray, "k+1 c"],
        lines: Float[np.ndarray, "k+1 v 2"],
        keypoints: Float[np.ndarray, "k+1 n 2"],
        touching: Bool[np.ndarray, "k"],
    ) -> tuple[int, str]:
        """Number of control steps before the first bad row, and what is bad there."""
        config, rod = self.config, self._chain.rod
        jumps = np.linalg.norm(np.diff(keypoints, axis=0), axis=-1).max(axis=1)
        bad = {
            "sharp bend": np.abs(coordinates[1:, 3:]).max(axis=1) * rod.hinges > config.sharpest_bend,
            "stretched": np.linalg.norm(lines[1:, -1] - lines[1:, 0], axis=1) > config.most_stretch * rod.length,
            "jump": jumps > config.largest_jump * config.motion.max_step,
            "self-crossing": self_crossings(lines[1:]),
            "contact": touching,
        }
        count = len(coordinates) - 1
        first = {reason: int(np.argmax(rows)) if rows.any() else count for reason, rows in bad.items()}
        reason = min(first, key=lambda name: first[name])
        return (first[reason], reason) if first[reason] < count else (count, "complete")

    def _touching(self, rows: Float[np.ndarray, "s c"]) -> Bool[np.ndarray, "k"]:
        """In which control steps the cable touches something at any time step."""
        if self._surroundings is None:
            return np.zeros(self.config.episode_steps, bool)
        clearance = self._surroundings.clearance(self._chain.polylines(rows))
        return clearance.reshape(-1, self._substeps).min(axis=1) < 0
