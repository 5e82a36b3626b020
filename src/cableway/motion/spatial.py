"""Where a cable held in space may be: the twelve numbers of `cableway.rod.spatial` that are free.

As in the plane (`cableway.motion.validity`), every shape between two is an equilibrium, so a motion is checked at
shapes a few millimetres apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import ConvexHull

from cableway.geometry import rotations
from cableway.geometry.spatial_convex import SpatialWorld, signed_distance
from cableway.geometry.spatial_convex_kernels import self_distance
from cableway.motion import spatial_kernels
from cableway.motion.limits import Margins
from cableway.motion.spatial_kernels import OTHER, WORLD
from cableway.robot.free_spatial_arms import FreeSpatialArms
from cableway.rod.spatial import SpatialRod
from cableway.scene.grippers import Grippers
from cableway.scene.spatial.grippers import SpatialBody
from cableway.scene.spatial.task import SpatialTask

NEAR, FAR = 0.001, 1e3
"""Distances [m]: of hulls, above which nothing is in the way; of a cable that is not looked at."""

OFF_CABLE = 0.001
"""Clearance [m] of gripper bodies from parts of the cable that they do not hold."""


@dataclass(frozen=True)
class SpatialHulls:
    """Bodies of the grippers that are hulls of corners, one after the other.

    Attributes:
        side: (p,) gripper that each moves with, 0 left, 1 right.
        corners: (c, 3) in that gripper's frame [m].
        first: (p + 1,) where those of each begin.
        radius: (p,) by which each is grown [m].
        held: (p,) length of cable from its gripper on that each may touch [m].
    """

    side: Int[np.ndarray, "p"]
    corners: Float[np.ndarray, "c 3"]
    first: Int[np.ndarray, "p+1"]
    radius: Float[np.ndarray, "p"]
    held: Float[np.ndarray, "p"]

    @classmethod
    def of(cls, bodies: Sequence[SpatialBody], cable: float) -> SpatialHulls:
        """Those on a cable of a radius [m]."""
        corners = [np.zeros((0, 3)), *(each.points for each in bodies)]
        return cls(
            np.array([each.side for each in bodies], dtype=np.int64),
            np.concatenate(corners),
            np.cumsum([len(each) for each in corners], dtype=np.int64),
            np.array([each.radius for each in bodies], float),
            np.array([each.held_arc(cable) for each in bodies], float),
        )

    def placed(self, poses: Float[np.ndarray, "t 2 7"]) -> Float[np.ndarray, "t c 3"]:
        """Their corners [m] in the world."""
        held = poses[:, np.repeat(self.side, np.diff(self.first))]
        return held[..., :3] + rotations.rotate(held[..., 3:], self.corners)


@dataclass(frozen=True)
class SpatialBodies:
    """Bodies of the grippers: balls in their frames, and hulls.

    Attributes:
        side: (k,) gripper that each ball moves with, 0 left, 1 right.
        at: (k, 3) where it is in that gripper's frame [m].
        radius: (k,) [m].
        held: (k,) length of cable from its gripper on that it may touch [m].
        hulls: The others.
    """

    side: Int[np.ndarray, "k"]
    at: Float[np.ndarray, "k 3"]
    radius: Float[np.ndarray, "k"]
    held: Float[np.ndarray, "k"]
    hulls: SpatialHulls

    @classmethod
    def of(cls, bodies: Sequence[SpatialBody], cable: float) -> SpatialBodies:
        """Those on a cable of a radius [m]."""
        balls = [each for each in bodies if len(each.points) == 1]
        return cls(
            np.array([each.side for each in balls], dtype=np.int64),
            np.concatenate([each.points for each in balls]),
            np.array([each.radius for each in balls], float),
            np.array([each.held_arc(cable) for each in balls], float),
            SpatialHulls.of([each for each in bodies if len(each.points) > 1], cable),
        )

    def arrays(self, length: float, stations: int) -> tuple[Any, ...]:
        """What the kernels take as `bodies`, for a cable of a length [m] and so many stations."""
        hulls = self.hulls
        packed = (hulls.side, hulls.corners, hulls.first, hulls.radius, _spared(hulls.held, length, stations))
        balls = (self.side, self.at, self.radius, _spared(self.held, length, stations))
        return (*balls, packed if len(hulls.side) else None)

    def points(self, poses: Float[np.ndarray, "t 2 7"]) -> Float[np.ndarray, "t k 3"]:
        """The centres of the balls [m] in the world."""
        held = poses[:, self.side]
        return held[..., :3] + rotations.rotate(held[..., 3:], self.at)

    def hull_gaps(
        self, poses: Float[np.ndarray, "t 2 7"], stations: Float[np.ndarray, "t s 3"], world: SpatialWorld,
        length: float, ceilings: Float[np.ndarray, "3"],
    ) -> tuple[np.ndarray, ...]:  # fmt: skip
        """`spatial_kernels.hull_gaps` of rows of a cable of a length [m]."""
        if not len(self.hulls.side):
            shape = (len(poses), 0)
            return tuple(np.zeros((*shape, *more)) for more in ((3,), (3, 3), (3, 3), (), ()))
        arrays = self.arrays(length, stations.shape[1])
        return spatial_kernels.hull_gaps(
            self.hulls.placed(poses), self.points(poses), stations, world.arrays, arrays, ceilings
        )

    def gaps(self, poses: Float[np.ndarray, "t 2 7"], world: SpatialWorld) -> Float[np.ndarray, "t 2"]:
        """Least distances [m] of the bodies from the world, and of the hands from each other; of hulls, to `NEAR`."""
        points = self.points(poses)
        off_world, apart = signed_distance(points, world)[0] - self.radius, _balls_gaps(points, self)
        elsewhere = np.full((len(poses), 3, 3), FAR)
        hulls = self.hull_gaps(poses, elsewhere, world, 1.0, np.full(3, NEAR))[0]
        return np.column_stack(
            [
                np.minimum(off_world.min(axis=1, initial=math.inf), hulls[..., WORLD].min(axis=1, initial=math.inf)),
                np.minimum(apart, hulls[..., OTHER].min(axis=1, initial=math.inf)),
            ]
        )

    @property
    def inner_balls(self) -> tuple[Int[np.ndarray, "b"], Float[np.ndarray, "b 3"], Float[np.ndarray, "b"]]:
        """Sides, places in the grippers' frames [m] and radii [m] of the balls, and of one in each hull."""
        hulls = [self.hulls.corners[i:j] for i, j in pairwise(self.hulls.first)]
        middles = [each.mean(axis=0) for each in hulls]
        depths = [
            -float((ConvexHull(each).equations @ (*middle, 1.0)).max())
            for each, middle in zip(hulls, middles, strict=True)
        ]
        return (
            np.concatenate([self.side, self.hulls.side]),
            np.concatenate([self.at, np.reshape(middles, (-1, 3))]),
            np.concatenate([self.radius, self.hulls.radius + depths]),
        )


def _spared(held: Float[np.ndarray, "k"], length: float, stations: int) -> Int[np.ndarray, "k"]:
    """Stations of a cable of a length [m], from a gripper on, that are held."""
    return np.minimum(stations, np.ceil(held * (stations - 1) / length).astype(np.int64) + 1)


class SpatialLimits(NamedTuple):
    """What a shape in space must keep.

    Attributes:
        cable_distance: Of the centre line from obstacles and walls [m].
        gripper_clearance: Of bodies from obstacles and walls [m].
        bodies_apart: Of the bodies of the two grippers from each other [m].
        bodies_off_cable: Of bodies from the centre line of what they do not hold [m].
        stability: Least stability margin.
        least_span: Least distance of the grippers [m].
        most_span: Greatest distance of the grippers [m].
        sharpest_turn: Greatest sine of the turn at a hinge.
        most_twist: Greatest twist from end to end [rad].
        apart: Stations along the rod from which on it could touch itself.
        self_distance: Of such stations from each other [m].
    """

    cable_distance: float
    gripper_clearance: float
    bodies_apart: float
    bodies_off_cable: float
    stability: float
    least_span: float
    most_span: float
    sharpest_turn: float
    most_twist: float
    apart: int
    self_distance: float


@dataclass(frozen=True)
class SpatialProblem:
    """A motion in space to be planned, as values.

    Attributes:
        rod: The cable's rod.
        radius: The cable's [m].
        world: Obstacles and walls.
        bodies: Of the grippers.
        grippers: Their limits.
        start: (12,) equilibrium.
        goal: (12,) equilibrium.
        least_bend_radius: That the cable takes [m].
        most_twist: That it takes from end to end [rad].
    """

    rod: SpatialRod
    radius: float
    world: SpatialWorld
    bodies: SpatialBodies
    grippers: Grippers
    start: Float[np.ndarray, "12"]
    goal: Float[np.ndarray, "12"]
    least_bend_radius: float
    most_twist: float

    @classmethod
    def of(cls, task: SpatialTask) -> SpatialProblem:
        """That of a task."""
        limits, cable = task.grippers, task.cable
        grippers = Grippers(
            radius=limits.radius, max_step=limits.max_step, max_turn=limits.max_turn, separation=limits.separation
        )
        return cls(
            task.rod, cable.radius, task.scene.world, SpatialBodies.of(task.bodies, cable.radius), grippers,
            np.array(task.start), np.array(task.goal), cable.min_bend_radius, cable.max_twist,
        )  # fmt: skip

    @property
    def sharpest_turn(self) -> float:
        """Greatest sine of the turn at a hinge that the least bend radius allows."""
        if self.least_bend_radius <= 0:
            return math.inf
        return math.sin(min(math.pi / 2, self.rod.length / self.rod.hinges / self.least_bend_radius))

    @property
    def stations_apart(self) -> int:
        """Stations along the rod from which on it could touch itself: half a turn of its own thickness."""
        return math.ceil(math.pi * self.radius * 2 * self.rod.hinges / self.rod.length) + 1


@dataclass(frozen=True)
class SpatialFreeSpace:
    """The configurations of a problem's cable that are free.

    Attributes:
        arrays: What the kernels take as `space`.
    """

    arrays: tuple[Any, ...]

    @classmethod
    def of(cls, problem: SpatialProblem, margins: Margins, arms: FreeSpatialArms | None = None) -> SpatialFreeSpace:
        """What margins allow, never more than start and goal keep, and where arms can hold the grippers."""
        rod, bodies = problem.rod, problem.bodies
        kept = np.array([problem.start, problem.goal])
        stations, poses = rod.shapes(kept)
        spans = np.linalg.norm(poses[:, 1, :3] - poses[:, 0, :3], axis=1)
        twists = np.abs(kept[:, 9]) / rod.twist
        turns = [spatial_kernels.sharpest_turn(shape, rod.length) for shape in stations]
        apart = problem.stations_apart
        selves = min(self_distance(shape, apart) for shape in stations)
        points, arrays = bodies.points(poses), bodies.arrays(rod.length, stations.shape[1])
        of_balls = signed_distance(points, problem.world)[0] - bodies.radius
        away = bodies.hull_gaps(poses, stations, problem.world, rod.length, np.full(3, math.inf))[0]
        to_world, apart_from, off_cable = away.min(axis=(0, 1), initial=math.inf).tolist()
        limits = SpatialLimits(
            cable_distance=min(
                problem.radius + margins.clearance, float(signed_distance(stations, problem.world)[0].min()) - 1e-6
            ),
            gripper_clearance=min(margins.clearance, float(of_balls.min()) - 1e-6, to_world - 1e-6),
            bodies_apart=min(margins.clearance, float(_balls_gaps(points, bodies).min()) - 1e-6, apart_from - 1e-6),
            bodies_off_cable=min(
                problem.radius + OFF_CABLE,
                off_cable - 1e-6,
                _off_cable(points, stations, bodies.side, bodies.radius, arrays[3]) - 1e-6,
            ),
            stability=min(margins.stability, float(rod.stability(kept)[0].min()) - 1e-6),
            least_span=min(problem.grippers.least_span, float(spans.min()) - 1e-9),
            most_span=max(margins.gripper_span * rod.length, float(spans.max()) + 1e-9),
            sharpest_turn=max([problem.sharpest_turn, *turns]),
            most_twist=max(problem.most_twist, float(twists.max()) + 1e-9),
            apart=apart,
            self_distance=min(2 * problem.radius + margins.self_distance, selves - 1e-9),
        )
        return cls((rod.arrays, problem.world.arrays, limits, arrays, arms))

    @property
    def arms(self) -> FreeSpatialArms | None:
        """What holds the grippers, if anything does."""
        return self.arrays[4]

    def are_free(self, q: Float[np.ndarray, "k 12"]) -> Bool[np.ndarray, "k"]:
        """Which configurations are free."""
        return spatial_kernels.are_free(np.ascontiguousarray(q, float), self.arrays)


def rows_between(rod: SpatialRod, q: Float[np.ndarray, "t 12"], at: Float[np.ndarray, "k"]) -> np.ndarray:
    """Rows at fractional indices, held at the ends, each on the way from one row to the next."""
    at = np.clip(at, 0, len(q) - 1)
    whole = np.minimum(at.astype(int), max(0, len(q) - 2))
    return rod.between(q[whole], q[np.minimum(whole + 1, len(q) - 1)], at - whole)


def continuous_poses(poses: Float[np.ndarray, "t 2 7"]) -> Float[np.ndarray, "t 2 7"]:
    """The same poses with quaternions whose sign does not jump from row to row."""
    out = poses.copy()
    same = np.sum(out[1:, :, 3:] * out[:-1, :, 3:], axis=2)
    out[1:, :, 3:] *= np.cumprod(np.where(same < 0, -1.0, 1.0), axis=0)[..., None]
    return out


def _balls_gaps(points: Float[np.ndarray, "t k 3"], bodies: SpatialBodies) -> Float[np.ndarray, "t"]:
    left, right = bodies.side == 0, bodies.side == 1
    gaps = np.linalg.norm(points[:, left][:, :, None] - points[:, right][:, None], axis=3)
    gaps -= bodies.radius[left][:, None] + bodies.radius[right]
    return gaps.min(axis=(1, 2), initial=math.inf)


def _off_cable(
    points: np.ndarray, stations: np.ndarray, side: np.ndarray, radius: np.ndarray, spared: np.ndarray
) -> float:
    """Least distance [m] of the balls from the centre line of what they do not hold."""
    least = math.inf
    for k in range(len(side)):
        line = stations[:, ::-1] if side[k] else stations
        away = np.linalg.norm(line[:, spared[k] :] - points[:, k, None], axis=2) - radius[k]
        least = min(least, float(away.min(initial=math.inf)))
    return least
