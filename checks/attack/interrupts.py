"""Every command, interrupted at random moments: SIGINT to all its processes (ctrl-c) or to it alone, and SIGTERM.

A third of the moments are drawn from the first seconds, a third from the whole duration, at most `LONGEST`, a third
from those in which the command writes its files. As many commands as there are cores run beside each other. Wrong is a
status other than 130 or 143, a traceback, more than one sentence, an end later than five seconds after the signal, a
file that is not whole or left over, a process that goes on; and, where a command resumes, results of the second
invocation other than those of one that was left alone. A signal before the command's own code runs ends it as any
Python program.

`python -m checks.attack.interrupts SEED COUNT [NAMES]`
"""

from __future__ import annotations

import json
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cableway.core.executors import cores
from checks.attack.commands import KEPT, RESUMED, Line, damaged, prepared, said_wrong

PATIENCE = 5.0
"""[s] between a signal and the end of the command, on a machine that is not busy."""

LONGEST = 15.0
"""[s] after which a signal comes at the latest."""

ENOUGH = 60.0
"""[s] for which a command is left alone, to see what it does: all but `reproduce` end before."""

FIRST = 2.5
"""[s] of a command that are its first moments."""

COMPLETE = 1.0
"""[s] within which a command may still end as if it had not been interrupted."""

MOMENTS = ("first", "any", "writing")
SIGNALS = (("group", signal.SIGINT), ("alone", signal.SIGINT), ("alone", signal.SIGTERM))


@dataclass(frozen=True)
class Timed:
    """A command that was left alone: how long it took [s], how many files it made on the way, what it left."""

    seconds: float
    files: int
    out: Path


def attack(seed: int, count: int, names: str = "") -> list[str]:
    """What was wrong in `count` interrupts of the commands by turns; each is printed as it comes."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background ignores it, and all below
    found: list[str] = []
    tally: Counter[tuple[str, str]] = Counter()
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(cores()) as pool:
        lines = prepared(Path(folder), names)
        timed = {line.name: _left_alone(line, Path(folder) / "alone" / line.name) for line in lines}
        turns = (_Turn(seed, turn, lines[turn % len(lines)], turn // len(lines)) for turn in range(count))
        for done, (turn, case, faults) in enumerate(pool.map(lambda turn: _interrupted(turn, timed), turns), start=1):
            tally[turn.line.name, "wrong" if faults else "right"] += 1
            if faults:
                found.append(f"{case}: {'; '.join(faults)}")
                print(found[-1], flush=True)
            if done % 20 == 0:
                print(f"{done} of {count}, {len(found)} wrong", flush=True)
    for line in lines:
        wrong, right = tally[line.name, "wrong"], tally[line.name, "right"]
        print(f"{line.name} ({timed[line.name].seconds:.1f} s): {wrong} wrong of {wrong + right}")
    return found


def _left_alone(line: Line, out: Path) -> Timed:
    """A command as it is here and now, with warm caches, for at most `ENOUGH`."""
    begun, process = time.monotonic(), _begin(line, out)
    seen: set[str] = set()
    while process.poll() is None and time.monotonic() - begun < ENOUGH:
        seen |= _names(out)
        time.sleep(0.002)
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    return Timed(time.monotonic() - begun, len(seen), out)


def _begin(line: Line, out: Path, *more: str) -> subprocess.Popen[bytes]:
    """Begin a command in a session and with a folder for temporary files of its own."""
    temporary = out.parent / "tmp"
    temporary.mkdir(parents=True, exist_ok=True)
    with open(out.parent / "stderr", "wb") as said:
        return subprocess.Popen(
            line.to(out, *more), cwd=out.parent, stdout=subprocess.DEVNULL, stderr=said, start_new_session=True,
            env={**os.environ, "TMPDIR": str(temporary)},
        )  # fmt: skip


def _names(out: Path) -> set[str]:
    return {str(Path(place) / name) for place, _, names in os.walk(out) for name in names}


@dataclass(frozen=True)
class _Turn:
    """One interrupt of an attack: which, of what command, and how many that has had before."""

    seed: int
    number: int
    line: Line
    round: int


def _interrupted(turn: _Turn, timed_all: Mapping[str, Timed]) -> tuple[_Turn, str, list[str]]:
    """Carry out one interrupt: its description, and what was wrong."""
    rng, line, timed = random.Random(f"{turn.seed} {turn.number}"), turn.line, timed_all[turn.line.name]
    moment, (whom, number) = MOMENTS[turn.round % 3], SIGNALS[(turn.round // 3 + turn.number) % 3]
    quiet, again = rng.random() < 0.5, rng.random() < 0.4
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        process = _begin(line, out, *["--quiet"] * quiet)
        begun = time.monotonic()
        _wait(process, out, rng, timed, moment)
        after, ours, over = time.monotonic() - begun, _handles(process.pid), process.poll() is not None
        if not over:
            os.killpg(process.pid, number) if whom == "group" else process.send_signal(number)
        late = _end(process)
        said = (out.parent / "stderr").read_text()
        faults = list(_faults(process.returncode, said, number, over=over, late=late, quiet=quiet)) if ours else []
        told = re.search("^cableway: .*; .*", said, re.MULTILINE)
        if process.returncode > 1 and not told and line.name in KEPT and any(out.glob(KEPT[line.name])):
            faults.append(f"does not say what is kept: {said[-300:]!r}")
        faults += _left_over(process.pid, out)
        if line.name in RESUMED and again and not faults:
            faults += _resumed(line, out, timed.out)
    case = f"{line.name}: {number.name} to {'it and all its processes' if whom == 'group' else 'it alone'}"
    return turn, f"{case} after {after:.2f} s ({moment})", faults


def _wait(process: subprocess.Popen[bytes], out: Path, rng: random.Random, timed: Timed, moment: str) -> None:
    """Until the moment has come."""
    if moment != "writing":
        most = min(LONGEST if moment == "any" else FIRST, timed.seconds)
        time.sleep(rng.uniform(0.05, most))
        return
    seen, wanted, later, begun = set[str](), rng.randint(1, max(timed.files, 1)), rng.uniform(0, 0.05), time.monotonic()
    while process.poll() is None and len(seen) < wanted and time.monotonic() - begun < LONGEST:
        seen |= _names(out)
        time.sleep(0.001)
    time.sleep(later)


def _handles(process: int) -> bool:
    """Whether a process has a handler of its own for SIGTERM: it has come as far as cableway."""
    try:
        caught = re.search(r"SigCgt:\s*([0-9a-f]+)", Path(f"/proc/{process}/status").read_text())
    except OSError:
        return True
    return caught is None or bool(int(caught[1], 16) >> (signal.SIGTERM - 1) & 1)


def _end(process: subprocess.Popen[bytes]) -> float:
    """Wait for the end of a command; [s] until then, `4 * PATIENCE` where it had to be killed."""
    sent = time.monotonic()
    try:
        process.wait(4 * PATIENCE)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    return time.monotonic() - sent


def _faults(status: int, said: str, number: signal.Signals, *, over: bool, late: float, quiet: bool) -> Iterator[str]:
    sentence = "interrupted" if number == signal.SIGINT else "terminated"
    if late > PATIENCE * max(1.0, os.getloadavg()[0] / cores()):
        yield f"ended {late:.1f} s later"
    yield from said_wrong(said, quiet=quiet)
    if status == 128 + number:
        if not re.search(rf"^cableway: {sentence}", said, re.MULTILINE):
            yield f"no sentence: {said[-300:]!r}"
    elif status not in (0, 1) or not (over or late < COMPLETE):
        yield f"status {status} after {late:.1f} s: {said[-300:]!r}"


def _left_over(session: int, out: Path) -> Iterator[str]:
    """Processes, temporary files, files that are not whole, plans without a report."""
    until = time.monotonic() + PATIENCE
    while (alive := _alive(session)) and time.monotonic() < until:
        time.sleep(0.05)
    for process, command in alive.items():
        yield f"goes on: {command[:120]}"
        os.kill(process, signal.SIGKILL)
    yield from damaged(out)
    yield from (f"{path} is left over" for path in (out.parent / "tmp").iterdir())
    if (out / "plan.npz").exists():
        missing = [name for name in ("task.yaml", "report.json") if not (out / name).exists()]
        yield from (f"there is a plan, and no {name}" for name in missing)


def _alive(session: int) -> dict[int, str]:
    """The processes of a session by number."""
    found = {}
    for path in Path("/proc").glob("[0-9]*"):
        try:
            state, _, _, its = (path / "stat").read_text().rpartition(")")[2].split()[:4]
            if int(its) == session and state != "Z":
                found[int(path.name)] = (path / "cmdline").read_text().replace("\0", " ")
        except (OSError, ValueError):
            continue  # it has ended meanwhile
    return found


def _resumed(line: Line, out: Path, reference: Path) -> Iterator[str]:
    """What is wrong with the same command once more."""
    done = _begin(line, out, "--quiet")
    done.wait()
    if done.returncode not in (0, 1):
        yield f"again: status {done.returncode}: {(out.parent / 'stderr').read_text()[-300:]!r}"
        return
    names, expected = ({name.removeprefix(str(each)) for name in _names(each)} for each in (out, reference))
    if names != expected:
        yield f"again: other files: {sorted(names ^ expected)}"
    for name in sorted(names & expected):
        one, other = Path(f"{out}{name}"), Path(f"{reference}{name}")
        if _content(one) != _content(other):
            yield f"again: another {name}"


CLOCKED = re.compile("time|seconds|date|machine|^control_|made_now|^file$|^folder$")
"""Keys of JSON files whose values differ from run to run."""

SUMMARIES = ("summary.json", "baseline.json")
"""Files that hold times under other keys, too; they are made of the others."""


def _content(path: Path) -> Any:
    """What two runs of a command have in common."""
    if path.suffix == ".json" and path.name not in SUMMARIES:
        return _without_times(json.loads(path.read_text()))
    return path.read_bytes() if path.suffix in (".safetensors", ".yaml") else path.suffix


def _without_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_times(each) for key, each in value.items() if not CLOCKED.search(key)}
    return [_without_times(each) for each in value] if isinstance(value, list) else value


if __name__ == "__main__":
    wrong = attack(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3] if len(sys.argv) > 3 else "")
    print(f"{len(wrong)} of {sys.argv[2]} interrupts wrong")
    sys.exit(bool(wrong))
