"""The scene in space: a box-shaped workspace whose floor is the table, with convex obstacles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from cableway.core.errors import InputError, SpacePoint, TaskError
from cableway.core.quantities import size_text
from cableway.geometry.spatial_convex import WALLS, SpatialWorld, chain_distance, signed_distance
from cableway.scene import checks
from cableway.scene.spatial.obstacles import SpatialObstacle, describe, displaced

MOST_OBSTACLES = 1000


@dataclass(frozen=True)
class SpatialScene:
    """A workspace and what stands in it.

    Attributes:
        size: (x, y, z) [m]; the origin is a corner of the table, and walls, table and ceiling are obstacles.
        obstacles: Convex obstacles; they may reach through the walls and overlap each other.

    Raises:
        TaskError: A size is not positive and finite, or an obstacle lies wholly outside.
    """

    size: tuple[float, float, float]
    obstacles: tuple[SpatialObstacle, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", checks.numbers(self.size, ("workspace", "size"), (checks.WORKSPACE,) * 3))
        object.__setattr__(self, "obstacles", tuple(self.obstacles))
        if len(self.obstacles) > MOST_OBSTACLES:
            raise TaskError(f"must be at most {MOST_OBSTACLES}, got {len(self.obstacles)}", ("obstacles",))
        for index, obstacle in enumerate(self.obstacles):
            bounds = obstacle.solid.bounds
            if (bounds[3:] <= 0).any() or (bounds[:3] >= self.size).any():
                problem = f"({describe(obstacle)}) lies wholly outside the workspace of {size_text(self.size)}"
                raise TaskError(problem, ("obstacles", index))

    def changed(self, by: Sequence[tuple[float, float, float]]) -> SpatialScene:
        """The scene with each obstacle displaced by (dx, dy, dz) [m]; none where `by` is empty.

        Raises:
            TaskError: An obstacle is then wholly outside, or stands on the table and is to be raised.
        """
        moved = [displaced(*pair) for pair in zip(self.obstacles, by, strict=True)] if by else self.obstacles
        return replace(self, obstacles=tuple(moved))

    @cached_property
    def world(self) -> SpatialWorld:
        """The obstacles and the walls, packed for the compiled kernels."""
        return SpatialWorld.of([obstacle.solid for obstacle in self.obstacles], np.array(self.size))

    def name_of(self, index: int) -> str:
        """What stands behind an index of `geometry.spatial_convex`, such as 'obstacles[2] (box at ...)'."""
        if index >= len(self.obstacles):
            return "the " + WALLS[index - len(self.obstacles)]
        return f"obstacles[{index}] ({describe(self.obstacles[index])})"

    def nearest(self, stations: Float[np.ndarray, "s 3"]) -> tuple[float, int, SpacePoint]:
        """Distance [m] of a line through stations from the nearest obstacle or wall, which that is, and about where."""
        distance, index = chain_distance(stations[None], self.world)
        away, _, which = signed_distance(stations, self.world)
        x, y, z = stations[int(np.argmin(np.where(which == index[0], away, np.inf)))].tolist()
        return float(distance[0]), int(index[0]), (x, y, z)

    def contains(self, points: Float[np.ndarray, "k 3"]) -> Bool[np.ndarray, "k"]:
        """Which points [m] are within the workspace."""
        return np.all((points >= 0) & (points <= self.size), axis=1)


def recorded_displacements(metadata: Mapping[str, Any]) -> tuple[SpacePoint, ...]:
    """Displacement [m] of each obstacle in the plant of a rollout, by its metadata; empty where none was moved.

    Raises:
        InputError: They are no displacements.
    """
    made_by: Any = metadata.get("configuration") or {}
    try:
        return tuple((float(x), float(y), float(z)) for x, y, z in made_by.get("plant", {}).get("obstacles", ()))
    except (AttributeError, TypeError, ValueError) as error:
        raise InputError(f"the rollout's plant.obstacles are no displacements: {error}") from error
