"""`cableway show`: the picture of a task."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro
from rich.text import Text

from cableway.cli.options import Options
from cableway.cli.terminal import Terminal


@dataclass(frozen=True, kw_only=True)
class Show(Options):
    """Draw a task; `--out` is a folder or a file ending in .png."""

    task: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="TASK")]
    """Name in the catalogue, or a YAML file."""

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        from cableway.figures.scene import task_figure
        from cableway.figures.style import save_figure
        from cableway.scene.files.loading import load_task

        task = load_task(self.task)
        path = self.target(task.name, "task.png")
        save_figure(task_figure(task), path)
        Terminal(self).result({"task": task.name, "picture": str(path)}, Text(str(path)))
        return 0
