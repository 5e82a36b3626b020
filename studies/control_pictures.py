"""The picture of docs/control.md: the same task and the same cable under each controller.

    .venv/bin/python studies/control_pictures.py [--task NAME] [--out FILE]

The cable is 1% short, stiff at one end, held 2 mm and 2 degrees askew, and measured late with 1 mm of noise: the plant
"hard" of the benchmark.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import shapely
from matplotlib.axes import Axes
from pictures import save

from cableway.figures import palette, style
from cableway.figures.rollout import draw_motion
from cableway.planning.planner import plan
from cableway.records import Rollout
from cableway.report import least_achievable_error
from cableway.scene.files.loading import load_task
from cableway.scene.task import Task
from cableway.simulation.perturbations.variants import named_perturbation
from cableway.tracking import track
from cableway.workflow.registry import CONTROLLERS, make_controller

COLUMNS = 3
LEFT, BETWEEN, ABOVE, CURVES = 0.25, 0.22, 0.26, 1.7
"""Inches left of panels, between them, above each, and of the panel of curves."""

FREE = 0.04
"""Space [m] that is shown above obstacles and cables."""


def rollouts(task: Task) -> dict[str, Rollout]:
    """Of each controller, by name."""
    perturbation, found = named_perturbation("hard", task), plan(task)
    plant, least = (
        perturbation.build(task, seed=0),
        least_achievable_error(perturbation.true_cable(task), task.goal) or 0.0,
    )
    print(f"least achievable error: {1000 * least:.1f} mm")
    return {name: track(plant, make_controller(name), found) for name in CONTROLLERS}


def draw_deviations(ax: Axes, runs: dict[str, Rollout]) -> None:
    """All of them over time [s], in millimetres."""
    for place, (name, run) in enumerate(runs.items()):
        ax.plot(run.times, 1000 * run.deviations_from_reference, linewidth=1.2, label=name, **style.series(place))
    style.log_axis(ax.yaxis)
    style.curve_axes(ax, "time [s]", "largest deviation [mm]")
    style.title(ax, "deviation, worst keypoint")
    style.name_curves(ax)


def main() -> None:
    """Run all controllers, draw, and print a line for each."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--task", default="single-obstacle-2")
    parser.add_argument("--out", type=Path, default=Path("docs/images/controllers.png"))
    given = parser.parse_args()
    task = load_task(given.task)
    runs = rollouts(task)
    width, rows = (style.DOUBLE - LEFT) / COLUMNS - BETWEEN, -(-len(runs) // COLUMNS)
    obstacles = [shapely.get_coordinates(solid) for solid in task.scene.solids]
    top = FREE + max(float(points[..., 1].max()) for points in (*obstacles, *(run.centreline for run in runs.values())))
    height = width * min(top, task.scene.size[1]) / task.scene.size[0]
    below = 0.42 + CURVES + 0.35
    tall = rows * (height + ABOVE) + below
    figure, panels = style.new_figure(style.DOUBLE, tall), []
    for number, (name, run) in enumerate(runs.items()):
        row, column = divmod(number, COLUMNS)
        ax = style.add_axes(
            figure, LEFT + column * (width + BETWEEN), tall - (row + 1) * (height + ABOVE), width, height
        )
        draw_motion(ax, task, run)
        ax.set_ylim(0, min(top, task.scene.size[1]))
        ax.set_axis_off()
        for patch in ax.patches:
            patch.set_clip_on(True)  # the walls go on beyond what is shown
        error = 1000 * run.shape_error(task.goal)
        text = f"{error:.1f} mm at the goal\n{1000 * run.deviations_from_reference.max():.0f} mm on the way"
        style.title(ax, name)
        ax.text(0.04, 0.95, text, transform=ax.transAxes, va="top", fontsize=style.NOTE, color=palette.INK)
        panels.append(ax)
        said = f"{name}: {', '.join(text.splitlines())}, clearance {1000 * run.clearance.min():.1f} mm"
        print(f"{said}, {run.metadata['outcome']}")
    panels.append(style.add_axes(figure, 0.5, 0.42, style.DOUBLE - 1.6, CURVES))
    draw_deviations(panels[-1], runs)
    style.letter_panels(*panels)
    save(figure, given.out)


if __name__ == "__main__":
    main()
