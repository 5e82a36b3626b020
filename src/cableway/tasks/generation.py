"""Random tasks by seed and kind."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError, TaskError, UnknownNameError
from cableway.geometry import se2
from cableway.geometry.convex import polyline_distance
from cableway.motion.sweeps import swept_shapes
from cableway.robot.branches import NoMotion, arm_motion
from cableway.scene.cell import CELLS
from cableway.scene.scene import Scene
from cableway.scene.task import END_DECIMALS, Task
from cableway.tasks.blocked import blocked
from cableway.tasks.clutter import clutter, dense, sizes
from cableway.tasks.ends import s_shaped, straight, table
from cableway.tasks.maze import maze
from cableway.tasks.motion import SWEEP_STEP, in_steps
from cableway.tasks.open import far, near
from cableway.tasks.passages import corridor, slot
from cableway.tasks.posts import SETUPS, crowded, posts, scattered
from cableway.tasks.serpentine import serpentine
from cableway.tasks.setup import Draft, Rejected, Setup

TRIES = 400
"""Draws before a seed is given up; the hardest kinds need some tens."""

FIRST_SEED = 1_000_000
"""Tasks to learn on have seeds from here on, so that none is a task of the benchmark's suites."""

LEAST_WAY = 0.4
"""Least mean distance between a keypoint's start and goal, in lengths of the cable."""


@dataclass(frozen=True)
class Witness:
    """A motion that solves a task, made without the planner: equilibria of the rod, one row per control step.

    Attributes:
        q: (T+1, 6) rod coordinates, straight from row to row.
    """

    q: Float[np.ndarray, "t 6"]


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of random task.

    Attributes:
        draw: Makes a draft, or raises `Rejected`; takes the width of the passage and the setup where there are some.
        widths: Least, usual and largest width [m] of its passage; None for a kind without one.
        obstructed: Whether the goal is far and something stands in the straight way to it.
        cell: Whether two arms hold the grippers, which can follow the motion that solves the task.
        setups: Which seeds take in turn, so that each is as frequent, however few draws come to something in it.
    """

    draw: Callable[..., Draft]
    widths: tuple[float, float, float] | None = None
    obstructed: bool = True
    cell: bool = False
    setups: tuple[Setup, ...] = ()


KINDS = {
    "clutter": Kind(draw=clutter),
    "dense": Kind(draw=dense),
    "sizes": Kind(draw=sizes),
    "posts": Kind(draw=posts),
    "cell": Kind(draw=posts, cell=True),
    "cell-clutter": Kind(draw=scattered, cell=True, setups=SETUPS),
    "cell-dense": Kind(draw=crowded, cell=True, setups=SETUPS),
    "straight": Kind(draw=straight),
    "s-shaped": Kind(draw=s_shaped),
    "table": Kind(draw=table),
    "slot": Kind(draw=slot, widths=(0.025, 0.025, 0.2)),
    "corridor": Kind(draw=corridor, widths=(0.025, 0.04, 0.2)),
    "serpentine": Kind(draw=serpentine, widths=(0.045, 0.06, 0.12)),
    "maze": Kind(draw=maze, widths=(0.06, 0.085, 0.15)),
    "blocked": Kind(draw=blocked),
    "open-near": Kind(draw=near, obstructed=False),
    "open-far": Kind(draw=far, obstructed=False),
}
"""Kinds of random tasks by name; the docstring of each draw says what makes its tasks solvable."""


def random_task(seed: int, kind: str, *, width: float | None = None) -> Task:
    """The random task of a seed and a kind, named after both.

    Args:
        seed: Not negative.
        kind: One of `KINDS`.
        width: Of the passage [m], for the kinds that have one.

    Raises:
        UnknownNameError: No such kind; the message lists them.
        InputError: The seed is negative, the width out of range, or nothing was found in many draws.
    """
    return random_task_with_witness(seed, kind, width=width)[0]


def random_task_with_witness(seed: int, kind: str, *, width: float | None = None) -> tuple[Task, Witness | None]:
    """As `random_task`, with a motion that solves the task; None where it is known to be infeasible."""
    options: dict[str, Any] = _options(kind, width)
    if seed < 0:
        raise InputError(f"seed must not be negative, got {seed}")
    if setups := KINDS[kind].setups:
        options["setup"] = setups[seed % len(setups)]
    rng = np.random.default_rng([zlib.crc32(kind.encode()), seed])
    reasons: dict[str, int] = {}
    for _ in range(TRIES):
        try:
            task, witness = _task(f"{kind}-{seed}", KINDS[kind].draw(rng, **options), KINDS[kind].obstructed)
            return (_in_cell(task, witness), witness) if KINDS[kind].cell and witness else (task, witness)
        except Rejected as reason:
            reasons[str(reason)] = reasons.get(str(reason), 0) + 1
    listed = ", ".join(f"{reason} ({count})" for reason, count in reasons.items())
    raise InputError(f"no {kind} task was found for seed {seed} in {TRIES} draws: {listed}")


def _options(kind: str, width: float | None) -> dict[str, float]:
    if kind not in KINDS:
        raise UnknownNameError("kind of random task", kind, KINDS)
    widths = KINDS[kind].widths
    if widths is None:
        if width is not None:
            having = ", ".join(name for name, other in KINDS.items() if other.widths)
            raise InputError(f"width is not for {kind}; kinds with a width: {having}")
        return {}
    least, usual, largest = widths
    if width is not None and not least <= width <= largest:
        raise InputError(f"width of {kind} must be from {least:g} to {largest:g} m, got {width!r}")
    return {"width": usual if width is None else float(width)}


def _task(name: str, draft: Draft, obstructed: bool) -> tuple[Task, Witness | None]:
    setup = draft.setup
    q = in_steps(draft.motion, setup.rod, setup.grippers) if draft.solvable else draft.motion
    ends = setup.rod.at_keypoints(setup.rod.shapes(q[[0, -1]])[0]).round(END_DECIMALS)
    obstacles = tuple(replace(obstacle, height=setup.height) for obstacle in draft.obstacles)
    scene = Scene(setup.size, obstacles, setup.wall_height)
    if obstructed:
        if np.linalg.norm(ends[1] - ends[0], axis=1).mean() < LEAST_WAY * setup.cable.length:
            raise Rejected("the goal is near the start")
        if not _in_the_way(scene, setup, q[[0, -1]]):
            raise Rejected("nothing stands in the way")
    try:
        task = Task(
            name=name,
            description=draft.description,
            scene=scene,
            cable=setup.cable,
            grippers=setup.grippers,
            start=ends[0],
            goal=ends[1],
        )
    except TaskError as error:
        raise Rejected(error.problem) from None
    return task, Witness(q) if draft.solvable else None


def _in_cell(task: Task, witness: Witness) -> Task:
    """The task between two UR5e with its grippers, which can follow its witness."""
    cell = next(cell for cell in CELLS.values() if cell.tool == task.grippers.body)
    task = task.in_cell(cell)
    if isinstance(arm_motion(task.cable.rod.shapes(witness.q)[1], task, cell), NoMotion):
        raise Rejected("the arms cannot follow")
    return task


def _in_the_way(scene: Scene, setup: Setup, ends: Float[np.ndarray, "2 6"]) -> bool:
    """Whether the cable hits something on the straight line in q, turning the short way."""
    straight = ends.copy()
    straight[1, 2] = straight[0, 2] + se2.wrap_angle(straight[1, 2] - straight[0, 2])
    lines = swept_shapes(setup.rod, straight, SWEEP_STEP)
    return bool(polyline_distance(lines, scene.world)[0].min() < setup.cable.radius)
