"""Planned shapes of two checkouts compared: the catalogue and random tasks of every kind, for who changes the planner.

    PYTHONPATH=BEFORE/src .venv/bin/python studies/compare_plans.py plan runs/before [--seeds 17] [--first 5000] &
    PYTHONPATH=src .venv/bin/python studies/compare_plans.py plan runs/after
    .venv/bin/python studies/compare_plans.py compare runs/before runs/after

`plan` saves shapes, poses and time of each task with the cableway on PYTHONPATH, in a file each, and goes on where it
stopped. `compare` names the tasks whose outcome or shapes differ, and says by how much planning became slower. Times
are processor times, the least of `--repeat` runs, of which the first may compile; both checkouts plan at once, so that
whatever else is done on the machine slows both.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import cableway as cw

TOLERANCE = 1e-9
"""Largest difference [m, rad] of shapes and poses that counts as rounding."""

UNSOLVABLE = "blocked"
"""The kind of random task without a plan."""


def tasks(seeds: range) -> Iterator[cw.Task]:
    """The catalogue, then a task of each kind for every seed."""
    from cableway.scene.files.loading import task_names
    from cableway.tasks.generation import KINDS

    yield from map(cw.load_task, task_names())
    for seed in seeds:
        for kind in sorted(set(KINDS) - {UNSOLVABLE}):
            yield cw.random_task(seed, kind)


def save_plans(folder: Path, seeds: range, repeat: int) -> None:
    """Plan what is not in the folder yet."""
    print(f"planned by {cw.__file__}")
    folder.mkdir(parents=True, exist_ok=True)
    for task in tasks(seeds):
        file = folder / f"{task.name}.npz"
        if file.exists():
            continue
        found, seconds = min((planned(task) for _ in range(repeat)), key=lambda each: each[1])
        np.savez(file, **found, seconds=np.array(seconds))
        print(f"{task.name}: {found.get('error', f'{seconds:.2f} s')}", flush=True)


def planned(task: cw.Task) -> tuple[dict[str, Any], float]:
    """What is kept of a task's plan, or why there is none, and the processor time [s]."""
    begun = time.process_time()
    try:
        plan = cw.plan(task, seed=0)
    except Exception as error:  # of whatever checkout
        found = {"error": np.array(f"{type(error).__name__}: {error}")}
    else:
        found = {"shapes": plan.shapes, "poses": plan.poses}
    return found, time.process_time() - begun


def difference(before: dict[str, np.ndarray], after: dict[str, np.ndarray]) -> str:
    """What differs between two plans of a task, in words; "" where nothing does."""
    if "error" in before or "error" in after:
        ends = ["no plan" if "error" in each else "a plan" for each in (before, after)]
        return "" if ends[0] == ends[1] else f"{ends[0]} before, {ends[1]} after"
    if before["shapes"].shape != after["shapes"].shape:
        return f"{len(before['shapes'])} rows before, {len(after['shapes'])} after"
    most = max(float(np.abs(before[name] - after[name]).max()) for name in ("shapes", "poses"))
    return "" if most <= TOLERANCE else f"shapes and poses differ by up to {most:.2e} m or rad"


def compare(before: Path, after: Path) -> int:
    """Print what differs; 1 if anything does, or if a task of the first folder was not planned again."""
    ratios, found = [], 0
    for file in sorted(before.glob("*.npz")):
        if not (after / file.name).exists():
            what, found = "not planned again", found + 1
        else:
            old, new = (dict(np.load(folder / file.name)) for folder in (before, after))
            ratios.append(float(new["seconds"] / old["seconds"]))
            what = difference(old, new)
            found += bool(what)
        if what:
            print(f"{file.stem}: {what}")
    print(f"{len(ratios)} tasks compared, {found} differ or are missing")
    if ratios:
        spread = ", ".join(f"{value:.2f}" for value in np.quantile(ratios, [0.5, 0.95, 1.0]))
        print(f"planning time after / before, median, p95, worst: {spread}")
    return 1 if found or not ratios else 0


def main() -> int:
    """Plan or compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    planning = commands.add_parser("plan")
    planning.add_argument("folder", type=Path)
    planning.add_argument("--seeds", type=int, default=17)
    planning.add_argument("--first", type=int, default=5000)
    planning.add_argument("--repeat", type=int, default=3)
    comparing = commands.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    given = parser.parse_args()
    if given.command == "compare":
        return compare(given.before, given.after)
    save_plans(given.folder, range(given.first, given.first + given.seeds), given.repeat)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
