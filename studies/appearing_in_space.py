"""Obstacles that turn out to stand in the way during runs in space: stopped for, gone round, or run into.

    .venv/bin/python studies/appearing_in_space.py [KIND ...] [--seeds 7000:7010] [--out runs/appearing-in-space]

Of each random task the obstacle nearest to the middle of the plan is moved there, where that leaves start and goal
free, and revealed after `REVEALED` seconds, unless cable or grippers have been there by then. Cables are perturbed.
Each run is made with the obstacle revealed, and with its never being known. Results are kept. Prints Markdown.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cableway.benchmark.statistics import share
from cableway.benchmark.tables import Table
from cableway.core.errors import CablewayError, InputError
from cableway.core.files import write_json
from cableway.records import Plan
from cableway.scene.spatial.obstacles import Prism
from cableway.scene.spatial.task import SpatialTask
from cableway.simulation.spatial_perturbation import SpatialPerturbation
from cableway.studio.running import Running
from cableway.studio.spatial_obstacles import frame_of
from cableway.tasks.space.generation import random_spatial_task
from cableway.workflow.solve_in_space import SpatialOptions, solve_in_space

REVEALED = 2.5
"""[s] from the start, of which 1.5 s are spent standing."""

KINDS = ("space-clutter", "window", "extruded")


def in_the_way(task: SpatialTask, plan: Plan, seed: int) -> SpatialPerturbation | None:
    """A perturbed cable, and an obstacle moved to the middle of the plan; None where none can be."""
    at = plan.shapes[plan.steps // 2, task.cable.keypoints // 2]
    middles = np.array([frame_of(each)[:3] for each in task.scene.obstacles])
    for index in np.argsort(np.linalg.norm(middles - at, axis=1)):
        by = at - middles[index]
        if isinstance(task.scene.obstacles[index], Prism):
            by[2] = 0.0
        moved = np.zeros((len(middles), 3))
        moved[index] = by
        found = replace(
            SpatialPerturbation.drawn(task, seed), obstacles=tuple(map(tuple, moved.tolist())), revealed=REVEALED
        )
        try:
            found.true_task(task)
            return found
        except CablewayError:
            continue
    return None


def made(kind: str, seed: int) -> dict[str, Any] | None:
    """What became of a task; None where no obstacle can stand in its way, or not from then on alone."""
    task = random_spatial_task(seed, kind)
    planned = solve_in_space(task, SpatialOptions(seed=seed))
    if planned.plan is None:
        return None
    late = in_the_way(task, planned.plan, seed)
    if late is None:
        return None
    found: dict[str, Any] = {}
    for name, perturbation in (("revealed", late), ("never known", replace(late, revealed=None))):
        options = SpatialOptions(plan=planned.plan, controller="rod-mpc", perturbation=perturbation, seed=seed)
        run = solve_in_space(task, options)
        rollout = run.rollout
        if name == "revealed" and (rollout is None or _was_there(task, late, run)):
            return None
        found[name] = {
            "success": run.success,
            "outcome": str(run.report.outcome),
            "stopped": bool(rollout and rollout.metadata["recovered"]),
            "clearance": None if rollout is None else rollout.least_clearance,
        }
    return found


def _was_there(task: SpatialTask, late: SpatialPerturbation, run: Any) -> bool:
    """Whether cable or grippers had been where the obstacle is, when it was revealed."""
    before = Running.of_rollout(task, run.plan, run.rollout, "")
    rows = tuple(row for row in before.rows if row.time <= REVEALED)
    try:
        index = int(np.flatnonzero(np.any(late.obstacles, axis=1))[0])
        whole = replace(before, perturbation=late, rows=rows)
        return whole.room_at(index) < 0
    except InputError:
        return True


def main() -> None:
    """Print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kinds", nargs="*", default=list(KINDS))
    parser.add_argument("--seeds", default="7000:7010")
    parser.add_argument("--out", type=Path, default=Path("runs/appearing-in-space"))
    given = parser.parse_args()
    first, last = map(int, given.seeds.split(":"))
    rows = []
    for kind in given.kinds:
        results = []
        for seed in range(first, last):
            file = given.out / f"{kind}-{seed}.json"
            if not file.exists():
                write_json(file, made(kind, seed))
            results.append(json.loads(file.read_text()))
        results = [each for each in results if each is not None]
        for name in ("revealed", "never known"):
            runs = [each[name] for each in results]
            rows.append(_row(kind, name, runs, last - first))
    names = ("kind", "the obstacle is", "tasks", "of", "success [%]", "stopped for it", "contact", "clearance [mm]")
    print(Table("obstacles that turn up", (names, *rows)).markdown())


def _row(kind: str, name: str, runs: list[dict[str, Any]], drawn: int) -> tuple[str, ...]:
    good = share([each["success"] for each in runs], list(map(str, range(len(runs)))))
    clear = [each["clearance"] for each in runs if each["clearance"] is not None]
    spread = " / ".join(f"{1000 * value:.1f}" for value in np.percentile(clear, (50, 5, 0))) if clear else "-"
    contacts = sum(value <= 0 for value in clear)
    won = "-" if good is None else f"{100 * good.value:.0f} ({100 * good.low:.0f} to {100 * good.high:.0f})"
    return (
        kind,
        name,
        str(len(runs)),
        str(drawn),
        won,
        str(sum(each["stopped"] for each in runs)),
        str(contacts),
        spread,
    )


if __name__ == "__main__":
    main()
