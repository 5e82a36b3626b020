"""The picture of a plan (paths of its keypoints, shapes it passes through, clearance) and of a failed attempt."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from cableway.core.quantities import quantity
from cableway.figures import scene, style
from cableway.figures.marks import LINE, Mark, draw_marks, marks_of, sentence_lines, write_lines
from cableway.records import Attempt, PaperStages, Plan
from cableway.scene.task import CONTROL_STEP, Task

SHAPES_SHOWN = 24
"""Shapes drawn of a motion: enough to see it, few enough to distinguish them."""

LEFT, BETWEEN, BELOW, ABOVE, BAR, COLUMN = 0.65, 0.7, 1.0, 0.45, 1.1, 3.5
"""Inches left of the first panel, between panels, below, above, for the colour bar, and of the column of curves."""

BESIDE = 0.68
"""Share of its usual size that a scene has in a row of several."""

LEGEND = 0.17
"""Height [inch] of a legend of one row above a panel."""


def plan_figure(task: Task, plan: Plan) -> Figure:
    """Paths of the keypoints, shapes over time, and clearance and gripper speed over time, side by side."""
    width, height = scene.panel_size(task)
    figure = style.new_figure(LEFT + 2 * width + BETWEEN + BAR + COLUMN + 0.5, BELOW + height + ABOVE)
    routes = style.add_axes(figure, LEFT, BELOW, width, height)
    _draw_stages(routes, task, plan.stages, plan.shapes)
    shapes = style.add_axes(figure, LEFT + width + BETWEEN, BELOW, width, height)
    draw_shapes(shapes, task, plan.shapes)
    style.title(shapes, f"the plan: {plan.steps} steps, {plan.steps * CONTROL_STEP:.1f} s")
    left = LEFT + 2 * width + BETWEEN + BAR + 0.25
    _draw_profiles(*curve_panels(figure, left, COLUMN, BELOW + height), task, plan)
    return figure


def curve_panels(figure: Figure, left: float, width: float, top: float) -> tuple[Axes, Axes]:
    """Two panels for curves over time, one above the other, each with room for its legend; all in inches."""
    half = (top - 0.6 - 0.95 - LEGEND) / 2
    above = style.add_axes(figure, left, top - LEGEND - half, width, half)
    return above, style.add_axes(figure, left, 0.6, width, half)


def attempt_figure(task: Task, attempt: Attempt) -> Figure:
    """How far planning got before it failed, and why it did: the place of the reason, or what did not verify."""
    width, height = scene.panel_size(task)
    panels = 1 if attempt.shapes is None else 2
    wide = LEFT + panels * width + (panels - 1) * (BETWEEN + BAR) + 0.4
    marks = [] if attempt.shapes is None else marks_of(attempt.verdict, scene.smooth(attempt.shapes))
    if attempt.at is not None or not marks:
        marks = [Mark(attempt.reason, attempt.at)]
    lines = ["No plan. What is wrong with the closest attempt:"] if len(marks) > 1 else []
    lines += sentence_lines([mark.sentence for mark in marks], wide - LEFT, "" if lines else "No plan: ")
    figure = style.new_figure(wide, BELOW + height + ABOVE + 0.2 + LINE * len(lines))
    above = style.add_axes(figure, LEFT, BELOW, width, height)
    _draw_stages(above, task, attempt.stages, attempt.shapes)
    if attempt.shapes is not None:
        reached = style.add_axes(figure, LEFT + width + BETWEEN, BELOW, width, height)
        draw_shapes(reached, task, attempt.shapes)
        style.title(reached, "the closest attempt")
        draw_marks(reached, marks)
    if attempt.at is not None:
        draw_marks(above, marks)
    write_lines(figure, LEFT, lines)
    return figure


def alternatives_figure(task: Task, motions: Sequence[Float[np.ndarray, "k n 2"]]) -> Figure:
    """The shapes of several plans over time, side by side."""
    width, height = (side * BESIDE for side in scene.panel_size(task))
    pitch = width + BAR
    figure = style.new_figure(LEFT + len(motions) * pitch, BELOW + height + ABOVE)
    for place, shapes in enumerate(motions):
        ax = style.add_axes(figure, LEFT + place * pitch, BELOW, width, height)
        draw_shapes(ax, task, shapes)
        if place:
            ax.set_ylabel("")
            ax.set_yticks([])
        style.title(ax, f"{task.name}: plan {place + 1} of {len(motions)}")
    return figure


def _draw_stages(ax: Axes, task: Task, stages: PaperStages | None, shapes: Float[np.ndarray, "t n 2"] | None) -> None:
    """The stages of the paper's planner; where there are none, the paths of the grippers and of the cable's middle."""
    if stages is not None:
        draw_routes(ax, task, stages.pivot, stages.path_set, stages.passages)
        style.title(ax, f"{task.name}: pivot path and path set")
    elif shapes is not None:
        _draw_paths(ax, task, shapes)
        style.title(ax, f"{task.name}: from start to goal")
    else:
        draw_routes(ax, task)
        style.title(ax, f"{task.name}: no initial trajectory")


def _draw_paths(ax: Axes, task: Task, shapes: Float[np.ndarray, "t n 2"]) -> None:
    """The paths of both grippers and of the cable's middle, whatever the cable does between them."""
    scene.draw_scene(ax, task)
    paths = (
        (0, style.LEFT, "left gripper"),
        (shapes.shape[1] // 2, style.PIVOT, "middle"),
        (-1, style.RIGHT, "right gripper"),
    )
    handles = scene.end_handles()
    for point, color, name in paths:
        handles += ax.plot(*shapes[:, point].T, color=color, linewidth=1.7, zorder=5, label=f"path of the {name}")
    scene.draw_end_shapes(ax, task)
    style.legend_below(ax, handles, 4)


def draw_routes(
    ax: Axes,
    task: Task,
    pivot: Float[np.ndarray, "P 2"] | None = None,
    paths: Float[np.ndarray, "n M 2"] | None = None,
    passages: Float[np.ndarray, "Q 2 2"] | None = None,
) -> None:
    """The scene with pivot path, keypoint paths and the passages they go through, as far as there are any."""
    scene.draw_scene(ax, task)
    handles: list[Any] = scene.end_handles()
    if paths is not None:
        handles += ax.plot(*paths.T, color=style.PATHS, linewidth=0.9, alpha=0.75, zorder=3, label="keypoint paths")[:1]
    if passages is not None and len(passages):
        handles += ax.plot(
            *passages.T, color=style.PASSAGE, linewidth=1.6, linestyle=(0, (3, 2)), marker="o", markersize=3, zorder=5,
            label="traversed passage",
        )[:1]  # fmt: skip
    if pivot is not None:
        handles += ax.plot(*pivot.T, color=style.PIVOT, linewidth=2.2, zorder=5, label="pivot path")
    scene.draw_end_shapes(ax, task)
    style.legend_below(ax, handles, 4)


def draw_shapes(ax: Axes, task: Task, shapes: Float[np.ndarray, "t n 2"]) -> None:
    """The scene with shapes of the cable coloured by time, the grippers' ways and a colour bar."""
    scene.draw_scene(ax, task)
    last = len(shapes) - 1
    rows = spread_rows(shapes, SHAPES_SHOWN)
    scene.draw_cables(ax, scene.smooth(shapes[rows]), task.cable.radius, style.TIME(rows / last))
    ways: tuple[tuple[int, Any, str], ...] = ((0, "-", "left gripper"), (-1, (0, (4, 2)), "right gripper"))
    handles: list[Any] = [Patch(facecolor=style.TIME(0.5), label="cable, coloured by time")]
    for end, dashes, name in ways:
        handles += ax.plot(
            *shapes[:, end].T, color=style.INK, linewidth=0.9, linestyle=dashes, alpha=0.7, zorder=5, label=name
        )
        scene.draw_grippers(ax, shapes[rows, end], task.grippers.radius, zorder=6, linewidths=0.4)
    goal = scene.smooth(task.goal)
    handles += ax.plot(*goal.T, color=style.INK, linewidth=1.0, linestyle=":", zorder=7, label="goal shape")
    add_time_bar(ax, last * CONTROL_STEP)
    style.legend_below(ax, handles, 2)


def spread_rows(shapes: Float[np.ndarray, "k n 2"], count: int) -> Int[np.ndarray, "r"]:
    """At most `count` rows, first and last included, between which the cable moves about equally far."""
    travel = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(shapes, axis=0), axis=2).mean(axis=1))])
    rows = np.searchsorted(travel, np.linspace(0, travel[-1], count)[1:-1])
    return np.unique(np.concatenate([[0], rows, [len(shapes) - 1]]))


def add_time_bar(ax: Axes, duration: float) -> None:
    """A colour bar from 0 to `duration` [s] right of the panel."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    box = ax.get_position()
    inch = 1 / figure.get_size_inches()[0]
    place = figure.add_axes((box.x1 + 0.12 * inch, box.y0 + 0.15 * box.height, 0.14 * inch, 0.7 * box.height))
    bar = figure.colorbar(ScalarMappable(Normalize(0, max(duration, CONTROL_STEP)), style.TIME), cax=place)
    bar.set_label("time [s]", fontsize=9, color=style.MUTED)
    place.tick_params(labelsize=8.5, colors=style.MUTED, length=0)
    for spine in place.spines.values():
        spine.set_visible(False)


def _draw_profiles(above: Axes, below: Axes, task: Task, plan: Plan) -> None:
    """Clearance of cable and grippers, and gripper motion against its limit, over time."""
    times = CONTROL_STEP * np.arange(len(plan.shapes))
    cable = task.scene.clearance(scene.smooth(plan.shapes), task.cable.radius)
    grippers = task.scene.signed_distance(plan.poses[:, :, :2]).min(axis=1) - task.grippers.radius
    draw_clearance(above, "clearance", times, cable, grippers)
    step = np.diff(plan.poses, axis=0)
    move = 100 * np.linalg.norm(step[:, :, :2], axis=2) / task.grippers.max_step
    turn = 100 * np.abs(step[:, :, 2]) / task.grippers.max_turn
    for i, (name, color) in enumerate((("left", style.LEFT), ("right", style.RIGHT))):
        below.plot(times[1:], move[:, i], color=color, linewidth=1.5, label=f"{name}, move")
        below.plot(times[1:], turn[:, i], color=color, linewidth=1.1, linestyle=":", label=f"{name}, turn")
    below.axhline(100, color=style.BAD, linewidth=1.0, linestyle="--")
    below.set_ylim(0, 1.05 * max(100.0, move.max(), turn.max()))
    style.curve_axes(below, "time [s]", "share of the limit [%]")
    style.title(below, "gripper motion", legend=4)


def draw_clearance(
    ax: Axes,
    title: str,
    times: Float[np.ndarray, "k"],
    cable: Float[np.ndarray, "k"],
    grippers: Float[np.ndarray, "k"],
) -> None:
    """Clearance [m] of the cable's surface and of the gripper discs over time [s], in millimetres."""
    curves = ((grippers, style.RIGHT, 1.3, "grippers"), (cable, style.INK, 1.7, "cable"))
    for curve, color, width, name in curves:
        ax.plot(times, 1000 * curve, color=color, linewidth=width, label=f"{name}, least {quantity(curve.min())}")
    ax.axhline(0, color=style.BAD, linewidth=1.0, linestyle="--")
    low, high = min(0.0, cable.min(), grippers.min()), max(cable.max(), grippers.max(), 0.01)
    ax.set_ylim(1000 * (low - 0.05 * (high - low)), 1000 * (high + 0.05 * (high - low)))
    style.curve_axes(ax, "time [s]", "clearance [mm]")
    style.title(ax, title, legend=2)
