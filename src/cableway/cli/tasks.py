"""`cableway tasks`: the catalogue, or random tasks written to files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from rich.text import Text

from cableway.cli.interrupts import INTERRUPTS
from cableway.cli.options import LARGEST_SEED, Flag, Maybe, PictureOptions, option
from cableway.cli.planning import CELL_NAMES
from cableway.cli.terminal import Terminal, columns
from cableway.core.errors import InputError
from cableway.core.quantities import limit_text

if TYPE_CHECKING:
    from cableway.scene.spatial.task import SpatialTask
    from cableway.scene.task import Task

PICTURE = "tasks.png"


@dataclass(frozen=True, kw_only=True)
class Tasks(PictureOptions):
    """List the tasks of the catalogue; or, with --random, write random tasks to YAML files and draw them."""

    out: Maybe[Path] = None
    """Folder for random tasks, by default runs/<kind>; and for the catalogue as report.json, by default not written."""

    random: Annotated[str | None, option(metavar="KIND")] = None
    """Write random tasks of this kind, blocked, cell, cell-clutter, cell-dense, clutter, corridor, dense, maze,
    open-far, open-near, posts, s-shaped, serpentine, sizes, slot, straight or table; or in space, extruded, lift,
    space-clutter, space-dense, window or yu. By default, the catalogue is listed."""

    count: int = 1
    """Number of random tasks, with seeds from --seed on."""

    width: Maybe[float] = None
    """Width of their passages [m], for kinds that have passages; by default, that of the kind."""

    body: Maybe[str] = None
    """What their grippers take up beyond balls, for kinds in space: 2f-85, 2f-85-long-fingers or hand-e; by default,
    nothing."""

    cell: Annotated[str | None, option(metavar=CELL_NAMES)] = None
    """Arms that hold their grippers, for kinds in space; by default, grippers alone."""

    picture: Flag = False
    """Also draw the random tasks, in one picture."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.count <= 10**6:
            raise InputError(f"--count must be from 1 to 1000000, got {self.count}")
        if (self.seed or 0) + self.count - 1 > LARGEST_SEED:
            raise InputError(f"--seed and --count exceed the largest seed {LARGEST_SEED}")
        if self.random is None and (self.count != 1 or self.width or self.body or self.cell or self.picture):
            raise InputError("--count, --width, --body, --cell and --picture need --random")
        if self.vector is not None and not self.picture:
            raise InputError("--vector needs --picture")

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        return self._catalogue() if self.random is None else self._random(self.random)

    def _catalogue(self) -> int:
        from cableway.scene.files.loading import load_planar_task, task_names

        tasks = [load_planar_task(name) for name in task_names()]
        rows = [_row(task) for task in tasks]
        self.keep("tasks", {"tasks": rows})
        Terminal(self).result({"tasks": rows}, _table(tasks))
        return 0

    def _random(self, kind: str) -> int:
        from cableway.core.files import only_writer
        from cableway.scene.files.saving import save_task
        from cableway.tasks.space.generation import SPATIAL_KINDS, random_any_task

        terminal, folder, tasks, rows = Terminal(self), self.folder(kind), [], []
        INTERRUPTS.kept = lambda: f"{len(tasks)} of {self.count} tasks are in {folder}" if tasks else ""
        with only_writer(folder), terminal.progress() as progress:
            for k in range(self.count):
                task = random_any_task((self.seed or 0) + k, kind, width=self.width, body=self.body, cell=self.cell)
                path = folder / f"{task.name}.yaml"
                save_task(task, path)
                tasks.append(task)
                rows.append({**_row(task), "file": str(path)})
                progress("tasks", (k + 1) / self.count)
            if self.picture:
                from cableway.figures.scene import tasks_figure
                from cableway.figures.space import spatial_tasks_figure

                figure = spatial_tasks_figure if kind in SPATIAL_KINDS else tasks_figure
                self.draw(figure(tasks), folder / PICTURE)
        terminal.note(f"in {folder}")
        terminal.result({"tasks": rows}, _table(tasks))
        return 0


def _row(task: Task | SpatialTask) -> dict[str, Any]:
    return {
        "name": task.name,
        "description": task.description,
        "cable_length": task.cable.length,
        "cable_radius": task.cable.radius,
        "obstacles": len(task.scene.obstacles),
        "workspace": list(task.scene.size),
    }


def _table(tasks: Sequence[Task | SpatialTask]) -> Any:
    table = columns("task", "cable", "obstacles", "description")
    for task in tasks:
        cable = f"{limit_text(task.cable.length)}, {limit_text(2 * task.cable.radius)}"
        table.add_row(Text(task.name), cable, str(len(task.scene.obstacles)), Text(task.description))
    return table
