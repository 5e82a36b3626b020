"""HDMI insertion to the end: how well the plug goes in with perturbed plants.

    .venv/bin/python studies/insertion.py [--task insertion] [--seeds 10] [--first 100] [--plants hdmi,hard]

Every seed draws a plant of its own and its noise. Each failure is listed.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from cableway.outcome import Outcome
from cableway.planning.planner import plan as find_plan
from cableway.records import Plan
from cableway.report import Report
from cableway.scene.files.loading import load_task
from cableway.scene.task import Task
from cableway.simulation.perturbations.variants import named_perturbation
from cableway.workflow.run import SolveOptions
from cableway.workflow.solve import solve

KINDS = ("nominal", "hdmi", "hard", "very-hard", "grasp", "slip", "stiff-middle", "all-faults")


def run(task: Task, plan: Plan, kind: str, seed: int) -> Report | None:
    """The report of one plant; None where the plant cannot take the start."""
    perturbation = named_perturbation(kind, replace(task, name=f"{task.name} {seed}"))
    report = solve(task, SolveOptions(plan=plan, perturbation=perturbation, seed=seed, recover=False)).report
    return None if report.outcome is Outcome.PLANT_FAILED and report.steps is None else report


def main() -> None:
    """Print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="insertion")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--plants", default=",".join(KINDS))
    given = parser.parse_args()
    task = load_task(given.task)
    plan = find_plan(task)
    failures = []
    print(
        "| plant | success | off the axis [mm], median, worst | turned [degrees], median, worst | depth [mm], least |"
    )
    print("|---|---|---|---|---|")
    for kind in given.plants.split(","):
        seeds = range(given.first, given.first + (1 if kind == "nominal" else given.seeds))
        reports = {seed: report for seed in seeds if (report := run(task, plan, kind, seed)) is not None}
        failures += [f"{kind}, seed {seed}: {report.failure}" for seed, report in reports.items() if report.failure]
        print(line(kind, list(reports.values())), flush=True)
    print("", *failures, sep="\n")


def line(kind: str, reports: list[Report]) -> str:
    """A row of the table; misalignment at the port, over the runs that came there."""
    inside = [found for report in reports if (found := report.insertion) and found.lateral_at_mouth is not None]
    lateral = np.array([1000 * (found.lateral_at_mouth or 0.0) for found in inside])
    turned = np.array([np.degrees(found.angle_at_mouth or 0.0) for found in inside])
    depth = np.array([1000 * found.depth for found in inside])
    figures = ["none came there"] * 3
    if inside:
        pairs = [f"{np.median(values):.2f}, {values.max():.2f}" for values in (lateral, turned)]
        figures = [*pairs, f"{depth.min():.1f}"]
    return f"| {kind} | {sum(report.success for report in reports)}/{len(reports)} | {' | '.join(figures)} |"


if __name__ == "__main__":
    main()
