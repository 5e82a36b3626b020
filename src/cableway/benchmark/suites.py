"""Suites: lists of episodes that are drawn from seeds once and then kept.

An episode is a task, a plant and a seed. The list of a suite is a file beside this one, made by
`tools/freeze_suites.py`; every line has a digest of its task's YAML, so that a task which comes out differently is
noticed. Sizes are beginnings of the list, so that a larger size contains the smaller ones.
"""

from __future__ import annotations

import csv
import hashlib
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from typing import TypeVar

import numpy as np

from cableway.core.deprecation import renamed_value
from cableway.core.errors import TaskError, UnknownNameError
from cableway.planning.moved_ends import set_up
from cableway.scene.cable import Cable
from cableway.scene.files.loading import cable_from_preset, catalogue_file, load_planar_task, task_names
from cableway.scene.files.saving import task_text
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.task import END_DECIMALS, Task
from cableway.simulation.perturbations.variants import RENAMED
from cableway.tasks.generation import random_task
from cableway.tasks.scaling import scaled
from cableway.tasks.space.generation import SPATIAL_KINDS, random_spatial_task

T = TypeVar("T", Task, SpatialTask)

SIZES = ("quick", "standard", "full")
"""Names of the sizes."""


@dataclass(frozen=True)
class Episode:
    """One run of a method.

    Attributes:
        suite: Name of its suite.
        name: Its own name, unique in the suite.
        task: A task of the catalogue, or the kind and seed of a random one, with the width of its passage after "@";
            after "^" the length [m] of its cable, to which all is scaled; after "~" the preset and the length of
            another cable, which starts and ends in the same shapes, scaled; after "+" the cell that it is put into,
            its ends moved where the arms could not hold them.
        plant: Name of the plant.
        seed: Of the planner and of the noise.
        digest: First half of the SHA-256 of the task's YAML, in hexadecimal digits.
        condition: Of the cameras by which the cable is known, one of `conditions.CONDITIONS`; "" without cameras.
    """

    suite: str
    name: str
    task: str
    plant: str
    seed: int
    digest: str
    condition: str = ""

    @property
    def in_space(self) -> bool:
        """Whether its task is one in space."""
        return is_in_space(self.task)

    def load(self) -> Task | SpatialTask:
        """The task.

        Raises:
            TaskError: It is no longer the one that was frozen.
        """
        return self.load_spatial() if self.in_space else self.load_planar()

    def load_planar(self) -> Task:
        """The same of a planar task."""
        return self._as_frozen(make_task(self.task))

    def load_spatial(self) -> SpatialTask:
        """The same of a task in space."""
        return self._as_frozen(make_spatial_task(self.task))

    def _as_frozen(self, task: T) -> T:
        if (digest := task_digest(self.task, task)) != self.digest:
            raise TaskError(f"task {self.task} has the digest {digest}, not the {self.digest} of suite {self.suite}")
        return task


@dataclass(frozen=True)
class Suite:
    """A suite.

    Attributes:
        name: Its name.
        version: Goes up when a list changes.
        description: One sentence.
        groups: What the episodes are grouped by in tables: "task", "kind", "plant", "cable" or "condition".
        sizes: Number of episodes of each size.
        own_sizes: The same for the default method, where that is held to more.
        beside: Methods that are run beside those that are asked for, to compare with.
    """

    name: str
    version: int
    description: str
    groups: str
    sizes: tuple[int, int, int]
    own_sizes: tuple[int, int, int] | None = None
    beside: tuple[str, ...] = ()

    def episodes(self, size: str, own: bool = False) -> tuple[Episode, ...]:
        """The episodes of a size; `own`: for the default method.

        Raises:
            UnknownNameError: No such size; the message lists them.
        """
        if size not in SIZES:
            raise UnknownNameError("size", size, SIZES)
        count = (self.own_sizes if own and self.own_sizes else self.sizes)[SIZES.index(size)]
        return frozen_episodes(self.name)[:count]


SUITES = {
    suite.name: suite
    for suite in (
        Suite("paper", 1, "the catalogue: the paper's tasks, with many seeds", "task", (11, 110, 1001)),
        Suite("clutter", 1, "four to seven obstacles", "kind", (12, 100, 1000), (12, 250, 1000)),
        Suite("dense", 1, "ten to fourteen obstacles, gaps down to 25 mm", "kind", (12, 100, 1000), (12, 250, 1000)),
        Suite("corridors", 1, "slots, corridors and serpentines of 25 to 60 mm", "kind",
              (8, 100, 1000), (8, 250, 1000)),
        Suite("mazes", 1, "mazes with lanes of 70 and 85 mm", "kind", (6, 100, 1000), (6, 250, 1000)),
        Suite("plants", 1, "clutter; perturbed cable, grasp or table", "plant",
              (17, 102, 1904)),
        Suite("plants-rough", 1, "as plants, with friction on the table", "plant", (17, 102, 510)),
        Suite("sensing", 1, "clutter; noise, latency, lost frames and occlusion", "plant", (8, 104, 1000)),
        Suite("table", 1, "clutter, dense and mazes; the cable in space on a table", "plant", (12, 102, 306)),
        Suite("limp", 1, "clutter and dense; cables from stiff to limp and heavy on a table with friction", "plant",
              (10, 100, 500)),
        Suite("faults", 1, "clutter and corridors; faults of robot, camera, controller and scene", "plant",
              (20, 120, 520)),
        Suite("cell", 3, "obstacles of 5 and 10 cm, few to many, between two arms with 2F-85, usual and long fingers; "
              "milder cables in space on a table", "plant", (12, 120, 360)),
        Suite("eyes", 7, "obstacles of 5 and 10 cm and the paper's tasks between two arms, the cable known by rendered "
              "pictures alone; the cables of cell", "condition", (6, 56, 182), beside=("true-keypoints",)),
        Suite("paper-cell", 3, "the catalogue with obstacles of 5 cm between two arms with 2F-85; the cables of cell",
              "task", (2, 33, 33)),
        Suite("lengths", 1, "clutter; cables of 0.15 to 2 m, everything on the table scaled", "cable", (12, 96, 480)),
        Suite("unconstrained", 1, "no obstacles, near and far goals", "kind", (10, 100, 1000)),
        Suite("lab-constrained", 1, "the paper's three tasks with obstacles, cables of its seven kinds, placed and "
              "measured as in a laboratory", "task", (21, 84, 1008)),
        Suite("lab-unconstrained", 1, "no obstacles, near and far goals, cables of four kinds, placed and measured "
              "as in a laboratory", "cable", (8, 104, 1000), (8, 400, 1000)),
        Suite("lab-drawn", 1, "as lab-constrained, with cables drawn from the ranges of their kinds", "cable",
              (21, 84, 1008)),
        Suite("blocked", 1, "infeasible tasks, to be reported as such", "kind", (10, 100, 1000)),
        Suite("space-clutter", 3, "in space; three to ten obstacles", "kind", (4, 50, 170)),
        Suite("space-dense", 3, "in space; thirty obstacles", "kind", (4, 50, 170)),
        Suite("windows", 2, "in space; windows of 0.35, 0.25 and 0.18 cable lengths", "kind", (3, 51, 171)),
        Suite("yu", 2, "in space; the four public scenes of Yu et al., boxes alone, with ends of our making", "kind",
              (4, 48, 168)),
        Suite("yu-cell", 1, "in space; the same scenes between the arms of dual-ur5e, which can hold both ends: plans "
              "alone, as arms are not simulated there", "kind", (4, 48, 168)),
        Suite("extruded", 2, "in space; the catalogue's obstacles with heights of 5 to 30 cm, and endless", "kind",
              (4, 44, 176)),
        Suite("lift", 2, "in space; from close to the table over a ridge, past three to eight obstacles", "kind",
              (4, 50, 170)),
    )
}  # fmt: skip
"""Suites by name."""

SPACE_SUITES = frozenset({"space-clutter", "space-dense", "windows", "yu", "yu-cell", "extruded", "lift"})
"""Suites in space; "all" is all others."""

PLANNER_SUITES = frozenset({"paper", "clutter", "dense", "corridors", "mazes", "sensing", "unconstrained", "blocked"})
"""Suites that judge planners alone: the cable is the nominal one, so that a plan succeeds in open loop, too, or there
is no plan. The others judge controllers."""


def get_suite(name: str) -> Suite:
    """The suite of a name.

    Raises:
        UnknownNameError: No such suite; the message lists them.
    """
    if name not in SUITES:
        raise UnknownNameError("suite", name, SUITES)
    return SUITES[name]


def episode_name(name: str) -> str:
    """The present name of an episode, with its suite and method or without, whose plant may have an old name."""
    for old, new in RENAMED.items():
        if name.endswith(f"-{old}"):
            return renamed_value("episode", name, {name: name.removesuffix(old) + new})
    return name


@cache
def frozen_episodes(suite: str) -> tuple[Episode, ...]:
    """All episodes of a suite, in order."""
    text = (resources.files("cableway.benchmark") / "frozen" / f"{suite}.csv").read_text()
    rows = csv.DictReader(text.splitlines())
    return tuple(
        Episode(
            suite, row["episode"], row["task"], row["plant"], int(row["seed"]), row["digest"], row.get("condition", "")
        )
        for row in rows
    )


def kind_of(task: str) -> str:
    """What a task belongs to in tables: itself in the catalogue, or the kind of random task, with its width.

    >>> kind_of("slot-20001@0.025"), kind_of("maze-1+dual-ur5e"), kind_of("real-maze~rubber-0.17")
    ('slot 25 mm', 'maze-1', 'real-maze')
    """
    task = task.partition("+")[0].partition("~")[0].partition("^")[0]
    if task in task_names():
        return task
    name, _, width = task.partition("@")
    return name.rsplit("-", 1)[0] + (f" {1000 * float(width):.0f} mm" if width else "")


def cable_of(task: str) -> str:
    """The preset that a task names, or the length of its cable.

    >>> cable_of("open-far-20001~usb-0.34"), cable_of("clutter-20004^1.2"), cable_of("maze-1")
    ('usb', '1.2 m', '')
    """
    length = task.partition("^")[2]
    return f"{length} m" if length else task.partition("~")[2].rpartition("-")[0]


def is_in_space(reference: str) -> bool:
    """Whether what `Episode.task` names is a task in space.

    >>> is_in_space("window-20001@0.085"), is_in_space("yu-20001+dual-ur5e"), is_in_space("clutter-20001")
    (True, True, False)
    """
    return reference.partition("+")[0].partition("@")[0].rpartition("-")[0] in SPATIAL_KINDS


def make_spatial_task(reference: str) -> SpatialTask:
    """The task in space that `Episode.task` names.

    Raises:
        InputError: There is none.
    """
    drawn, _, cell = reference.partition("+")
    name, _, width = drawn.partition("@")
    kind, _, seed = name.rpartition("-")
    return random_spatial_task(int(seed), kind, width=float(width) if width else None, cell=cell or None)


def make_task(reference: str) -> Task:
    """The planar task that `Episode.task` names.

    Raises:
        InputError: There is none.
    """
    reference, _, cell = reference.partition("+")
    if cell:
        return set_up(make_task(reference), cell, move=True).task
    base, _, cable = reference.partition("~")
    base, _, length = base.partition("^")
    if base in task_names():
        task = load_planar_task(base)
    else:
        name, _, width = base.partition("@")
        kind, _, seed = name.rpartition("-")
        task = random_task(int(seed), kind, width=float(width) if width else None)
    if length:
        task = replace(scaled(task, float(length) / task.cable.length), name=reference.replace("^", "-"))
    if not cable:
        return task
    preset, _, length = cable.rpartition("-")
    return _with_cable(task, cable_from_preset(preset, length=float(length)), reference.replace("~", "-"))


def _with_cable(task: Task, cable: Cable, name: str) -> Task:
    """With another cable, whose ends have the same loads, made dimensionless, and the same centre and direction."""
    q = np.array([task.start_equilibrium, task.goal_equilibrium])
    start, goal = cable.rod.at_keypoints(cable.rod.shapes(q)[0]).round(END_DECIMALS)
    return replace(task, name=name, cable=cable, start=start, goal=goal, start_poses=None, goal_poses=None)


def task_digest(reference: str, task: Task | SpatialTask) -> str:
    """See `Episode.digest`; of a task in the catalogue that of its file, whose end shapes may be left to the rod."""
    text = catalogue_file(reference).read_text() if reference in task_names() else task_text(task)
    return hashlib.sha256(text.encode()).hexdigest()[:32]
