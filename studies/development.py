"""Episodes apart from those of the suites, on which a method may be improved.

    .venv/bin/python studies/development.py --tasks clutter-300:310,maze-5300:5310@0.085 --plants fault-peg,table-all
        [--method cableway] [--seed 0] [--out runs/development]

Every task runs on every plant, and failures are drawn as by `cableway bench`. The seeds of the suites, 20000 and above,
are refused. The same command goes on after an interrupt and prints again what is already there.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from cableway.benchmark.episode import Result, jobs_of
from cableway.benchmark.runner import read_result, run_jobs
from cableway.benchmark.suites import Episode, make_task, task_digest
from cableway.core.errors import CablewayError
from cableway.simulation.perturbations.variants import named_perturbation, variant

FROZEN = 20000
"""Least seed of the suites."""


def main() -> None:
    """Run what is not there yet and print a line an episode and one a plant."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", required=True)
    parser.add_argument("--plants", required=True)
    parser.add_argument("--method", default="cableway")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/development"))
    given = parser.parse_args()
    plants = given.plants.split(",")
    for plant in plants:
        variant(plant)
    jobs = jobs_of(given.method, episodes([one for kinds in given.tasks.split(",") for one in tasks(kinds)], plants,
                                          given.seed))  # fmt: skip
    missing = [job for job in jobs if read_result(job, given.out) is None]
    run_jobs(missing, given.out, workers=given.workers, done=show)
    results = [result for job in jobs if (result := read_result(job, given.out))]
    for plant in plants:
        of = [result for result in results if result.plant == plant]
        print(f"{plant:24s} {counts(of)}")
    print(f"all: {counts(results)}")


def counts(results: list[Result]) -> str:
    """Successes and contacts; those of faults that were avoidable, too."""
    avoidable = [result for result in results if result.unavoidable is False and result.contact]
    return (
        f"{sum(r.success for r in results):3d} of {len(results):3d}, contact {sum(r.contact for r in results)}"
        f", avoidable {len(avoidable)}"
    )


def tasks(kinds: str) -> list[str]:
    """Of "clutter-300:310@0.085" every task."""
    named, _, width = kinds.partition("@")
    kind, _, seeds = named.rpartition("-")
    first, _, end = seeds.partition(":")
    if int(first) >= FROZEN:
        raise SystemExit(f"{kinds}: seeds from {FROZEN} on are the suites'")
    return [f"{kind}-{seed}" + (width and f"@{width}") for seed in range(int(first), int(end or int(first) + 1))]


def episodes(names: list[str], plants: list[str], seed: int) -> list[Episode]:
    """Those that can begin; the others are printed."""
    found = []
    for name in names:
        for plant in plants:
            try:
                task = make_task(name)
                named_perturbation(plant, task, seed).build(task, seed).reset()
            except CablewayError as error:
                print(f"{name} {plant}: cannot begin: {error}", flush=True)
                continue
            label = f"{name.replace('@', '-')}-{plant}"
            found.append(Episode("development", label, name, plant, seed, task_digest(name, task)))
    return found


def show(result: Result) -> None:
    """A line of an episode."""
    what = "" if result.success else f" {result.outcome}: {result.detail}"
    touch = f", clearance {1000 * result.clearance:.2f} mm" if result.clearance is not None else ""
    touch += " avoidable" if result.contact and result.unavoidable is False else ""
    print(f"{result.episode}: {'success' if result.success else 'FAILED'}, recovered {result.recovered}{touch}{what}",
          flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
