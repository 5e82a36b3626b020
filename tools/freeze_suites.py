"""Draw the suites of the benchmark and write their lists, one line for each episode.

    .venv/bin/python tools/freeze_suites.py [SUITE ...] [--lines N]

An existing list is continued, never drawn again: remove its file and raise the suite's version to change it.
Where the cable of a plant can't take the start of a task, as one 3% short between grippers that hold a straight one,
another task is drawn in its place.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import re
from functools import cache
from pathlib import Path

import numpy as np

from cableway.benchmark.conditions import CONDITIONS
from cableway.benchmark.suites import (
    SUITES,
    is_in_space,
    make_spatial_task,
    make_task,
    task_digest,
)
from cableway.core.errors import InputError, SimulationError
from cableway.geometry.convex import polyline_distance
from cableway.scene.files.loading import task_names
from cableway.simulation.perturbations.variants import (
    CELL_SUITE,
    FAULTS_SUITE,
    LIMP_SUITE,
    PLANTS_SUITE,
    ROUGH_SUITE,
    SENSING_SUITE,
    TABLE_SUITE,
    VARIANTS,
    named_perturbation,
)
from cableway.tasks.space.generation import LENGTH, WINDOWS

FOLDER = Path(__file__).parents[1] / "src/cableway/benchmark/frozen"
FIRST, NEXT = 20000, 10000
"""Seed of the first random task, and from a task to the one in its place: nothing was ever chosen on these."""

EYES_FIRST, EYES_PLANT = 100000, 4000
"""Seeds of the first random task of the suite "eyes", and of its first plant."""

LEAST_ROOM = 0.005
"""Least clearance [m] of start and goal; a plan must keep 4 mm."""

TASKS = 100 * len(PLANTS_SUITE)
"""Tasks of the suite "plants": then come more seeds of the noise, two for every third task of those seen with noise."""

COLUMNS = ["episode", "task", "plant", "seed", "digest", "condition"]
"""Of a list; the last one of "eyes" alone."""

IN_CELL = tuple(
    f"{name}+dual-ur5e"
    for name in ("single-obstacle-1", "single-obstacle-2", "multi-obstacle-1", "multi-obstacle-2", "multi-obstacle-3",
                 "real-single", "real-multi", "maze-1")
)  # fmt: skip
"""The tasks of the catalogue whose ends the arms can hold, and between which there is a plan for them."""

PAPER_CELLS = (
    "single-obstacle-2+dual-ur5e", "multi-obstacle-2+dual-ur5e", "single-obstacle-1+dual-ur5e",
    "multi-obstacle-1+dual-ur5e", "multi-obstacle-3+dual-ur5e", "maze-1+dual-ur5e", "maze-2+dual-ur5e-tilted",
    "real-single+dual-ur5e", "real-multi+dual-ur5e", "real-maze+dual-ur5e-tilted-aside", "insertion+dual-ur5e",
)  # fmt: skip
"""The whole catalogue, each task in a cell between whose arms there is a plan, obstacles 5 cm high in all of them; two
of the quickest come first."""

LONG = ("paracord-0.34", "rubber-0.34", "ethernet-0.34", "usb-0.34")
OTHERS = ("cotton-0.22", "hdmi-0.25", "silicone-0.27")
SHORT = ("rubber-0.17", "paracord-0.17")
LAB = [
    *((task, cable) for cable in LONG + OTHERS for task in ("real-single", "real-multi")),
    *(("real-maze", cable) for cable in SHORT * 2 + OTHERS),
]
"""Tasks and cables of the paper's summary: the long ones on two tasks, the short ones on the maze twice as often; and
its three other cables, on all."""

LENGTHS = (0.15, 0.3, 0.6, 0.9, 1.2, 2.0)
"""[m]"""

PATTERNS = {
    "plants": ("clutter-{}",),
    "plants-rough": ("clutter-{}",),
    "sensing": ("clutter-{}",),
    "table": tuple(kind for kind in ("clutter-{}", "dense-{}", "maze-{}@0.085") for _ in TABLE_SUITE),
    "limp": tuple(kind for kind in ("clutter-{}", "dense-{}") for _ in LIMP_SUITE),
    "faults": tuple(kind for kind in ("clutter-{}", "corridor-{}@0.06") for _ in FAULTS_SUITE),
    "cell": tuple(kind for kind in ("cell-{}", "cell-clutter-{}", "cell-dense-{}") for _ in CELL_SUITE),
    "corridors": ("slot-{}@0.025", "corridor-{}@0.04", "serpentine-{}@0.06", "serpentine-{}@0.05"),
    "mazes": ("maze-{}@0.085", "maze-{}@0.07"),
    "windows": tuple(f"window-{{}}@{round(share * LENGTH, 4):g}" for share in WINDOWS),
    "yu-cell": ("yu-{}+dual-ur5e",),
    "lengths": tuple(f"clutter-{{}}^{length}" for length in LENGTHS),
    "unconstrained": ("open-near-{}", "open-far-{}"),
    "lab-unconstrained": tuple(f"open-{way}-{{}}~{cable}" for way in ("near", "far") for cable in LONG),
}
"""Kinds of random tasks, in turn; otherwise that of the suite's name."""

IN_TURN = {
    "plants": PLANTS_SUITE,
    "plants-rough": ROUGH_SUITE,
    "sensing": SENSING_SUITE,
    "table": TABLE_SUITE,
    "limp": LIMP_SUITE,
    "cell": CELL_SUITE,
    "faults": FAULTS_SUITE,
    "lengths": ("nominal",) * len(LENGTHS) + ("hard",) * len(LENGTHS),
    "lab-unconstrained": ("laid",),
}
"""Plants, in turn; otherwise the nominal one."""


def line(suite: str, number: int, before: list[list[str]]) -> list[str]:
    """One line of a list.

    Args:
        suite: Name.
        number: Of the line, from 0.
        before: The lines before it.
    """
    if suite == "paper":
        names = task_names()
        return described(names[number % len(names)], "nominal", number // len(names))
    if suite == "plants" and number >= TASKS:
        noisy = [row for row in before[:TASKS] if VARIANTS[row[2]].noisy]
        every_third = [row for plant in PLANTS_SUITE for row in [row for row in noisy if row[2] == plant][::3]]
        row = every_third[(number - TASKS) % len(every_third)]
        return described(row[1], row[2], 1 + (number - TASKS) // len(every_third))
    if suite in ("lab-constrained", "lab-drawn"):
        task, cable = LAB[number % len(LAB)]
        return described(f"{task}~{cable}", "laid" if suite == "lab-constrained" else "drawn", number)
    if suite == "paper-cell":
        again, place = divmod(number, len(PAPER_CELLS))
        return described(PAPER_CELLS[place], CELL_SUITE[number % len(CELL_SUITE)], again)
    if suite == "eyes":
        return seen_by_cameras(number)
    patterns, plants = PATTERNS.get(suite, (suite + "-{}",)), IN_TURN.get(suite, ("nominal",))
    return first_possible(patterns[number % len(patterns)], FIRST + number, plants[number % len(plants)], 0)


def seen_by_cameras(number: int) -> list[str]:
    """A line of the suite "eyes": two random tasks, then one of the catalogue, the conditions in turn."""
    condition, third, drawn = tuple(CONDITIONS)[number % len(CONDITIONS)], number // 3, number % 3
    of_kind, seed = third if drawn == 2 else 2 * third + drawn, EYES_PLANT + number
    plant = CELL_SUITE[of_kind % len(CELL_SUITE)]
    if drawn == 2:
        name, *others = described(IN_CELL[of_kind % len(IN_CELL)], plant, seed)
    else:
        name, *others = first_possible("cell-clutter-{}", EYES_FIRST + of_kind, plant, seed)
    return [f"{name}-{condition}", *others, condition]


def first_possible(pattern: str, first: int, plant: str, seed: int) -> list[str]:
    """The line of an episode whose task is the first that can be set up, of seeds `first`, `first` + `NEXT`, ..."""
    for number in itertools.count(first, NEXT):
        try:
            return described(pattern.format(number), plant, seed)
        except (InputError, SimulationError) as error:
            print(f"{pattern.format(number)}, {plant}: another task, because {error}", flush=True)
    raise AssertionError


def name_of(task: str, plant: str, seed: int) -> str:
    """The name of an episode."""
    return re.sub("[@~^+]", "-", task) + ("" if plant == "nominal" else f"-{plant}") + (f"-s{seed}" if seed else "")


def described(task: str, plant: str, seed: int) -> list[str]:
    """The line of an episode; raises as `checked` does."""
    return [name_of(task, plant, seed), task, plant, str(seed), checked(task, plant, seed)]


@cache
def checked(task: str, plant: str, seed: int) -> str:
    """The digest of a task that can be set up with a plant.

    Raises:
        InputError: There is no such task, or its ends are too near to something for a plan.
        SimulationError: The plant can't take its start.
    """
    if is_in_space(task):  # whose ends keep what they should
        return task_digest(task, make_spatial_task(task))
    made = make_task(task)
    shapes = made.cable.rod.shapes(np.array([made.start_equilibrium, made.goal_equilibrium]))[0]
    room = float(polyline_distance(shapes, made.scene.world)[0].min()) - max(made.cable.radius, made.grippers.radius)
    if room < LEAST_ROOM:
        raise InputError(f"the ends of {task} have {1000 * room:.1f} mm of clearance")
    if plant != "nominal":
        named_perturbation(plant, made, seed).build(made, seed)
    return task_digest(task, made)


def freeze(suite: str, most: int) -> None:
    """Write what is missing of a list, or of its first lines."""
    path, count = FOLDER / f"{suite}.csv", min(max(SUITES[suite].sizes), most)
    rows = list(csv.reader(path.open()))[1:] if path.exists() else []
    path.parent.mkdir(exist_ok=True)
    with path.open("a", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if not rows:
            writer.writerow(COLUMNS if suite == "eyes" else COLUMNS[:-1])
        while len(rows) < count:
            rows.append(line(suite, len(rows), rows))
            writer.writerow(rows[-1])
            file.flush()
            print(f"{suite}: {len(rows)} of {count}", flush=True)


def main() -> None:
    """Freeze the chosen suites, or all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("suites", nargs="*", metavar="SUITE", default=list(SUITES))
    parser.add_argument("--lines", type=int, default=10**9, help="no more than these of each list")
    given = parser.parse_args()
    for suite in given.suites:
        freeze(suite, given.lines)


if __name__ == "__main__":
    main()
