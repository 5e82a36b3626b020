"""How long plans take with and without limits of acceleration and jerk, and how they are tracked.

    .venv/bin/python studies/ramps.py [--seeds FIRST:END] [--track] [--out FOLDER]

The tasks are those of the catalogue without a port, and clutter by seeds. Each run leaves a line in
FOLDER/ramps.jsonl (runs/ramps unless given); what stands there is not run again. The bound is the duration with
limits of speed alone, at the share of them that plans use: no parametrisation of the same path is faster. Prints
Markdown.
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
from cableway.scene.files.loading import load_task, task_names
from cableway.scene.task import CONTROL_STEP, Task
from cableway.tasks.generation import random_task
from cableway.workflow.run import SolveOptions
from cableway.workflow.solve import solve

ACCELERATION = {"max_acceleration": 0.5, "max_turn_acceleration": 5.0}
JERK = {"max_jerk": 5.0, "max_turn_jerk": 50.0}
LIMITS: dict[str, dict[str, float]] = {
    "speed": {"max_acceleration": 1e3},
    "acceleration": ACCELERATION,
    "jerk": ACCELERATION | JERK,
    "gentle": {"max_acceleration": 0.25, "max_turn_acceleration": 2.5, "max_jerk": 1.0, "max_turn_jerk": 10.0},
}
"""By name [m/s², rad/s², m/s³, rad/s³]."""


def row(task: Task, limits: str, track: bool) -> dict[str, Any]:
    """One run, in a line."""
    task = replace(task, grippers=replace(task.grippers, **LIMITS[limits]))
    start = time.process_time()
    report = solve(task, SolveOptions(track=track)).report
    return {
        "task": task.name, "limits": limits, "track": track, "outcome": report.outcome.value,
        "steps": report.plan_steps,
        "error": report.shape_error, "clearance": report.min_clearance, "seconds": time.process_time() - start,
    }  # fmt: skip


TITLES = ("limits", "tasks", "outcomes", "longer [s], median", "p95", "worst", "longer [%], median", "p95", "worst")
TRACKED = ("limits", "runs", "succeed", "final error [mm], median", "p95", "worst", "clearance [mm], median", "least")


def durations(rows: list[dict[str, Any]]) -> Table:
    """For each set of limits: what became of the runs, and how much longer than the bound their plans are."""
    fastest = {line["task"]: line["steps"] for line in rows if line["limits"] == "speed"}
    lines: list[tuple[str, ...]] = [TITLES]
    for limits in LIMITS:
        mine = [line for line in rows if line["limits"] == limits]
        pairs = [(line["steps"], fastest.get(line["task"])) for line in mine]
        steps = np.array([pair for pair in pairs if all(pair)], float).reshape(-1, 2)
        said = ", ".join(f"{name} {count}" for name, count in sorted(Counter(line["outcome"] for line in mine).items()))
        cells = ("-",) * 6
        if len(steps):
            longer = CONTROL_STEP * (steps[:, 0] - steps[:, 1]), 100 * (steps[:, 0] / steps[:, 1] - 1)
            pairs = zip(longer, ("{:.1f}", "{:.0f}"), strict=True)
            cells = tuple(form.format(x) for each, form in pairs for x in (*np.quantile(each, (0.5, 0.95)), each.max()))
        lines.append((limits, f"{len(mine)}", said, *cells))
    return Table("", tuple(lines))


def tracking(rows: list[dict[str, Any]]) -> Table:
    """How the plans are tracked under each set of limits."""
    lines: list[tuple[str, ...]] = [TRACKED]
    for limits in LIMITS:
        mine = [line for line in rows if line["limits"] == limits]
        tracked = [line for line in mine if line["error"] is not None]
        if tracked:
            error, clear = (1000 * np.array([line[name] for line in tracked]) for name in ("error", "clearance"))
            cells = (*np.quantile(error, (0.5, 0.95)), error.max(), np.median(clear), clear.min())
            good = sum(line["outcome"] == "success" for line in mine)
            lines.append((limits, f"{len(mine)}", f"{good}", *(f"{value:.2f}" for value in cells)))
    return Table("", tuple(lines))


def main() -> None:
    """Run what is missing and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--seeds", default="9000:9012")
    parser.add_argument("--track", action="store_true")
    parser.add_argument("--limits", default=",".join(LIMITS))
    parser.add_argument("--out", type=Path, default=Path("runs/ramps"))
    options = parser.parse_args()
    file = options.out / "ramps.jsonl"
    file.parent.mkdir(parents=True, exist_ok=True)
    lines = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    rows = {(line["task"], line["limits"], line["track"]): line for line in lines}
    tasks = [task for task in map(load_task, task_names()) if task.port is None]
    tasks += [random_task(seed, "clutter") for seed in range(*map(int, options.seeds.split(":")))]
    for task in tasks:
        for limits in options.limits.split(","):
            if (key := (task.name, limits, options.track)) not in rows:
                rows[key] = row(task, limits, options.track)
                with file.open("a") as log:
                    log.write(json.dumps(rows[key]) + "\n")
                print(json.dumps(rows[key]), flush=True)
    found = [line for key, line in rows.items() if key[2] == options.track]
    print("\n" + (tracking if options.track else durations)(found).markdown())


if __name__ == "__main__":
    main()
