"""`cableway show`: the picture of a task."""

from __future__ import annotations

from dataclasses import dataclass

from rich.text import Text

from cableway.cli.options import TaskOptions
from cableway.cli.terminal import Terminal


@dataclass(frozen=True, kw_only=True)
class Show(TaskOptions):
    """Draw a task; `--out` is a folder or a file ending in .png."""

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        from cableway.figures.scene import task_figure
        from cableway.figures.style import save_figure

        task = self.load()
        path = self.target(task.name, "task.png")
        save_figure(task_figure(task), path)
        Terminal(self).result({"task": task.name, "picture": str(path)}, Text(str(path)))
        return 0
