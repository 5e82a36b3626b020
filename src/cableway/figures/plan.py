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
from matplotlib.ticker import MaxNLocator

from cableway.core.quantities import quantity
from cableway.figures import palette, scene, style
from cableway.figures.marks import LINE, Mark, draw_marks, marks_of, sentence_lines, write_lines
from cableway.records import Attempt, PaperStages, Plan
from cableway.scene.clearance import pieces_clearance
from cableway.scene.task import CONTROL_STEP, Task

SHAPES_SHOWN = 24
"""Shapes drawn of a motion: enough to see it, few enough to distinguish them."""

CURVES, HEADED, AXIS = 1.15, 0.55, 0.42
"""Heights [inch] of a panel of curves, of its title and legend above, and of its axis below."""


def plan_figure(task: Task, plan: Plan) -> Figure:
    """Paths of the keypoints and shapes over time; below them, clearance and gripper speed over time."""
    below = AXIS + CURVES + HEADED
    figure, (routes, shapes) = scene.panel_row(task, 2, below)
    _draw_stages(routes, task, plan.stages, plan.shapes)
    draw_shapes(shapes, task, plan.shapes, plan.poses)
    style.title(shapes, f"the plan: {plan.steps} steps, {plan.steps * CONTROL_STEP:.1f} s")
    scene.finish_row([routes, shapes])
    clearance = style.add_axes(figure, scene.LEFT, AXIS, scene.PANEL, CURVES)
    left = scene.LEFT + scene.PANEL + scene.LEFT + scene.BETWEEN / 2
    motion = style.add_axes(figure, left, AXIS, style.DOUBLE - scene.RIGHT - left, CURVES)
    _draw_profiles(clearance, motion, task, plan)
    style.letter_panels(routes, shapes, clearance, motion)
    return figure


def attempt_figure(task: Task, attempt: Attempt) -> Figure:
    """How far planning got before it failed, and why it did: the place of the reason, or what did not verify."""
    wide = style.SINGLE if attempt.shapes is None else style.DOUBLE
    marks = [] if attempt.shapes is None else marks_of(attempt.verdict, scene.smooth(attempt.shapes))
    if attempt.at is not None or not marks:
        marks = [Mark(attempt.reason, attempt.at)]
    lines = ["No plan. What is wrong with the closest attempt:"] if len(marks) > 1 else []
    lines += sentence_lines([mark.sentence for mark in marks], wide - scene.LEFT, "" if lines else "No plan: ")
    figure, panels = scene.panel_row(task, 1 if attempt.shapes is None else 2, above=0.1 + LINE * len(lines))
    _draw_stages(panels[0], task, attempt.stages, attempt.shapes)
    if attempt.shapes is not None:
        draw_shapes(panels[1], task, attempt.shapes, attempt.poses)
        style.title(panels[1], "the closest attempt")
        scene.finish_row(panels)
        draw_marks(panels[1], marks)
    if attempt.at is not None:
        draw_marks(panels[0], marks)
    write_lines(figure, scene.LEFT, lines)
    return figure


def alternatives_figure(task: Task, motions: Sequence[Float[np.ndarray, "k n 2"]]) -> Figure:
    """The shapes of several plans over time, side by side."""
    figure, panels = scene.panel_row(task, len(motions))
    for place, (ax, shapes) in enumerate(zip(panels, motions, strict=True), start=1):
        handles = _draw_moving(ax, task, shapes)
        style.title(ax, f"plan {place}: {(len(shapes) - 1) * CONTROL_STEP:.1f} s")
        if place == 1 + (len(motions) == 3):
            colors = (("start", palette.START), ("end", palette.GOAL))
            entries = [*(Patch(facecolor=color, label=name) for name, color in colors), *handles]
            style.legend_below(ax, entries, 5 if len(motions) == 3 else 3)
    scene.finish_row(panels)
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
        (0, palette.LEFT, "left gripper"),
        (shapes.shape[1] // 2, palette.PIVOT, "middle"),
        (-1, palette.RIGHT, "right gripper"),
    )
    handles = scene.end_handles()
    for point, color, name in paths:
        handles += ax.plot(*shapes[:, point].T, color=color, linewidth=1.3, zorder=5, label=name)
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
        look: dict[str, Any] = {"color": palette.PATHS, "linewidth": 0.6, "alpha": 0.75, "zorder": 3}
        handles += ax.plot(*paths.T, **look, label="keypoint paths")[:1]
    if passages is not None and len(passages):
        handles += ax.plot(
            *passages.T, color=palette.PASSAGE, linewidth=1.2, linestyle=(0, (3, 2)), marker="o", markersize=2,
            zorder=5, label="traversed passage",
        )[:1]  # fmt: skip
    if pivot is not None:
        handles += ax.plot(*pivot.T, color=palette.PIVOT, linewidth=1.5, zorder=5, label="pivot path")
    scene.draw_end_shapes(ax, task)
    style.legend_below(ax, handles, 4)


def draw_shapes(
    ax: Axes,
    task: Task,
    shapes: Float[np.ndarray, "t n 2"],
    poses: Float[np.ndarray, "t 2 3"] | None = None,
    *,
    bar: bool = True,
) -> None:
    """The scene with shapes of the cable coloured by time, the grippers' ways, and where wanted a colour bar.

    With gripper poses also the bodies of the grippers.
    """
    handles = _draw_moving(ax, task, shapes, poses)
    if bar:
        add_time_bar(ax, (len(shapes) - 1) * CONTROL_STEP)
    style.legend_below(ax, [Patch(facecolor=style.TIME(0.5), label="cable, coloured by time"), *handles], 2)


def _draw_moving(
    ax: Axes, task: Task, shapes: Float[np.ndarray, "t n 2"], poses: Float[np.ndarray, "t 2 3"] | None = None
) -> list[Any]:
    """The scene with shapes coloured by time and the grippers' ways; legend entries of what is not coloured."""
    scene.draw_scene(ax, task)
    last = len(shapes) - 1
    rows = spread_rows(shapes, SHAPES_SHOWN)
    if poses is not None:
        scene.draw_bodies(ax, task, poses[rows])
    scene.draw_cables(ax, scene.smooth(shapes[rows]), task.cable.radius, style.TIME(rows / last))
    ways: tuple[tuple[int, Any, str], ...] = ((0, "-", "left gripper"), (-1, (0, (4, 2)), "right gripper"))
    handles: list[Any] = []
    for end, dashes, name in ways:
        handles += ax.plot(
            *shapes[:, end].T, color=palette.INK, linewidth=0.7, linestyle=dashes, alpha=0.7, zorder=5, label=name
        )
        scene.draw_grippers(ax, shapes[rows, end], task.grippers.radius, zorder=6, linewidths=0.3)
    goal = scene.smooth(task.goal)
    return handles + ax.plot(*goal.T, color=palette.INK, linewidth=0.9, linestyle=":", zorder=7, label="goal shape")


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
    place = figure.add_axes((box.x1 + 0.08 * inch, box.y0 + 0.15 * box.height, 0.1 * inch, 0.7 * box.height))
    bar = figure.colorbar(ScalarMappable(Normalize(0, max(duration, CONTROL_STEP)), style.TIME), cax=place)
    bar.set_label("time [s]", fontsize=style.LABEL, color=palette.MUTED, labelpad=2)
    bar.locator = MaxNLocator("auto", steps=[1, 2, 5, 10])
    place.tick_params(labelsize=style.TICK, colors=palette.MUTED, length=0, pad=2)
    for spine in place.spines.values():
        spine.set_visible(False)


def _draw_profiles(above: Axes, below: Axes, task: Task, plan: Plan) -> None:
    """Clearance of cable and grippers, and gripper motion against its limit, over time."""
    times = CONTROL_STEP * np.arange(len(plan.shapes))
    cable = task.scene.clearance(scene.smooth(plan.shapes), task.cable.radius)
    grippers = task.scene.signed_distance(plan.poses[:, :, :2]).min(axis=1) - task.grippers.radius
    grippers = np.minimum(grippers, pieces_clearance(scene.smooth(plan.shapes), plan.poses, task))
    draw_clearance(above, "clearance", times, cable, grippers)
    step = np.diff(plan.poses, axis=0)
    move = 100 * np.linalg.norm(step[:, :, :2], axis=2) / task.grippers.max_step
    turn = 100 * np.abs(step[:, :, 2]) / task.grippers.max_turn
    for i, (name, color) in enumerate((("left", palette.LEFT), ("right", palette.RIGHT))):
        below.plot(times[1:], move[:, i], color=color, linewidth=1.2, label=f"{name}, move")
        below.plot(times[1:], turn[:, i], color=color, linewidth=1.0, linestyle=":", label=f"{name}, turn")
    below.axhline(100, color=palette.BAD, linewidth=1.0, linestyle="--")
    below.set_ylim(0, 1.05 * max(100.0, move.max(), turn.max()))
    style.curve_axes(below, "time [s]", "share of the limit [%]")
    style.title(below, "gripper motion", legend=True)


def draw_clearance(
    ax: Axes,
    title: str,
    times: Float[np.ndarray, "k"],
    cable: Float[np.ndarray, "k"],
    grippers: Float[np.ndarray, "k"],
) -> None:
    """Clearance [m] of the cable's surface and of the gripper discs over time [s], in millimetres."""
    curves = ((grippers, palette.RIGHT, 1.2, "grippers"), (cable, palette.INK, 1.4, "cable"))
    for curve, color, width, name in curves:
        ax.plot(times, 1000 * curve, color=color, linewidth=width, label=f"{name}, least {quantity(curve.min())}")
    ax.axhline(0, color=palette.BAD, linewidth=1.0, linestyle="--")
    low, high = min(0.0, cable.min(), grippers.min()), max(cable.max(), grippers.max(), 0.01)
    ax.set_ylim(1000 * (low - 0.05 * (high - low)), 1000 * (high + 0.05 * (high - low)))
    style.curve_axes(ax, "time [s]", "clearance [mm]")
    style.title(ax, title, legend=True)
