"""The moving picture of README and docs/planning.md: an obstacle closes the way, and the cable finds another one.

    .venv/bin/python studies/moving_picture.py [--out docs/images/replanning.gif]

The task, the plant and the run are those of docs/planning.md ("Replanning").
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PathCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from PIL import Image

import cableway as cw
from cableway.core.files import write_atomically
from cableway.figures import palette, scene, style
from cableway.figures.moving import MovingScene
from cableway.figures.plan import spread_rows
from cableway.figures.replanning import EXPECTED, LEFT, STILL, UNSEEN, Stop, stops_of
from cableway.records import Plan, Rollout
from cableway.workflow.run import Run, SolveOptions
from cableway.workflow.solve import solve

TASK = "multi-obstacle-1"
PLANT = cw.Perturbation(obstacles=((-0.06, 0.0), *[(0.0, 0.0)] * 3), revealed=4.5)

SIZE, INCH, SIDE, MARGIN = (7.2, 5.2), 100, 4.9, 0.15
"""Width and height [inch], pixels to the inch; side of the scene and the space round it [inch]."""

SPEED, RATE = 2, 10
"""Times real time, and frames a second."""

SHOWN, LAST = 1.8, 2.5
"""Seconds for which a plan and the end stand still."""

COLORS = 128
"""Of the palette, which all frames share."""

STEPS = ("1  plan", "2  track", "3  obstacle moved:\n    stop", "4  plan anew", "5  track", "6  goal reached")


@dataclass(frozen=True)
class Moment:
    """A frame: the row of the run, which of `STEPS` it belongs to, and the plan that is shown, if one is."""

    row: int
    step: int
    plan: np.ndarray | None = None
    seconds: float = 1 / RATE


def moments(plan: Plan, run: Rollout, stop: Stop) -> Iterator[Moment]:
    """All frames in order, from where the grippers first move."""
    moves = np.flatnonzero(np.abs(np.diff(run.reference, axis=0)).max(axis=(1, 2)) > STILL)
    begun, again = int(moves[0]), int(moves[moves >= stop.after][0])
    yield Moment(begun, 0, plan.shapes, SHOWN)
    yield from (Moment(row, 1) for row in range(begun, stop.first, SPEED))
    yield Moment(stop.first, 2, seconds=SHOWN / 2)
    yield from (Moment(row, 2) for row in range(stop.first, stop.after, SPEED))
    yield Moment(stop.after, 3, run.reference[stop.after :], SHOWN)
    yield from (Moment(row, 4) for row in range(again, run.steps, SPEED))
    yield Moment(run.steps, 5, seconds=LAST)


class Picture:
    """The scene on the left, what is going on on the right."""

    def __init__(self, found: Run) -> None:
        assert found.plan is not None
        assert found.rollout is not None
        self._task, self._run = found.task, found.rollout
        self._figure = style.new_figure(*SIZE)
        self._figure.set_dpi(INCH)
        self._canvas = FigureCanvasAgg(self._figure)
        self._ax = style.add_axes(self._figure, MARGIN, MARGIN, SIDE, SIDE)
        self._scene = MovingScene(self._ax, found.task, found.rollout, found.plan)
        self._ax.set(xticks=[], yticks=[], xlabel="", ylabel="")
        self._side = style.add_axes(self._figure, SIDE + 2 * MARGIN, MARGIN, SIZE[0] - SIDE - 3 * MARGIN, SIDE)
        self._side.set(xlim=(0, 1), ylim=(0, 1))
        self._side.set_axis_off()
        handles = [
            Patch(label="not seen yet", **UNSEEN), Line2D([], [], label="plan given up", **LEFT),
            Patch(label="as planned", **EXPECTED),
        ]  # fmt: skip
        self._side.legend(
            handles=handles, loc="lower left", bbox_to_anchor=(0, 0.34), frameon=False, fontsize=10.5, borderpad=0,
            borderaxespad=0, handlelength=1.6, labelcolor=palette.MUTED,
        )  # fmt: skip

    def draw(self, moment: Moment) -> Image.Image:
        """A frame."""
        self._scene.show(moment.row)
        shown = [] if moment.plan is None else [self._draw_plan(self._ax, moment.plan)]
        self._write(moment)
        self._canvas.draw()
        for artist in shown:
            artist.remove()
        return Image.fromarray(np.asarray(self._canvas.buffer_rgba())).convert("RGB")

    def _draw_plan(self, ax: Axes, shapes: np.ndarray) -> PathCollection:
        rows = spread_rows(shapes, 16)
        colors = style.TIME(rows / (len(shapes) - 1))
        return scene.draw_cables(ax, scene.smooth(shapes[rows]), self._task.cable.radius, colors, alpha=0.75)

    def _write(self, moment: Moment) -> None:
        """The steps, the present one in bold; time, distance from the goal and clearance."""
        for text in list(self._side.texts):
            text.remove()
        y = 0.98
        for number, name in enumerate(STEPS):
            now = number == moment.step
            color = palette.BAD if now and number == 2 else palette.INK if now else "#a9b1ba"
            self._side.text(0, y, name, fontsize=13, fontweight="bold" if now else None, color=color, va="top")
            y -= 0.115 if "\n" in name else 0.075
        row, run = moment.row, self._run
        away = 1000 * float(np.linalg.norm(run.keypoints[row] - self._task.goal, axis=1).mean())
        facts = (
            ("time", f"{run.times[row]:.1f} s"),
            ("to the goal", f"{away:.{0 if away > 10 else 1}f} mm"),
            ("clearance", f"{1000 * min(run.clearance[row], run.gripper_clearance[row]):.0f} mm"),
        )
        for place, (name, value) in enumerate(facts):
            height = 0.25 - 0.07 * place
            self._side.text(0, height, name, fontsize=11, color=palette.MUTED)
            self._side.text(1, height, value, fontsize=12, color=palette.INK, ha="right")
        self._side.text(0, 0.0, f"simulation, {SPEED} x real time", fontsize=10, color=palette.MUTED)


def write_gif(path: Path, frames: list[Image.Image], seconds: list[float]) -> None:
    """Write frames that share one palette, without dithering, so that what stands still costs nothing."""
    every = frames[:: max(1, len(frames) // 12)]
    sheet = Image.new("RGB", (every[0].width, every[0].height * len(every)))
    for place, frame in enumerate(every):
        sheet.paste(frame, (0, place * frame.height))
    shared = sheet.quantize(COLORS, method=Image.Quantize.MAXCOVERAGE)
    first, *rest = (frame.quantize(palette=shared, dither=Image.Dither.NONE) for frame in frames)
    durations = [round(1000 * value) for value in seconds]
    write_atomically(
        path,
        lambda file: first.save(
            file, format="gif", save_all=True, append_images=rest, duration=durations, loop=0, optimize=True, disposal=1
        ),
    )


def main() -> None:
    """Run the task, draw it, and say what it came to."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--out", type=Path, default=Path("docs/images/replanning.gif"))
    given = parser.parse_args()
    found = solve(cw.load_task(TASK), SolveOptions(perturbation=PLANT))
    assert found.plan is not None
    assert found.rollout is not None
    (stop,) = stops_of(found.rollout)
    picture, shown = Picture(found), list(moments(found.plan, found.rollout, stop))
    write_gif(given.out, [picture.draw(moment) for moment in shown], [moment.seconds for moment in shown])
    seconds, size = sum(moment.seconds for moment in shown), given.out.stat().st_size
    print(f"{given.out}: {len(shown)} frames, {seconds:.0f} s, {size / 1e3:.0f} kB")
    print(found.report)


if __name__ == "__main__":
    main()
