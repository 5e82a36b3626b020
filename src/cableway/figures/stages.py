"""The stages of the paper's planner side by side, and cables that follow one plan."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from cableway.figures.plan import draw_routes, draw_shapes
from cableway.figures.scene import draw_cable, draw_end_shapes, draw_scene, panel_size
from cableway.figures.style import (
    SERIES,
    TIME,
    add_axes,
    curve_axes,
    legend_below,
    log_axis,
    new_figure,
    series,
    title,
)
from cableway.records import PaperStages, Rollout
from cableway.scene.task import Task

LEFT, BETWEEN, BELOW, CURVES = 0.7, 0.9, 1.1, 4.0
"""Inches left of the panels, between them, below them, and the width of a panel with curves."""


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
    width, height = panel_size(task)
    pitch, right = height + BELOW + 0.5, LEFT + width + BETWEEN
    figure = new_figure(right + width + 0.3, 2 * pitch)
    first, second = (add_axes(figure, left, pitch + BELOW, width, height) for left in (LEFT, right))
    third, last = (add_axes(figure, left, BELOW, width, height) for left in (LEFT, right + 0.6))
    last.set_position(last.get_position().shrunk((width - 0.6) / width, 1.0))
    title(first, "pivot path")
    draw_scene(first, task)
    handles = []
    for place, (label, path) in enumerate(pivots.items()):
        handles += first.plot(*path.T, linewidth=2, label=label, **series(place + 1))
    draw_end_shapes(first, task)
    legend_below(first, handles, 3)
    title(second, "passages and path set")
    draw_routes(second, task, stages.pivot, stages.path_set, stages.passages)
    title(third, "deformation")
    draw_shapes(third, task, shapes)
    title(last, "progress σ of the keypoints")
    for place, curve in enumerate(stages.progress.T):
        last.plot(curve, color=TIME(place / (stages.progress.shape[1] - 1)), linewidth=1.3)
    curve_axes(last, "step", "share of the path; first keypoint blue, last one orange", whole=True)
    return figure


def followers_figure(task: Task, rollouts: Mapping[str, Rollout]) -> Figure:
    """Where cables lay at the start, halfway and at the end of the same plan, and their errors over time.

    Args:
        task: The task.
        rollouts: By name of the cable.
    """
    width, height = panel_size(task)
    figure = new_figure(LEFT + width + BETWEEN + 0.6 + CURVES + 0.3, height + BELOW + 0.5)
    scene = add_axes(figure, LEFT, BELOW, width, height)
    errors = add_axes(figure, LEFT + width + BETWEEN + 0.6, BELOW, CURVES, height)
    draw_scene(scene, task)
    title(scene, "start, halfway, end")
    title(errors, "stacked shape error")
    handles = []
    for place, (name, rollout) in enumerate(rollouts.items()):
        for row in (0, rollout.steps // 2, -1):
            draw_cable(scene, rollout.centreline[row], task.cable.radius / 2, SERIES[place % len(SERIES)], alpha=0.8)
        error = 1000 * np.linalg.norm(rollout.keypoints - task.goal, axis=(1, 2))
        handles += errors.plot(rollout.times, error, label=name, **series(place))
    draw_end_shapes(scene, task)
    legend_below(scene, handles, 4)
    log_axis(errors.yaxis)
    curve_axes(errors, "time [s]", "to the goal [mm]")
    return figure
