"""Where arms should stand and how much their tools should lean: which plans of the named tasks arms could follow.

    .venv/bin/python studies/cell_layouts.py
    .venv/bin/python studies/cell_layouts.py --model ur10e        # only these arms
    .venv/bin/python studies/cell_layouts.py --slid real-maze     # one task, its cable slid along one curve

Each named task with obstacles of 5 cm is planned for the hands alone, without arms. In 20 rows of its plan, evenly
spaced, all ways are found in which the arms of a cell can hold the cable: which arm holds which end, in which branch
and turn. A task counts as held where some way is possible at start and goal, and as kept where one is in every row.

Of one task the cable is slid through its lanes instead, without a plan, and the way that can be kept in most rows is
printed, whether or not the ends as designed are among them.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

import cableway as cw
from cableway.benchmark.tables import Table
from cableway.core.errors import CablewayError
from cableway.geometry import polyline
from cableway.planning.candidates import Search
from cableway.planning.config import PlannerConfig
from cableway.planning.moved_ends import move_ends
from cableway.robot.branches import NoMotion, PackedCell, possible_ways
from cableway.scene.cell import CELLS, Cell, MountedArm, Way
from cableway.scene.files.loading import as_draft

ROWS = 20
"""Of a plan that are looked at."""

LAYOUTS: dict[str, tuple[tuple[int, float, float], ...]] = {
    "ur5e": ((0, 1.0, 0.15), (0, 1.1, 0.15), (0, 1.2, 0.15), (0, 1.0, 0.45), (90, 1.1, 0.0), (90, 1.0, 0.45)),
    "ur10e": (
        (0, 1.2, 0.0),
        (0, 1.4, 0.0),
        (0, 1.6, 0.0),
        (0, 1.4, 0.3),
        (0, 1.6, 0.3),
        (90, 1.4, 0.0),
        (90, 1.6, 0.0),
    ),
}
"""By model: direction from arm to arm [degrees], distance of their bases and height of those above the table [m]."""

SLID_ROWS = 80
"""Of a cable that is slid."""

SLID_LAYOUTS = ((0, 1.1, 0.15), (0, 1.2, 0.15), (90, 1.1, 0.0), (90, 1.0, 0.45))
"""As `LAYOUTS`; each with the table in the middle, and so far aside [m] from it as `ASIDE`."""

ASIDE = (0.0, 0.15)

TILTS = (0.0, 0.17)
"""Of tools [rad]; a little more brings the fingers of a 2F-85 into the table."""


def laid_out(
    degrees: float, distance: float, height: float, tilt: float, aside: float = 0.0, model: str = "ur5e"
) -> Cell:
    """A cell like `dual-ur5e` with its arms elsewhere, `aside` [m] across the direction from arm to arm."""
    angle = math.radians(degrees)
    x, y = distance / 2 * math.cos(angle), distance / 2 * math.sin(angle)
    dx, dy = aside * math.sin(angle), -aside * math.cos(angle)
    arms = (
        MountedArm(position=(dx - x, dy - y, height), angle=angle, model=model),
        MountedArm(position=(dx + x, dy + y, height), angle=angle - math.pi, model=model),
    )
    return replace(CELLS["dual-ur5e"], arms=arms, tilt=tilt)


def planned(cell: Cell) -> Iterator[tuple[cw.Task, np.ndarray]]:
    """The named tasks with the hands of a cell but without its arms, and rows of gripper poses of their plans."""
    for name in cw.task_names():
        draft = as_draft(name).unchecked().in_cell(cell)
        if draft.plug is not None:  # the hands must then keep off a port, too
            continue
        try:
            task = move_ends(replace(draft, cell=None)).task
            poses = cw.plan(task, seed=0).poses
        except CablewayError as error:
            print(f"{name} is left out: {error}")
            continue
        yield task, poses[np.linspace(0, len(poses) - 1, ROWS).astype(int)]


def shares(task: cw.Task, poses: np.ndarray, cell: Cell) -> dict[Way, float]:
    """Share of the rows in which arms can hold the cable in a way, of the ways that are possible at both ends."""
    packed = PackedCell(task, cell)
    rows = [possible_ways(row, packed) for row in poses]
    ways: list[set[Way]] = [set() if isinstance(row, NoMotion) else set(row) for row in rows]
    count = Counter(way for row in ways for way in row)
    return {way: count[way] / len(rows) for way in ways[0] & ways[-1]}


def print_slid(name: str) -> None:
    """Print a line for each layout and tilt: how many rows of a cable that is slid arms can follow in one way."""
    for tilt, layout, aside in product(TILTS, SLID_LAYOUTS, ASIDE):
        cell = laid_out(*layout, tilt, aside)
        task = as_draft(name).unchecked().in_cell(cell).checked()
        shapes = Search(task, PlannerConfig(), 0, None).trajectories().make("slide-head", 0).shapes
        rows = polyline.end_poses(shapes[np.linspace(0, len(shapes) - 1, SLID_ROWS).astype(int)])
        packed = PackedCell(task, cell)
        found = [possible_ways(row, packed) for row in rows]
        kept = Counter(way for row in found if not isinstance(row, NoMotion) for way in row)
        way, count = max(kept.items(), key=lambda each: each[1], default=(None, 0))
        left = [k for k, row in enumerate(found) if isinstance(row, NoMotion) or way not in row]
        print(f"{layout}, {aside:g} m aside, tilt {tilt:.2f}: {count} of {SLID_ROWS} rows; not in {left}", flush=True)


def print_layouts(models: Sequence[str]) -> None:
    """Print a line for each layout and tilt, then a table of all."""
    rows = [("model", "direction [deg]", "bases apart [m]", "their height [m]", "tilt [rad]", "tasks", "held", "kept")]
    for model, tilt in product(models, TILTS):
        tasks = list(planned(replace(CELLS["dual-ur5e"], tilt=tilt)))
        for layout in LAYOUTS[model]:
            found = [shares(*each, laid_out(*layout, tilt, model=model)) for each in tasks]
            best = [max(ways.values(), default=0.0) for ways in found]
            held, kept = sum(map(bool, found)), sum(share == 1 for share in best)
            rows.append((model, *(f"{value:g}" for value in (*layout, tilt)), *map(str, (len(tasks), held, kept))))
            where = ", ".join(f"{title} {cell}" for title, cell in zip(rows[0], rows[-1], strict=True))
            names = (task.name for task, _ in tasks)
            each = (f"{n} {len(ways)}/{share:.2f}" for n, ways, share in zip(names, found, best, strict=True))
            print(f"{where};", *each, flush=True)
    print("\n" + Table("Layouts", tuple(rows)).markdown())


def main() -> None:
    """Compare layouts and tilts."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--slid", metavar="TASK", help="of the cable of this task, slid along one curve")
    parser.add_argument("--model", choices=list(LAYOUTS), action="append", help="of both arms; default: each in turn")
    given = parser.parse_args()
    if given.slid:
        print_slid(given.slid)
    else:
        print_layouts(given.model or list(LAYOUTS))


if __name__ == "__main__":
    main()
