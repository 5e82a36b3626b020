"""Methods of a benchmark that cheat, crash, hang or answer nonsense: none is a success, none costs anything else."""

from __future__ import annotations

import csv
import random
from collections.abc import Iterable
from pathlib import Path

import methods_for_tests

from checks.attack import hostile_methods
from checks.attack.cases import ADDRESSES, DONE, Case, command
from checks.attack.made import EPISODE, Made, episode

SOUND = "SOUND"

TESTED = f"{SOUND} HANGS DIES QUITS CLAIMS RAISES TELLS NO_METHOD BREAKS STAYS NOTHING_OF_THIS_NAME".split()
METHODS = [
    *((Path(methods_for_tests.__file__), name) for name in TESTED),
    *((Path(hostile_methods.__file__), name) for name in vars(hostile_methods) if name.isupper()),
]


def benched(file: Path, name: str) -> Iterable[str]:
    """What is wrong with a benchmark of one method, and with what it says of that."""
    line = ("bench", EPISODE[0], "--episodes", episode(), "--methods", f"{file}:{name}", "--workers", 1)
    known = hasattr(hostile_methods if "hostile" in file.name else methods_for_tests, name) and name != "NO_METHOD"
    yield from command(*line, "--time-limit", 6, "--out", "bench", allowed=[DONE] if known else [2])
    if not known:
        return
    table = Path("bench/results.csv")
    if not table.exists():
        yield "no results"
        return
    rows = list(csv.DictReader(table.open()))
    if len(rows) != 1:
        yield f"{len(rows)} results of one episode"
    for row in rows:
        if (row["success"].lower() == "true") != (name == SOUND):
            yield f"success is {row['success']}: {row['outcome']}, {row['detail']}"


def case(rng: random.Random, number: int, made: Made) -> Case:
    """The case of a number: all of them in turn."""
    del rng, made
    file, name = METHODS[number % len(METHODS)]
    return Case(f"the method {name}", lambda: benched(file, name), 60.0, memory=ADDRESSES)
