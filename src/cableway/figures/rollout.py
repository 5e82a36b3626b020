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
from cableway.figures.plan import ABOVE, BAR, BELOW, LEFT, add_time_bar, draw_clearance, spread_rows
from cableway.outcome import SUCCESS_ERROR
from cableway.records import Estimate, Rollout
from cableway.scene.task import Task

SHAPES_SHOWN = 12
"""Shapes drawn of a rollout: each with its reference, so fewer than of a plan."""

COLUMN = 4.6
"""Width [inch] of the column of curves."""

HEADROOM = 0.2
"""Share of the panel above the curves, for the legend."""


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
        style.title(found, "estimates of the cable")
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
        Line2D([], [], color=style.INK, linewidth=0.9, label="gripper paths"),
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
    least = 1e-4
    curves = ((to_reference, style.LEFT, 1.3, "to the reference"), (to_goal, style.INK, 1.7, "to the goal"))
    for curve, color, width, name in curves:
        label = f"{name}, final {1000 * curve[-1]:.2f} mm"
        ax.plot(times, 1000 * np.maximum(curve, least), color=color, linewidth=width, label=label)
    ax.axhline(1000 * SUCCESS_ERROR, color=style.BAD, linewidth=1.0, linestyle="--")
    ax.annotate(
        f"success below {100 * SUCCESS_ERROR:g} cm", (0, 1000 * SUCCESS_ERROR), xycoords=("axes fraction", "data"),
        xytext=(4, 3), textcoords="offset points", fontsize=8, color=style.BAD,
    )  # fmt: skip
    ax.set_yscale("log")
    ax.set_ylim(1000 * least, 1000 * max(10.0, 10 * to_goal.max()))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())
    style.curve_axes(ax, "time [s]", "error [mm]")
    ax.legend(fontsize=8, frameon=False, loc="upper right", labelcolor=style.INK)


def draw_estimates(ax: Axes, rollout: Rollout) -> None:
    """Each estimate's distance from its nominal value, in prior standard deviations: all fit one axis.

    The band about a curve is one standard deviation either way, drawn for those that turned out to differ; the legend
    has the last values, those that differ in bold. A parameter that is not estimated has no curve.
    """
    assert rollout.estimates is not None
    assert rollout.deviations is not None
    found = rollout.estimated()
    moving = [(column, name) for column, name in enumerate(found) if found[name].prior > 0]
    for number, (column, name) in enumerate(moving):
        estimate, color = found[name], style.SERIES[number % len(style.SERIES)]
        dashes = "-" if number < len(style.SERIES) else (0, (3, 1.5))
        away = (rollout.estimates[:, column] - estimate.nominal) / estimate.prior
        ax.plot(
            rollout.times[1:], away, color=color, linestyle=dashes, linewidth=1.9 if estimate.differs else 0.9,
            label=last_value(name, estimate),
        )  # fmt: skip
        if estimate.differs:
            width = rollout.deviations[:, column] / estimate.prior
            ax.fill_between(rollout.times[1:], away - width, away + width, color=color, alpha=0.15, linewidth=0)
    style.curve_axes(ax, "time [s]", "distance from the prior [standard deviations]")
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + HEADROOM / (1 - HEADROOM) * (high - low))
    legend = ax.legend(fontsize=6.8, frameon=False, loc="upper left", ncols=2, labelcolor=style.INK, columnspacing=1.0)
    for text, (_, name) in zip(legend.get_texts(), moving, strict=True):
        text.set_fontweight("bold" if found[name].differs else "normal")


def last_value(name: str, estimate: Estimate) -> str:
    """Name, value and standard deviation of an estimate; metres as millimetres.

    >>> last_value("length", Estimate(0.2971, 0.0004, 0.3, 0.006, "m"))
    'length 297.10 ± 0.40 mm'
    """
    scale, unit = (1000.0, "mm") if estimate.unit == "m" else (1.0, estimate.unit)
    value, deviation = scale * estimate.value, scale * estimate.deviation
    decimals = int(np.clip(1 - np.floor(np.log10(max(deviation, 1e-3))), 0, 3))
    return f"{name} {value:.{decimals}f} ± {deviation:.{decimals}f} {unit}".rstrip()
