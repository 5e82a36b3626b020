"""The command lines that are interrupted, starved and crowded, and what must hold of the files that they leave."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cableway.core.errors import InputError
from cableway.core.reading import read_arrays, read_json
from cableway.scene.files.document import read_document

CABLEWAY = str(Path(sys.executable).with_name("cableway"))

LINES = {
    "tasks": "--random maze --count 20 --picture",
    "list": "",
    "show": "real-maze",
    "plan": "multi-obstacle-1 --alternatives 2",
    "run": "single-obstacle-2",
    "table": "single-obstacle-2 --plant {table}",
    "check": "{task} {plan}",
    "export": "{plan} --task {task} --rate 100",
    "collect": "--transitions 3000 --workers 2",
    "train": "--data {data} --config {config}",
    "evaluate": "conv --data {data}",
    "models": "",
    "bench": "paper --methods open-loop --workers 2 --episodes single-obstacle-1,single-obstacle-2,insertion",
    "reproduce": "--workers 2",
}
"""What follows the command's name; what stands in braces is made by `prepared`."""

ALSO = {"list": "tasks", "table": "run"}
"""Commands that come twice."""

RESUMED = ("collect", "train", "bench")
"""Those that go on where they were interrupted, and end within a minute."""

KEPT = {
    "collect": "manifest.json", "train": "*.state", "bench": "episodes/**/*.json", "reproduce": "episodes/**/*.json",
    "tasks": "*.yaml", "plan": "report.json", "run": "report.json", "table": "report.json",
}  # fmt: skip
"""Files by which to see that a command that was interrupted has kept something, which it must say then."""

WHOLE = {".png": b"IEND\xaeB`\x82", ".csv": b"\n", ".html": b"</html>", ".md": b"\n", ".yaml": b"\n"}
"""Last bytes of files that are whole."""


@dataclass(frozen=True)
class Line:
    """One command line.

    Attributes:
        name: As in `LINES`.
        words: Of the command line, but for where results go.
    """

    name: str
    words: tuple[str, ...]

    def to(self, out: Path, *more: str) -> list[str]:
        """The command line with its results in `out`."""
        target = out / "trajectory.csv" if self.name == "export" else out
        return [CABLEWAY, *self.words, "--out", str(target), *more]


def prepared(folder: Path, names: str = "") -> list[Line]:
    """The lines of these names, all where there are none, with a plan, a data set and files made for them."""
    for line in ("plan single-obstacle-2 --out plan", "collect --transitions 2000 --workers 2 --out data"):
        subprocess.run([CABLEWAY, *line.split(), "--quiet"], check=True, cwd=folder)
    config, table = folder / "config.yaml", folder / "table.yaml"
    config.write_text("cableway: 1\nmodel:\n  kind: mlp\ntraining:\n  epochs: 150\n  rollout_epochs: 0\n")
    table.write_text("cableway: 1\ntable: {}\n")
    made = {"task": folder / "plan/task.yaml", "plan": folder / "plan/plan.npz", "data": folder / "data"}
    made |= {"config": config, "table": table}
    chosen = names.split(",") if names else LINES
    return [Line(name, (ALSO.get(name, name), *LINES[name].format(**made).split())) for name in chosen]


def damaged(folder: Path) -> Iterator[str]:
    """Files below a folder that are not whole, or should have gone."""
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder)
        if path.name.startswith("."):
            yield f"{name} is left over"
        elif path.is_file() and (fault := _fault(path)):
            yield f"{name} is not whole: {fault}"


def _fault(path: Path) -> str:
    try:
        match path.suffix:
            case ".npz":
                read_arrays(path)
            case ".json":
                read_json(path)
            case ".yaml":
                read_document(path)
    except InputError as error:
        return str(error)
    return "" if path.read_bytes().endswith(WHOLE.get(path.suffix, b"")) else "its end is missing"


def said_wrong(said: str, *, quiet: bool, most: int = 1) -> Iterator[str]:
    """What is wrong with what a command said on stderr; with `--quiet` nothing but a sentence of ours may come."""
    lines = said.splitlines()
    ours = [line for line in lines if line.startswith("cableway: ")]
    if re.search(r"^(Traceback|Exception ignored|Fatal Python error)|Error: |^Process |leaked", said, re.MULTILINE):
        yield f"a traceback or warning: {said[-700:]!r}"
    elif len(ours) > most:
        yield f"{len(ours)} sentences: {said[-500:]!r}"
    elif quiet and len(lines) > len(ours):
        yield f"not ours: {said[-500:]!r}"
