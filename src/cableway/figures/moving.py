"""The scene of a run in motion: a still background, and the artists that change from row to row."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.path import Path as Outline

from cableway.figures import palette, scene
from cableway.figures.replanning import EXPECTED, LEFT, STILL, UNSEEN, change_of, left_of, stops_of
from cableway.records import Plan, Rollout
from cableway.scene.bodies import outer_bodies
from cableway.scene.task import Task

REMEMBERED = 3.0
"""Time [s] for which a plan that was given up is still drawn, and the new one called new."""

SEEN: dict[str, Any] = {
    "facecolor": palette.OBSTACLE, "edgecolor": palette.OBSTACLE_EDGE, "hatch": "", "linestyle": "-",
}  # fmt: skip
"""How an obstacle is drawn that the controller knows of."""

AHEAD: dict[str, Any] = {"color": palette.REFERENCE, "linewidth": 1.0, "alpha": 0.8}
"""How the gripper paths to come are drawn."""


class MovingScene:
    """Cable, reference, grippers and plug in their scene.

    Args:
        ax: Where to.
        task: The task of the run.
        run: All rows.
        plan: What was followed first; of a plan that was given up the rest is drawn, too.

    Attributes:
        moving: What is to be drawn anew after `show`.
    """

    def __init__(self, ax: Axes, task: Task, run: Rollout, plan: Plan | None = None) -> None:
        self._task, self._run, self._plan = task, run, plan
        self._change, self._stops = change_of(task, run), stops_of(run)
        scene.draw_scene(ax, task if self._change is None else task.in_scene(self._change.kept))
        obstacles: list[Artist] = []
        if self._change is not None:
            self._expected, self._actual = (
                scene.draw_solids(ax, some) for some in (self._change.expected, self._change.actual)
            )
            obstacles = [self._expected, self._actual]
        radius = task.cable.radius
        scene.draw_cable(ax, scene.smooth(task.start), radius, palette.START, alpha=0.3)
        scene.draw_cable(ax, scene.smooth(task.goal), radius, palette.GOAL, alpha=0.5)
        self._trails = [ax.plot([], [], color=palette.MUTED, linewidth=0.9, zorder=3)[0] for _ in (0, 1)]
        self._ahead = [ax.plot([], [], zorder=3, **AHEAD)[0] for _ in (0, 1)]
        self._left = [ax.plot([], [], zorder=3, **LEFT)[0] for _ in (0, 1)]
        self._cable = scene.draw_cable(ax, run.centreline[0], radius, palette.INK, zorder=5)
        self._reference = ax.plot([], [], color=palette.REFERENCE, linewidth=1.2, linestyle=(0, (3, 2)), zorder=6)[0]
        self._grippers = scene.draw_grippers(ax, run.poses[0, :, :2], task.grippers.radius, linewidths=1.1)
        self._plug = ax.fill([0, 0, 0], [0, 0, 0], color=palette.MUTED, zorder=4)[0] if task.plug is not None else None
        self._bodies = [
            (body, ax.fill([0, 0, 0], [0, 0, 0], color=palette.MUTED, alpha=0.3, linewidth=0, zorder=4)[0])
            for body in outer_bodies(task.grippers.pieces, [None])
        ]
        lines = [*self._trails, *self._ahead, *self._left]
        parts: list[Artist | None] = [*obstacles, *lines, self._cable, self._reference, self._plug]
        parts += [patch for _, patch in self._bodies]
        self.moving = [part for part in (*parts, self._grippers) if part is not None]

    def show(self, row: int) -> None:
        """Put everything where it is in a row."""
        run, task = self._run, self._task
        self._cable.set_path(scene.cable_path(run.centreline[row], task.cable.radius))
        self._reference.set_data(*scene.smooth(run.reference[row]).T)
        self._grippers.set_paths([Outline.circle((x, y), task.grippers.radius) for x, y in run.poses[row, :, :2]])
        for side, trail in enumerate(self._trails):
            trail.set_data(*run.poses[: row + 1, side, :2].T)
        for lines, shapes in ((self._ahead, self.ahead(row)), (self._left, self.left(row))):
            for end, line in zip((0, -1), lines, strict=True):
                line.set_data(*shapes[:, end].T)
        if self._change is not None:
            known = bool(run.times[row] >= self._change.known)
            self._expected.set(**(EXPECTED if known else SEEN))
            self._actual.set(**(SEEN if known else UNSEEN))
        for body, patch in self._bodies:
            patch.set_xy(body.placed(run.poses[row, body.side]))
        if self._plug is not None:
            self._plug.set_xy(scene.plug_corners(task, run.poses[row, 1]))

    def ahead(self, row: int) -> Float[np.ndarray, "k n 2"]:
        """The shapes to come [m] of the plan that is followed in a row; none where the cable waits for one."""
        run = self._run
        for number, stop in enumerate(self._stops):
            if row < stop.first:
                if number == 0 and self._plan is not None:
                    return left_of(self._plan, run.reference[row])
                return run.reference[row : stop.first]
            if row < stop.after:
                return run.reference[:0]
        return run.reference[row:]

    def left(self, row: int) -> Float[np.ndarray, "k n 2"]:
        """What would have been left [m] of the first plan, where it was given up a moment ago; else nothing."""
        run = self._run
        if self._plan is not None and self._stops:
            first, after = self._stops[0]
            if first <= row and run.times[row] < run.times[after] + REMEMBERED:
                return left_of(self._plan, run.reference[first])
        return run.reference[:0]


def moving_handles(task: Task, run: Rollout) -> list[Patch | Line2D]:
    """Legend entries of what `MovingScene` draws."""
    change = change_of(task, run)
    handles: list[Patch | Line2D] = [
        Patch(facecolor=palette.INK, label="cable"),
        Line2D([], [], color=palette.REFERENCE, linewidth=1.6, linestyle=(0, (3, 2)), label="reference"),
        Patch(facecolor=palette.GOAL, alpha=0.5, label="goal"),
        Patch(facecolor=palette.START, alpha=0.3, label="start"),
        Line2D([], [], label="way ahead", **AHEAD),
    ]
    if stops_of(run):
        handles.append(Line2D([], [], label="plan given up", **LEFT))
    if change is not None and change.known > 0:
        handles.append(Patch(label="obstacle not seen yet", **UNSEEN))
    if change is not None and change.expected.obstacles:
        handles.append(Patch(label="obstacle as planned", **EXPECTED))
    return handles


def captions(task: Task, rollout: Rollout) -> list[str]:
    """What is going on in each row, in a few words."""
    still = np.abs(rollout.reference - rollout.reference[0]).max(axis=(1, 2)) <= STILL
    led = np.abs(rollout.reference - rollout.reference[-1]).max(axis=(1, 2)) > STILL
    first = len(still) if still.all() else int(np.argmin(still))
    last = int(np.flatnonzero(led)[-1]) + 1 if led.any() else 0
    holding = "hold" if rollout.estimates is None else "hold: estimates settle"
    said = ["", *(str(status).partition(";")[0] for status in rollout.status)]
    usual = [holding if row < first else "tracking" if row <= last else "settling" for row in range(len(still))]
    told = [usual[row] if text in ("", "tracking") else text for row, text in enumerate(said)]
    change = change_of(task, rollout)
    for stop in stops_of(rollout):
        if change is not None and change.known <= rollout.times[stop.after]:
            for row in range(stop.first, stop.after):
                told[row] = told[row].replace("the way is blocked", change.name)
        lately = np.flatnonzero(rollout.times <= rollout.times[stop.after] + REMEMBERED)
        for row in range(stop.after, int(lately[-1]) + 1):
            told[row] = told[row].replace("tracking", "replanned")
    return told
