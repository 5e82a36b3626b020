"""Limp and heavy cables on a table with friction: from where on friction, not the grippers, decides their shape.

    .venv/bin/python studies/limp_cables.py [--ratios 3,10,30,60,100,200,400] [--seeds 300:310]
        [--kinds clutter,dense] [--workers 2]

A cable is known by mu rho g L^3 / EI: friction over its length against what bends it. Here only EI changes, on the
table plant with its uniform cable, which is 2 to 5% longer or shorter, held askew, and measured late with noise. Each
failure is listed.
"""

from __future__ import annotations

import argparse
import itertools
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import numpy as np

from cableway.core.errors import CablewayError
from cableway.simulation.perturbations.variants import named_perturbation
from cableway.tasks.generation import random_task
from cableway.workflow.run import SolveOptions
from cableway.workflow.solve import solve

GRAVITY = 9.81


def main() -> None:
    """Print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ratios", default="3,10,30,60,100,200,400")
    parser.add_argument("--seeds", default="300:310")
    parser.add_argument("--kinds", default="clutter,dense")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    tasks = list(itertools.product(given.kinds.split(","), range(*map(int, given.seeds.split(":")))))
    print("| mu rho g L^3 / EI | success | contact | error [mm], median, worst | deviation [mm], median |")
    print("|---|---|---|---|---|")
    failures = []
    with ProcessPoolExecutor(given.workers, get_context("spawn")) as pool:
        for ratio in map(float, given.ratios.split(",")):
            rows = [row for row in pool.map(led, itertools.repeat(ratio), *zip(*tasks, strict=True)) if row]
            errors, deviations = ([1000 * row[k] for row in rows if row[k] is not None] for k in (2, 3))
            succeeded, touched = (sum(row[k] for row in rows) for k in (0, 1))
            print(f"| {ratio:g} | {succeeded}/{len(rows)} | {touched} | {np.median(errors):.1f}, {max(errors):.1f} | "
                  f"{np.median(deviations):.1f} |", flush=True)  # fmt: skip
            failures += [f"{ratio:g}: {row[4]}" for row in rows if not row[0]]
    print("", *failures, sep="\n")


def led(ratio: float, kind: str, seed: int) -> tuple[bool, bool, float | None, float | None, str] | None:
    """Success, contact, final error [m], largest deviation [m] and why not; None where it cannot begin."""
    task = random_task(seed, kind)
    perturbation = named_perturbation("table-uniform", task)
    cable, table = perturbation.cable, perturbation.table
    assert cable is not None
    assert table is not None
    load = table.friction * cable.linear_density * GRAVITY * cable.length**3
    limp = replace(perturbation, cable=replace(cable, bending_stiffness=load / ratio))
    try:
        run = solve(task, SolveOptions(perturbation=limp))
    except CablewayError as error:
        print(f"<!-- {task.name}: {error} -->", flush=True)
        return None
    touched = run.rollout is not None and not run.rollout.least_clearance > 0
    report = run.report
    return run.success, touched, report.shape_error, report.largest_deviation, f"{task.name}: {report.failure}"


if __name__ == "__main__":
    main()
