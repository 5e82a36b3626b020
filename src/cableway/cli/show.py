"""`cableway show`: the picture of a task, of the arms in a plan or a rollout, or of either in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.text import Text

from cableway.cli.options import VECTOR, PictureOptions, TaskOptions, option
from cableway.cli.outputs import CELL_PICTURE, PLAN_PICTURE, ROLLOUT_PICTURE
from cableway.cli.terminal import Terminal
from cableway.core.errors import InputError, TaskError

if TYPE_CHECKING:
    from cableway.figures.style import Figure
    from cableway.records import Plan, Rollout
    from cableway.scene.spatial.task import SpatialDraft, SpatialTask
    from cableway.scene.task import Draft, Task


@dataclass(frozen=True, kw_only=True)
class Show(PictureOptions, TaskOptions):
    """Draw a task, also one that no cable can do, with what is wrong with it; `--out` is a folder, or a .png, .svg or
    .pdf file."""

    file: Annotated[tyro.conf.Positional[Path | None], option(metavar="[FILE]")] = None
    """A plan.npz or rollout.npz of the task in a cell, whose arms are drawn, in perspective and from above; or of a
    task in space. By default, the task."""

    def execute(self) -> int:
        """Carry the command out and return its exit status.

        Raises:
            InputError: No cable can do the task; where there is something to draw, the message names the picture. Or
                the file has no joints of arms.
        """
        if self.file is not None:
            return self._show_record(self.file)
        from cableway.scene.files.loading import load_task
        from cableway.scene.spatial.task import SpatialDraft
        from cableway.scene.task import Draft

        try:
            task = load_task(self.task)
        except TaskError as error:
            if not isinstance(error.draft, Draft | SpatialDraft):
                raise
            path = self._target(error.draft.name)
            self.draw(_figure(error.draft, error.faults), path)
            more = len(error.faults) - 1
            others = f" (and {more} more fault{'s' if more > 1 else ''})" if more else ""
            raise InputError(f"{error}{others}; drawn in {path}") from None
        path = self._target(task.name)
        self.draw(_figure(task), path)
        Terminal(self).result({"task": task.name, "picture": str(path)}, Text(str(path)))
        return 0

    def _show_record(self, file: Path) -> int:
        from cableway.scene.spatial.task import SpatialTask
        from cableway.workflow.reading import read_record

        task, record = self.load_any(), read_record(file)
        try:
            if isinstance(task, SpatialTask):
                figure, picture = _figure_in_space(task, record)
            else:
                figure, picture = _arms_figure(task, record), CELL_PICTURE
        except InputError as error:
            raise InputError(f"{file}: {error}") from None
        path = self._target(task.name, picture)
        self.draw(figure, path)
        Terminal(self).result({"task": task.name, "picture": str(path)}, Text(str(path)))
        return 0

    def _target(self, name: str, picture: str = "task.png") -> Path:
        return self.target(name, picture, *(f".{ending}" for ending in VECTOR))


def _arms_figure(task: Task, record: Plan | Rollout) -> Figure:
    """The picture of the arms.

    Raises:
        InputError: There are none, or the record is of another task.
    """
    from cableway.figures.cell import cell_figure

    figure = cell_figure(task, record)
    if figure is None:
        lacking = "it has no joints of arms" if task.cell is not None else f"the task {task.name} is in no cell"
        raise InputError(f"{lacking}, and show draws the arms of plans and rollouts alone")
    return figure


def _figure_in_space(task: SpatialTask, record: Plan | Rollout) -> tuple[Figure, str]:
    """The picture of a plan or a rollout, and its usual name.

    Raises:
        InputError: It is of another task.
    """
    from cableway.figures.space import spatial_plan_figure, spatial_rollout_figure
    from cableway.records import Plan

    points = record.shapes if isinstance(record, Plan) else record.keypoints
    wanted = (task.cable.keypoints, 3)
    if points.shape[1:] != wanted:
        raise InputError(f"its keypoints have shape {points.shape[1:]}, those of the task {task.name} {wanted}")
    if isinstance(record, Plan):
        return spatial_plan_figure(task, record), PLAN_PICTURE
    return spatial_rollout_figure(task, record), ROLLOUT_PICTURE


def _figure(task: Draft | SpatialDraft, faults: Sequence[TaskError] = ()) -> Figure:
    """The picture of a task on the table or in space."""
    from cableway.figures.scene import task_figure
    from cableway.figures.space import spatial_task_figure
    from cableway.scene.spatial.task import SpatialDraft

    return spatial_task_figure(task, faults) if isinstance(task, SpatialDraft) else task_figure(task, faults)
