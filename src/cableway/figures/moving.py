"""The scene of a run in motion: a still background, and the artists that change from row to row."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.path import Path as Outline

from cableway.figures import scene, style
from cableway.records import Rollout
from cableway.scene.task import Task

STILL = 1e-6
"""Most that a reference moves [m] while it waits."""


class MovingScene:
    """Cable, reference, grippers and plug in their scene.

    Args:
        ax: Where to.
        task: The task of the run.
        run: All rows.

    Attributes:
        moving: What is to be drawn anew after `show`.
    """

    def __init__(self, ax: Axes, task: Task, run: Rollout) -> None:
        self._task, self._run = task, run
        scene.draw_scene(ax, task)
        radius = task.cable.radius
        scene.draw_cable(ax, scene.smooth(task.start), radius, style.START, alpha=0.3)
        scene.draw_cable(ax, scene.smooth(task.goal), radius, style.GOAL, alpha=0.5)
        self._trails = [ax.plot([], [], color=style.MUTED, linewidth=0.9, zorder=3)[0] for _ in (0, 1)]
        self._cable = scene.draw_cable(ax, run.centreline[0], radius, style.INK, zorder=5)
        self._reference = ax.plot([], [], color=style.REFERENCE, linewidth=1.2, linestyle=(0, (3, 2)), zorder=6)[0]
        self._grippers = scene.draw_grippers(ax, run.poses[0, :, :2], task.grippers.radius, linewidths=1.1)
        self._plug = ax.fill([0, 0, 0], [0, 0, 0], color=style.MUTED, zorder=4)[0] if task.plug is not None else None
        parts: list[Artist | None] = [*self._trails, self._cable, self._reference, self._plug]
        self.moving = [part for part in (*parts, self._grippers) if part is not None]

    def show(self, row: int) -> None:
        """Put everything where it is in a row."""
        run, task = self._run, self._task
        self._cable.set_path(scene.cable_path(run.centreline[row], task.cable.radius))
        self._reference.set_data(*scene.smooth(run.reference[row]).T)
        self._grippers.set_paths([Outline.circle((x, y), task.grippers.radius) for x, y in run.poses[row, :, :2]])
        for side, trail in enumerate(self._trails):
            trail.set_data(*run.poses[: row + 1, side, :2].T)
        if self._plug is not None:
            self._plug.set_xy(scene.plug_corners(task, run.poses[row, 1]))


def moving_handles() -> list[Patch | Line2D]:
    """Legend entries of what `MovingScene` draws."""
    return [
        Patch(facecolor=style.INK, label="cable"),
        Line2D([], [], color=style.REFERENCE, linewidth=1.6, linestyle=(0, (3, 2)), label="reference"),
        Patch(facecolor=style.GOAL, alpha=0.5, label="goal"),
        Patch(facecolor=style.START, alpha=0.3, label="start"),
    ]


def captions(rollout: Rollout) -> list[str]:
    """What is going on in each row, in a few words."""
    still = np.abs(rollout.reference - rollout.reference[0]).max(axis=(1, 2)) <= STILL
    led = np.abs(rollout.reference - rollout.reference[-1]).max(axis=(1, 2)) > STILL
    first = len(still) if still.all() else int(np.argmin(still))
    last = int(np.flatnonzero(led)[-1]) + 1 if led.any() else 0
    holding = "hold" if rollout.estimates is None else "hold: estimates settle"
    said = ["", *(str(status).partition(";")[0] for status in rollout.status)]
    usual = [holding if row < first else "tracking" if row <= last else "settling" for row in range(len(still))]
    return [usual[row] if text in ("", "tracking") else text for row, text in enumerate(said)]
