"""The pictures of README and documentation, except those of the simulator, which `simulator_accuracy.py` makes.

    .venv/bin/python studies/pictures.py [NAME ...]

All of `PICTURES` unless named; about a minute on one core. The same code makes the same pictures.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

import cableway as cw
from cableway.core.errors import PlanningError, TaskError
from cableway.core.files import write_atomically
from cableway.figures import palette, scene, style
from cableway.figures.cell import cell_figure
from cableway.figures.plan import (
    alternatives_figure,
    attempt_figure,
    draw_clearance,
    draw_routes,
    draw_shapes,
    plan_figure,
)
from cableway.figures.rollout import draw_tracking, rollout_figure, scene_and_curves
from cableway.figures.stages import draw_progress
from cableway.planning.config import PivotConfig
from cableway.planning.initial_trajectories import InitialTrajectories
from cableway.planning.routes.passages import find_passages
from cableway.records import Rollout
from cableway.scene.files.loading import load_cell
from cableway.scene.task import CONTROL_STEP, Task
from cableway.tang2025.planning.chain import PaperChain
from cableway.tang2025.planning.config import PathSetConfig
from cableway.tang2025.planning.path_set import generate_path_set

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / "docs" / "images"

EXAMPLE = "multi-obstacle-1"
"""The task on which the stages of the method are shown."""

PIXELS, TALL, DOTS_PER_INCH = 1200, 1500, 160
"""Most pixels across a picture, up it, and in an inch of it."""

WEIGHTS = ((0.0, palette.INK), (0.01, palette.LEFT), (0.1, palette.RIGHT), (1.0, palette.PIVOT))
"""Clearance weights k_c [m] of the pivot paths shown, with their colours."""


def _trajectories(task: Task, clearance_weight: float = 1.0) -> InitialTrajectories:
    return InitialTrajectories(task, cw.PlannerConfig(pivot=PivotConfig(clearance_weight=clearance_weight)))


def pivot() -> Figure:
    """All passages of the scene, and pivot paths with different weights of clearance."""
    task = cw.load_task(EXAMPLE)
    figure, (left, right) = scene.panel_row(task, 2)
    style.title(left, "passages")
    draw_routes(left, task, passages=np.array([passage.ends for passage in cw.find_passages(task.scene)]))
    style.legend_below(left, [*scene.end_handles(), _line(palette.PASSAGE, "passage")], 3)
    style.title(right, "pivot paths")
    scene.draw_scene(right, task)
    handles = []
    for weight, colour in WEIGHTS:
        right.plot(*_trajectories(task, weight).pivot.T, color=colour, linewidth=1.5, zorder=5)
        handles.append(_line(colour, f"weight {1000 * weight:g} mm"))
    scene.draw_end_shapes(right, task)
    style.legend_below(right, handles, 2)
    scene.finish_row([left, right])
    return figure


def _line(colour: str, label: str) -> Line2D:
    return Line2D([], [], color=colour, linewidth=1.5, label=label)


def path_set() -> Figure:
    """The paper's path set and ours along the same pivot path."""
    task = cw.load_task(EXAMPLE)
    figure, panels = scene.panel_row(task, 2)
    route, passages = _trajectories(task).pivot, find_passages(task.scene)
    for ax, kind, title in zip(
        panels, ("transfer", "homotopic"), ("linear transfer", "one homotopy class"), strict=True
    ):
        paths = generate_path_set(task, route, passages, PathSetConfig(kind=kind))
        draw_routes(ax, task, paths.pivot, paths.paths, paths.passages)
        style.title(ax, f"path set: {title}")
    scene.finish_row(panels)
    panels[1].get_legend().remove()  # it is that of the first  # pyright: ignore[reportOptionalMemberAccess]
    return figure


def deformation() -> Figure:
    """The optimised shapes along the path set, and how far each keypoint is along its path over time."""
    task = cw.load_task(EXAMPLE)
    figure, (left, right) = scene.panel_row(task, 2)
    shapes, stages = PaperChain(task, cw.PlannerConfig(), _trajectories(task).pivot).deformation("head")
    draw_shapes(left, task, shapes)
    style.title(left, "deformation along the path set")
    draw_progress(right, stages.progress)
    style.letter_panels(left, right)
    return figure


def projection() -> Figure:
    """What the search among equilibria finds, and the plan made of it."""
    task = cw.load_task(EXAMPLE)
    figure, (left, right) = scene.panel_row(task, 2)
    draw_shapes(left, task, _trajectories(task).make("corridor").shapes, bar=False)
    style.title(left, "found among equilibria")
    found = cw.plan(task)
    draw_shapes(right, task, found.shapes)
    style.title(right, f"plan: optimised, verified, {found.steps * CONTROL_STEP:.1f} s")
    scene.finish_row([left, right])
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
    figure, (left, right, below) = scene_and_curves(task)
    led = runs["rod-mpc"]
    draw_tracking(left, task, led)
    style.title(left, "tracking")
    for (name, run), colour in zip(runs.items(), (palette.INK, palette.GOAL), strict=True):
        deviation = 1000 * run.deviations_from_reference
        right.plot(run.times, deviation, color=colour, linewidth=1.3, label=f"{name}, final {deviation[-1]:.1f} mm")
    style.title(right, "deviation, worst keypoint", legend=True)
    style.curve_axes(right, "time [s]", "deviation [mm]")
    right.set_ylim(0)
    draw_clearance(below, "clearance with rod-mpc", led.times, led.clearance, led.gripper_clearance)
    style.letter_panels(left, right, below)
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


def run(name: str) -> Figure:
    """What `cableway run` draws."""
    task = cw.load_task(name)
    return rollout_figure(task, cw.track(cw.CableSimulator(task), cw.RodMPC(), cw.plan(task)))


def cell() -> Figure:
    """What `cableway plan` draws of a cell."""
    task = cw.load_task("multi-obstacle-2").in_cell(load_cell("dual-ur5e"))
    figure = cell_figure(task, cw.plan(task))
    assert figure is not None
    return figure


PICTURES: dict[str, Callable[[], Figure]] = {
    "maze-1": lambda: run("maze-1"),
    "single-obstacle-2": lambda: run("single-obstacle-2"),
    "planning": planning,
    "alternatives": alternatives,
    "cell": cell,
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
    figure.set_dpi(DOTS_PER_INCH)
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
