"""What a case is, and how one is run: in a process and a folder of its own, its time and memory measured.

Right is one of the exit statuses that the case allows; one sentence where that is 2; no traceback; nothing that would
steer a terminal; files that are whole. Whether a verdict is right, the case knows: it knows what it forged.
"""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from unicodedata import category

from cableway.core.errors import InputError
from cableway.core.reading import read_arrays, read_json

PATIENCE = 5.0
"""Processor time [s] that a case takes at most, unless it is one with a limit of its own."""

GUARD = 90.0
"""Time [s] after which a case counts as hanging, and is ended."""

MEMORY = 1e9
"""Bytes that a case takes at most; it cannot get `ADDRESSES`."""

ADDRESSES = 12_000_000_000

DONE, FAILED, WRONG = 0, 1, 2
ANY = (DONE, FAILED, WRONG)


@dataclass(frozen=True)
class Case:
    """One attack.

    Attributes:
        name: What it does.
        act: Does it, in an empty current folder, and yields what was wrong.
        seconds: Processor time that it may take.
        memory: Bytes that it may take.
    """

    name: str
    act: Callable[[], Iterable[str]]
    seconds: float = PATIENCE
    memory: float = MEMORY


class Said(NamedTuple):
    """How a command ended, and what it printed."""

    status: int
    out: str
    err: str

    @property
    def faults(self) -> Iterator[str]:
        """What is wrong whatever the command was to do."""
        if "Traceback (most recent" in self.err + self.out:
            yield f"a traceback: {self.err[-500:]!r}"
        if steers := sorted({each for each in self.out + self.err if each not in "\n\t" and category(each)[0] == "C"}):
            yield f"characters that steer a terminal: {''.join(steers)!r}"
        sentences = [line for line in self.err.splitlines() if line.startswith("cableway: ")]
        parsed = self.err.lstrip().startswith("╭")  # by tyro, which draws a box round it
        if self.status == WRONG and not parsed and (len(sentences) != 1 or self.err.splitlines()[-1] != sentences[0]):
            yield f"status 2 without one sentence: {self.err[-300:]!r}"
        if any(len(line) > 1000 for line in sentences):
            yield f"a sentence of {max(map(len, sentences))} letters: {sentences[0][:200]!r}"


def command(*arguments: object, allowed: Iterable[int] = ANY) -> Iterator[str]:
    """What is wrong with how a command line ends; the words after it are for `said`."""
    done = run(*arguments)
    if done.status not in allowed:
        yield f"status {done.status}: {done.err[-300:]!r}"
    yield from done.faults


def run(*arguments: object) -> Said:
    """A command line, in this process; or, where the case is one of those, as a user runs it."""
    line = [str(argument) for argument in arguments]
    if "ATTACK_REAL" in os.environ:
        tool = Path(sys.executable).with_name("cableway")
        done = subprocess.run([tool, *line], capture_output=True, text=True, errors="surrogateescape")
        return Said(done.returncode, done.stdout, done.stderr)
    from cableway.cli import main

    before = _printed()
    status = main(line)
    return Said(status, *(after[len(part) :] for after, part in zip(_printed(), before, strict=True)))


def _printed() -> list[str]:
    """What this process has printed so far, which goes to files beside its folder."""
    sys.stdout.flush()
    sys.stderr.flush()
    return [Path(f"../{name}").read_text(errors="surrogateescape") for name in ("out", "err")]


def unwhole(folder: Path) -> Iterator[str]:
    """Files that a command left half-written."""
    for path in folder.rglob("*"):
        if re.search(r"^\..*\.[0-9a-f]{12}$", path.name):
            yield f"{path}: left over"
        try:
            if path.name == "report.json":
                read_json(path)
            elif path.name in ("plan.npz", "rollout.npz"):
                read_arrays(path)
            elif path.suffix == ".png" and path.read_bytes()[-8:-4] != b"IEND":
                yield f"{path}: cut off"
        except InputError as error:
            yield f"left damaged: {error}"


# ---------------------------------------------------------------------------------------------- in its own process
class Running:
    """A case under way."""

    def __init__(self, case: Case, folder: Path, real: bool) -> None:
        self.case, self._folder, self._begun = case, folder, time.monotonic()
        (folder / "here").mkdir(parents=True)
        self._inherited = 0 if real else 4096 * int(Path("/proc/self/statm").read_text().split()[1])
        self._process = os.fork()
        if self._process == 0:
            _carry_out(case, folder, real)

    def ended(self) -> list[str] | None:
        """What was wrong, once it has ended."""
        process, status, used = os.wait4(self._process, os.WNOHANG)
        if process == 0:
            if time.monotonic() - self._begun < GUARD:
                return None
            self.stop()
            return [f"not ended after {GUARD:g} s"]
        self._end_group()
        try:
            found = json.loads((self._folder / "faults.json").read_text())
        except OSError:
            found = [f"the process ended with {os.waitstatus_to_exitcode(status)}: {self._last_words()!r}"]
        if (taken := used.ru_utime + used.ru_stime) > self.case.seconds:
            found.append(f"took {taken:.1f} s of processor time, more than {self.case.seconds:g}")
        if (memory := 1024 * used.ru_maxrss - self._inherited) > self.case.memory:
            found.append(f"took {memory / 1e9:.2f} GB of memory")
        return found

    def stop(self) -> None:
        """End it now."""
        self._end_group()
        os.waitpid(self._process, 0)

    def _end_group(self) -> None:
        with suppress(ProcessLookupError):
            os.killpg(self._process, signal.SIGKILL)

    def _last_words(self) -> str:
        return (self._folder / "err").read_text(errors="replace")[-300:]


def _carry_out(case: Case, folder: Path, real: bool) -> None:
    """All that the new process does."""
    status = 1
    try:
        os.setsid()
        os.chdir(folder / "here")
        for number, name in ((1, "out"), (2, "err")):
            os.dup2(os.open(folder / name, os.O_WRONLY | os.O_CREAT | os.O_APPEND), number)
        resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if real:
            os.environ["ATTACK_REAL"] = "1"
        try:
            found = list(case.act())
        except BaseException as error:
            where = traceback.extract_tb(error.__traceback__)[-1]
            found = [f"raised {type(error).__name__}: {str(error)[:300]} ({where.filename}, line {where.lineno})"]
        found += unwhole(Path())
        (folder / "faults.json").write_text(json.dumps(found))
        status = 0
    finally:
        os._exit(status)
