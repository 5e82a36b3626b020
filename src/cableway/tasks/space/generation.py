"""Random tasks in space: scenes with cables of many weights, whose ends keep margins and no straight line joins.

Ends are drawn among the equilibria of the rod, each fixed by twelve numbers, until both are stable, touch nothing and
keep `CLEARANCE`. A task is drawn anew where the straight line between its ends in the twelve numbers meets no
obstacle. That a motion exists is not known of a task, but for what planners find.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from cableway.core.errors import InputError, TaskError, UnknownNameError
from cableway.geometry.spatial_convex import signed_distance
from cableway.geometry.spatial_convex_kernels import self_distance
from cableway.motion.spatial import SpatialBodies
from cableway.robot.spatial_arms import SpatialArms
from cableway.rod.material import GRAVITY
from cableway.scene.cell import Cell
from cableway.scene.files.cells import named_cell
from cableway.scene.files.loading import load_planar_task, task_names
from cableway.scene.files.presets import preset_names
from cableway.scene.obstacles import Obstacle
from cableway.scene.spatial.cable import SpatialCable
from cableway.scene.spatial.grippers import SpatialGrippers
from cableway.scene.spatial.obstacles import Prism
from cableway.scene.spatial.scene import SpatialScene
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.spatial.validity import unbounded
from cableway.scene.task import END_DECIMALS, Task
from cableway.tasks.generation import KINDS, random_task
from cableway.tasks.space.obstacles import YU_SCENES, Size, floating, ridge, standing, window, yu_scene

LENGTH = 0.34
"""Of the cables [m]; presets then weigh 7.1 to 241 B/L^2."""

WEIGHTS = (2.0, 100.0)
"""Least and greatest weight gamma of cables that are no preset, drawn evenly in their logarithm."""

CLEARANCE, STABILITY, SPAN, TWIST = 0.008, 25.0, 0.97, 2 * np.pi
"""What ends keep: clearance of cable and grippers [m], stability margin, span in lengths, twist [rad] at most."""

SPREAD = (*[0.0] * 3, *[1.2] * 3, *[8.0] * 3, *[2.0] * 3)
"""Standard deviations of the rotation vector [rad], the force and the moment of an end."""

LEAST_WAY = 0.4
"""Least mean distance between a keypoint's start and goal, in lengths of the cable."""

ABOVE_TABLE = (0.01, 0.05)
"""Of the lowest point of cable and grippers in a `lift` task at its ends [m]."""

WINDOWS = (0.35, 0.25, 0.18)
"""Widths of windows in lengths of the cable, in turn by seed."""

CEILING = 0.5
"""Height of the workspace above the tables of the catalogue [m]."""

TRIES, BATCH, BATCHES = 60, 512, 40
"""Scenes drawn for a seed; shapes drawn at once for an end, and how often."""

LINE_ROWS = 400
"""Shapes along the straight line between two ends: at most some 5 mm apart."""

Part = Literal["anywhere", "left half", "right half"]


class Rejected(Exception):
    """A draw came to nothing."""


@dataclass(frozen=True, kw_only=True)
class Draw:
    """A scene, and where in it ends may be.

    Attributes:
        scene: The scene.
        description: One sentence.
        alone: What it says besides of grippers without arms.
        parts: Of the workspace in which the cable is at start and goal.
        low: Whether the cable is close to the table at both ends.
        radius: Of the grippers' balls [m].
        body: What else of them takes room, a name or nothing.
        cell: Whose arms hold them, or nothing.
    """

    scene: SpatialScene
    description: str
    alone: str = ""
    parts: tuple[Part, Part] = ("anywhere", "anywhere")
    low: bool = False
    radius: float = 0.02
    body: str | None = None
    cell: Cell | None = None

    @cached_property
    def grippers(self) -> SpatialGrippers:
        """The grippers."""
        return SpatialGrippers(radius=self.radius, body=self.body)


Kind = Callable[[np.random.Generator, int, float | None], Draw]


def clutter(rng: np.random.Generator, seed: int, width: float | None) -> Draw:
    """3 to 10 obstacles anywhere in a cube of 0.9 m."""
    return _strewn(rng, int(rng.integers(3, 11)))


def dense(rng: np.random.Generator, seed: int, width: float | None) -> Draw:
    """30 obstacles anywhere in a cube of 0.9 m."""
    return _strewn(rng, 30)


def _strewn(rng: np.random.Generator, count: int) -> Draw:
    size = (0.9, 0.9, 0.9)
    obstacles = tuple(floating(rng, size) for _ in range(count))
    return Draw(scene=SpatialScene(size, obstacles), description=f"{count} obstacles anywhere in a cube of 0.9 m.")


def windows(rng: np.random.Generator, seed: int, width: float | None) -> Draw:
    """A wall with a square window of 0.35, 0.25 or 0.18 lengths of the cable, by seed, or as wide as asked."""
    size = (1.2, 0.8, 0.8)
    wide = round(WINDOWS[seed % len(WINDOWS)] * LENGTH if width is None else width, 4)
    return Draw(
        scene=SpatialScene(size, window(rng, size, wide)),
        description=f"Through a window of {1000 * wide:g} mm, {wide / LENGTH:.2f} lengths of the cable.",
        parts=("left half", "right half") if rng.integers(2) else ("right half", "left half"),
    )


def lift(rng: np.random.Generator, seed: int, width: float | None) -> Draw:
    """From close to the table over a ridge and between 3 to 8 obstacles that stand there; in the air at both ends."""
    size, count = (1.2, 0.8, 0.6), int(rng.integers(3, 9))
    obstacles = (ridge(rng, size), *(standing(rng, size, 0.25) for _ in range(count)))
    return Draw(
        scene=SpatialScene(size, obstacles),
        description=f"Lifted from close to the table over a ridge, past {count} obstacles; it lies on it at no end.",
        parts=("left half", "right half") if rng.integers(2) else ("right half", "left half"),
        low=True,
    )


def extruded(rng: np.random.Generator, seed: int, width: float | None) -> Draw:
    """The obstacles of a task of the catalogue, in turn by seed: every other time round with heights, else endless."""
    names = task_names()
    name, endless = names[seed % len(names)], (seed // len(names)) % 2 == 1
    planar = load_planar_task(name).scene
    obstacles = tuple(Prism(section=_as_high(rng, obstacle, endless)) for obstacle in planar.obstacles)
    heights = "of unlimited height" if endless else "5 to 30 cm high"
    size: Size = (*planar.size, CEILING)
    return Draw(scene=SpatialScene(size, obstacles), description=f"The obstacles of {name}, {heights}.", radius=0.01)


def _as_high(rng: np.random.Generator, obstacle: Obstacle, endless: bool) -> Obstacle:
    return replace(obstacle, height=None if endless else round(rng.uniform(0.05, 0.3), 3))


def yu(rng: np.random.Generator, seed: int, width: float | None) -> Draw:
    """One of the four public scenes of Yu et al., by seed, with ends of our making."""
    number = seed % YU_SCENES
    description = f"Scene {number} of Yu et al. (IJRR 2024), boxes only; ends of our making"
    return Draw(scene=yu_scene(number), description=description, alone=", without arms.")


SPATIAL_KINDS: dict[str, Kind] = {
    "space-clutter": clutter,
    "space-dense": dense,
    "window": windows,
    "lift": lift,
    "extruded": extruded,
    "yu": yu,
}
"""Kinds of random tasks in space by name."""

WIDTHS = (0.05, 0.3)
"""Least and largest width of a window [m] that may be asked for."""


def random_spatial_task(
    seed: int, kind: str, *, width: float | None = None, body: str | None = None, cell: str | None = None
) -> SpatialTask:
    """The random task in space of a seed, a kind and, if it has them, a body of grippers and a cell; named after them.

    Args:
        seed: Not negative.
        kind: One of `SPATIAL_KINDS`.
        width: Of the window [m], for that kind.
        body: What grippers take up beyond their balls, by name.
        cell: Name of a cell, whose arms can hold both ends in the same way.

    Raises:
        UnknownNameError: No such kind or cell; the message lists them.
        TaskError: No such body; the message lists them.
        InputError: The seed is negative, the width out of range or for another kind, or nothing was found.
    """
    if kind not in SPATIAL_KINDS:
        raise UnknownNameError("kind of random task in space", kind, SPATIAL_KINDS)
    if seed < 0:
        raise InputError(f"seed must not be negative, got {seed}")
    if width is not None and kind != "window":
        raise InputError(f"width is not for {kind}; kinds with a width in space: window")
    if width is not None and not WIDTHS[0] <= width <= WIDTHS[1]:
        raise InputError(f"width of {kind} must be from {WIDTHS[0]:g} to {WIDTHS[1]:g} m, got {width!r}")
    rng = np.random.default_rng([zlib.crc32(kind.encode()), seed])
    cable, reasons = random_cable(rng), dict[str, int]()
    name = "-".join([kind, *(each for each in (body, cell) if each is not None), str(seed)])
    arms = None if cell is None else named_cell(cell)
    for _ in range(TRIES):
        try:
            return _task(name, rng, replace(SPATIAL_KINDS[kind](rng, seed, width), body=body, cell=arms), cable)
        except Rejected as reason:
            reasons[str(reason)] = reasons.get(str(reason), 0) + 1
    listed = ", ".join(f"{reason} ({count})" for reason, count in reasons.items())
    raise InputError(f"no {kind} task was found for seed {seed} in {TRIES} draws: {listed}")


def random_any_task(
    seed: int, kind: str, *, width: float | None = None, body: str | None = None, cell: str | None = None
) -> Task | SpatialTask:
    """The random task of a seed and a kind, on the table or in space; see `random_task` and `random_spatial_task`.

    Raises:
        UnknownNameError: There is no such kind; the message lists them.
        InputError: As there, or a body or a cell is asked for on the table.
    """
    if kind in SPATIAL_KINDS:
        return random_spatial_task(seed, kind, width=width, body=body, cell=cell)
    if kind not in KINDS:
        raise UnknownNameError("kind of random task", kind, (*KINDS, *SPATIAL_KINDS))
    for name, given in (("body", body), ("cell", cell)):
        if given is not None:
            raise InputError(f"{name} is not for {kind}; kinds in space: {', '.join(SPATIAL_KINDS)}")
    return random_task(seed, kind, width=width)


def random_cable(rng: np.random.Generator) -> SpatialCable:
    """A preset, or a cable of a random weight; all are `LENGTH` long."""
    if rng.integers(2):
        return SpatialCable.of_preset(str(rng.choice(preset_names())), length=LENGTH)
    weight = float(np.exp(rng.uniform(*np.log(WEIGHTS))))
    density = weight * SpatialCable.bending_stiffness / (GRAVITY * LENGTH**3)
    return SpatialCable(length=LENGTH, linear_density=round(density, 6))


def _task(name: str, rng: np.random.Generator, draw: Draw, cable: SpatialCable) -> SpatialTask:
    ends = [random_end(rng, draw, cable, part) for part in draw.parts]
    keypoints = cable.rod.at_keypoints(cable.rod.shapes(np.array(ends))[0])
    if np.linalg.norm(keypoints[1] - keypoints[0], axis=1).mean() < LEAST_WAY * cable.length:
        raise Rejected("the goal is near the start")
    if line_is_free(np.array(ends), draw.scene, cable, draw.radius):
        raise Rejected("nothing stands in the way")
    said = f"{draw.description}{draw.alone}"
    if draw.cell is not None:
        said = f"{draw.description.removesuffix('.')}. Between the arms of {draw.cell.name}."
    try:
        task = SpatialTask(
            name=name, description=said, scene=draw.scene, cable=cable, start=ends[0], goal=ends[1],
            grippers=draw.grippers, cell=draw.cell,
        )  # fmt: skip
    except TaskError as error:
        raise Rejected(error.problem) from None
    if draw.cell is not None and isinstance(SpatialArms(task).ways(), str):
        raise Rejected("arms cannot hold both ends in the same way")
    return task


def random_end(rng: np.random.Generator, draw: Draw, cable: SpatialCable, part: Part) -> Float[np.ndarray, "12"]:
    """An equilibrium that keeps what ends keep.

    Raises:
        Rejected: None was found.
    """
    size = np.array(draw.scene.size)
    low, high = 0.05 * size, 0.95 * size
    if part == "left half":
        high[0] = 0.42 * size[0]
    elif part == "right half":
        low[0] = 0.58 * size[0]
    bodies = SpatialBodies.of(draw.grippers.bodies, cable.radius)
    for _ in range(BATCHES):
        q = rng.normal(0.0, SPREAD, (BATCH, 12))
        q[:, :3] = rng.uniform(low, high, (BATCH, 3))
        if draw.low:
            stations, poses = cable.rod.shapes(q)
            lowest = np.minimum(stations[..., 2].min(1) - cable.radius, poses[..., 2].min(1) - draw.radius)
            lowest = np.minimum(lowest, bodies.hulls.placed(poses)[..., 2].min(1, initial=np.inf))
            q[:, 2] += rng.uniform(*ABOVE_TABLE, BATCH) - lowest
        q = q.round(END_DECIMALS)
        kept = np.flatnonzero(_keep_margins(q, draw, cable, bodies))
        if len(kept):
            return q[kept[0]]
    raise Rejected("there is no room for the ends")


def _keep_margins(
    q: Float[np.ndarray, "k 12"], draw: Draw, cable: SpatialCable, bodies: SpatialBodies
) -> Bool[np.ndarray, "k"]:
    """Which shapes keep what ends keep, the cheapest tests first."""
    stations, poses = cable.rod.shapes(q)
    span = np.linalg.norm(poses[:, 1, :3] - poses[:, 0, :3], axis=1)
    kept = (span < SPAN * cable.length) & (span > 2 * draw.radius + CLEARANCE)
    kept &= np.abs(q[:, 9]) / cable.twist_ratio < TWIST
    for points, wanted in ((poses[..., :3], draw.radius + CLEARANCE), (stations, cable.radius + CLEARANCE)):
        away = signed_distance(points[kept], draw.scene.world, 2 * wanted)[0]
        kept[kept] = away.min(axis=1, initial=np.inf) >= wanted
    kept[kept] = cable.rod.stability(q[kept], STABILITY)[0] >= STABILITY
    apart = int(np.ceil(np.pi * cable.radius * (stations.shape[1] - 1) / cable.length)) + 1
    off = int(np.ceil(np.pi / 2 * (draw.radius + cable.radius) * (stations.shape[1] - 1) / cable.length)) + 1
    for i in np.flatnonzero(kept):
        line, held = stations[i], poses[i, :, :3]
        free = min(
            np.linalg.norm(line[off:] - held[0], axis=1).min(), np.linalg.norm(line[:-off] - held[1], axis=1).min()
        )
        kept[i] = self_distance(line, apart) > 2 * cable.radius + CLEARANCE / 2 and free > (
            draw.radius + cable.radius + CLEARANCE / 2
        )
    wanted = np.array([CLEARANCE, CLEARANCE, cable.radius + CLEARANCE / 2])
    away = bodies.hull_gaps(poses[kept], stations[kept], draw.scene.world, cable.length, wanted)[0]
    kept[kept] = (away >= wanted).all(axis=(1, 2))
    return kept


def line_is_free(ends: Float[np.ndarray, "2 12"], scene: SpatialScene, cable: SpatialCable, radius: float) -> bool:
    """Whether neither cable nor grippers touch an obstacle on the straight line in q; walls are left out."""
    rod, shares = cable.rod, np.linspace(0.0, 1.0, LINE_ROWS)
    rows = rod.between(np.repeat(ends[:1], LINE_ROWS, axis=0), np.repeat(ends[1:], LINE_ROWS, axis=0), shares)
    stations, poses = rod.shapes(rows)
    world = unbounded(scene.world.solids)
    return all(
        signed_distance(points, world, 2 * wanted)[0].min() >= wanted
        for points, wanted in ((stations, cable.radius), (poses[..., :3], radius))
    )
