"""Plans and runs with grippers that have bodies: random tasks with a witness, and the catalogue with lower posts.

    .venv/bin/python studies/gripper_bodies.py posts:100:200 --run                         # seeds 100 to 199
    .venv/bin/python studies/gripper_bodies.py cell:100:200 cell-dense:9000:9060           # the same between two arms
    .venv/bin/python studies/gripper_bodies.py catalogue --height 0.05 --body 2f-85
    .venv/bin/python studies/gripper_bodies.py catalogue --cell dual-ur5e                  # ends moved if they must be

Each task is planned, verified and, with `--run`, led on its nominal cable. Beside it stands the clearance that the plan
for discs alone would leave to the bodies. Results are appended to `NAME.jsonl` in the
folder as they come, and tasks that are there are not done again. Times are of the processor. Prints Markdown.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import cableway as cw
from cableway.benchmark.tables import Table
from cableway.core.errors import CablewayError
from cableway.core.provenance import versions
from cableway.geometry import polyline
from cableway.planning.moved_ends import set_up
from cableway.scene.clearance import pieces_clearance


def catalogue(body: str, height: float) -> Iterator[tuple[str, cw.Task | str]]:
    """The named tasks with grippers and heights of obstacles, and no walls; or why one cannot be."""
    for name in cw.task_names():
        task = cw.load_task(name)
        obstacles = tuple(replace(obstacle, height=height) for obstacle in task.scene.obstacles)
        scene = replace(task.scene, obstacles=obstacles, wall_height=0.001)
        try:
            yield name, replace(task, scene=scene, grippers=replace(task.grippers, body=body))
        except CablewayError as error:
            yield name, str(error)


def catalogue_in_cell(cell: str) -> Iterator[tuple[str, cw.Task | str]]:
    """The named tasks in a cell, their ends moved where hands or arms cannot hold them; or why one cannot be."""
    for name in cw.task_names():
        try:
            moved = set_up(name, cell, move=True)
        except CablewayError as error:
            yield name, str(error)
            continue
        for note in moved.notes():
            print(f"{name}: {note}", flush=True)
        yield name, moved.task


def judged(task: cw.Task, run: bool) -> dict[str, Any]:
    """What became of a task."""
    began = time.process_time()
    try:
        plan = cw.plan(task, seed=0)
    except CablewayError as error:
        return {"planned": False, "why": str(error), "time": time.process_time() - began}
    taken = time.process_time() - began
    verdict = cw.verify_plan(plan, task)
    lines = polyline.spline(plan.shapes, 4)
    found: dict[str, Any] = {
        "planned": True,
        "verified": verdict.passed,
        "rows": len(plan.shapes),
        "time": taken,
        "pieces_clearance": float(pieces_clearance(lines, plan.poses, task).min()),
        "approach": plan.approach is not None,
        "retreat": plan.retreat is not None,
    }
    try:
        blind = cw.plan(replace(task, grippers=replace(task.grippers, body=None), cell=None), seed=0)
        lines = polyline.spline(blind.shapes, 4)
        found["pieces_clearance_of_discs"] = float(pieces_clearance(lines, blind.poses, task).min())
    except CablewayError as error:
        found["why_not_for_discs"] = str(error)
    if run:
        report = cw.solve(task, cw.SolveOptions(plan=plan)).report
        found |= {"outcome": str(report.outcome), "shape_error": report.shape_error, "clearance": report.min_clearance}
    return found


TITLES = ("tasks", "drawn", "possible", "planned", "verified", "median [s]", "p95 [s]", "worst [s]",
          "approach", "retreat", "discs' plans that touch", "led to the goal", "error [mm], median, worst")  # fmt: skip


def line(named: str, results: list[dict[str, Any]], run: bool) -> tuple[str, ...]:
    """The table's row of some tasks."""
    possible = [each for each in results if each.get("possible", True)]
    planned = [each for each in possible if each["planned"]]
    times = np.array([each["time"] for each in possible])
    blind = [each["pieces_clearance_of_discs"] for each in planned if "pieces_clearance_of_discs" in each]
    led, error = "-", "-"
    if run:
        led = f"{sum(each.get('outcome') == 'success' for each in planned)}"
        errors = [1000 * value for each in planned if (value := each.get("shape_error")) is not None]
        error = f"{np.median(errors):.1f}, {max(errors):.1f}" if errors else "-"
    return (
        named,
        *(f"{count}" for count in (len(results), len(possible), len(planned))),
        f"{sum(each['verified'] for each in planned)}",
        *(f"{value:.2f}" for value in (np.median(times), np.quantile(times, 0.95), times.max())),
        *(f"{sum(each[name] for each in planned)}" for name in ("approach", "retreat")),
        f"{sum(each <= 0 for each in blind)} of {len(blind)}",
        led,
        error,
    )


def main() -> None:
    """Go through the tasks and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("kinds", nargs="+", help="catalogue, or kinds of random tasks as KIND:FIRST:END")
    parser.add_argument("--body", default="2f-85")
    parser.add_argument("--height", type=float, default=0.05)
    parser.add_argument("--cell", help="of the catalogue, in place of body and height")
    parser.add_argument("--run", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("runs/gripper-bodies"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    cw.plan(cw.random_task(0, "cell"), seed=0)  # compiles
    rows = [TITLES]
    for kind in given.kinds:
        if kind == "catalogue":
            named = f"catalogue-{Path(given.cell).stem if given.cell else f'{given.body}-{given.height:g}'}"
            tasks = catalogue_in_cell(given.cell) if given.cell else catalogue(given.body, given.height)
        else:
            named, first, end = kind.split(":")
            tasks = ((f"{named}-{seed}", cw.random_task(seed, named)) for seed in range(int(first), int(end)))
        rows.append(line(named, list(results(tasks, given.out / f"{named}.jsonl", given.run)), given.run))
    print("\n" + Table("", tuple(rows)).markdown())


def results(tasks: Iterator[tuple[str, cw.Task | str]], path: Path, run: bool) -> Iterator[dict[str, Any]]:
    """What became of the tasks, from the file or now."""
    lines = path.read_text().splitlines() if path.exists() else []
    done = {result["task"]: result for result in map(json.loads, lines)}
    for name, task in tasks:
        if name not in done:
            result = {"possible": False, "why": task} if isinstance(task, str) else judged(task, run)
            done[name] = {"task": name, **result, "versions": versions()}
            with path.open("a") as file:
                file.write(json.dumps(done[name]) + "\n")
        print(json.dumps({key: value for key, value in done[name].items() if key != "versions"}), flush=True)
        yield done[name]


if __name__ == "__main__":
    main()
