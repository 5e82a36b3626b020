"""Random gripper motions that lead a cable through stable shapes.

A motion goes along straight lines in rod coordinates q (`cableway.rod.planar`), from one random equilibrium to
the next: every point of such a line is an equilibrium, so the cable is led, not folded or snapped, and both grippers
move together and against each other as planned motions do. Each line is run at its own speed with ramps, with rests
between lines, and small random gripper motions are added on top.

Note:
    The paper (Tang et al.) collects with random gripper motions from a straight cable; these fold the cable within a
    few seconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import accumulate
from typing import NamedTuple, get_args

import numpy as np
from jaxtyping import Float

from cableway.core.checks import Checked, NotNegative, Positive
from cableway.core.errors import InputError
from cableway.motion.time_parametrization import gripper_effort
from cableway.motion.validity import first_fault
from cableway.rod.planar import PlanarRod
from cableway.scene.grippers import Grippers
from cableway.scene.scene import Scene
from cableway.simulation.shapes import Kind, kinds_of

CHECKS = 12
"""Shapes along a line at which stability, stretch and self-crossing are checked."""

ATTEMPTS = 20
"""Random next shapes tried before the cable is moved without changing its shape."""

LOADS = 200
"""Random loads tried for one that gives a shape of the wanted kind."""

RAMP = 3
"""Control steps in which a motion gets up to speed, and comes to rest again."""


@dataclass(frozen=True, kw_only=True)
class MotionConfig(Checked):
    """How grippers move at random.

    Attributes:
        max_step: Largest move of a gripper in one control step [m].
        max_turn: Largest turn of a gripper in one control step [rad].
        speed: Least and greatest cruising speed, as a share of the limits.
        jitter: Greatest standard deviation of the added motion in one step, as a share of the limits; drawn anew
            from 0 up to this for each motion.
        jitter_memory: Share of the added displacement that is left after one step.
        longest_rest: Most control steps of standing still between two lines.
        area: Side of the square [m] in which the cable's centre starts.
        travel: Standard deviation of the centre's displacement along one line [m], each axis.
        rotation: Standard deviation of the cable's rotation along one line [rad].
        load_mean: Mean of the load (a_x, a_y, m) of a random shape; negative a_x compresses the cable.
        load_spread: Standard deviation of the load.
        load_scale: Random loads are scaled by a factor from 0 up to this, so that near-straight shapes are common.
        least_stability: Least stability margin along a line.
        most_stretch: Greatest distance of the grippers along a line, as a share of the cable's length.
        kinds: What the shapes at the ends of lines look like; one kind is drawn for each motion.
        clearance: Least clearance [m] along a line and greatest at its end, where there is a scene: the cable is led
            near obstacles and walls without touching them.

    Raises:
        InputError: A value is out of range.
    """

    max_step: Positive[float] = Grippers.max_step
    max_turn: Positive[float] = Grippers.max_turn
    speed: tuple[float, float] = (0.2, 1.0)
    jitter: NotNegative[float] = 0.2
    jitter_memory: float = 0.8
    longest_rest: int = 5
    area: Positive[float] = 0.7
    travel: NotNegative[float] = 0.12
    rotation: NotNegative[float] = 0.5
    load_mean: tuple[float, float, float] = (-10.0, 0.0, 0.0)
    load_spread: tuple[float, float, float] = (14.0, 7.0, 3.5)
    load_scale: NotNegative[float] = 1.2
    least_stability: float = 15.0
    most_stretch: Positive[float] = 0.97
    kinds: tuple[Kind, ...] = ("any",)
    clearance: tuple[float, float] = (0.005, 0.04)

    def __post_init__(self) -> None:
        super().__post_init__()
        _require(0 < self.speed[0] <= self.speed[1] <= 1, "speed", "two ascending shares in (0, 1]", self.speed)
        _require(0 <= self.jitter_memory < 1, "jitter_memory", "in [0, 1)", self.jitter_memory)
        _require(self.longest_rest >= 0, "longest_rest", "not negative", self.longest_rest)
        _require(self.most_stretch < 1, "most_stretch", "below 1", self.most_stretch)
        loads = (*self.load_mean, *self.load_spread, self.least_stability)
        _require(all(map(math.isfinite, loads)), "load_mean, load_spread, least_stability", "finite", loads)
        _require(min(self.load_spread) >= 0, "load_spread", "not negative", self.load_spread)
        _require(len(self.kinds) > 0, "kinds", f"some of {', '.join(get_args(Kind))}", self.kinds)
        ascending = 0 <= self.clearance[0] < self.clearance[1] < math.inf
        _require(ascending, "clearance", "two ascending distances", self.clearance)


def _require(condition: bool, name: str, wanted: str, value: object) -> None:
    if not condition:
        raise InputError(f"motion.{name} must be {wanted}, got {value!r}")


class Surroundings(NamedTuple):
    """What a cable is led among.

    Attributes:
        scene: Workspace and obstacles.
        radius: The cable's [m].
    """

    scene: Scene
    radius: float

    def clearance(self, lines: Float[np.ndarray, "t v 2"]) -> Float[np.ndarray, "t"]:
        """Of the cable's surface [m] where its centreline is one of these."""
        return self.scene.clearance(lines, self.radius)


def random_motion(
    rod: PlanarRod,
    config: MotionConfig,
    steps: int,
    rng: np.random.Generator,
    surroundings: Surroundings | None = None,
) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, "steps+1 2 3"]]:
    """A start and a random motion from it.

    Args:
        rod: The cable.
        config: Limits and distributions.
        steps: Number of control steps.
        rng: Source of randomness.
        surroundings: What stands in the way; None for open space without walls.

    Returns:
        The equilibrium q at the start, and the gripper poses [m, m, rad] there and after each control step.

    Raises:
        InputError: The distributions allow no stable shape, or none that is clear of the surroundings.
    """
    kind = config.kinds[0] if len(config.kinds) == 1 else config.kinds[rng.integers(len(config.kinds))]
    course = _Course(rod, config, kind, surroundings)
    start = q = course.start(rng)
    rows = rod.shapes(q[None])[1]
    while len(rows) <= steps:
        target = course.next(q, rng)
        line = _timed(rod, config, q, target, rng)
        rest = np.repeat(line[-1:], rng.integers(config.longest_rest + 1), axis=0)
        rows = np.concatenate([rows, line, rest])
        q = target
    return start, _shaken(rows[: steps + 1], config, rng)


class _Course(NamedTuple):
    """Where a motion may lead."""

    rod: PlanarRod
    config: MotionConfig
    kind: Kind
    surroundings: Surroundings | None

    def start(self, rng: np.random.Generator) -> Float[np.ndarray, "6"]:
        """A random shape to start in."""
        area = (self.config.area,) * 2 if self.surroundings is None else self.surroundings.scene.size
        for _ in range(50 * ATTEMPTS):
            pose = [*rng.uniform(0, area), rng.uniform(-np.pi, np.pi)]
            q = np.concatenate([pose, self._load(rng)])
            if self._allows(q[None]):
                return q
        raise InputError(
            f"motion.load_mean, load_spread and least_stability allow no stable shape of kind {self.kind!r}"
            f"{'' if self.surroundings is None else ' that is clear of the scene'}; lower least_stability"
        )

    def next(self, q: Float[np.ndarray, "6"], rng: np.random.Generator) -> Float[np.ndarray, "6"]:
        """A shape that a straight line in q leads to: moved, bent, or both."""
        if self.surroundings is not None:
            return self._next_nearby(q, rng)
        kind = rng.integers(4)
        moved = self._moved(q, rng)
        if kind == 0:
            return moved
        for _ in range(ATTEMPTS):
            target = q.copy() if kind == 1 else moved.copy()
            target[3:] = self._load(rng)
            if self._allows(_line(q, target)):
                return target
        return moved

    def _next_nearby(self, q: Float[np.ndarray, "6"], rng: np.random.Generator) -> Float[np.ndarray, "6"]:
        """The same, clear of everything on the way and near something at its end, or else only clear, or else q."""
        assert self.surroundings is not None
        reachable = q
        for _ in range(ATTEMPTS):
            target = self._moved(q, rng)
            if rng.integers(2):
                target[3:] = self._load(rng)
            if self._allows(_line(q, target)):
                reachable = target
                if self.surroundings.clearance(self.rod.shapes(target[None])[0])[0] <= self.config.clearance[1]:
                    break
        return reachable

    def _moved(self, q: Float[np.ndarray, "6"], rng: np.random.Generator) -> Float[np.ndarray, "6"]:
        moved = q.copy()
        moved[:3] += rng.normal(0, [self.config.travel, self.config.travel, self.config.rotation])
        return moved

    def _load(self, rng: np.random.Generator) -> Float[np.ndarray, "3"]:
        for _ in range(LOADS):
            load = rng.uniform(0, self.config.load_scale) * rng.normal(self.config.load_mean, self.config.load_spread)
            if self.kind == "any" or self.kind in kinds_of(self.rod, np.concatenate([np.zeros(3), load])):
                return load
        raise InputError(
            f"motion.load_mean, load_spread and load_scale give no shape of kind {self.kind!r} in {LOADS} attempts"
        )

    def _allows(self, line: Float[np.ndarray, "t 6"]) -> bool:
        around = self.surroundings
        return not first_fault(
            self.rod,
            line,
            stability=self.config.least_stability,
            most_span=self.config.most_stretch * self.rod.length,
            room=None if around is None else (around.scene.world, around.radius + self.config.clearance[0]),
        )


def _line(q: Float[np.ndarray, "6"], target: Float[np.ndarray, "6"]) -> Float[np.ndarray, "t 6"]:
    return q + np.linspace(0, 1, CHECKS)[:, None] * (target - q)


def _timed(
    rod: PlanarRod,
    config: MotionConfig,
    q: Float[np.ndarray, "6"],
    target: Float[np.ndarray, "6"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "k 2 3"]:
    """Gripper poses after each control step along the line from q to target, at one cruising speed with ramps."""
    grid = np.linspace(0, 1, 101)
    efforts = gripper_effort(rod.shapes(rod.between(q, target, grid))[1], config.max_step, config.max_turn)
    effort = np.concatenate([[0.0], np.cumsum(efforts)])
    count = math.ceil(effort[-1] / rng.uniform(*config.speed)) + RAMP
    k = np.arange(count)
    speed = np.minimum(1.0, np.minimum(k + 1, count - k) / RAMP)
    reached = effort[-1] * np.cumsum(speed) / speed.sum()
    share = np.interp(reached, effort, grid) if effort[-1] > 0 else np.ones(count)
    return rod.shapes(rod.between(q, target, share))[1]


def _shaken(
    poses: Float[np.ndarray, "k 2 3"], config: MotionConfig, rng: np.random.Generator
) -> Float[np.ndarray, "k 2 3"]:
    """The motion with a random one added, both together within the limits."""
    scale = rng.uniform(0, config.jitter) * np.array([config.max_step, config.max_step, config.max_turn])
    kicks = scale * rng.normal(size=(len(poses) - 1, 2, 3))
    added = accumulate(kicks, lambda now, kick: config.jitter_memory * now + kick, initial=np.zeros((2, 3)))
    actions = np.diff(poses + np.array(list(added)), axis=0)
    moves = np.linalg.norm(actions[..., :2], axis=-1, keepdims=True)
    actions[..., :2] *= np.minimum(1.0, config.max_step / np.maximum(moves, 1e-12))
    actions[..., 2] = np.clip(actions[..., 2], -config.max_turn, config.max_turn)
    return np.concatenate([poses[:1], poses[:1] + np.cumsum(actions, axis=0)])
