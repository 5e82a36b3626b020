"""`cableway export`: a plan or a rollout as gripper poses by time, in a file that any program reads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from cableway.cli.check import read_record
from cableway.cli.options import Flag, Maybe, Options
from cableway.cli.outputs import TASK
from cableway.cli.terminal import Terminal, pairs
from cableway.core.errors import InputError
from cableway.core.quantities import limit_text, quantity

if TYPE_CHECKING:
    from cableway.scene.task import Task
    from cableway.workflow.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class Export(Options):
    """Write a plan or a rollout as gripper poses by time, CSV or JSON, for robots; a header says frame and units."""

    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE")]
    """A plan.npz or rollout.npz."""

    out: Maybe[Path] = None
    """A file ending in .csv or .json; by default, runs/export/<task>-<name of FILE>.csv."""

    task: Maybe[str] = None
    """The task that it is of; by default, the task.yaml beside it."""

    rate: Maybe[float] = None
    """Rows per second on a smooth curve that keeps the limits of the rows; by default, its rows as they are."""

    cable: Flag = False
    """The keypoints of the cable, too."""

    unverified: Flag = False
    """Export it even if it does not verify; the header says so."""

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        from cableway.workflow.trajectory import Trajectory

        record, task = read_record(self.file), self._load()
        trajectory = Trajectory.of(
            record, task, rate=self.rate, cable=self.cable, unverified=self.unverified, source=str(self.file)
        )
        path = self.out or self.folder("export") / f"{task.name}-{self.file.stem}.csv"
        trajectory.write(path)
        report = {"file": str(path), "rows": len(trajectory.times), "header": trajectory.header}
        Terminal(self).result(report, pairs(_rows(trajectory, path)))
        return 0

    def _load(self) -> Task:
        from cableway.scene.files.loading import load_task

        beside = self.file.with_name(TASK)
        if self.task is None and not beside.is_file():
            raise InputError(f"{beside}: no such file; --task must say what {self.file} is of")
        return load_task(self.task or beside)


def _rows(trajectory: Trajectory, path: Path) -> list[tuple[str, str]]:
    """Names and values as text with units."""
    header = trajectory.header
    reached, limits, off = header["reached"], header["limits"], header["off_rows"]
    units = dict(zip(limits, ("m/s", "rad/s", "m/s²", "rad/s²", "m/s³", "rad/s³"), strict=True))
    rows = [
        ("file", str(path)),
        ("task", header["task"]),
        ("rows", f"{len(trajectory.times)} in {header['duration']:.2f} s"),
        ("verified", header["verified"]),
        ("off the rows", f"at most {quantity(off['distance'])}, {quantity(off['turn'], 'rad')}"),
    ]
    for name, unit in units.items():
        limit = "none" if limits[name] is None else limit_text(limits[name], unit)
        rows.append((name.replace("_", " "), f"{quantity(reached[name], unit)}, limit {limit}"))
    return [*rows, ("use", header["use"])]
