"""Plan random tasks and print how many of each kind are solved, in what time, and what was wrong with the others.

    .venv/bin/python studies/planning.py clutter maze@0.07 [--seeds FIRST:END] [--planners NAME ...] [--iterations N]

After `@` stands the width [m] of a kind that takes one. Each task leaves a line in FOLDER/KIND.jsonl (runs/planning
unless given), and its picture where no plan was found; tasks that stand there already are not planned again. A blocked
task counts as solved where the planner says that there is no plan. --iterations is for planners with RRT*, which makes
about a thousand in a second. Times are of the processor. Prints Markdown.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cableway.benchmark.tables import Table
from cableway.core.errors import PlanningError
from cableway.figures.plan import attempt_figure
from cableway.figures.style import save_figure
from cableway.planning.config import PivotConfig, PlannerConfig
from cableway.planning.named import PLANNERS
from cableway.planning.planner import plan
from cableway.records import Attempt
from cableway.scene.task import Task
from cableway.tasks.generation import random_task_with_witness

FAULTS = {
    "contact": ("cable clearance", "gripper clearance", "rod clearance"),
    "length": ("length error",),
    "not followed": ("rows the rod does not reach", "rod deviation", "rod stability"),
}
"""Failed checks by what they mean; a task without a sequence of shapes at all counts as "none found"."""


def faults(attempt: Attempt | None) -> list[str]:
    """What was wrong with the closest attempt."""
    if attempt is None or attempt.verdict is None:
        return ["none found"]
    failed = {check.name for check in attempt.verdict.failures()}
    return [fault for fault, names in FAULTS.items() if failed & set(names)] or ["other"]


def attempt(task: Task, solvable: bool, config: PlannerConfig, limit: float, picture: Path) -> dict[str, Any]:
    """Plan one task; the picture shows what came closest where a way was missed."""
    wall, cpu = time.perf_counter(), time.process_time()
    row: dict[str, Any] = {"task": task.name, "solved": True, "initial trajectory": "", "steps": 0, "reason": ""}
    try:
        found = plan(task, config=config, expired=lambda: time.perf_counter() - wall > limit)
        row |= {"solved": solvable, "initial trajectory": found.metadata["initial_trajectory"], "steps": found.steps}
    except PlanningError as error:
        row |= {"solved": not solvable and str(error).startswith("there is no plan"), "reason": str(error)}
        if not row["solved"]:
            row["faults"] = faults(error.attempt)
            save_figure(attempt_figure(task, error.attempt or Attempt(str(error))), picture)
    return row | {"seconds": round(time.perf_counter() - wall, 3), "cpu": round(time.process_time() - cpu, 3)}


TITLES = ("kind", "planner", "solved", "median [s]", "p95 [s]", "worst [s]", "initial trajectories", "not solved")


def summary(kind: str, planner: str, rows: list[dict[str, Any]]) -> tuple[str, ...]:
    """The table's row of some tasks."""
    times = np.array([row["cpu"] for row in rows])
    spread = (f"{value:.2f}" for value in (np.median(times), np.quantile(times, 0.95), times.max()))
    names = Counter(row["initial trajectory"] for row in rows if row["initial trajectory"])
    wrong = Counter(fault for row in rows for fault in row.get("faults", []))
    counts = (", ".join(f"{name} {count}" for name, count in sorted(each.items())) for each in (names, wrong))
    return (kind, planner, f"{sum(row['solved'] for row in rows)} of {len(rows)}", *spread, *counts)


def planned(kind: str, planner: str, options: argparse.Namespace) -> list[dict[str, Any]]:
    """What became of the tasks of a kind; those that are missing are planned."""
    name, _, width = kind.partition("@")
    label = kind if planner == "default" else f"{kind}-{planner}"
    label += "" if options.iterations == PivotConfig.iterations else f"-{options.iterations}"
    config = PlannerConfig.named(planner)
    config = replace(config, pivot=replace(config.pivot, iterations=options.iterations))
    file = options.out / f"{label}.jsonl"
    file.parent.mkdir(parents=True, exist_ok=True)
    known = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    rows = {row["task"]: row for row in known}
    wanted = {f"{name}-{seed}": seed for seed in range(*map(int, options.seeds.split(":")))}
    for task_name, seed in wanted.items():
        if task_name not in rows:
            task, witness = random_task_with_witness(seed, name, width=float(width) if width else None)
            picture = options.out / label / f"{task_name}.png"
            rows[task_name] = attempt(task, witness is not None, config, options.time_limit, picture)
            with file.open("a") as log:
                log.write(json.dumps(rows[task_name]) + "\n")
            if not rows[task_name]["solved"]:
                print(json.dumps(rows[task_name]), flush=True)
    return [rows[task_name] for task_name in wanted]


def main() -> None:
    """Plan what is missing and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("kinds", nargs="+")
    parser.add_argument("--seeds", default="0:10")
    parser.add_argument("--planners", nargs="+", choices=PLANNERS, default=["default"])
    parser.add_argument("--iterations", type=int, default=PivotConfig.iterations)
    parser.add_argument("--time-limit", type=float, default=30.0)
    parser.add_argument("--out", type=Path, default=Path("runs/planning"))
    options = parser.parse_args()
    plan(random_task_with_witness(0, "clutter")[0])  # so that no task pays for loading kernels
    rows = [TITLES]
    for planner in options.planners:
        for kind in options.kinds:
            rows.append(summary(kind, planner, planned(kind, planner, options)))
            print(*rows[-1], sep=", ", flush=True)
    print("\n" + Table("", tuple(rows)).markdown())


if __name__ == "__main__":
    main()
