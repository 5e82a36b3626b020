"""`cableway check`: check a plan or rollout file independently."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.text import Text

from cableway.cli.options import TaskOptions
from cableway.cli.terminal import Terminal, columns

if TYPE_CHECKING:
    from rich.table import Table

    from cableway.records import Verdict
    from cableway.scene.task import Task


@dataclass(frozen=True, kw_only=True)
class Check(TaskOptions):
    """Check a plan.npz or rollout.npz independently of the code that made it."""

    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE")]
    """A plan.npz or rollout.npz; its arrays show which."""

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        task = self.load()
        kind, verdict = _judge(task, self.file)
        report = {
            "task": task.name,
            "file": str(self.file),
            "kind": kind,
            "passed": verdict.passed,
            "checks": verdict.as_dict(),
        }
        self.keep("check", report)
        Terminal(self).result(report, _table(verdict))
        return 0 if verdict.passed else 1


def _judge(task: Task, file: Path) -> tuple[str, Verdict]:
    """The kind of a file and what is to be said of it.

    Raises:
        FileFormatError: It is neither a plan nor a rollout.
        InputError: It belongs to a task with another number of keypoints, or states a length that is none.
    """
    from cableway.core.errors import FileFormatError, InputError
    from cableway.core.files import read_arrays
    from cableway.records import INSERTION, Plan, Rollout
    from cableway.verification import plant_length, verify_insertion, verify_insertion_plan, verify_plan, verify_rollout

    arrays = read_arrays(file)
    if "centreline" in arrays:
        rollout = Rollout.from_arrays(arrays, str(file))
        inserting = rollout.metadata.get("part") == INSERTION
        judge = verify_insertion if inserting else verify_rollout
        try:
            verdict = judge(rollout, task, length=plant_length(rollout, task))
        except InputError as error:
            raise InputError(f"{file}: {error}") from None
        return "insertion" if inserting else "rollout", verdict
    if "shapes" in arrays:
        plan = Plan.from_arrays(arrays, str(file))
        inserting = plan.metadata.get("part") == INSERTION
        return ("insertion plan", verify_insertion_plan(plan, task)) if inserting else ("plan", verify_plan(plan, task))
    raise FileFormatError(
        f"{file}: neither a plan (it would have an array 'shapes') nor a rollout ('centreline'); "
        f"it has {', '.join(sorted(arrays)) or 'nothing'}"
    )


def _table(verdict: Verdict) -> Table:
    table = columns("", "check", "value", "limit", "where")
    for check in verdict.checks:
        scale, unit = (1000.0, "mm") if check.unit == "m" else (1.0, check.unit)
        table.add_row(
            "[green]pass[/green]" if check.passed else "[red]FAIL[/red]",
            Text(check.name),
            f"{scale * check.value:.4g} {unit}".rstrip(),
            f"{scale * check.limit:.4g} {unit}".rstrip(),
            Text(check.where),
        )
    return table
