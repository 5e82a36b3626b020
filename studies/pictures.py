"""The pictures of README and documentation, except those of the simulator, which `simulator_accuracy.py` makes.

    .venv/bin/python studies/pictures.py [NAME ...]

All of `PICTURES` unless named; about a minute on one core. The same code makes the same pictures.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

import cableway as cw
from cableway.core.errors import PlanningError, TaskError
from cableway.core.files import write_atomically
from cableway.figures import scene, style
from cableway.figures.plan import (
    alternatives_figure,
    attempt_figure,
    draw_clearance,
    draw_routes,
    draw_shapes,
    plan_figure,
)
from cableway.figures.rollout import draw_tracking, rollout_figure
from cableway.planning.config import PivotConfig
from cableway.planning.initial_trajectories import InitialTrajectories
from cableway.planning.routes.passages import find_passages
from cableway.records import Rollout
from cableway.scene.task import CONTROL_STEP, Task
from cableway.tang2025.planning.chain import PaperChain
from cableway.tang2025.planning.config import PathSetConfig
from cableway.tang2025.planning.path_set import generate_path_set

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / "docs" / "images"

EXAMPLE = "multi-obstacle-1"
"""The task on which the stages of the method are shown."""

PIXELS, TALL, DOTS_PER_INCH = 1500, 1250, 125
"""Most pixels across a picture, up it, and in an inch of it."""

WEIGHTS = ((0.0, style.INK), (0.01, style.LEFT), (0.1, style.RIGHT), (1.0, style.PIVOT))
"""Clearance weights k_c [m] of the pivot paths shown, with their colours."""

MARGIN, BETWEEN, BAR, CURVES = 0.7, 1.0, 0.8, 4.2
"""Inches left of a row of panels, between panels, for a colour bar beside one, and the width of a column of curves."""


def _row(
    task: Task, widths: Sequence[float], between: float = BETWEEN, right: float = 0.4
) -> tuple[Figure, list[Axes]]:
    """A figure with panels side by side, as high as a panel for the task's scene."""
    height = scene.panel_size(task)[1]
    lefts = [MARGIN + sum(widths[:k]) + between * k for k in range(len(widths))]
    figure = style.new_figure(lefts[-1] + widths[-1] + right, height + 1.5)
    return figure, [style.add_axes(figure, x, 1.0, width, height) for x, width in zip(lefts, widths, strict=True)]


def _trajectories(task: Task, clearance_weight: float = 1.0) -> InitialTrajectories:
    return InitialTrajectories(task, cw.PlannerConfig(pivot=PivotConfig(clearance_weight=clearance_weight)))


def pivot() -> Figure:
    """All passages of the scene, and pivot paths with different weights of clearance."""
    task = cw.load_task(EXAMPLE)
    side = scene.panel_size(task)[0]
    figure, (left, right) = _row(task, (side, side))
    style.title(left, "passages")
    draw_routes(left, task, passages=np.array([passage.ends for passage in cw.find_passages(task.scene)]))
    style.legend_below(left, [*scene.end_handles(), _line(style.PASSAGE, "passage")], 5)
    style.title(right, "pivot paths")
    scene.draw_scene(right, task)
    handles = []
    for weight, colour in WEIGHTS:
        right.plot(*_trajectories(task, weight).pivot.T, color=colour, linewidth=2.2, zorder=5)
        handles.append(_line(colour, f"clearance weight {weight:g} m"))
    scene.draw_end_shapes(right, task)
    style.legend_below(right, handles, 2)
    return figure


def _line(colour: str, label: str) -> Line2D:
    return Line2D([], [], color=colour, linewidth=2.2, label=label)


def path_set() -> Figure:
    """The paper's path set and ours along the same pivot path."""
    task = cw.load_task(EXAMPLE)
    side = scene.panel_size(task)[0]
    figure, panels = _row(task, (side, side))
    route, passages = _trajectories(task).pivot, find_passages(task.scene)
    for ax, kind, title in zip(
        panels, ("transfer", "homotopic"), ("linear transfer", "one homotopy class"), strict=True
    ):
        paths = generate_path_set(task, route, passages, PathSetConfig(kind=kind))
        draw_routes(ax, task, paths.pivot, paths.paths, paths.passages)
        style.title(ax, f"path set: {title}")
    return figure


def deformation() -> Figure:
    """The optimised shapes along the path set, and how far each keypoint is along its path over time."""
    task = cw.load_task(EXAMPLE)
    figure, (left, right) = _row(task, (scene.panel_size(task)[0], CURVES), BETWEEN + BAR)
    shapes, stages = PaperChain(task, cw.PlannerConfig(), _trajectories(task).pivot).deformation("head")
    draw_shapes(left, task, shapes)
    style.title(left, "deformation, optimised along the path set")
    last = stages.progress.shape[1] - 1
    for i, curve in enumerate(stages.progress.T):
        ends = {0: "left gripper", last: "right gripper"}
        right.plot(curve, color=style.TIME(i / last), linewidth=1.4, label=ends.get(i))
    style.title(right, "progress σ of each keypoint")
    style.curve_axes(right, "step", "share of the path")
    right.legend(fontsize=8.5, frameon=False, labelcolor=style.INK)
    return figure


def projection() -> Figure:
    """What the search among equilibria finds, and the plan made of it."""
    task = cw.load_task(EXAMPLE)
    side = scene.panel_size(task)[0]
    figure, (left, right) = _row(task, (side, side), BETWEEN + BAR, BAR + 0.2)
    draw_shapes(left, task, _trajectories(task).make("corridor").shapes)
    style.title(left, "initial trajectory: found among equilibria")
    found = cw.plan(task)
    draw_shapes(right, task, found.shapes)
    style.title(right, f"plan: optimised, verified, {found.steps * CONTROL_STEP:.1f} s")
    return figure


def _differing() -> tuple[Task, dict[str, Rollout]]:
    """One plan, tracked with and without feedback, with a perturbed cable."""
    task = cw.load_task(EXAMPLE)
    found = cw.plan(task)
    cable = replace(task.cable, length=1.01 * task.cable.length, stiffness_profile=(0.5, 2.0))
    held = cw.GraspConfig(left=(0.002, 0.0, 0.035), right=(0.0, 0.002, -0.035))
    controllers = {"rod-mpc": cw.RodMPC(), "open-loop": cw.OpenLoop()}
    runs = {
        name: cw.track(cw.GraspedCable(cw.CableSimulator(task, cable=cable), held), controller, found)
        for name, controller in controllers.items()
    }
    return task, runs


def tracking() -> Figure:
    """A perturbed cable that tracks the plan; deviation with and without feedback; clearance."""
    task, runs = _differing()
    figure, (left, right) = _row(task, (scene.panel_size(task)[0], CURVES), BETWEEN + BAR)
    x0, y0, width, height = right.get_position().bounds
    right.set_position((x0, y0 + 0.57 * height, width, 0.43 * height))
    below = figure.add_axes((x0, y0, width, 0.38 * height))
    led = runs["rod-mpc"]
    draw_tracking(left, task, led)
    style.title(left, "tracking")
    for (name, run), colour in zip(runs.items(), (style.INK, style.GOAL), strict=True):
        deviation = 1000 * run.deviations_from_reference
        right.plot(run.times, deviation, color=colour, linewidth=1.6, label=f"{name}, final {deviation[-1]:.1f} mm")
    style.title(right, "deviation, worst keypoint")
    style.curve_axes(right, "", "deviation [mm]")
    right.set_ylim(0)
    right.legend(fontsize=8.5, frameon=False, labelcolor=style.INK)
    draw_clearance(below, "clearance with rod-mpc", led.times, led.clearance, led.gripper_clearance)
    return figure


def failure() -> Figure:
    """The closest attempt of the paper's planner, and its verdict."""
    task = cw.load_task(EXAMPLE)
    return _attempt(task, cw.PlannerConfig.named("tang2025"))


def _attempt(task: Task, config: cw.PlannerConfig | None = None) -> Figure:
    try:
        cw.plan(task, config=config)
    except PlanningError as error:
        return attempt_figure(task, error.attempt)
    raise RuntimeError(f"{task.name} was to have no plan")


def shown_task(name: str, *change: str) -> Task:
    """A task file that the tutorial shows, by the name in its first line; with one text in it changed to another."""
    text = (ROOT / "docs" / "tutorial.md").read_text()
    (content,) = re.findall(rf"^```yaml\n(# {re.escape(name)}\n.*?)^```", text, re.MULTILINE | re.DOTALL)
    content = content.replace(*change) if change else content
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_text(content)
        return cw.load_task(path)


def overlap() -> Figure:
    """What `cableway show` draws of a task that no cable can do."""
    try:
        shown_task("post.yaml", "center: [0.35, 0.35]", "center: [0.20, 0.17]")
    except TaskError as error:
        return scene.task_figure(error.draft, error.faults)
    raise RuntimeError("the task was to be impossible")


def alternatives() -> Figure:
    """Plans that go round the obstacles in different ways."""
    task = cw.load_task(EXAMPLE)
    return alternatives_figure(task, [found.shapes for found in cw.plan(task, alternatives=3)])


def planning() -> Figure:
    """What `cableway plan` draws."""
    task = cw.load_task(EXAMPLE)
    return plan_figure(task, cw.plan(task))


def first_run() -> Figure:
    """What `cableway run` draws."""
    task = cw.load_task("single-obstacle-2")
    return rollout_figure(task, cw.track(cw.CableSimulator(task), cw.RodMPC(), cw.plan(task)))


PICTURES: dict[str, Callable[[], Figure]] = {
    "single-obstacle-2": first_run,
    "planning": planning,
    "alternatives": alternatives,
    "method-pivot": pivot,
    "method-path-set": path_set,
    "method-deformation": deformation,
    "method-projection": projection,
    "method-tracking": tracking,
    "method-failure": failure,
    "tutorial-task": lambda: scene.task_figure(shown_task("post.yaml")),
    "tutorial-overlap": overlap,
    "tutorial-failure": lambda: _attempt(shown_task("narrow.yaml")),
}


def save(figure: Figure, path: Path) -> None:
    """Write a figure to a small file."""
    figure.set_dpi(min(PIXELS / figure.get_size_inches()[0], DOTS_PER_INCH))
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    save_small(Image.fromarray(np.asarray(canvas.buffer_rgba())), path)


def save_small(picture: Image.Image, path: Path) -> None:
    """Write a picture with 256 colours, no larger than `PIXELS` and `TALL`: a third of the size, with no difference."""
    picture = picture.convert("RGB")
    picture.thumbnail((PIXELS, TALL))
    small = picture.quantize(kmeans=1)
    write_atomically(path, lambda file: small.save(file, format="png", optimize=True))


def main() -> None:
    """Make the pictures."""
    for name in sys.argv[1:] or PICTURES:
        save(PICTURES[name](), IMAGES / f"{name}.png")
        print(IMAGES / f"{name}.png", flush=True)


if __name__ == "__main__":
    main()
