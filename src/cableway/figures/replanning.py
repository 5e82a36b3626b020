"""A run whose obstacles are not where its plan has them: what it found, where it stopped, and how it went on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from cableway.core.errors import InputError
from cableway.figures import palette, scene, style
from cableway.figures.plan import spread_rows
from cableway.records import Plan, Rollout
from cableway.scene.scene import Scene
from cableway.scene.task import Task

STILL = 1e-6
"""Most that a reference moves [m] while it waits."""

STOPS_SHOWN = 3
"""Most stops with a row of panels of their own."""

SHAPES_SHOWN = 14
"""Most shapes of a plan in a panel."""

UNSEEN: dict[str, Any] = {"facecolor": "white", "edgecolor": palette.BAD, "hatch": "////", "linestyle": (0, (3, 2))}
EXPECTED: dict[str, Any] = {"facecolor": "none", "edgecolor": palette.MUTED, "linestyle": (0, (3, 2))}
"""How an obstacle is drawn that the controller does not know of yet, and the place where the plan has one."""

LEFT: dict[str, Any] = {"color": palette.BAD, "linewidth": 1.1, "linestyle": (0, (2, 2))}
"""How the gripper paths of a plan that was given up are drawn."""


class Change(NamedTuple):
    """What the plan did not know of the obstacles.

    Attributes:
        known: Time [s] from which the controller knows it; infinity where it never does.
        kept: The scene with the obstacles that are where the plan has them.
        expected: The others where the plan has them.
        actual: Where these are, and further ones.
        whole: All obstacles where they are.
    """

    known: float
    kept: Scene
    expected: Scene
    actual: Scene
    whole: Scene

    @property
    def name(self) -> str:
        """In words."""
        return "obstacle moved" if self.expected.obstacles else "new obstacle"


def change_of(task: Task, rollout: Rollout) -> Change | None:
    """What the metadata say of displaced and further obstacles; None where all are as in the task.

    Raises:
        InputError: They do not fit the task.
    """
    actual = task.as_recorded(rollout.metadata)
    if actual is task:
        return None
    known = rollout.metadata["plant"].get("revealed")
    try:
        when = math.inf if known is None else float(known)
    except (TypeError, ValueError) as error:
        raise InputError(f"the rollout's plant.revealed is no time: {error}") from error
    every, size, planned = actual.scene.obstacles, task.scene.size, task.scene.obstacles
    moved = [index for index, obstacle in enumerate(planned) if every[index] != obstacle]
    kept = tuple(obstacle for index, obstacle in enumerate(planned) if index not in moved)
    others = (*(every[index] for index in moved), *every[len(planned) :])
    expected = tuple(planned[index] for index in moved)
    return Change(when, Scene(size, kept), Scene(size, expected), Scene(size, others), actual.scene)


class Stop(NamedTuple):
    """A recovery: the row in which the grippers were stopped, and the first one whose reference is of a new plan."""

    first: int
    after: int


def stops_of(rollout: Rollout) -> list[Stop]:
    """The recoveries in order, each from where the reference stands still."""
    moves = np.abs(np.diff(rollout.reference, axis=0)).max(axis=(1, 2), initial=0.0) > STILL
    found = []
    for time in rollout.metadata.get("recovered", ()):
        after = int(np.searchsorted(rollout.times, time - 1e-6)) + 1
        begun = np.flatnonzero(moves[: max(after - 1, 0)])
        found.append(Stop(int(begun[-1]) + 1 if len(begun) else 0, min(after, rollout.steps)))
    return found


def left_of(plan: Plan, reference: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "k n 2"]:
    """Shapes of a plan [m] from the one nearest to a reference on."""
    return plan.shapes[int(np.argmin(np.linalg.norm(plan.shapes - reference, axis=(1, 2)))) :]


def draw_actual_scene(ax: Axes, task: Task, change: Change | None) -> list[Any]:
    """The scene with the obstacles where they are, and outlines of where the plan has them; legend entries of these."""
    scene.draw_scene(ax, task if change is None else task.in_scene(change.whole))
    if change is None or not change.expected.obstacles:
        return []
    scene.draw_solids(ax, change.expected, **EXPECTED)
    return [Patch(label="obstacle as planned", **EXPECTED)]


def draw_left(ax: Axes, shapes: Float[np.ndarray, "k n 2"]) -> list[Line2D]:
    """The gripper paths of the rest of a plan that was given up; its legend entry."""
    for end in (0, -1):
        ax.plot(*shapes[:, end].T, zorder=6, **LEFT)
    return [Line2D([], [], label="plan given up", **LEFT)]


def replanning_figure(task: Task, plan: Plan, rollout: Rollout) -> Figure:
    """For each recovery where the cable stopped and what became of its plan, and the new plan; then how it ended.

    Args:
        task: The task.
        plan: What was followed first.
        rollout: What happened, with at least one recovery.
    """
    change, stops = change_of(task, rollout), stops_of(rollout)[:STOPS_SHOWN]
    figure, panels = scene.panel_row(task, 2 * len(stops) + 1)
    for number, stop in enumerate(stops):
        given_up = left_of(plan, rollout.reference[stop.first]) if number == 0 else None
        until = stops[number + 1].first if number + 1 < len(stops) else rollout.steps
        _draw_stop(panels[2 * number], task, rollout, change, stop, given_up)
        _draw_new_plan(panels[2 * number + 1], task, rollout, change, range(stop.after, until + 1))
    _draw_end(panels[-1], task, rollout, change)
    scene.finish_row(panels)
    return figure


def _draw_stop(
    ax: Axes,
    task: Task,
    rollout: Rollout,
    change: Change | None,
    stop: Stop,
    given_up: Float[np.ndarray, "k n 2"] | None,
) -> None:
    handles = draw_actual_scene(ax, task, change)
    why = change.name if change is not None and change.known <= rollout.times[stop.after] else "off the plan"
    status = str(rollout.status[stop.first]).partition(";")[0] if rollout.steps else ""
    style.title(ax, f"{rollout.times[stop.first]:.1f} s: {why if 'blocked' in status else status}")
    _draw_way(ax, rollout, stop.first)
    if given_up is not None:
        handles += draw_left(ax, given_up)
    _draw_cable(ax, task, rollout, stop.after)
    style.legend_below(ax, [Patch(facecolor=palette.INK, label="cable"), *handles], 2)


def _draw_new_plan(ax: Axes, task: Task, rollout: Rollout, change: Change | None, rows: Sequence[int]) -> None:
    draw_actual_scene(ax, task, change)
    style.title(ax, f"{rollout.times[rows[0] - 1]:.1f} s: new plan")
    shapes = rollout.reference[rows]
    shown = spread_rows(shapes, SHAPES_SHOWN)
    colors = style.TIME(np.array(shown) / max(len(shapes) - 1, 1))
    scene.draw_cables(ax, scene.smooth(shapes[shown]), task.cable.radius, colors)
    for end in (0, -1):
        ax.plot(*shapes[:, end].T, color=palette.INK, linewidth=0.7, alpha=0.7, zorder=5)
        scene.draw_grippers(ax, shapes[shown, end], task.grippers.radius, zorder=6, linewidths=0.3)
    style.legend_below(
        ax, [Patch(facecolor=palette.START, label="begin"), Patch(facecolor=palette.GOAL, label="end")], 2
    )


def _draw_end(ax: Axes, task: Task, rollout: Rollout, change: Change | None) -> None:
    draw_actual_scene(ax, task, change)
    style.title(ax, f"{rollout.times[-1]:.1f} s: {rollout.outcome}")
    _draw_way(ax, rollout, rollout.steps)
    goal = ax.plot(*scene.smooth(task.goal).T, color=palette.GOAL, linewidth=3.5, alpha=0.5, zorder=3, label="goal")
    _draw_cable(ax, task, rollout, rollout.steps)
    style.legend_below(ax, [*goal, Line2D([], [], color=palette.MUTED, linewidth=0.9, label="gripper paths")], 2)


def _draw_way(ax: Axes, rollout: Rollout, row: int) -> None:
    """The gripper paths up to a row."""
    for side in (0, 1):
        ax.plot(*rollout.poses[: row + 1, side, :2].T, color=palette.MUTED, linewidth=0.9, zorder=3)


def _draw_cable(ax: Axes, task: Task, rollout: Rollout, row: int) -> None:
    scene.draw_cable(ax, rollout.centreline[row], task.cable.radius, palette.INK, zorder=5)
    scene.draw_grippers(ax, rollout.poses[row, :, :2], task.grippers.radius)
