"""How records show themselves in a notebook: a picture and a small table, as HTML that needs nothing else."""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from cableway.core.checks import shown
from cableway.core.errors import InputError, printable
from cableway.core.files import write_bytes
from cableway.core.quantities import limit_text, quantity, size_text
from cableway.figures import palette, scene, style
from cableway.figures.plan import SHAPES_SHOWN, spread_rows
from cableway.figures.scene import task_figure
from cableway.figures.space import spatial_task_figure
from cableway.figures.video import write_video
from cableway.records import Plan, Rollout
from cableway.scene.cable import Cable
from cableway.scene.files.loading import TaskSource, as_task
from cableway.scene.spatial.task import SpatialDraft
from cableway.scene.task import CONTROL_STEP, Draft

Rows = Sequence[tuple[str, str]]

SIDE, AROUND = 2.6, 0.03
"""Longer side [inch] of a picture of shapes without a scene, and what is shown about them [m]."""


@dataclass(frozen=True)
class Animation:
    """A video of a run that plays in a notebook.

    Attributes:
        video: MP4, H.264.
    """

    video: bytes

    def save(self, path: Path | str) -> None:
        """Write it to a file.

        Raises:
            InputError: It does not end in .mp4.
        """
        if Path(path).suffix.lower() != ".mp4":
            raise InputError(f"{path}: a video is written to a file that ends in .mp4")
        write_bytes(Path(path), self.video)

    def _repr_html_(self) -> str:
        source = base64.b64encode(self.video).decode()
        return f'<video controls loop width="640" src="data:video/mp4;base64,{source}"></video>'

    def __repr__(self) -> str:
        return f"Animation({len(self.video) / 1e6:.1f} MB)"


def animation(rollout: Rollout, task: TaskSource, plan: Plan | None = None) -> Animation:
    """The video of a run; see `Rollout.animate`."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rollout.mp4"
        write_video(path, as_task(task), rollout, plan=plan)
        return Animation(path.read_bytes())


def html(record: object) -> str:
    """A task, plan or rollout, as HTML.

    Raises:
        InputError: It is none of these.
    """
    match record:
        case Draft():
            return page(_task_rows(record), task_figure(record, tuple(record.faults())))
        case SpatialDraft():
            return page(_spatial_rows(record), spatial_task_figure(record, tuple(record.faults())))
        case Plan():
            return page(_plan_rows(record), _shapes_figure(record.shapes))
        case Rollout():
            return page(_rollout_rows(record), _shapes_figure(record.keypoints, record.centreline))
    raise InputError(f"what shows itself must be a Task, a Plan or a Rollout, got {shown(record)}")


def page(rows: Rows, figure: Figure | None = None) -> str:
    """A table of names and values, beside a picture where there is one, as HTML."""
    cells = "".join(
        f"<tr><th style='text-align:left'>{escape(printable(name))}</th>"
        f"<td style='text-align:left'>{escape(printable(value))}</td></tr>"
        for name, value in rows
    )
    parts = [f"<table>{cells}</table>"]
    if figure is not None:
        source = base64.b64encode(style.figure_png(figure)).decode()
        parts.insert(0, f"<img alt='' src='data:image/png;base64,{source}' style='max-width:420px'>")
    return f"<div style='display:flex;flex-wrap:wrap;gap:1em;align-items:center'>{''.join(parts)}</div>"


def _task_rows(task: Draft) -> Rows:
    cable, heights = task.cable, [height for height in task.scene.heights[:-1] if height is not None]
    high = f", up to {limit_text(max(heights))} high" if heights else ""
    return [
        ("task", task.name),
        ("workspace", size_text(task.scene.size)),
        ("obstacles", f"{len(task.scene.obstacles)}{high}"),
        (
            "cable",
            f"{limit_text(cable.length)} long, {limit_text(2 * cable.radius)} thick, {cable.keypoints} keypoints",
        ),
        *([("cell", task.cell.name)] if task.cell is not None else []),
        *(("not possible", fault.sentence) for fault in task.faults()),
    ]


def _spatial_rows(task: SpatialDraft) -> Rows:
    cable = task.cable
    return [
        ("task", task.name),
        ("workspace", size_text(task.scene.size)),
        ("obstacles", str(len(task.scene.obstacles))),
        ("cable", f"{limit_text(cable.length)} long, {limit_text(2 * cable.radius)} thick, weight {cable.weight:.3g}"),
        *(("not possible", fault.sentence) for fault in task.faults()),
    ]


def _plan_rows(plan: Plan) -> Rows:
    verdict = plan.verdict
    said = "not verified here" if verdict is None else "passed" if verdict.passed else "failed"
    made = plan.metadata.get("initial_trajectory")
    return [
        ("plan", f"{plan.steps} steps, {plan.steps * CONTROL_STEP:.1f} s"),
        ("checks", said),
        *([("initial trajectory", str(made))] if made else []),
    ]


def _rollout_rows(rollout: Rollout) -> Rows:
    off = float(np.linalg.norm(rollout.keypoints[-1] - rollout.reference[-1]))
    return [
        ("rollout", f"{rollout.steps} steps, {rollout.times[-1] - rollout.times[0]:.1f} s"),
        ("ended", str(rollout.outcome) + (f": {rollout.detail}" if rollout.detail else "")),
        ("from the last reference, stacked", quantity(off)),
        ("largest deviation", quantity(float(rollout.deviations_from_reference.max()))),
        ("least clearance", quantity(rollout.least_clearance)),
    ]


def _shapes_figure(shapes: Float[np.ndarray, "t n 2"], curves: Float[np.ndarray, "t m 2"] | None = None) -> Figure:
    """Shapes coloured by time, without the scene, which a record does not know."""
    low = shapes.min(axis=(0, 1)) - AROUND
    high = shapes.max(axis=(0, 1)) + AROUND
    width, height = SIDE * (high - low) / (high - low).max()
    figure = style.new_figure(scene.LEFT + width + scene.RIGHT, scene.BELOW + height + scene.RIGHT)
    ax = style.add_axes(figure, scene.LEFT, scene.BELOW, width, height)
    scene.frame(ax, low, high)
    rows = spread_rows(shapes, SHAPES_SHOWN)
    lines = scene.smooth(shapes[rows]) if curves is None else curves[rows]
    scene.draw_cables(ax, lines, Cable.radius, style.TIME(rows / max(len(shapes) - 1, 1)))
    for end in (0, -1):
        ax.plot(*shapes[:, end].T, color=palette.INK, linewidth=0.7, alpha=0.7, zorder=5)
    style.legend_below(ax, [Patch(facecolor=style.TIME(0.5), label="cable, coloured by time")], 1)
    return figure
