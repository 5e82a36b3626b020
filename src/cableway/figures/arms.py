"""The picture of a cell's arms along a plan, seen from above."""

from __future__ import annotations

import numpy as np
import shapely
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch

from cableway.figures import scene, style
from cableway.records import Plan
from cableway.robot.cell_kinematics import CellKinematics
from cableway.scene.cell import Way
from cableway.scene.task import CONTROL_STEP, Task

COLORS = (style.BLUE, style.ORANGE)
"""Of the arms that hold the left and the right end."""

MARGIN = 0.04
"""Round the arms [m]."""


def arms_figure(task: Task, plan: Plan) -> Figure | None:
    """Both arms, their links' capsules from above, at the start, half-way and at the goal; None without a cell."""
    way = Way.of_record(plan.metadata)
    if task.cell is None or plan.joints is None or way is None:
        return None
    rows = [0, plan.steps // 2, plan.steps]
    links = CellKinematics(task, way).links(plan.joints[rows])
    low, high = _extent(links, task)
    width = (style.DOUBLE - scene.LEFT - 2 * scene.BETWEEN - scene.RIGHT) / 3
    height = width * (high[1] - low[1]) / (high[0] - low[0])
    figure = style.new_figure(style.DOUBLE, scene.BELOW + height + scene.ABOVE)
    panels: list[Axes] = []
    for place, row in enumerate(rows):
        left = scene.LEFT + place * (width + scene.BETWEEN)
        ax = style.add_axes(figure, left, scene.BELOW, width, height)
        scene.draw_scene(ax, task)
        ax.set_xlim(low[0], high[0])
        ax.set_ylim(low[1], high[1])
        _draw_arms(ax, [(ends[place], radius) for ends, radius in links])
        curve = scene.smooth(plan.shapes[row])
        scene.draw_cable(ax, curve, task.cable.radius, style.INK, zorder=10)
        style.title(ax, f"{row * CONTROL_STEP:.1f} s")
        panels.append(ax)
    names = [f"arm {arm} holds the {side} end" for arm, side in zip(way.holders, ("left", "right"), strict=True)]
    entries = [Patch(facecolor=color, alpha=0.6, label=name) for color, name in zip(COLORS, names, strict=True)]
    style.legend_below(panels[1], entries, 2)
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
    for (ends, radius), color in zip(links, COLORS, strict=True):
        for index in np.argsort(ends[..., 2].max(axis=1)):
            outline = shapely.LineString(ends[index, :, :2]).buffer(float(radius[index]))
            path = scene.polygon_path(outline)  # pyright: ignore[reportArgumentType]
            ax.add_patch(PathPatch(path, facecolor=color, alpha=0.35, edgecolor=color, linewidth=0.5, zorder=9))
