"""A page that plays a plan or a run by itself: one HTML file, without a server and without a network."""

from __future__ import annotations

import json
import math
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from markupsafe import Markup

from cableway.core.errors import InputError
from cableway.core.templates import render
from cableway.figures import palette
from cableway.geometry import polyline
from cableway.records import Plan, Rollout
from cableway.scene.clearance import PIECES
from cableway.scene.files.loading import AnyTask
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.task import CONTROL_STEP, Task
from cableway.studio.spatial_film import film_in_space
from cableway.workflow.run import Run

if TYPE_CHECKING:
    from cableway.studio.running import Running

TEMPLATE, TABLE, SPACE = "film.html.jinja", "film_table.js.jinja", "film_space.js.jinja"
"""The page, and what draws on the table and in space."""

DECIMALS = 4
"""Of a metre: a tenth of a millimetre is less than a page shows."""

COLORS = {
    "ink": palette.INK, "muted": palette.MUTED, "obstacle": palette.OBSTACLE, "edge": palette.OBSTACLE_EDGE,
    "start": palette.START, "goal": palette.GOAL, "left": palette.LEFT, "right": palette.RIGHT,
    "reference": palette.REFERENCE, "green": palette.GREEN,
}  # fmt: skip


def film_page(task: AnyTask, record: Plan | Rollout, sentence: str = "") -> str:
    """An HTML page that plays a plan or a rollout of a task.

    Args:
        task: The task, on the table or in space.
        record: What is played.
        sentence: Said below the task's name; what the record is where "".
    """
    in_space = isinstance(task, SpatialTask)
    film = film_in_space(task, record) if isinstance(task, SpatialTask) else _on_table(task, record)
    times = record.times if isinstance(record, Rollout) else CONTROL_STEP * np.arange(record.steps + 1)
    film["times"] = times.round(3).tolist()
    return render(
        TEMPLATE, "cableway.studio", title=task.name, sentence=sentence or repr(record), last=len(times) - 1,
        in_space=in_space, drawing=SPACE if in_space else TABLE, reference="reference" in film, colors=COLORS,
        palette=Markup(_script(COLORS)), data=Markup(_script(film)),
    )  # fmt: skip


def film_video(running: Running) -> bytes:
    """A video (MP4) of a run.

    Raises:
        InputError: Nothing of it is recorded yet.
    """
    from cableway.figures.video import write_video  # here, since Matplotlib takes half a second

    if running.rollout is None:
        raise InputError("the run is not over yet: a video is made of what is recorded")
    insertion = running.run.insertion if isinstance(running.run, Run) else None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rollout.mp4"
        write_video(path, running.task, running.rollout, insertion, plan=running.plan)
        return path.read_bytes()


def _on_table(task: Task, record: Plan | Rollout) -> dict[str, Any]:
    """What `film_table.js.jinja` draws."""
    return {
        "size": list(task.scene.size),
        "obstacles": [{"points": _points(each.vertices), "radius": each.rounding} for each in task.scene.obstacles],
        "port": None if task.port_walls is None else _points(task.port_walls),
        "radius": task.cable.radius,
        "gripper": task.grippers.radius,
        "start": _points(polyline.spline(task.start, PIECES)),
        "goal": _points(polyline.spline(task.goal, PIECES)),
        "ways": [_points(record.poses[:, side, :2]) for side in (0, 1)],
        **(_of_rollout(record) if isinstance(record, Rollout) else _of_plan(task, record)),
    }


def _of_plan(task: Task, plan: Plan) -> dict[str, Any]:
    lines = polyline.spline(plan.shapes, PIECES)
    return {
        "cables": [_points(line) for line in lines],
        "clearance": task.scene.clearance(lines, task.cable.radius).round(6).tolist(),
    }


def _of_rollout(rollout: Rollout) -> dict[str, Any]:
    return {
        "cables": [_points(line) for line in rollout.centreline],
        "reference": [_points(line) for line in polyline.spline(rollout.reference, PIECES)],
        "seen": [[_seen(point) for point in row] for row in rollout.observed],
        "clearance": rollout.clearance.round(6).tolist(),
    }


def _points(line: Float[np.ndarray, "k 2"]) -> list[list[float]]:
    return line.round(DECIMALS).tolist()


def _seen(point: Float[np.ndarray, "2"]) -> list[float] | None:
    return None if math.isnan(point[0]) else point.round(DECIMALS).tolist()


def _script(value: Any) -> str:
    """JSON that ends no script element."""
    return json.dumps(value, allow_nan=False).replace("<", "\\u003c")
