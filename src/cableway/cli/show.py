"""`cableway show`: the picture of a task."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rich.text import Text

from cableway.cli.options import VECTOR, PictureOptions, TaskOptions
from cableway.cli.terminal import Terminal
from cableway.core.errors import InputError, TaskError


@dataclass(frozen=True, kw_only=True)
class Show(PictureOptions, TaskOptions):
    """Draw a task, also one that no cable can do, with what is wrong with it; `--out` is a folder, or a .png, .svg or
    .pdf file."""

    def execute(self) -> int:
        """Carry the command out and return its exit status.

        Raises:
            InputError: No cable can do the task; where there is something to draw, the message names the picture.
        """
        from cableway.figures.scene import task_figure
        from cableway.scene.files.loading import load_task
        from cableway.scene.task import Draft

        try:
            task = load_task(self.task)
        except TaskError as error:
            if not isinstance(error.draft, Draft):
                raise
            path = self._target(error.draft.name)
            self.draw(task_figure(error.draft, error.faults), path)
            more = len(error.faults) - 1
            others = f" (and {more} more fault{'s' if more > 1 else ''})" if more else ""
            raise InputError(f"{error}{others}; drawn in {path}") from None
        path = self._target(task.name)
        self.draw(task_figure(task), path)
        Terminal(self).result({"task": task.name, "picture": str(path)}, Text(str(path)))
        return 0

    def _target(self, name: str) -> Path:
        return self.target(name, "task.png", *(f".{ending}" for ending in VECTOR))
