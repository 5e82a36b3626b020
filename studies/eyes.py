"""How well cables are led that are known by cameras alone, beside the same runs with true keypoints.

    .venv/bin/python studies/eyes.py [--first 6400] [--count 12] [--cameras front,back above] [--out out/eyes]

Tasks of kind "cell" on the table plant with arms, whose cables are of another length, curved, stiff in part and held
askew, all as "table-*" draws them, but for noise and latency of the keypoints: those are the cameras'. Each task is
planned once; the plan is followed with true keypoints, without noise or latency, and by each group of cameras. A task
without a plan counts as a failure of all. Rollouts are kept in the folder. Prints Markdown.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from cableway.core.errors import CablewayError
from cableway.simulation.perturbations.sensing import SensingConfig
from cableway.simulation.perturbations.variants import named_perturbation
from cableway.tasks.generation import random_task
from cableway.tracking.eyes import EyesConfig
from cableway.workflow.run import SolveOptions
from cableway.workflow.solve import solve

KINDS = ("table-uniform", "table-coiled", "table-stiff-third", "table-rough", "table-all")
TRUE = "true keypoints"


def ran(seed: int, ways: list[str], folder: Path, frame_rate: float) -> dict[str, dict]:
    """What became of a task in each way of knowing the cable."""
    file = folder / f"{seed}.json"
    if file.exists():
        return json.loads(file.read_text())
    task = random_task(seed, "cell")
    perturbation = replace(named_perturbation(KINDS[seed % len(KINDS)], task, seed), sensing=SensingConfig())
    options, found = SolveOptions(perturbation=perturbation, seed=seed), {}
    for way in ways:
        eyes = None if way == TRUE else EyesConfig(cameras=tuple(way.split(",")), frame_rate=frame_rate, seed=seed)
        try:
            run = solve(task, replace(options, eyes=eyes))
        except CablewayError as error:
            found[way] = {"success": False, "failure": str(error)}
            continue
        options = replace(options, plan=options.plan or run.plan)
        report, rollout = run.report, run.rollout
        found[way] = {"success": run.success, "failure": report.failure, "outcome": str(report.outcome)}
        if rollout is not None:
            found[way] |= {
                "clearance": float(min(rollout.clearance.min(), rollout.gripper_clearance.min())),
                "off_goal": float(np.linalg.norm(rollout.keypoints[-1] - task.goal, axis=1).mean()),
                "duration": float(rollout.times[-1]),
                "eyes": rollout.metadata.get("eyes"),
            }
        if options.plan is None:  # nothing to follow, however the cable is known
            break
    file.write_text(json.dumps(found))
    return found


def main() -> None:
    """Run the tasks and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=6400)
    parser.add_argument("--count", type=int, default=12)
    parser.add_argument("--cameras", nargs="+", default=["front,back"])
    parser.add_argument("--frame-rate", type=float, default=30.0)
    parser.add_argument("--out", type=Path, default=Path("out/eyes"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    ways, found = [TRUE, *given.cameras], []
    for seed in range(given.first, given.first + given.count):
        found.append(ran(seed, ways, given.out, given.frame_rate))
        print(f"{seed}: " + "; ".join(f"{way}: {each['failure'] or 'success'}" for way, each in found[-1].items()),
              flush=True)  # fmt: skip
    titles = ("keypoints", "success", "contact", "off the goal, mean [mm]", "tracking error, mean, worst [mm]",
              "hidden [%]", "frames not known [%]", "time per frame [ms]")  # fmt: skip
    print("\n| " + " | ".join(titles) + " |\n" + "|---" * len(titles) + "|")
    for way in ways:
        rows = [each.get(way, {"success": False}) for each in found]
        made = [row for row in rows if "clearance" in row]
        eyes = [row["eyes"] for row in made if row["eyes"]]
        cells = [way, f"{sum(row['success'] for row in rows)} of {len(rows)}",
                 f"{sum(row['clearance'] <= 0 for row in made)}",
                 f"{1e3 * np.mean([row['off_goal'] for row in made]):.1f}"]  # fmt: skip
        cells += ["-"] * 4 if not eyes else [
            f"{1e3 * np.mean([each['mean_error'] for each in eyes]):.1f}, "
            f"{1e3 * max(each['largest_error'] for each in eyes):.1f}",
            f"{100 * np.mean([each['hidden'] for each in eyes]):.0f}",
            f"{100 * (1 - np.mean([each['known'] for each in eyes])):.1f}",
            f"{1e3 * np.mean([each['seconds_per_frame'] for each in eyes]):.1f}",
        ]  # fmt: skip
        print("| " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
