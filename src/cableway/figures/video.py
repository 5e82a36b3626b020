"""The video of a rollout: the cable on its way, with errors and clearance running alongside."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.path import Path as Outline

from cableway.core.errors import CablewayError
from cableway.core.files import write_atomically
from cableway.figures import scene, style
from cableway.figures.plan import draw_clearance
from cableway.figures.rollout import draw_errors, stacked_errors
from cableway.records import Rollout
from cableway.scene.task import Task

SIZE = (1280, 720)
"""Pixels of a frame, both multiples of 16 as H.264 likes them."""

INCH = 100
"""Pixels of a frame to the inch."""

LONGEST = 30.0
"""Playing time [s] beyond which a video runs at twice the speed, four times, and so on."""

FINAL_PAUSE = 1.5
"""Time [s] for which the last frame stands still."""

FASTEST = 20
"""Most frames a second; a faster run leaves rows out."""

BELOW_LEGEND = 0.8
"""Share of the curves' height that their legend leaves free; drawing a legend in every frame would be slow."""


def write_video(
    path: Path, task: Task, rollout: Rollout, *, progress: Callable[[str, float], None] | None = None
) -> None:
    """Write the video of a rollout (MP4, H.264), in real time unless that is longer than `LONGEST`.

    Args:
        path: Where to; written atomically.
        task: The task of the rollout.
        rollout: What happened.
        progress: Called with "video" and the share done.

    Raises:
        CablewayError: The encoder failed.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    rows, rate, speed = playback(rollout)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.") as folder:
        film = Path(folder) / "film.mp4"
        try:
            _encode(film, rate, _frames(task, rollout, rows, rate, speed, progress))
        except (OSError, RuntimeError) as error:
            raise CablewayError(f"{path}: the video could not be encoded ({error})") from error
        with film.open("rb") as source:
            write_atomically(path, lambda file: shutil.copyfileobj(source, file))


def playback(rollout: Rollout) -> tuple[range, float, int]:
    """The rows to show, the frames a second, and how many times faster than real time that is."""
    step = float(rollout.times[-1]) / max(rollout.steps, 1) or 1.0
    speed = 1
    while rollout.times[-1] / speed > LONGEST:
        speed *= 2
    stride = max(1, int(np.ceil(speed / (FASTEST * step) - 1e-9)))
    return range(0, len(rollout.times), stride), speed / (stride * step), speed


def _encode(path: Path, rate: float, frames: Iterator[np.ndarray]) -> None:
    """Send frames to ffmpeg.

    Its process is started here and not by imageio-ffmpeg, which forks to do so: a risk where JAX's threads run.
    A group of its own keeps ctrl-c from it.
    """
    raw = ["-f", "rawvideo", "-pix_fmt", "rgba", "-s", f"{SIZE[0]}x{SIZE[1]}", "-r", f"{rate:.6g}", "-i", "-"]
    coded = ["-an", "-vcodec", "libx264", "-pix_fmt", "yuv420p", "-preset", "veryfast", "-crf", "19"]
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", *raw, *coded, "-movflags", "+faststart", str(path)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, process_group=0
    ) as encoder:
        assert encoder.stdin is not None
        assert encoder.stderr is not None
        try:
            with encoder.stdin as sink:
                for frame in frames:
                    sink.write(np.ascontiguousarray(frame).data)
        except BrokenPipeError:
            pass  # ffmpeg gave up; it says why
        except BaseException:
            encoder.kill()
            encoder.wait()  # `with` alone does not wait after an interrupt
            raise
        complaint = encoder.stderr.read().decode(errors="replace").strip()
    if encoder.returncode != 0:
        raise OSError(complaint.splitlines()[-1] if complaint else f"ffmpeg ended with {encoder.returncode}")


def _frames(
    task: Task,
    rollout: Rollout,
    rows: range,
    rate: float,
    speed: int,
    progress: Callable[[str, float], None] | None,
) -> Iterator[np.ndarray]:
    """Frames (height, width, 4) of 8-bit colours; only what moves is drawn afresh."""
    stage = _Stage(task, rollout, speed)
    shown = [*rows, *[rollout.steps] * (round(FINAL_PAUSE * rate))]
    for count, row in enumerate(shown):
        yield stage.frame(row)
        if progress is not None:
            progress("video", (count + 1) / len(shown))


class _Stage:
    """The figure of a frame: a still background, and the artists that change from row to row."""

    def __init__(self, task: Task, rollout: Rollout, speed: int) -> None:
        self._task, self._rollout = task, rollout
        self._figure = style.new_figure(SIZE[0] / INCH, SIZE[1] / INCH)
        self._figure.set_dpi(INCH)
        self._moving: list[tuple[Axes, Artist]] = []
        self._build_scene()
        self._build_curves()
        label = f"{task.name}" + (f"   ({speed} x real time)" if speed > 1 else "")
        self._figure.text(0.045, 0.945, label, fontsize=13, fontweight="bold", color=style.INK)
        self._canvas = FigureCanvasAgg(self._figure)
        self._canvas.draw()
        self._still = self._canvas.copy_from_bbox(self._figure.bbox)

    def _add(self, ax: Axes, artist: Artist) -> None:
        artist.set_animated(True)
        self._moving.append((ax, artist))

    def _build_scene(self) -> None:
        task, rollout = self._task, self._rollout
        width, height = scene.panel_size(task)
        grow = 5.9 / scene.PANEL
        ax = style.add_axes(self._figure, 0.6, 0.78 + (5.9 - grow * height) / 2, grow * width, grow * height)
        scene.draw_scene(ax, task)
        radius = task.cable.radius
        scene.draw_cable(ax, scene.smooth(task.start), radius, style.START, alpha=0.22)
        scene.draw_cable(ax, scene.smooth(task.goal), radius, style.GOAL, alpha=0.45)
        self._trails = [ax.plot([], [], color=style.MUTED, linewidth=0.9, zorder=3)[0] for _ in (0, 1)]
        self._cable = scene.draw_cable(ax, rollout.centreline[0], radius, style.INK, zorder=5)
        self._reference = ax.plot([], [], color="#ffb454", linewidth=1.2, linestyle=(0, (3, 2)), zorder=6)[0]
        self._grippers = scene.draw_grippers(ax, rollout.poses[0, :, :2], task.grippers.radius, linewidths=1.1)
        self._plug = ax.fill([0, 0, 0], [0, 0, 0], color=style.MUTED, zorder=4)[0] if task.plug is not None else None
        self._clock = ax.text(
            0.985, 1.02, "", transform=ax.transAxes, ha="right", fontsize=12, color=style.INK, family="DejaVu Sans Mono"
        )
        moving = [*self._trails, self._cable, self._reference, self._plug, self._grippers, self._clock]
        for artist in moving:
            if artist is not None:
                self._add(ax, artist)
        handles = [
            Patch(facecolor=style.INK, label="cable"),
            Line2D([], [], color="#ffb454", linewidth=1.6, linestyle=(0, (3, 2)), label="reference"),
            Patch(facecolor=style.GOAL, alpha=0.45, label="goal"),
            Patch(facecolor=style.START, alpha=0.22, label="start"),
        ]
        style.legend_below(ax, handles, 4)

    def _build_curves(self) -> None:
        left, wide, tall = 7.5, 5.0, 2.45
        rollout = self._rollout
        above = style.add_axes(self._figure, left, 4.2, wide, tall)
        draw_errors(above, rollout.times, *stacked_errors(self._task, rollout))
        style.title(above, "stacked shape error")
        below = style.add_axes(self._figure, left, 0.78, wide, tall)
        draw_clearance(below, rollout.times, rollout.clearance, rollout.gripper_clearance)
        style.title(below, "clearance")
        self._cursors = []
        for ax in (above, below):
            for line in ax.lines[:2]:
                line.set_alpha(0.9)
            future = ax.axvspan(0, 1, ymax=BELOW_LEGEND, color="white", alpha=0.75, linewidth=0, zorder=3)
            cursor = ax.axvline(0, ymax=BELOW_LEGEND, color=style.GOAL, linewidth=1.2, zorder=4)
            ax.set_xlim(0, max(float(rollout.times[-1]), 1e-3))
            self._cursors.append((future, cursor))
            self._add(ax, future)
            self._add(ax, cursor)

    def frame(self, row: int) -> np.ndarray:
        """The picture of one row."""
        rollout, task = self._rollout, self._task
        now = float(rollout.times[row])
        self._cable.set_path(scene.cable_path(rollout.centreline[row], task.cable.radius))
        self._reference.set_data(*scene.smooth(rollout.reference[row]).T)
        self._grippers.set_paths([Outline.circle((x, y), task.grippers.radius) for x, y in rollout.poses[row, :, :2]])
        for side, trail in enumerate(self._trails):
            trail.set_data(*rollout.poses[: row + 1, side, :2].T)
        if self._plug is not None:
            self._plug.set_xy(scene.plug_corners(task, rollout.poses[row, 1]))
        self._clock.set_text(f"{now:5.1f} s")
        for future, cursor in self._cursors:
            future.set_x(now)
            future.set_width(max(float(rollout.times[-1]) - now, 0.0))
            cursor.set_xdata([now, now])
        self._canvas.restore_region(self._still)
        for ax, artist in self._moving:
            ax.draw_artist(artist)
        return np.asarray(self._canvas.buffer_rgba())
