"""Every command on a disk that is full after so many bytes, and two of them at once into one folder.

The disk is a file system in memory where one may be mounted, else the system's limit on the size of a file. Wrong is a
traceback, more or less than one sentence, a status other than 1, a file that is not whole or left over, a success
without all its files. Of two commands at once, one is refused with status 2, or both follow one another; what is there
in the end is of one of them alone.

`python -m checks.attack.disks SEED COUNT [NAMES]`
"""

from __future__ import annotations

import os
import random
import re
import resource
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from cableway.core.reading import read_arrays, read_json
from checks.attack.commands import Line, damaged, prepared, said_wrong

NAMES = "tasks,list,show,plan,run,table,check,export,collect,train,evaluate,models,bench"

SHARED = {"plan": "maze-1", "run": "maze-1"}
"""Tasks of the second of two commands at once; others differ in nothing, or in their seed."""

SEEDED = ("tasks", "collect")


def attack(seed: int, count: int, names: str = "") -> list[str]:
    """What was wrong in `count` cases, full disks and shared folders by turns; each is printed as it comes."""
    rng, found, tally = random.Random(seed), [], Counter[tuple[str, bool]]()
    with tempfile.TemporaryDirectory() as folder:
        lines = prepared(Path(folder), names or NAMES)
        alone = {}
        for line in lines:
            alone[line.name] = Path(folder) / "alone" / line.name
            done = _run(line, alone[line.name])
            assert done.returncode == 0, done.stderr
        for turn in range(count):
            line = lines[turn % len(lines)]
            if turn // len(lines) % 3 < 2:
                name, faults = _full(rng, line, alone[line.name])
            else:
                name, faults = _at_once(rng, line, alone[line.name])
            tally[line.name, bool(faults)] += 1
            if faults:
                found.append(f"{line.name}, {name}: {'; '.join(faults)}")
                print(found[-1], flush=True)
    for line in lines:
        wrong, right = tally[line.name, True], tally[line.name, False]
        print(f"{line.name}: {wrong} wrong of {wrong + right}")
    return found


def _run(line: Line, out: Path, *more: str, limit: int | None = None) -> subprocess.CompletedProcess[str]:
    def limited() -> None:
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    out.parent.mkdir(parents=True, exist_ok=True)
    return subprocess.run(
        line.to(out, *more, "--quiet"), cwd=out.parent, capture_output=True, text=True, preexec_fn=limited
    )


@contextmanager
def disk(kilobytes: int) -> Iterator[tuple[Path, bool]]:
    """A folder with so much room, and whether it is a file system of its own."""
    with tempfile.TemporaryDirectory() as folder:
        mount = ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", folder]
        mounted = os.geteuid() == 0 and subprocess.run(mount, capture_output=True).returncode == 0
        try:
            yield Path(folder), mounted
        finally:
            if mounted:
                subprocess.run(["umount", folder], check=True)


def _full(rng: random.Random, line: Line, alone: Path) -> tuple[str, list[str]]:
    """A command on a disk with too little room, or just enough."""
    sizes = sorted(path.stat().st_size for path in alone.rglob("*") if path.is_file())
    most, limits = max(sum(sizes) // 1024, 8), rng.random() < 0.3
    kilobytes = rng.choice([4, rng.randint(4, most), rng.randint(4, max(most // 4, 5)), most + 64])
    with disk(1_000_000 if limits else kilobytes) as (folder, mounted):
        limits = limits or not mounted
        done = _run(line, folder / "out", limit=rng.randint(1, sizes[-1]) if limits else None)
        faults = [*said_wrong(done.stderr, quiet=True), *damaged(folder)]
        if done.returncode == 0:
            missing = _names(alone) - _names(folder / "out")
            faults += [f"status 0 without {', '.join(sorted(missing))}"] if missing else []
        elif done.returncode != 1 or not done.stderr.startswith("cableway: "):
            faults.append(f"status {done.returncode}: {done.stderr[-300:]!r}")
    return "files limited" if limits else f"{kilobytes} kB of {most}", faults


def _names(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def _at_once(rng: random.Random, line: Line, alone: Path) -> tuple[str, list[str]]:
    """Two commands into one folder, the second begun at any time while the first one runs."""
    other = _other(line)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        begin = {"cwd": folder, "stderr": subprocess.PIPE, "stdout": subprocess.DEVNULL, "text": True}
        first = subprocess.Popen(line.to(out, "--quiet"), **begin)
        with suppress(subprocess.TimeoutExpired):
            first.wait(rng.uniform(0, 4))
        second = subprocess.Popen(other.to(out, "--quiet"), **begin)
        ends = [(process.communicate()[1], process.returncode) for process in (first, second)]
        faults = [fault for said, _ in ends for fault in said_wrong(said, quiet=True)] + list(damaged(out))
        for said, status in ends:
            refused = status == 2 and re.search("another process is writing|contains a data set", said)
            if status not in (0, 1) and not refused:
                faults.append(f"status {status}: {said[-300:]!r}")
        if all(status == 2 for _, status in ends):
            faults.append("both were refused")
        faults += _mixed(out)
        if line == other and _names(out) != _names(alone):
            faults.append(f"other files: {sorted(_names(out) ^ _names(alone))}")
    return "two at once", faults


def _other(line: Line) -> Line:
    if line.name in SHARED:
        return Line(line.name, (line.name, SHARED[line.name]))
    return Line(line.name, (*line.words, "--seed", "7")) if line.name in SEEDED else line


def _mixed(out: Path) -> Iterator[str]:
    """Plan, task and rollout of different runs."""
    report = out / "report.json"
    if not (out / "plan.npz").exists():
        return
    named = read_json(report)["task"]
    if f"name: {named}" not in (out / "task.yaml").read_text():
        yield f"the report is of {named}, the task is not"
    if (out / "rollout.npz").exists():
        plan, rollout = read_arrays(out / "plan.npz"), read_arrays(out / "rollout.npz")
        if abs(plan["shapes"][0] - rollout["reference"][0]).max() > 0.05:
            yield "the rollout is not of the plan"


if __name__ == "__main__":
    wrong = attack(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3] if len(sys.argv) > 3 else "")
    print(f"{len(wrong)} of {sys.argv[2]} cases wrong")
    sys.exit(bool(wrong))
