"""Every command, interrupted at a random moment by SIGINT (ctrl-c, all its processes) or SIGTERM (the command alone).

Wrong is a status other than 130 or 143, a traceback, a file that is not whole, an end later than five seconds after the
signal. A signal during the first moments of the interpreter itself, before any line of cableway, ends it as any Python.
"""

from __future__ import annotations

import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from cableway.core.errors import InputError
from cableway.core.reading import read_arrays, read_json
from cableway.scene.files.document import read_document

PATIENCE = 5.0
"""[s] between a signal and the end of the command."""

LONGEST = 60.0
"""[s] after which a signal comes at the latest."""

COMMANDS = {
    "tasks": "tasks --random maze --count 20 --picture",
    "list": "tasks",
    "show": "show real-maze",
    "plan": "plan multi-obstacle-1 --alternatives 2",
    "run": "run single-obstacle-2",
    "check": "check {task} {plan}",
    "export": "export {plan} --task {task} --rate 100",
    "collect": "collect --transitions 3000 --workers 2",
    "train": "train --data {data} --config {config}",
    "evaluate": "evaluate conv --data {data}",
    "models": "models",
    "bench": "bench paper,clutter --workers 2",
    "reproduce": "reproduce --workers 2",
}
"""Command lines; what stands in braces is made beforehand."""


ENDS = {".png": b"IEND\xaeB`\x82", ".csv": b"\n", ".html": b"</html>\n"}
"""Last bytes of files that are whole."""


def interrupted(rng: random.Random, name: str, line: str, most: float) -> str:
    """What was wrong after one interrupt, "" for nothing."""
    number, after = rng.choice([signal.SIGINT, signal.SIGINT, signal.SIGTERM]), rng.uniform(0.05, most)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        target = out / "trajectory.csv" if name == "export" else out
        command = [str(Path(sys.executable).with_name("cableway")), *line.split(), "--out", str(target)]
        process = subprocess.Popen(
            command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        time.sleep(after)
        begun, ended = _is_begun(process.pid), process.poll() is not None
        if not ended:
            os.killpg(process.pid, number) if number == signal.SIGINT else process.send_signal(number)
        sent = time.monotonic()
        try:
            _, said = process.communicate(timeout=4 * PATIENCE)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return f"{name}: {number.name} after {after:.2f} s: not ended after {4 * PATIENCE:g} s"
        late = time.monotonic() - sent
        faults = list(_faults(process.returncode, said, number, begun=begun, ended=ended, late=late))
        faults += [f"{path.relative_to(out)}: {fault}" for path, fault in _damaged(out)]
    return f"{name}: {number.name} after {after:.2f} s: {'; '.join(faults)}" if faults else ""


def _is_begun(process: int) -> bool:
    """Whether the interpreter has come as far as cableway: it has loaded what `signal` is in, and more."""
    try:
        return "SigCgt" in Path(f"/proc/{process}/status").read_text() and _catches(process, signal.SIGTERM)
    except (OSError, ValueError):
        return True


def _catches(process: int, number: signal.Signals) -> bool:
    """Whether a process has a handler of its own for a signal."""
    caught = re.search(r"SigCgt:\s*([0-9a-f]+)", Path(f"/proc/{process}/status").read_text())
    return caught is not None and bool(int(caught[1], 16) >> (number - 1) & 1)


def _faults(status: int, said: str, number: signal.Signals, *, begun: bool, ended: bool, late: float) -> Iterator[str]:
    natural = (0, 1) if ended or "interrupted" not in said + "terminated" else ()
    if late > PATIENCE:
        yield f"ended {late:.1f} s later"
    if not begun:
        return
    if "Traceback" in said:
        yield f"a traceback: {said[-600:]!r}"
    if status not in (128 + number, *natural):
        yield f"status {status}: {said[-300:]!r}"
    elif status == 128 + number and not re.search(r"cableway: (interrupted|terminated)", said):
        yield f"no sentence: {said[-300:]!r}"


def _damaged(folder: Path) -> Iterator[tuple[Path, str]]:
    """Files that are not whole."""
    for path in folder.rglob("*"):
        content = path.read_bytes() if path.is_file() else b""
        try:
            if re.search(r"^\..*\.[0-9a-f]{12}$", path.name):
                yield path, "left over"
            elif path.suffix == ".npz":
                read_arrays(path)
            elif path.suffix == ".json":
                read_json(path)
            elif path.suffix == ".yaml":
                read_document(path)
            elif (path.suffix == ".png" and content[-8:-4] != b"IEND") or (
                path.suffix == ".csv" and content[-1:] != b"\n"
            ):
                yield path, "cut off"
        except InputError as error:
            yield path, str(error)


def prepared(folder: Path) -> dict[str, str]:
    """A plan, a data set and a training configuration to interrupt commands on."""
    tool = str(Path(sys.executable).with_name("cableway"))

    def made(line: str) -> None:
        subprocess.run([tool, *line.split(), "--quiet"], check=True, cwd=folder)

    made("plan single-obstacle-2 --out plan")
    made("collect --transitions 2000 --workers 2 --out data")
    config = folder / "config.yaml"
    config.write_text("cableway: 1\nmodel:\n  kind: mlp\ntraining:\n  epochs: 400\n  rollout_epochs: 0\n")
    return {
        "task": str(folder / "plan/task.yaml"), "plan": str(folder / "plan/plan.npz"), "data": str(folder / "data"),
        "config": str(config),
    }  # fmt: skip


def attack(seed: int, count: int, only: str = "") -> list[str]:
    """What was wrong in `count` interrupts of the commands by turns."""
    rng, found = random.Random(seed), []
    with tempfile.TemporaryDirectory() as folder:
        made = prepared(Path(folder))
        lines = {name: line.format(**made) for name, line in COMMANDS.items() if not only or name in only.split(",")}
        lasts = {name: _duration(name, line, Path(folder)) for name, line in lines.items()}
        for turn in range(count):
            name = list(lines)[turn % len(lines)]
            most = lasts[name] if turn % 2 else min(lasts[name], 2.5)
            if fault := interrupted(rng, name, lines[name], most):
                found.append(fault)
                print(fault, flush=True)
    return found


def _duration(name: str, line: str, folder: Path) -> float:
    """[s] that a command takes here and now, at most `LONGEST`."""
    target = folder / "timed" / name / ("x.csv" if name == "export" else "")
    command = [str(Path(sys.executable).with_name("cableway")), *line.split(), "--out", str(target)]
    begun = time.monotonic()
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True) as one:
        try:
            one.wait(LONGEST)
        except subprocess.TimeoutExpired:
            os.killpg(one.pid, signal.SIGKILL)
    return time.monotonic() - begun


if __name__ == "__main__":
    wrong = attack(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3] if len(sys.argv) > 3 else "")
    print(f"{len(wrong)} of {sys.argv[2]} interrupts wrong")
