"""Long cables: random tasks made larger, from cables that move as their equilibria to ones that swing.

    .venv/bin/python studies/long_cables.py [--lengths 0.3,0.6,0.9,1.2,1.8] [--plants nominal,hard]
        [--controllers rod-mpc,open-loop] [--seeds 400:410]

Gripper limits, radius, stiffness and weight per metre are those of the 0.3 m cable. Each failure is listed.
"""

from __future__ import annotations

import argparse
import itertools

import numpy as np

from cableway.core.errors import CablewayError
from cableway.simulation.perturbations.variants import named_perturbation
from cableway.tasks.generation import random_task
from cableway.tasks.scaling import scaled
from cableway.workflow.run import Run, SolveOptions
from cableway.workflow.solve import solve


def main() -> None:
    """Print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lengths", default="0.3,0.6,0.9,1.2,1.8")
    parser.add_argument("--plants", default="nominal,hard")
    parser.add_argument("--controllers", default="rod-mpc,open-loop")
    parser.add_argument("--seeds", default="400:410")
    given = parser.parse_args()
    seeds = range(*map(int, given.seeds.split(":")))
    failures = []
    print("| length [m] | first mode [Hz] | plant | controller | success | contact | error [mm], median, worst |")
    print("|---|---|---|---|---|---|---|")
    for length, plant, controller in itertools.product(
        map(float, given.lengths.split(",")), given.plants.split(","), given.controllers.split(",")
    ):
        runs, frequency = [], 0.0
        for seed in seeds:
            task = random_task(seed, "clutter")
            task = scaled(task, length / task.cable.length)
            frequency = task.cable.frequency
            try:
                run = solve(task, SolveOptions(controller=controller, perturbation=named_perturbation(plant, task)))
            except CablewayError as error:
                print(f"<!-- {task.name} at {length:g} m, {plant}: {error} -->")
                continue
            runs.append(run)
            if not run.success:
                failures.append(f"{length:g} m, {plant}, {controller}, seed {seed}: {run.report.failure}")
        print(f"| {length:g} | {frequency:.2f} | {plant} | {controller} | {figures(runs)} |", flush=True)
    print("", *failures, sep="\n")


def figures(runs: list[Run]) -> str:
    """Success, contact and final error."""
    touched = sum(run.rollout is not None and not run.rollout.least_clearance > 0 for run in runs)
    errors = [1000 * run.report.shape_error for run in runs if run.report.shape_error is not None]
    error = f"{np.median(errors):.2f}, {max(errors):.1f}" if errors else ""
    return f"{sum(run.success for run in runs)}/{len(runs)} | {touched} | {error}"


if __name__ == "__main__":
    main()
