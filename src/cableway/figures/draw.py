"""One call for the picture of whatever there is of a task."""

from __future__ import annotations

import os
from pathlib import Path

from matplotlib.figure import Figure

from cableway.core.checks import shown
from cableway.core.errors import InputError
from cableway.figures.insertion import insertion_figure
from cableway.figures.plan import attempt_figure, plan_figure
from cableway.figures.rollout import rollout_figure
from cableway.figures.scene import task_figure
from cableway.figures.space import spatial_task_figure
from cableway.figures.style import save_figure
from cableway.records import INSERTION, Attempt, Plan, Rollout
from cableway.scene.files.loading import TaskSource, as_task, load_task
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.task import Task


def draw(
    task: TaskSource | SpatialTask,
    record: Plan | Rollout | Attempt | None = None,
    *,
    path: Path | str | None = None,
) -> Figure:
    """Draw a task, or what came of it: the pictures that the commands leave.

    Args:
        task: The task, or its name or file.
        record: A plan, a rollout, also of an insertion, or the `attempt` of a `PlanningError`; None for the task alone.
        path: A file that the picture is written to, too: PNG, SVG or PDF by its ending.

    Raises:
        InputError: There is no such task, the record is none of these, or the file has another ending.
    """
    task = load_task(task) if isinstance(task, str | os.PathLike) else task
    if isinstance(task, SpatialTask) and record is None:
        figure = spatial_task_figure(task)
    else:
        figure = _figure(as_task(task), record)
    if path is not None:
        save_figure(figure, Path(path))
    return figure


def _figure(task: Task, record: Plan | Rollout | Attempt | None) -> Figure:
    match record:
        case None:
            return task_figure(task)
        case Plan():
            return plan_figure(task, record)
        case Rollout():
            inserts = record.metadata.get("part") == INSERTION
            return (insertion_figure if inserts else rollout_figure)(task, record)
        case Attempt():
            return attempt_figure(task, record)
    raise InputError(f"what is drawn of a task must be a Plan, a Rollout or an Attempt, got {shown(record)}")
