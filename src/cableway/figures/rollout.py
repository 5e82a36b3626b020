"""The picture of a rollout: actual shapes against the reference, and errors, clearance and estimates over time."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, NullFormatter

from cableway.figures import scene, style
from cableway.figures.estimates import draw_estimates
from cableway.figures.plan import ABOVE, BAR, BELOW, LEFT, add_time_bar, draw_clearance, spread_rows
from cableway.outcome import SUCCESS_ERROR
from cableway.records import Rollout
from cableway.scene.task import Task

SHAPES_SHOWN = 12
"""Shapes drawn of a rollout: each with its reference, so fewer than of a plan."""

COLUMN = 4.6
"""Width [inch] of the column of curves."""


def rollout_figure(task: Task, rollout: Rollout) -> Figure:
    """Shapes with their reference on the left; errors, clearance and estimates, if any, over time on the right."""
    width, height = scene.panel_size(task)
    columns = 1 if rollout.estimates is None else 2
    figure = style.new_figure(LEFT + width + BAR + 0.3 + columns * COLUMN + 0.25, BELOW + height + ABOVE)
    ax = style.add_axes(figure, LEFT, BELOW, width, height)
    draw_tracking(ax, task, rollout)
    style.title(ax, f"{task.name}: tracking, {rollout.steps} steps")
    left, half = LEFT + width + BAR + 0.3, (height + BELOW - 1.6) / 2
    above = style.add_axes(figure, left, height + BELOW - half, COLUMN, half)
    below = style.add_axes(figure, left, 0.6, COLUMN, half)
    draw_errors(above, rollout.times, *stacked_errors(task, rollout))
    style.title(above, "stacked shape error")
    style.title(below, "clearance, simulated")
    draw_clearance(below, rollout.times, rollout.clearance, rollout.gripper_clearance)
    if rollout.estimates is not None:
        found = style.add_axes(figure, left + COLUMN + 0.7, 0.6, COLUMN - 0.7, height + BELOW - 0.6)
        draw_estimates(found, rollout)
        style.title(found, "what the controller believes of the cable")
    return figure


def stacked_errors(task: Task, rollout: Rollout) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k"]]:
    """Stacked distance [m] of the keypoints to the goal and to the reference at each time."""
    to_goal = np.linalg.norm(rollout.keypoints - task.goal, axis=(1, 2))
    return to_goal, np.linalg.norm(rollout.keypoints - rollout.reference, axis=(1, 2))


def draw_tracking(ax: Axes, task: Task, rollout: Rollout) -> None:
    """The scene with the motion in it, a scale of time and a legend."""
    draw_motion(ax, task, rollout)
    add_time_bar(ax, float(rollout.times[-1]))
    handles: list[Any] = [
        Patch(facecolor=style.TIME(0.5), label="cable, coloured by time"),
        Line2D([], [], color="#9aa3ad", linewidth=1.2, linestyle=(0, (3, 2)), label="reference"),
        Line2D([], [], color=style.INK, linewidth=0.9, label="gripper ways"),
        Line2D([], [], color=style.INK, linewidth=1.0, linestyle=":", label="goal shape"),
    ]
    style.legend_below(ax, handles, 2)


def draw_motion(ax: Axes, task: Task, rollout: Rollout) -> None:
    """The scene with the simulated cable coloured by time and the reference dashed on it."""
    scene.draw_scene(ax, task)
    rows = spread_rows(rollout.keypoints, SHAPES_SHOWN)
    colors = style.TIME(rows / max(rollout.steps, 1))
    scene.draw_cables(ax, rollout.centreline[rows], task.cable.radius, colors)
    for row in rows:
        ax.plot(*scene.smooth(rollout.reference[row]).T, color="white", linewidth=0.9, linestyle=(0, (3, 2)), zorder=5)
    for side in (0, 1):
        ax.plot(*rollout.poses[:, side, :2].T, color=style.INK, linewidth=0.8, alpha=0.6, zorder=5)
        scene.draw_grippers(ax, rollout.poses[rows, side, :2], task.grippers.radius, zorder=6, linewidths=0.4)
    ax.plot(*scene.smooth(task.goal).T, color=style.INK, linewidth=1.0, linestyle=":", zorder=7)


def draw_errors(
    ax: Axes,
    times: Float[np.ndarray, "k"],
    to_goal: Float[np.ndarray, "k"],
    to_reference: Float[np.ndarray, "k"],
) -> None:
    """Stacked errors [m] over time [s] on a logarithmic scale in millimetres, with the line of success."""
    floor = 1e-4
    curves = ((to_reference, style.LEFT, 1.3, "to the reference"), (to_goal, style.INK, 1.7, "to the goal"))
    for curve, color, width, name in curves:
        label = f"{name}, final {1000 * curve[-1]:.2f} mm"
        ax.plot(times, 1000 * np.maximum(curve, floor), color=color, linewidth=width, label=label)
    ax.axhline(1000 * SUCCESS_ERROR, color=style.BAD, linewidth=1.0, linestyle="--")
    ax.annotate(
        f"success below {100 * SUCCESS_ERROR:g} cm", (0, 1000 * SUCCESS_ERROR), xycoords=("axes fraction", "data"),
        xytext=(4, 3), textcoords="offset points", fontsize=8, color=style.BAD,
    )  # fmt: skip
    ax.set_yscale("log")
    ax.set_ylim(1000 * floor, 1000 * max(10.0, 10 * to_goal.max()))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())
    style.curve_axes(ax, "time [s]", "error [mm]")
    ax.legend(fontsize=8, frameon=False, loc="upper right", labelcolor=style.INK)
