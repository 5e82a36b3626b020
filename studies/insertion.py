"""HDMI insertion to the end: how well the plug goes in with perturbed plants.

    .venv/bin/python studies/insertion.py [--task insertion] [--seeds 10] [--first 100] [--plants hdmi,hard] [--blindly]

Every seed draws a plant of its own and its noise. With `--blindly` the nominal grasp is assumed, so that
the table shows what the estimate of the grasp is worth. Each failure is said.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np

from cableway.control.insertion import InsertionConfig, InsertionController
from cableway.control.rod_mpc import RodMPC
from cableway.core.errors import SimulationError
from cableway.estimation.rod_filter import EstimatorConfig
from cableway.planning.insertion import plan_insertion
from cableway.planning.planner import plan as find_plan
from cableway.records import Plan
from cableway.report import Report, summarize
from cableway.scene.files.loading import load_task
from cableway.scene.task import Task
from cableway.simulation.perturbations.variants import named_perturbation
from cableway.tracking import insert_plug, may_insert, track

KINDS = ("nominal", "hdmi", "hard", "very-hard", "grasp", "slip", "stiff-middle", "all-faults")


@dataclass(frozen=True)
class Study:
    """What leads along which plans."""

    task: Task
    plan: Plan
    push: Plan
    controller: RodMPC
    pusher: InsertionController

    def run(self, kind: str, seed: int) -> Report | None:
        """The report of one plant; None where the plant cannot take the start."""
        perturbation = named_perturbation(kind, replace(self.task, name=f"{self.task.name} {seed}"))
        try:
            plant = perturbation.build(self.task, seed)
        except SimulationError:
            return None
        rollout, insertion = track(plant, self.controller, self.plan, seed=seed), None
        if may_insert(rollout, self.task):
            insertion = insert_plug(plant, self.push, controller=self.pusher, seed=seed)
        return summarize(
            self.task, self.plan, rollout, insertion_plan=self.push, insertion=insertion, cable=perturbation.cable
        )


def main() -> None:
    """Print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="insertion")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--plants", default=",".join(KINDS))
    parser.add_argument("--blindly", action="store_true")
    given = parser.parse_args()
    task = load_task(given.task)
    blind = InsertionConfig(estimator=EstimatorConfig.nominal())
    study = Study(
        task, find_plan(task), plan_insertion(task), RodMPC(), InsertionController(blind if given.blindly else None)
    )
    failures = []
    print(
        "| plant | success | off the axis [mm], median, worst | turned [degrees], median, worst | depth [mm], least |"
    )
    print("|---|---|---|---|---|")
    for kind in given.plants.split(","):
        seeds = range(given.first, given.first + (1 if kind == "nominal" else given.seeds))
        reports = {seed: report for seed in seeds if (report := study.run(kind, seed)) is not None}
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
