"""The pictures of a rollout: actual shapes against the reference, errors and clearance over time; and estimates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon
from matplotlib.ticker import FuncFormatter, NullFormatter

from cableway.core.quantities import limit_text, quantity
from cableway.figures import palette, scene, style
from cableway.figures.marks import LINE, draw_marks, marks_of, sentence_lines, write_lines
from cableway.figures.plan import AXIS, HEADED, add_time_bar, draw_clearance, spread_rows
from cableway.figures.replanning import change_of, draw_actual_scene, draw_left, left_of, stops_of
from cableway.outcome import SUCCESS_ERROR
from cableway.records import Plan, Rollout, Verdict
from cableway.scene.files.loading import AnyTask
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.task import Task

SHAPES_SHOWN = 12
"""Shapes drawn of a rollout: each with its reference, so fewer than of a plan."""


def rollout_figure(
    task: Task,
    rollout: Rollout,
    *,
    plan: Plan | None = None,
    failure: str | None = None,
    verdict: Verdict | None = None,
) -> Figure:
    """Shapes with their reference; errors and clearance over time; and what went wrong.

    Args:
        task: The task.
        rollout: What happened.
        plan: What was followed first; what is left of it where it was given up is drawn.
        failure: Why it is no success, in a sentence; None where it is one.
        verdict: Checks of the rollout; places and shapes of those that did not pass are marked.
    """
    marks, room = marks_of(verdict, rollout.centreline), style.DOUBLE - scene.LEFT
    lines = [] if failure is None else sentence_lines([failure], room, "Failed: ")
    lines += sentence_lines([mark.sentence for mark in marks], room) if marks else []
    figure, (ax, above, below) = scene_and_curves(task, 0.1 + LINE * len(lines) if lines else 0.0)
    draw_tracking(ax, task, rollout, plan)
    style.title(ax, f"{task.name}: tracking, {rollout.steps} steps")
    draw_marks(ax, marks)
    write_lines(figure, scene.LEFT, lines)
    draw_errors(above, rollout.times, *stacked_errors(task, rollout))
    draw_clearance(below, "clearance", rollout.times, rollout.clearance, rollout.gripper_clearance)
    style.letter_panels(ax, above, below)
    return figure


def scene_and_curves(task: Task, more: float = 0.0) -> tuple[Figure, tuple[Axes, Axes, Axes]]:
    """A figure with a panel for the task's scene and a bar of time, and two panels for curves one above the other.

    Args:
        task: The task.
        more: Height [inch] left free above them.
    """
    width, height = scene.panel_size(task)
    tall = scene.BELOW + height + scene.ABOVE
    figure = style.new_figure(style.DOUBLE, tall + more)
    ax = style.add_axes(figure, scene.LEFT, scene.BELOW, width, height)
    left = scene.LEFT + width + scene.BAR + scene.LEFT
    column, half = style.DOUBLE - scene.RIGHT - left, tall / 2 - AXIS - HEADED
    above, below = (style.add_axes(figure, left, AXIS + up, column, half) for up in (tall / 2, 0.0))
    return figure, (ax, above, below)


def estimates_figure(rollout: Rollout) -> Figure | None:
    """What the controller found out about the cable, over time; None where no estimate moved."""
    moved = [name for name, estimate in rollout.estimated().items() if estimate.differs]
    if not moved:
        return None
    figure = style.new_figure(style.DOUBLE, 2.8)
    draw_estimates(style.add_axes(figure, scene.LEFT, AXIS, 4.3, 2.8 - AXIS - scene.ABOVE), rollout, moved)
    return figure


def stacked_errors(task: AnyTask, rollout: Rollout) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k"]]:
    """Stacked distance [m] of the keypoints to the goal and to the reference at each time."""
    goal = task.keypoints("goal") if isinstance(task, SpatialTask) else task.goal
    to_goal = np.linalg.norm(rollout.keypoints - goal, axis=(1, 2))
    return to_goal, np.linalg.norm(rollout.keypoints - rollout.reference, axis=(1, 2))


def draw_tracking(ax: Axes, task: Task, rollout: Rollout, plan: Plan | None = None) -> None:
    """The scene with the motion in it, a scale of time and a legend."""
    changed = draw_motion(ax, task, rollout)
    if plan is not None and (stops := stops_of(rollout)):
        changed += draw_left(ax, left_of(plan, rollout.reference[stops[0].first]))
    add_time_bar(ax, float(rollout.times[-1]))
    handles: list[Any] = [
        Patch(facecolor=style.TIME(0.5), label="cable, coloured by time"),
        Line2D([], [], color=palette.OBSTACLE_EDGE, linewidth=1.0, linestyle=(0, (3, 2)), label="reference"),
        Line2D([], [], color=palette.INK, linewidth=0.7, label="gripper paths"),
        Line2D([], [], color=palette.INK, linewidth=1.0, linestyle=":", label="goal shape"),
    ]
    style.legend_below(ax, handles + changed, 3 if changed else 2, wide=bool(changed))


def draw_motion(ax: Axes, task: Task, rollout: Rollout) -> list[Any]:
    """The scene with the simulated cable coloured by time and the reference dashed on it.

    Returns:
        Legend entries of what the plan did not know.
    """
    changed = draw_actual_scene(ax, task, change_of(task, rollout))
    rows = spread_rows(rollout.keypoints, SHAPES_SHOWN)
    colors = style.TIME(rows / max(rollout.steps, 1))
    scene.draw_bodies(ax, task, rollout.poses[rows])
    scene.draw_cables(ax, rollout.centreline[rows], task.cable.radius, colors)
    if task.plug is not None:
        for row, color in zip(rows, colors, strict=True):
            corners = scene.plug_corners(task, rollout.poses[row, 1])
            ax.add_patch(Polygon(corners, facecolor=color, edgecolor="white", linewidth=0.4, alpha=0.65, zorder=4))
    for row in rows:
        ax.plot(*scene.smooth(rollout.reference[row]).T, color="white", linewidth=0.6, linestyle=(0, (3, 2)), zorder=5)
    for side in (0, 1):
        ax.plot(*rollout.poses[:, side, :2].T, color=palette.INK, linewidth=0.6, alpha=0.6, zorder=5)
        scene.draw_grippers(ax, rollout.poses[rows, side, :2], task.grippers.radius, zorder=6, linewidths=0.3)
    ax.plot(*scene.smooth(task.goal).T, color=palette.INK, linewidth=0.9, linestyle=":", zorder=7)
    return changed


def draw_errors(
    ax: Axes,
    times: Float[np.ndarray, "k"],
    to_goal: Float[np.ndarray, "g"],
    to_reference: Float[np.ndarray, "k"],
) -> None:
    """Stacked errors [m] over time [s] on a logarithmic scale in millimetres, with the line of success.

    `to_goal` may end before the others do, as where an insertion leads the cable away from its goal.
    """
    least = 1e-4
    curves = ((to_reference, palette.LEFT, 1.2, "to the reference"), (to_goal, palette.INK, 1.4, "to the goal"))
    for curve, color, width, name in curves:
        label = f"{name}, final {quantity(curve[-1])}"
        ax.plot(times[: len(curve)], 1000 * np.maximum(curve, least), color=color, linewidth=width, label=label)
    ax.axhline(1000 * SUCCESS_ERROR, color=palette.BAD, linewidth=1.0, linestyle="--")
    ax.annotate(
        f"success below {limit_text(SUCCESS_ERROR)}", (0, 1000 * SUCCESS_ERROR), xycoords=("axes fraction", "data"),
        xytext=(3, 2), textcoords="offset points", fontsize=style.NOTE, color=palette.BAD,
    )  # fmt: skip
    ax.set_yscale("log")
    ax.set_ylim(1000 * least, 2000 * max(to_goal.max(), to_reference.max(), SUCCESS_ERROR))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())
    style.curve_axes(ax, "time [s]", "error [mm]")
    style.title(ax, "stacked shape error", legend=True)


def draw_estimates(ax: Axes, rollout: Rollout, names: Sequence[str]) -> None:
    """Some estimates' distances from their nominal values, in prior standard deviations: all fit one axis.

    The band about a curve is one standard deviation either way; the legend beside them has the last values.
    """
    assert rollout.estimates is not None
    assert rollout.deviations is not None
    found = rollout.estimated()
    for number, name in enumerate(names):
        estimate, look, column = found[name], style.series(number), list(found).index(name)
        away = (rollout.estimates[:, column] - estimate.nominal) / estimate.prior
        width = rollout.deviations[:, column] / estimate.prior
        ax.plot(rollout.times[1:], away, linewidth=1.3, label=f"{name} {estimate}", **look)
        ax.fill_between(rollout.times[1:], away - width, away + width, color=look["color"], alpha=0.15, linewidth=0)
    style.curve_axes(ax, "time [s]", "from the prior [standard deviations]")
    style.title(ax, "estimates that moved")
    style.legend_right(ax)
