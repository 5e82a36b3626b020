"""The picture of a cell's arms along a plan or a rollout, in perspective and from above."""

from __future__ import annotations

import numpy as np
import shapely
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch

from cableway.figures import palette, scene, style
from cableway.figures.perspective import ARMS, CellView, way_of
from cableway.records import Plan, Rollout
from cableway.robot.cell_kinematics import CellKinematics
from cableway.scene.task import CONTROL_STEP, Task

MARGIN = 0.04
"""Round the arms [m]."""

SHAPE = 0.68
"""Height of a picture in perspective over its width."""

APART = 0.1
"""Between the two rows of pictures [inch], besides the titles."""

FINE = 300
"""Pixels of such a picture to the inch."""


def cell_figure(task: Task, record: Plan | Rollout) -> Figure | None:
    """Both arms at the start, half-way and at the end: in perspective, and their links' capsules from above.

    None where the task has no cell, or the record no joints.
    """
    way = way_of(task, record)
    if way is None or record.joints is None:
        return None
    last = len(record.joints) - 1
    rows = [0, last // 2, last]
    shown = task.as_recorded(record.metadata)
    links = CellKinematics(task, way).links(record.joints[rows])
    low, high = _extent(links, task)
    width = (style.DOUBLE - scene.LEFT - 2 * scene.BETWEEN - scene.RIGHT) / 3
    height, tall = width * (high[1] - low[1]) / (high[0] - low[0]), width * SHAPE
    upper = scene.BELOW + height + scene.ABOVE + APART
    figure = style.new_figure(style.DOUBLE, upper + tall + scene.ABOVE)
    view = CellView(task, record, (round(FINE * width), round(FINE * tall)))
    panels: list[Axes] = []
    for place, row in enumerate(rows):
        left = scene.LEFT + place * (width + scene.BETWEEN)
        ax = style.add_axes(figure, left, upper, width, tall)
        ax.imshow(view.image(row), aspect="auto")
        ax.set_axis_off()
        time = float(record.times[row]) if isinstance(record, Rollout) else row * CONTROL_STEP
        style.title(ax, f"{time:.1f} s")
        panels.append(ax)
    for place, row in enumerate(rows):
        left = scene.LEFT + place * (width + scene.BETWEEN)
        ax = style.add_axes(figure, left, scene.BELOW, width, height)
        scene.draw_scene(ax, shown)
        ax.set_xlim(low[0], high[0])
        ax.set_ylim(low[1], high[1])
        scene.draw_cable(ax, scene.smooth(task.goal), task.cable.radius, palette.GOAL, zorder=3, alpha=0.6)
        _draw_arms(ax, [(ends[place], radius) for ends, radius in links])
        curve = record.centreline[row] if isinstance(record, Rollout) else scene.smooth(record.shapes[row])
        scene.draw_cable(ax, curve, task.cable.radius, palette.INK, zorder=10)
        style.title(ax, "from above")
        panels.append(ax)
    names = [f"arm {arm} holds the {side} end" for arm, side in zip(way.holders, ("left", "right"), strict=True)]
    entries = [Patch(facecolor=color, alpha=0.6, label=name) for color, name in zip(ARMS, names, strict=True)]
    entries.append(Patch(facecolor=palette.GOAL, alpha=0.6, label="goal"))
    style.legend_below(panels[4], entries, 3)
    scene.finish_row(panels)
    return figure


def _extent(
    links: list[tuple[Float[np.ndarray, "t k 2 3"], Float[np.ndarray, "k"]]], task: Task
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Lower left and upper right corner [m] of table and arms."""
    corners = [np.zeros((1, 2)), np.array([task.scene.size])]
    for ends, radius in links:
        corners += [(ends[..., :2] + sign * radius[:, None, None]).reshape(-1, 2) for sign in (-1, 1)]
    every = np.concatenate(corners)
    return every.min(axis=0) - MARGIN, every.max(axis=0) + MARGIN


def _draw_arms(ax: Axes, links: list[tuple[Float[np.ndarray, "k 2 3"], Float[np.ndarray, "k"]]]) -> None:
    """The links of both arms, higher ones above lower ones."""
    for (ends, radius), color in zip(links, ARMS, strict=True):
        for index in np.argsort(ends[..., 2].max(axis=1)):
            outline = shapely.LineString(ends[index, :, :2]).buffer(float(radius[index]))
            path = scene.polygon_path(outline)  # pyright: ignore[reportArgumentType]
            ax.add_patch(PathPatch(path, facecolor=color, alpha=0.35, edgecolor=color, linewidth=0.5, zorder=9))
