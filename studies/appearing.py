"""Whether a peg that nobody told of is seen by depth cameras in time, beside runs that are told and runs that are not.

    .venv/bin/python studies/appearing.py [--first 7200] [--count 5] [--out out/appearing]

Random tasks of kind "clutter", each planned once. Then a peg of 12 mm stands where a keypoint comes by half-way along
the plan, with as much room about start, goal and obstacles as there is. The plan is followed three times, the cable
known by two low cameras at 10 Hz: with depths; told of the peg by the plant after a second; and neither. A task without
a plan counts as a failure of all. Reports are kept in the folder. Prints Markdown.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from cableway.core.errors import CablewayError
from cableway.records import Plan
from cableway.scene.task import Task
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.tasks.generation import random_task
from cableway.tracking.eyes import EyesConfig
from cableway.workflow.run import SolveOptions
from cableway.workflow.solve import solve

PEG = 0.006
WAYS = {"depth cameras": (True, None), "told after 1 s": (False, 1.0), "nothing": (False, None)}


def peg_on(plan: Plan, task: Task) -> tuple[float, float, float]:
    """A peg (x, y, radius) [m] in the way of the plan."""
    count = len(plan.shapes)
    places = plan.shapes[2 * count // 5 : 3 * count // 5, 2:-2].reshape(-1, 2)
    ends = np.concatenate([task.start, task.goal])
    room = np.linalg.norm(places[:, None] - ends, axis=2).min(axis=1)
    room = np.minimum(room, task.scene.signed_distance(places))
    x, y = places[int(np.argmax(room))]
    return round(float(x), 4), round(float(y), 4), PEG


def ran(seed: int, folder: Path) -> dict[str, dict]:
    """What became of a task in each way of knowing the peg."""
    file = folder / f"{seed}.json"
    if file.exists():
        return json.loads(file.read_text())
    task, found = random_task(seed, "clutter"), {way: {"success": False, "failure": "no plan"} for way in WAYS}
    plan = solve(task, SolveOptions(seed=seed, track=False)).plan
    for way, (depth, revealed) in {} if plan is None else WAYS.items():
        assert plan is not None
        perturbation = Perturbation(pegs=(peg_on(plan, task),), revealed=revealed)
        eyes = EyesConfig(frame_rate=10.0, seed=seed, depth=depth)
        try:
            run = solve(task, SolveOptions(seed=seed, plan=plan, perturbation=perturbation, eyes=eyes))
        except CablewayError as error:
            found[way] = {"success": False, "failure": str(error)}
            continue
        found[way] = {"success": run.success, "failure": run.report.failure}
        rollout = run.rollout
        if rollout is not None:
            blocked = [k for k, status in enumerate(rollout.status) if "blocked" in str(status)]
            found[way] |= {
                "clearance": float(min(rollout.clearance.min(), rollout.gripper_clearance.min())),
                "stopped": float(rollout.times[blocked[0]]) if blocked else None,
                "duration": float(rollout.times[-1]),
                "appeared": len(rollout.metadata["eyes"].get("appeared", ())),
            }
    file.write_text(json.dumps(found))
    return found


def main() -> None:
    """Run the tasks and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=7200)
    parser.add_argument("--count", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("out/appearing"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    found = []
    for seed in range(given.first, given.first + given.count):
        found.append(ran(seed, given.out))
        print(f"{seed}: " + "; ".join(f"{way}: {each['failure'] or 'success'}" for way, each in found[-1].items()),
              flush=True)  # fmt: skip
    print("\n| known by | success | contact | least clearance [mm] | stopped for it after [s] |\n|---|---|---|---|---|")
    for way in WAYS:
        rows = [each[way] for each in found]
        clear = [row["clearance"] for row in rows if "clearance" in row]
        stopped = [f"{row['stopped']:.1f}" if row.get("stopped") is not None else "-" for row in rows]
        shown = ", ".join(f"{1e3 * each:.1f}" for each in clear)
        print(f"| {way} | {sum(row['success'] for row in rows)} of {len(rows)} | {sum(each <= 0 for each in clear)} |"
              f" {shown} | {', '.join(stopped)} |")  # fmt: skip


if __name__ == "__main__":
    main()
