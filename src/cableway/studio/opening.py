"""What a page opens: a task, or the plan or rollout of one."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError
from cableway.core.quantities import quantity
from cableway.records import Plan, Rollout
from cableway.scene.files.loading import AnyDraft, AnyTask, as_any_draft, load_cell, load_task
from cableway.scene.spatial.task import SpatialTask
from cableway.workflow.reading import read_record

TASK, PLAN = "task.yaml", "plan.npz"
"""Files of a folder of results: the task and the best plan."""

ELSEWHERE = 0.02
"""Distance [m] of a keypoint at the start or the goal of a plan beyond which it is that of another task."""


class Opened(NamedTuple):
    """What there was.

    Attributes:
        draft: The task.
        name: Of the file of plan or rollout; "" where there is none.
        plan: Of the task, if one was opened, or lies beside a rollout.
        rollout: Of the task, if one was opened.
    """

    draft: AnyDraft
    name: str = ""
    plan: Plan | None = None
    rollout: Rollout | None = None


def opened(source: Any, cell: str | None = None) -> Opened:
    """A task, its name or file, or the file (.npz) of a plan or a rollout with that of its task beside it.

    Args:
        source: What is opened.
        cell: Name or file of a cell that the task is put into, whether or not its arms can hold it.

    Raises:
        InputError: There is no such task, its values make none, or the record is not of it.
        FileFormatError: The file is neither a plan nor a rollout.
    """
    if cell is not None:
        found = opened(source)
        if found.name:
            raise InputError(f"a cell is for a task, not for {source}")
        return Opened(found.draft.in_cell(load_cell(cell)))
    if isinstance(source, Opened):
        return source
    if not (isinstance(source, str | Path) and str(source).lower().endswith(".npz")):
        return Opened(as_any_draft(source).unchecked())
    path = Path(source)
    record, beside = read_record(path), path.with_name(TASK)
    if not beside.is_file():
        raise InputError(f"{path}: the task of it is to lie beside it, as {TASK}")
    task = load_task(beside)
    start, goal = _ends(task)
    shapes = record.shapes if isinstance(record, Plan) else record.reference
    if shapes.shape[2:] != start.shape[1:]:
        raise InputError(f"{path}: is {'not ' * (shapes.shape[2] < 3)}in space, unlike {task.name}")
    if shapes.shape[1:] != start.shape:
        raise InputError(f"{path}: has {shapes.shape[1]} keypoints, not {len(start)} as {task.name}")
    off = max(float(np.abs(shapes[0] - start).max()), float(np.abs(shapes[-1] - goal).max()))
    if isinstance(record, Plan):
        if off > ELSEWHERE:
            raise InputError(f"{path}: begins or ends {quantity(off)} from where {task.name} does, of which it is not")
        return Opened(task.unchecked(), path.name, record)
    plan = path.with_name(PLAN)
    return Opened(task.unchecked(), path.name, Plan.load(plan) if plan.is_file() else None, record)


def _ends(task: AnyTask) -> tuple[Float[np.ndarray, "n space"], Float[np.ndarray, "n space"]]:
    """Keypoints [m] at start and goal."""
    return (
        (task.keypoints("start"), task.keypoints("goal")) if isinstance(task, SpatialTask) else (task.start, task.goal)
    )
