"""`cableway check`: check a plan or rollout file independently."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.text import Text

from cableway.cli.options import Maybe, TaskOptions, option
from cableway.cli.terminal import Terminal, columns

if TYPE_CHECKING:
    from rich.table import Table

    from cableway.records import Verdict


@dataclass(frozen=True, kw_only=True)
class Check(TaskOptions):
    """Check a plan.npz or rollout.npz independently of the code that made it; or what both ends of a task in space
    keep."""

    out: Maybe[Path] = None
    """Folder for report.json; by default, none is written."""

    file: Annotated[tyro.conf.Positional[Path | None], option(metavar="[FILE]")] = None
    """A plan.npz or rollout.npz; its arrays show which. Without one, the task itself is checked, which must be in
    space."""

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        from cableway.core.errors import InputError
        from cableway.verification import kind_of, verify_record
        from cableway.workflow.reading import read_record

        if self.file is None:
            return self._check_ends()
        task, record = self.load(), read_record(self.file)
        try:
            verdict = verify_record(record, task)
        except InputError as error:
            raise InputError(f"{self.file}: {error}") from None
        report = {
            "task": task.name,
            "file": str(self.file),
            "kind": kind_of(record),
            "passed": verdict.passed,
            "checks": verdict.as_dict(),
        }
        self.keep("check", report)
        Terminal(self).result(report, _table(verdict))
        return 0 if verdict.passed else 1

    def _check_ends(self) -> int:
        from cableway.core.errors import InputError
        from cableway.scene.spatial.task import SpatialTask
        from cableway.scene.task import ENDS

        task = self.load_any()
        if not isinstance(task, SpatialTask):
            raise InputError(f"check needs FILE, a plan.npz or rollout.npz of the task {task.name!r}")
        kept = {end: task.kept(end) for end in ENDS}
        report = {"task": task.name, "kind": "task", "passed": True, **kept}
        self.keep("check", report)
        Terminal(self).result(report, _ends_table(kept))
        return 0


def _ends_table(kept: Mapping[str, Mapping[str, float]]) -> Table:
    from cableway.core.quantities import quantity

    table = columns("", "cable clearance", "gripper clearance", "stability", "twist", "grippers apart")
    for end, each in kept.items():
        table.add_row(
            Text(end),
            quantity(each["cable_clearance"]),
            quantity(each["gripper_clearance"]),
            f"{each['stability']:.3g}",
            quantity(each["twist"], "rad"),
            quantity(each["span"]),
        )
    return table


def _table(verdict: Verdict) -> Table:
    from cableway.core.quantities import limit_text, quantity, told_apart

    table = columns("", "check", "value", "limit", "where")
    for check in verdict.checks:
        table.add_row(
            "[green]pass[/green]" if check.passed else "[red]FAIL[/red]",
            Text(check.name),
            quantity(check.value, check.unit) if check.passed else told_apart(check.value, check.limit, check.unit),
            limit_text(check.limit, check.unit),
            Text(check.place),
        )
    return table
