"""Plans and runs with grippers that have bodies: random tasks with a witness, and the catalogue with lower posts.

    .venv/bin/python studies/gripper_bodies.py posts 100 200 --out runs/gripper-bodies     # seeds 100 to 199
    .venv/bin/python studies/gripper_bodies.py cell 100 200 --run                          # the same between two arms
    .venv/bin/python studies/gripper_bodies.py catalogue --height 0.05 --body 2f-85
    .venv/bin/python studies/gripper_bodies.py catalogue --cell dual-ur5e                  # ends moved if they must be

Each task is planned, verified and, with `--run`, led on its nominal cable. Beside it stands the clearance that the plan
for discs alone would leave to the bodies. Results are appended to `NAME.jsonl` in the
folder as they come, and tasks that are there are not done again.
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


def main() -> None:
    """Go through the tasks and sum up."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("kind", help="catalogue, or a kind of random tasks")
    parser.add_argument("seeds", type=int, nargs="*", default=(0, 10))
    parser.add_argument("--body", default="2f-85")
    parser.add_argument("--height", type=float, default=0.05)
    parser.add_argument("--cell", help="of the catalogue, in place of body and height")
    parser.add_argument("--run", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("runs/gripper-bodies"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    setting = Path(given.cell).stem if given.cell else f"{given.body}-{given.height:g}"
    named = f"catalogue-{setting}" if given.kind == "catalogue" else given.kind
    path = given.out / f"{named}.jsonl"
    lines = path.read_text().splitlines() if path.exists() else []
    done = {result["task"]: result for result in map(json.loads, lines)}
    tasks: Iterator[tuple[str, cw.Task | str]] = (
        (catalogue_in_cell(given.cell) if given.cell else catalogue(given.body, given.height))
        if given.kind == "catalogue"
        else ((f"{given.kind}-{seed}", cw.random_task(seed, given.kind)) for seed in range(*given.seeds))
    )
    cw.plan(cw.random_task(0, "cell"), seed=0)  # compiles
    for name, task in tasks:
        if name not in done:
            result = {"possible": False, "why": task} if isinstance(task, str) else judged(task, given.run)
            done[name] = {"task": name, **result, "versions": versions()}
            with path.open("a") as file:
                file.write(json.dumps(done[name]) + "\n")
        print(json.dumps({key: value for key, value in done[name].items() if key != "versions"}), flush=True)
    results = list(done.values())
    possible = [each for each in results if each.get("possible", True)]
    planned = [each for each in possible if each["planned"]]
    times = np.array([each["time"] for each in possible])
    print(f"{len(results)} tasks, {len(possible)} possible, {len(planned)} planned and", end=" ")
    print(f"{sum(each['verified'] for each in planned)} verified; processor time [s], median / 95% / worst:", end=" ")
    print(" / ".join(f"{value:.2f}" for value in (np.median(times), np.quantile(times, 0.95), times.max())))
    if given.kind == "cell":
        both = sum(each["approach"] and each["retreat"] for each in planned)
        print(f"{both} with approach and retreat, {sum(each['approach'] for each in planned)} with an approach")
    blind = [each["pieces_clearance_of_discs"] for each in planned if "pieces_clearance_of_discs" in each]
    print(f"of {len(blind)} plans for discs alone, bodies touch something in {sum(each <= 0 for each in blind)}")
    if given.run:
        print(f"{sum(each.get('outcome') == 'success' for each in planned)} led to their goal")


if __name__ == "__main__":
    main()
