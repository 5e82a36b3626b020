"""Episodes of a collection: a simulated cable led at random until its shape is no longer wanted."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from cableway.core.checks import Checked, NotNegative, Positive
from cableway.core.errors import SimulationError
from cableway.rod.planar import PlanarRod
from cableway.scene.cable import Cable
from cableway.scene.files.presets import preset_ranges
from cableway.scene.scene import Scene
from cableway.simulation.chain import Chain
from cableway.simulation.plant import PlantConfig
from cableway.simulation.random_motion import MotionConfig, Surroundings, random_motion
from cableway.simulation.shapes import self_crossings

GRASP_TOLERANCE = 0.002
"""By how much the cable's ends may be nearer to each other than the grippers, as a share of the length."""


@dataclass(frozen=True, kw_only=True)
class CollectionConfig(Checked):
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
        ranges: Least and greatest value of those fields of the cable that are drawn anew for each episode, "preset"
            for the ranges of the cable's preset; the same cable throughout where None.
        motion: How the grippers move.

    Raises:
        InputError: A value is out of range.
    """

    transitions: Positive[int] = 60_000
    seed: NotNegative[int] = 0
    episode_steps: Positive[int] = 60
    time_step: float = PlantConfig.time_step
    sharpest_bend: Positive[float] = 20.0
    most_stretch: Positive[float] = 0.985
    largest_jump: Positive[float] = 4.0
    shard_episodes: Positive[int] = 500
    task: str | None = None
    cable: Cable = field(default_factory=Cable)
    ranges: dict[str, tuple[float, float]] | Literal["preset"] | None = None
    motion: MotionConfig = field(default_factory=MotionConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        PlantConfig(time_step=self.time_step)
        if self.ranges == "preset":
            object.__setattr__(self, "ranges", preset_ranges(str(self.cable.preset)))
        self.cable_at(np.random.default_rng(self.seed))

    @property
    def drawn(self) -> tuple[str, ...]:
        """Fields of the cable that are drawn for each episode."""
        return tuple(sorted(self.ranges)) if isinstance(self.ranges, dict) else ()

    def cable_at(self, rng: np.random.Generator) -> Cable:
        """The cable of an episode, the next to be drawn from `rng`."""
        return self.cable.sample(rng, self.ranges) if isinstance(self.ranges, dict) else self.cable


class Episode(NamedTuple):
    """What one episode gave.

    Attributes:
        keypoints: (k+1, n, 2) [m].
        poses: (k+1, 2, 3) gripper poses [m, m, rad].
        cable: The cable.
        ended: Why it ended.
    """

    keypoints: Float[np.ndarray, "k n 2"]
    poses: Float[np.ndarray, "k 2 3"]
    cable: Cable
    ended: str


class Collector:
    """Makes the episodes of a collection, each from its number alone.

    Args:
        config: What is collected.
        scene: Where, or None for open space without walls.
    """

    def __init__(self, config: CollectionConfig, scene: Scene | None = None) -> None:
        self.config = config
        self._scene = scene
        self._chain = Chain(config.cable, scene, config.time_step)
        self._substeps = PlantConfig(time_step=config.time_step).substeps

    def episode(self, number: int) -> Episode:
        """Episode `number` of this collection."""
        config, substeps = self.config, self._substeps
        rng = np.random.default_rng(np.random.SeedSequence(config.seed, spawn_key=(number,)))
        cable = config.cable_at(rng)
        chain = Chain(cable, self._scene, config.time_step) if config.drawn else self._chain
        surroundings = None if self._scene is None else Surroundings(self._scene, cable.radius)
        q, poses = random_motion(chain.rod, config.motion, config.episode_steps, rng, surroundings)
        poses = self._until_stretched(poses, chain.rod)
        fraction = np.arange(1, substeps + 1)[:, None, None] / substeps
        path = poses[:-1, None] + fraction * np.diff(poses, axis=0)[:, None]
        try:
            chain.place(q)
            start = chain.coordinates[None]
            rows = np.concatenate([start, chain.advance(path.reshape(-1, 2, 3))])
        except SimulationError:
            return Episode(np.empty((1, chain.rod.keypoints, 2)), poses[:1], cable, "diverged")
        coordinates = rows[::substeps]
        lines = chain.polylines(coordinates)
        keypoints = chain.keypoints(lines)
        touching = _touching(chain, rows, surroundings, substeps)
        count, ended = self._usable(chain.rod, coordinates, lines, keypoints, touching)
        return Episode(keypoints[: count + 1], poses[: count + 1], cable, ended)

    def _until_stretched(self, poses: Float[np.ndarray, "k 2 3"], rod: PlanarRod) -> Float[np.ndarray, "j 2 3"]:
        """Gripper poses up to those so far apart that the episode has certainly ended; the rest is not simulated."""
        apart = np.linalg.norm(poses[:, 1, :2] - poses[:, 0, :2], axis=1)
        beyond = np.flatnonzero(apart > (self.config.most_stretch + GRASP_TOLERANCE) * rod.length)
        return poses if not len(beyond) else poses[: beyond[0] + 1]

    def _usable(
        self,
        rod: PlanarRod,
        coordinates: Float[np.ndarray, "k c"],
        lines: Float[np.ndarray, "k v 2"],
        keypoints: Float[np.ndarray, "k n 2"],
        touching: Bool[np.ndarray, "k"],
    ) -> tuple[int, str]:
        """Number of control steps before the first bad row, and what is bad there."""
        config = self.config
        jumps = np.linalg.norm(np.diff(keypoints, axis=0, prepend=keypoints[:1]), axis=-1).max(axis=1)
        bad = {
            "sharp bend": np.abs(coordinates[:, 3:]).max(axis=1) * rod.hinges > config.sharpest_bend,
            "stretched": np.linalg.norm(lines[:, -1] - lines[:, 0], axis=1) > config.most_stretch * rod.length,
            "jump": jumps > config.largest_jump * config.motion.max_step,
            "self-crossing": self_crossings(lines),
            "contact": touching,
        }
        first = {reason: int(np.argmax(rows)) for reason, rows in bad.items() if rows.any()}
        if not first:
            return len(coordinates) - 1, "complete"
        reason = min(first, key=lambda name: first[name])
        return max(0, first[reason] - 1), reason


def _touching(
    chain: Chain, rows: Float[np.ndarray, "s c"], surroundings: Surroundings | None, substeps: int
) -> Bool[np.ndarray, "k"]:
    """At the start and in each control step, whether the cable touches something at any time step."""
    count = len(rows) // substeps
    if surroundings is None:
        return np.zeros(count + 1, bool)
    touches = surroundings.clearance(chain.polylines(rows)) < 0
    return np.concatenate([touches[:1], touches[1:].reshape(count, substeps).any(axis=1)])
