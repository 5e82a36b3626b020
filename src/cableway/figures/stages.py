"""The stages of the paper's planner side by side, cables that follow one plan, and runs beside each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from cableway.figures import palette, scene, style
from cableway.figures.plan import AXIS, draw_routes, draw_shapes, spread_rows
from cableway.figures.rollout import stacked_errors
from cableway.outcome import SUCCESS_ERROR
from cableway.records import PaperStages, Rollout
from cableway.scene.task import Task


def stages_figure(
    task: Task,
    pivots: Mapping[str, Float[np.ndarray, "P 2"]],
    shapes: Float[np.ndarray, "t n 2"],
    stages: PaperStages,
) -> Figure:
    """Pivot paths, path set, deformation along it, and the progress of each keypoint over time.

    Args:
        task: The task.
        pivots: Pivot paths [m] by what they were made with.
        shapes: (T+1, n, 2) the deformation along the path set [m].
        stages: The path set and the progress along it.
    """
    figure, (first, second, third, last) = scene.panel_row(task, 4)
    scene.draw_scene(first, task)
    handles = []
    for place, (label, path) in enumerate(pivots.items()):
        handles += first.plot(*path.T, linewidth=1.4, label=label, zorder=5, **style.series(place + 1))
    scene.draw_end_shapes(first, task)
    style.legend_below(first, handles, 2)
    style.title(first, f"{task.name}: pivot path")
    draw_routes(second, task, stages.pivot, stages.path_set, stages.passages)
    style.title(second, "passages and path set")
    draw_shapes(third, task, shapes)
    style.title(third, "deformation")
    scene.finish_row([first, second, third])
    draw_progress(last, stages.progress)
    style.letter_panels(first, second, third, last)
    return figure


def draw_progress(ax: Axes, progress: Float[np.ndarray, "t n"]) -> None:
    """The progress of the keypoints along their paths over the steps, coloured from the left gripper to the right."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    box, (wide, _) = ax.get_position(), figure.get_size_inches()
    bar, room = 0.1 / wide, 0.55 / wide
    left = (scene.LEFT + scene.PANEL + scene.BAR + scene.LEFT) / wide
    ax.set_position((left, box.y0, 1 - left - room, box.height))
    last = progress.shape[1] - 1
    for place, curve in enumerate(progress.T):
        ax.plot(curve, color=style.TIME(place / last), linewidth=1.1)
    style.curve_axes(ax, "step", "share of the path", whole=True)
    style.title(ax, "progress σ of the keypoints")
    place = figure.add_axes((1 - room + bar, box.y0 + 0.15 * box.height, bar, 0.7 * box.height))
    scale = figure.colorbar(ScalarMappable(Normalize(1, last + 1), style.TIME), cax=place, ticks=[1, last + 1])
    scale.set_label("keypoint", fontsize=style.LABEL, color=palette.MUTED, labelpad=-4)
    scale.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
    place.tick_params(labelsize=style.TICK, colors=palette.MUTED, length=0, pad=2)


def followers_figure(task: Task, rollouts: Mapping[str, Rollout]) -> Figure:
    """Where cables lay at the start, halfway and at the end of the same plan, and their errors over time.

    Args:
        task: The task.
        rollouts: By name of the cable.
    """
    width, height = scene.panel_size(task)
    figure = style.new_figure(style.DOUBLE, scene.BELOW + height + scene.ABOVE)
    ax = style.add_axes(figure, scene.LEFT, scene.BELOW, width, height)
    left = scene.LEFT + width + scene.LEFT + scene.BETWEEN
    errors = style.add_axes(figure, left, scene.BELOW, style.DOUBLE - left - 0.75, height)
    scene.draw_scene(ax, task)
    style.title(ax, "start, halfway, end")
    style.title(errors, "stacked error to the goal")
    for place, (name, rollout) in enumerate(rollouts.items()):
        look = style.series(place + 1)
        for row in (0, rollout.steps // 2, -1):
            scene.draw_cable(ax, rollout.centreline[row], task.cable.radius / 2, look["color"], alpha=0.8)
        errors.plot(rollout.times, 1000 * stacked_errors(task, rollout)[0], label=name, linewidth=1.2, **look)
    for shape in (task.start, task.goal):
        ax.plot(*scene.smooth(shape).T, color=palette.INK, linewidth=0.9, linestyle=":", zorder=7)
    style.log_axis(errors.yaxis)
    style.curve_axes(errors, "time [s]", "error [mm]")
    style.name_curves(errors)
    style.letter_panels(ax, errors)
    return figure


def tasks_over_time_figure(rollouts: Sequence[tuple[Task, Rollout]]) -> Figure:
    """Error to the goal and clearance over time, two panels for each task."""
    columns, each, gap = 4, 0.85, 0.1
    rows, pitch = -(-len(rollouts) // columns), (style.DOUBLE - scene.RIGHT) / columns
    tall = scene.ABOVE + 2 * each + gap + AXIS
    figure, headed = style.new_figure(style.DOUBLE, rows * tall), []
    furthest = max(float(stacked_errors(task, rollout)[0].max()) for task, rollout in rollouts)
    free = [np.minimum(rollout.clearance, rollout.gripper_clearance) for _, rollout in rollouts]
    freest = max(float(curve.max()) for curve in free)
    for number, (task, rollout) in enumerate(rollouts):
        row, column = divmod(number, columns)
        left, bottom = scene.LEFT + column * pitch, (rows - 1 - row) * tall + AXIS
        below, above = (style.add_axes(figure, left, bottom + up, pitch - scene.LEFT, each) for up in (0.0, each + gap))
        above.plot(rollout.times, 1000 * stacked_errors(task, rollout)[0], color=palette.INK, linewidth=1.2)
        above.axhline(1000 * SUCCESS_ERROR, color=palette.BAD, linewidth=0.8, linestyle="--")
        style.log_axis(above.yaxis)
        above.set_ylim(0.05, 2000 * furthest)
        below.plot(rollout.times, 1000 * free[number], color=palette.BLUE, linewidth=1.2)
        below.axhline(0, color=palette.BAD, linewidth=0.8, linestyle="--")
        below.set_ylim(-50 * freest, 1050 * freest)
        style.title(above, task.name)
        style.curve_axes(above, "", "" if column else "error [mm]")
        style.curve_axes(below, "time [s]", "" if column else "clearance [mm]")
        above.set_xticklabels([])
        headed.append(above)
    style.letter_panels(*headed)
    return figure


SNAPSHOTS_SHOWN = 10
"""Most moments of a run in a small panel."""


def snapshots_figure(runs: Sequence[tuple[str, Task, Rollout]]) -> Figure:
    """The cable on its way, coloured by time, in a panel for each run; its name is above it.

    Cables are as thick in the picture whatever they are, as thin ones would not be seen.
    """
    figure, panels = scene.small_panels([name for name, _, _ in runs], 4, 1.67)
    for ax, (_, task, rollout) in zip(panels, runs, strict=True):
        scene.draw_scene(ax, task)
        rows = spread_rows(rollout.keypoints, SNAPSHOTS_SHOWN)
        for row, color in zip(rows, style.TIME(rows / max(rollout.steps, 1)), strict=True):
            ax.plot(*rollout.centreline[row].T, color=color, linewidth=1.5, solid_capstyle="round", zorder=4)
        for side in (0, 1):
            ax.plot(*rollout.poses[:, side, :2].T, color=palette.INK, linewidth=0.4, alpha=0.5, zorder=3)
        ax.plot(*scene.smooth(task.goal).T, color=palette.INK, linewidth=0.8, linestyle=":", zorder=7)
        scene.leave_bare(ax)
    return figure
