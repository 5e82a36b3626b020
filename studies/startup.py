"""How long commands take to start, and the first run of all: `python studies/startup.py [TASK] [--runs 3]`.

With an empty cache folder the task is run once, as `make demo` does it, which compiles every kernel; then each command
starts several times, those that work for long with `--help`. Prints a table in Markdown: wall time,
median and slowest of the runs, the median of processor time, and the machine; and below it whether
the slowest runs meet `FIRST_TARGET` and `START_TARGET`; status 1 where they do not, or a command fails. Processor time
counts all processes of a command, so that on two processors it may exceed wall time.
"""

from __future__ import annotations

import argparse
import math
import os
import platform
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence

import llvmlite.binding

FIRST = ("run", "--quiet", "--out", "first")

FIRST_TARGET, START_TARGET = 60.0, 1.5
"""Wall time [s] wanted of the first run, from an empty cache to the video, and of the second start of a command."""

WORKING = ("plan", "run")
"""Commands whose time is that of a whole task, and not of a start."""

Measured = tuple[float, float, int]
"""Wall time and processor time [s] of a command, and its exit status."""


def commands(task: str) -> tuple[Sequence[str], ...]:
    """Command lines that are started again and again, each with what the first run left."""
    return (
        ("--version",),
        ("--help",),
        *((name, "--help") for name in ("run", "bench", "collect", "train", "evaluate", "reproduce")),
        ("tasks",),
        ("show", task, "--out", "second"),
        ("check", task, "first/plan.npz"),
        ("export", "first/plan.npz", "--out", "second.csv"),
        ("models",),
        ("warm-up",),
        ("plan", task, "--out", "second"),
        ("run", task, "--no-video", "--out", "second"),
        ("run", task, "--out", "second"),
    )


def measured(command: Sequence[str], folder: str) -> Measured:
    """A command in a folder with a cache of its own."""
    environment = {**os.environ, "XDG_CACHE_HOME": os.path.join(folder, "cache")}
    environment.pop("NUMBA_CACHE_DIR", None)
    line, before, begun = [sys.executable, "-m", "cableway", *command], _processor_time(), time.perf_counter()
    done = subprocess.run(line, cwd=folder, env=environment, capture_output=True)
    return time.perf_counter() - begun, _processor_time() - before, done.returncode


def _processor_time() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def is_met(runs: Sequence[Measured], target: float) -> bool:
    """Whether every run succeeded, and in time."""
    return all(status == 0 and wall <= target for wall, _, status in runs)


def row(name: str, runs: Sequence[Measured]) -> str:
    """A line of the table."""
    statuses = sorted({status for *_, status in runs})
    failed = "" if statuses == [0] else f" (exit status {', '.join(map(str, statuses))})"
    wall, processor = (statistics.median(run[place] for run in runs) for place in (0, 1))
    slowest = max(wall for wall, *_ in runs)
    return f"| `{name}`{failed} | {wall:.1f} | {slowest:.1f} | {processor:.1f} | {len(runs)} |"


def main() -> int:
    """Print the table; 1 where a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task", nargs="?", default="single-obstacle-2")
    parser.add_argument("--runs", type=int, default=3)
    given = parser.parse_args()
    cpu, count = llvmlite.binding.get_host_cpu_name(), os.cpu_count()
    print(f"{count} processors ({cpu}), Python {platform.python_version()}, load {os.getloadavg()[0]:.1f} before\n")
    print("| command | wall time [s] | slowest [s] | processor time [s] | runs |\n|---|---|---|---|---|")
    missed: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        first = (FIRST[0], given.task, *FIRST[1:])
        runs = [measured(first, folder)]
        print(row(f"{' '.join(first[:2])}, empty cache", runs), flush=True)
        missed += [] if is_met(runs, FIRST_TARGET) else ["the first run"]
        for command in commands(given.task):
            runs, name = [measured(command, folder) for _ in range(given.runs)], " ".join(command)
            print(row(re.sub(r" --out \S+", "", name), runs), flush=True)
            working = command[0] in WORKING and "--help" not in command
            missed += [] if is_met(runs, math.inf if working else START_TARGET) else [name]
    targets = f"the first run within {FIRST_TARGET:g} s, every start within {START_TARGET:g} s"
    print(f"\nWanted: {targets}. Missed: {', '.join(missed) or 'nothing'}.")
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
