"""The picture of docs/control.md: the same task and the same cable under each controller.

    .venv/bin/python studies/control_pictures.py [--task NAME] [--out FILE]

The cable is 1% short, stiff at one end, held 2 mm and 2 degrees askew, and measured late with 1 mm of noise: the plant
"hard" of the benchmark.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from matplotlib.axes import Axes
from pictures import save

from cableway.figures import scene, style
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
BETWEEN, ABOVE, CURVES = 0.35, 0.6, 2.4
"""Inches between panels, above each, and of the panel of curves."""


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
        ax.plot(run.times, 1000 * run.deviations_from_reference, linewidth=1.4, label=name, **style.series(place))
    style.log_axis(ax.yaxis)
    style.curve_axes(ax, "time [s]", "largest deviation [mm]")
    style.title(ax, "deviation, worst keypoint", legend=6)


def main() -> None:
    """Run all controllers, draw, and print a line for each."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--task", default="single-obstacle-2")
    parser.add_argument("--out", type=Path, default=Path("docs/images/controllers.png"))
    given = parser.parse_args()
    task = load_task(given.task)
    runs = rollouts(task)
    width, height = (0.52 * side for side in scene.panel_size(task))
    rows = -(-len(runs) // COLUMNS)
    wide = BETWEEN + COLUMNS * (width + BETWEEN)
    tall = rows * (height + ABOVE) + CURVES + 1.4
    figure = style.new_figure(wide, tall)
    for number, (name, run) in enumerate(runs.items()):
        row, column = divmod(number, COLUMNS)
        ax = style.add_axes(
            figure, BETWEEN + column * (width + BETWEEN), tall - (row + 1) * (height + ABOVE), width, height
        )
        draw_motion(ax, task, run)
        ax.set_axis_off()
        error = 1000 * run.shape_error(task.goal)
        text = f"{name}: {error:.1f} mm, on the way {1000 * run.deviations_from_reference.max():.0f} mm"
        ax.set_title(text, loc="left", fontsize=8, color=style.INK, pad=4)
        print(f"{text}, clearance {1000 * run.clearance.min():.1f} mm, {run.metadata['outcome']}")
    draw_deviations(style.add_axes(figure, 0.75, 0.6, wide - 1.0, CURVES), runs)
    save(figure, given.out)


if __name__ == "__main__":
    main()
