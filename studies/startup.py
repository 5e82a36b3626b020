"""How long commands take to start, and the first run of all: `python studies/startup.py [TASK] [--runs 3]`.

With an empty cache folder the task is run once, which compiles every kernel; then each command starts several times.
Prints a table in Markdown for the page on the command line: wall time and processor time, the least of the runs, with
the machine. Processor time counts all processes of a command, so that on two processors it may exceed wall time.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence

import llvmlite.binding

FIRST = ("run", "--quiet", "--out", "first")


def commands(task: str) -> tuple[Sequence[str], ...]:
    """Command lines that are started again and again, each with what the first run left."""
    return (
        ("--version",),
        ("--help",),
        ("run", "--help"),
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


def measured(command: Sequence[str], folder: str) -> tuple[float, float, int]:
    """Wall time and processor time [s] of a command in a folder with a cache of its own, and its exit status."""
    environment = {**os.environ, "XDG_CACHE_HOME": os.path.join(folder, "cache")}
    environment.pop("NUMBA_CACHE_DIR", None)
    line, before, begun = [sys.executable, "-m", "cableway", *command], _processor_time(), time.perf_counter()
    done = subprocess.run(line, cwd=folder, env=environment, capture_output=True)
    return time.perf_counter() - begun, _processor_time() - before, done.returncode


def _processor_time() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def row(name: str, runs: Sequence[tuple[float, float, int]]) -> str:
    """A line of the table."""
    statuses = sorted({status for *_, status in runs})
    failed = "" if statuses == [0] else f" (exit status {', '.join(map(str, statuses))})"
    wall, processor = (min(run[place] for run in runs) for place in (0, 1))
    return f"| `{name}`{failed} | {wall:.1f} | {processor:.1f} | {len(runs)} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task", nargs="?", default="single-obstacle-2")
    parser.add_argument("--runs", type=int, default=3)
    given = parser.parse_args()
    cpu, count = llvmlite.binding.get_host_cpu_name(), os.cpu_count()
    print(f"{count} processors ({cpu}), Python {platform.python_version()}, load {os.getloadavg()[0]:.1f} before\n")
    print("| command | wall time [s] | processor time [s] | runs |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        first = (FIRST[0], given.task, *FIRST[1:])
        print(row(f"{' '.join(first[:2])}, empty cache", [measured(first, folder)]), flush=True)
        for command in commands(given.task):
            runs = [measured(command, folder) for _ in range(given.runs)]
            print(row(" ".join(command).replace(" --out second", ""), runs), flush=True)


if __name__ == "__main__":
    main()
