"""The video of a run: the cable on its way and into the port, with errors and clearance running alongside."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg

from cableway.figures import palette, scene, style
from cableway.figures.film import write_film
from cableway.figures.moving import MovingScene, captions, moving_handles
from cableway.figures.perspective import CellView, way_of
from cableway.figures.plan import draw_clearance
from cableway.figures.rollout import draw_errors, stacked_errors
from cableway.figures.space import SpaceView
from cableway.records import INSERTION, Plan, Rollout
from cableway.scene.files.loading import AnyTask
from cableway.scene.spatial.task import SpatialTask

SIZE = (1280, 720)
"""Pixels of a frame, both multiples of 16 as H.264 likes them."""

INCH = 112
"""Pixels of a frame to the inch."""


class Layout(NamedTuple):
    """Where the panels of a frame are [inch]: left, bottom, width, height.

    Attributes:
        scene: A square that the scene seen from above is in.
        errors: The curves of errors.
        clearance: The curves of clearance.
        perspective: The cell in perspective; None without a cell.
    """

    scene: tuple[float, float, float, float]
    errors: tuple[float, float, float, float]
    clearance: tuple[float, float, float, float]
    perspective: tuple[float, float, float, float] | None = None


SPACE = Layout((0.14, 0.5, 6.3, 5.1), (6.95, 3.75, 4.21, 2.05), (6.95, 0.7, 4.21, 2.05))
"""In space, where the scene is in perspective."""

TABLE = Layout((0.54, 0.9, 4.8, 4.8), (6.7, 3.75, 4.46, 2.05), (6.7, 0.7, 4.46, 2.05))
"""Of grippers alone."""

CELL = Layout((7.72, 2.72, 3.2, 3.2), (0.7, 0.5, 4.6, 1.05), (6.4, 0.5, 4.6, 1.05), (0.54, 1.98, 6.4, 3.72))
"""Of a cell with arms."""

LONGEST = 30.0
"""Playing time [s] beyond which a video runs at twice the speed, four times, and so on."""

FINAL_PAUSE = 1.5
"""Time [s] for which the last frame stands still."""

FASTEST = 20
"""Most frames a second; a faster run leaves rows out."""


def write_video(
    path: Path,
    task: AnyTask,
    rollout: Rollout,
    insertion: Rollout | None = None,
    *,
    plan: Plan | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> None:
    """Write the video of a run (MP4, H.264), in real time unless that is longer than `LONGEST`.

    Args:
        path: Where to; written atomically.
        task: The task of the rollout, on the table or in space.
        rollout: What happened.
        insertion: And then, where a plug was inserted.
        plan: What was followed first, so that it can be shown where it was given up.
        progress: Called with "video" and the share done.

    Raises:
        CablewayError: The encoder failed.
    """
    in_space = isinstance(task, SpatialTask)
    stage = _SpatialStage(task, rollout) if in_space else _Stage(task, rollout, insertion, plan)
    rows, rate, speed = playback(stage.run)
    stage.title(speed)
    write_film(path, rate, _frames(stage, rows, rate, progress))


def playback(rollout: Rollout) -> tuple[range, float, int]:
    """The rows to show, the frames a second, and how many times faster than real time that is."""
    step = float(rollout.times[-1]) / max(rollout.steps, 1) or 1.0
    speed = 1
    while rollout.times[-1] / speed > LONGEST:
        speed *= 2
    stride = max(1, int(np.ceil(speed / (FASTEST * step) - 1e-9)))
    return range(0, len(rollout.times), stride), speed / (stride * step), speed


def joined(rollout: Rollout, insertion: Rollout | None) -> Rollout:
    """A rollout and the insertion after it, which begins where the rollout ends, as one without estimates."""
    if insertion is None:
        return rollout
    rows = ("keypoints", "observed", "poses", "centreline", "reference", "clearance", "gripper_clearance")
    with_arms = rollout.joints is not None and insertion.joints is not None
    parts: dict[str, Any] = {
        name: np.concatenate([getattr(rollout, name), getattr(insertion, name)[1:]])
        for name in (*rows, *(("joints",) if with_arms else ()))
    }
    steps = {
        name: np.concatenate([getattr(rollout, name), getattr(insertion, name)])
        for name in ("actions", "solve_time", "status")
    }
    times = np.concatenate([rollout.times, rollout.times[-1] + insertion.times[1:] - insertion.times[0]])
    return replace(rollout, times=times, estimates=None, deviations=None, **({"joints": None} | parts | steps))


def _frames(
    stage: _Stage, rows: range, rate: float, progress: Callable[[str, float], None] | None
) -> Iterator[np.ndarray]:
    """Frames (height, width, 4) of 8-bit colours; only what moves is drawn afresh."""
    shown = [*rows, *[stage.run.steps] * (round(FINAL_PAUSE * rate))]
    frame, last = stage.frame(shown[0]), shown[0]
    for count, row in enumerate(shown):
        if row != last:
            frame, last = stage.frame(row), row
        yield frame
        if progress is not None:
            progress("video", (count + 1) / len(shown))


class _Stage:
    """The figure of a frame: a still background, and the artists that change from row to row."""

    def __init__(self, task: AnyTask, rollout: Rollout, insertion: Rollout | None, plan: Plan | None = None) -> None:
        self._task: Any = task
        self._rollout, self._insertion = rollout, insertion
        self.run = joined(rollout, insertion)
        self._captions = self._said()
        if insertion is not None:
            self._captions += [INSERTION] * insertion.steps
        self._figure = style.new_figure(SIZE[0] / INCH, SIZE[1] / INCH)
        self._figure.set_dpi(INCH)
        self._moving: list[tuple[Axes, Artist]] = []
        self._layout = self._laid_out()
        self._build_scene(plan)
        self._build_curves()

    def _said(self) -> list[str]:
        """What is going on in each row of the rollout."""
        return captions(self._task, self._rollout)

    def _laid_out(self) -> Layout:
        return TABLE if way_of(self._task, self.run) is None else CELL

    def title(self, speed: int) -> None:
        """Write the title, and keep all that stands still."""
        label = f"{self._task.name}" + (f"   ({speed} x real time)" if speed > 1 else "")
        self._figure.text(0.6 / 12.8, 0.95, label, fontsize=12, fontweight="bold", color=palette.INK)
        self._canvas = FigureCanvasAgg(self._figure)
        self._canvas.draw()
        self._still = self._canvas.copy_from_bbox(self._figure.bbox)

    def _add(self, ax: Axes, artist: Artist) -> None:
        artist.set_animated(True)
        self._moving.append((ax, artist))

    def _build_scene(self, plan: Plan | None) -> None:
        left, bottom, side, _ = self._layout.scene
        width, height = scene.panel_size(self._task, side)
        ax = style.add_axes(self._figure, left + (side - width) / 2, bottom + (side - height) / 2, width, height)
        self._scene = MovingScene(ax, self._task, self.run, plan)
        self._view, clock = None, ax
        if self._layout.perspective is not None:
            clock = style.add_axes(self._figure, *self._layout.perspective)
            pixels = (round(INCH * self._layout.perspective[2]), round(INCH * self._layout.perspective[3]))
            self._view = CellView(self._task, self.run, pixels)
            self._add_picture(clock, self._view.image(0))
        for artist in self._scene.moving:
            self._add(ax, artist)
        self._add_clock(clock)
        style.legend_below(ax, moving_handles(self._task, self.run), 4)

    def _add_picture(self, ax: Axes, image: np.ndarray) -> None:
        """A panel for pictures in perspective."""
        self._picture = ax.imshow(image, aspect="auto", interpolation="nearest")
        ax.set_axis_off()
        self._add(ax, self._picture)

    def _add_clock(self, ax: Axes) -> None:
        """The time above a panel."""
        self._clock = ax.text(0.0, 1.02, "", transform=ax.transAxes, fontsize=11, color=palette.INK)
        self._add(ax, self._clock)

    def _show(self, row: int) -> None:
        """The scene in one row."""
        self._scene.show(row)
        if self._view is not None:
            self._picture.set_data(self._view.image(row))

    def _build_curves(self) -> None:
        run, tracked = self.run, len(self._rollout.times)
        above = style.add_axes(self._figure, *self._layout.errors)
        to_goal, to_reference = stacked_errors(self._task, run)
        draw_errors(above, run.times, to_goal[:tracked], to_reference)
        below = style.add_axes(self._figure, *self._layout.clearance)
        draw_clearance(below, "clearance", run.times, run.clearance, run.gripper_clearance)
        self._cursors = []
        for ax in (above, below):
            ax.set_xlim(0, max(float(run.times[-1]), 1e-3))
            if self._insertion is not None:
                ax.axvline(self._rollout.times[-1], color=palette.MUTED, linewidth=1.0, linestyle=":")
                ax.annotate(
                    f" {INSERTION}", (self._rollout.times[-1], 1), xycoords=("data", "axes fraction"), ha="left",
                    va="top", fontsize=style.NOTE, color=palette.MUTED,
                )  # fmt: skip
            future = ax.axvspan(0, 1, color="white", alpha=0.75, linewidth=0, zorder=3)
            cursor = ax.axvline(0, color=palette.GOAL, linewidth=1.2, zorder=4)
            self._cursors.append((future, cursor))
            self._add(ax, future)
            self._add(ax, cursor)

    def frame(self, row: int) -> np.ndarray:
        """The picture of one row."""
        now, end = float(self.run.times[row]), float(self.run.times[-1])
        self._show(row)
        self._clock.set_text(f"{now:.1f} s   {self._captions[row]}")
        for future, cursor in self._cursors:
            future.set_x(now)
            future.set_width(max(end - now, 0.0))
            cursor.set_xdata([now, now])
        self._canvas.restore_region(self._still)
        for ax, artist in self._moving:
            ax.draw_artist(artist)
        return np.asarray(self._canvas.buffer_rgba())


class _SpatialStage(_Stage):
    """The same in space."""

    def __init__(self, task: SpatialTask, rollout: Rollout) -> None:
        super().__init__(task.as_recorded(rollout.metadata), rollout, None)

    def _said(self) -> list[str]:
        return ["", *map(str, self._rollout.status)]

    def _laid_out(self) -> Layout:
        return SPACE

    def _build_scene(self, plan: Plan | None) -> None:
        left, bottom, width, height = self._layout.scene
        ax = style.add_axes(self._figure, left, bottom, width, height)
        self._space = SpaceView(self._task, pixels=(round(INCH * width), round(INCH * height)))
        self._add_picture(ax, self._image(0))
        self._add_clock(ax)

    def _show(self, row: int) -> None:
        self._picture.set_data(self._image(row))

    def _image(self, row: int) -> np.ndarray:
        """The cable and its grippers on the way, and the goal."""
        goal, run = self._task.stations("goal"), self.run
        cables = [(goal, palette.GOAL), (run.centreline[row], palette.INK)]
        return self._space.picture(cables, [(run.poses[row], palette.MUTED)]).color
