"""The picture of a moment of a run, as an array."""

from __future__ import annotations

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg

from cableway.figures import palette, scene, style
from cableway.records import Measurement
from cableway.scene.task import Task

SIDE = 3.2
"""Of the longer side of the workspace [inch]."""


def picture(task: Task, truth: Measurement) -> np.ndarray:
    """The scene with cable, grippers and, dotted, the goal: (rows, columns, 3) of uint8."""
    width, height = scene.panel_size(task, SIDE)
    figure = style.new_figure(width, height)
    ax = style.add_axes(figure, 0.0, 0.0, width, height)
    scene.draw_scene(ax, task)
    scene.draw_bodies(ax, task, truth.poses[None])
    scene.draw_cable(ax, truth.centreline, task.cable.radius, palette.BLUE)
    scene.draw_grippers(ax, truth.poses[:, :2], task.grippers.radius)
    ax.plot(*scene.smooth(task.goal).T, color=palette.INK, linewidth=0.9, linestyle=":")
    scene.leave_bare(ax)
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    canvas.draw()
    return np.array(canvas.buffer_rgba())[..., :3]
