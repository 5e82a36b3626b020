"""Plan random tasks of a kind and print how many are solved and how long it takes.

    .venv/bin/python studies/planning.py KIND [--seeds FIRST:END] [--width W] [--planner NAME] [--iterations N] [...]

Each task leaves a line in FOLDER/KIND.jsonl (runs/planning unless given), and its picture where no plan was found;
tasks that stand there already are not planned again. A blocked task counts as solved where the planner says that
there is no plan. --iterations is for planners with RRT*, which makes about a thousand in a second.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

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


def summary(kind: str, rows: list[dict[str, Any]]) -> str:
    """One line: the share solved, wall times, and which initial trajectories led to the plans."""
    seconds = np.array([row["seconds"] for row in rows])
    names = [row["initial trajectory"] or "none" for row in rows]
    counts = ", ".join(f"{name} {names.count(name)}" for name in sorted(set(names)))
    wrong = [fault for row in rows for fault in row.get("faults", [])]
    counts += "".join(f"; {fault} {wrong.count(fault)}" for fault in sorted(set(wrong)))
    return (
        f"{kind}: {sum(row['solved'] for row in rows)}/{len(rows)} solved, seconds median {np.median(seconds):.2f} "
        f"p95 {np.quantile(seconds, 0.95):.2f} worst {seconds.max():.2f}; {counts}"
    )


def main() -> None:
    """Plan what is missing, print a line for each task and the summary."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("kind")
    parser.add_argument("--seeds", default="0:10")
    parser.add_argument("--width", type=float)
    parser.add_argument("--planner", choices=PLANNERS, default="default")
    parser.add_argument("--iterations", type=int, default=PivotConfig.iterations)
    parser.add_argument("--time-limit", type=float, default=30.0)
    parser.add_argument("--out", type=Path, default=Path("runs/planning"))
    options = parser.parse_args()
    label = options.kind if options.width is None else f"{options.kind}-{1000 * options.width:g}mm"
    label += "" if options.planner == "default" else f"-{options.planner}"
    label += "" if options.iterations == PivotConfig.iterations else f"-{options.iterations}"
    config = PlannerConfig.named(options.planner)
    config = replace(config, pivot=replace(config.pivot, iterations=options.iterations))
    file = options.out / f"{label}.jsonl"
    file.parent.mkdir(parents=True, exist_ok=True)
    known = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    rows = {row["task"]: row for row in known}
    wanted = [f"{options.kind}-{seed}" for seed in range(*map(int, options.seeds.split(":")))]
    plan(random_task_with_witness(0, "clutter")[0])  # so that no task pays for loading kernels
    for name in wanted:
        if name not in rows:
            seed = int(name.rsplit("-", 1)[1])
            task, witness = random_task_with_witness(seed, options.kind, width=options.width)
            picture = options.out / label / f"{name}.png"
            rows[name] = attempt(task, witness is not None, config, options.time_limit, picture)
            with file.open("a") as log:
                log.write(json.dumps(rows[name]) + "\n")
        print(json.dumps(rows[name]), flush=True)
    print(summary(label, [rows[name] for name in wanted]))


if __name__ == "__main__":
    main()
