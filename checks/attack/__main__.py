"""The attack: `python -m checks.attack --seed 0 --count 2000`, all families, one report; status 1 if any case is wrong.

A case is made from the seed, its family and its number alone: `--case files:17` runs that one again.
"""

from __future__ import annotations

import os

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MPLBACKEND="agg")

import argparse
import random
import shutil
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from checks.attack import arguments, documents, files, methods, plants, records
from checks.attack.cases import Case, Running
from checks.attack.made import Made, make

warnings.filterwarnings("ignore", "os.fork", DeprecationWarning)

FAMILIES = {
    "files": (files.case, 34),
    "records": (records.case, 26),
    "documents": (documents.case, 18),
    "plants": (plants.case, 12),
    "arguments": (arguments.case, 8),
    "methods": (methods.case, 2),
}
"""How each family makes a case of its random numbers, its number and what there is; its share of all cases [%]."""

REAL = 25
"""One case in so many runs as a user would run it: a new process."""

Key = tuple[str, int]


def chosen(count: int, only: str) -> list[Key]:
    """Families and numbers of the cases, so that every family is under way from the beginning."""
    wanted = {name: share for name, (_, share) in FAMILIES.items() if not only or name in only.split(",")}
    total = sum(wanted.values())
    keys = [(name, k, (k + 0.5) / share) for name, share in wanted.items() for k in range(-(-count * share // total))]
    return [(name, k) for name, k, _ in sorted(keys, key=lambda key: key[2])][:count]


def made_case(seed: int, key: Key, made: Made) -> Case:
    """The case of a seed, family and number."""
    family, number = key
    return FAMILIES[family][0](random.Random(f"{seed} {family} {number}"), number, made)


def attack(seed: int, keys: list[Key], made: Made, work: Path, workers: int) -> Iterator[tuple[Key, str, list[str]]]:
    """Run all cases, some at a time; of each its key, its name and what was wrong."""
    waiting, running = list(reversed(keys)), {}
    try:
        while waiting or running:
            while waiting and len(running) < workers:
                key = waiting.pop()
                real = key[1] % REAL == REAL - 1
                folder = work / f"{key[0]}-{key[1]}"
                shutil.rmtree(folder, ignore_errors=True)
                running[key] = Running(made_case(seed, key, made), folder, real), folder
            for key, (one, folder) in list(running.items()):
                if (found := one.ended()) is not None:
                    del running[key]
                    yield key, one.case.name, found
                    if not found:
                        shutil.rmtree(folder, ignore_errors=True)
            time.sleep(0.005)
    finally:
        for one, _ in running.values():
            one.stop()


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m checks.attack", description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--only", default="", help=f"families, separated by commas: {', '.join(FAMILIES)}")
    parser.add_argument("--case", default="", help="cases to run again: family:number, separated by commas")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--made", type=Path, help="folder to keep what is attacked in, for the next run")
    asked = parser.parse_args()
    keys = [(name, int(number)) for name, _, number in (each.partition(":") for each in asked.case.split(",") if each)]
    keys = keys or chosen(asked.count, asked.only)
    work, begun = Path(tempfile.mkdtemp(prefix="cableway-attack-")), time.monotonic()
    made = make(asked.made or work / "made")
    print(f"{len(keys)} cases of seed {asked.seed} in {work}; prepared in {time.monotonic() - begun:.0f} s", flush=True)
    counts, wrong = Counter(name for name, _ in keys), Counter()
    for place, (key, name, found) in enumerate(attack(asked.seed, keys, made, work, asked.workers), start=1):
        wrong[key[0]] += bool(found)
        for fault in found:
            print(f"{key[0]}:{key[1]} {name!r}: {fault}", flush=True)
        if place % 100 == 0:
            seconds = time.monotonic() - begun
            print(f"{place} of {len(keys)} cases, {wrong.total()} wrong, {seconds:.0f} s", flush=True)
    print(f"\n{'family':12} {'cases':>6} {'wrong':>6}")
    for name, count in [*counts.items(), ("all", counts.total())]:
        print(f"{name:12} {count:6} {wrong[name] if name != 'all' else wrong.total():6}")
    print(f"{time.monotonic() - begun:.0f} s; again: python -m checks.attack --seed {asked.seed} --case FAMILY:NUMBER")
    if not wrong.total():
        shutil.rmtree(work, ignore_errors=True)
    return min(1, wrong.total())


if __name__ == "__main__":
    sys.exit(main())
