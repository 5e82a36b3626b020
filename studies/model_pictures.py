"""The pictures of docs/models.md, from what `studies/models.py` left.

    .venv/bin/python studies/model_pictures.py [--comparison runs/comparison] [--out docs/images]

After the stages collect, train, evaluate, adapt and plateau.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from models import LONGER, TEST_SETS, model_path
from pictures import save

from cableway.datasets.reading import load_transitions
from cableway.datasets.transitions import Transitions
from cableway.figures import palette, scene, style
from cableway.figures.learning import AXIS, HEIGHT, LEFT, horizon_figure
from cableway.tang2025.models.base import DeformationModel, rollout
from cableway.tang2025.models.checkpoint import load_model, read_card
from cableway.tang2025.models.dataset import window_starts
from cableway.tang2025.models.evaluation import window_errors

PREDICTED = ("rod", "bilstm", "transformer", "conv")
"""Shipped models whose predictions are drawn."""

DRAWN_ON = ("nominal", "graded")
"""Test sets on which they are drawn."""

AHEAD = (10, 20, 30)
"""Steps after which a predicted shape is drawn."""

PANEL, BETWEEN = 1.56, 0.18
"""Inches of a panel of predictions, and between two."""


def typical_window(model: DeformationModel, data: Transitions) -> int:
    """The row at which the window begins whose error after the last of `AHEAD` is nearest to the median one."""
    starts = window_starts(data.episode, AHEAD[-1], 10)
    errors = window_errors(model, data, (AHEAD[-1],)).stacked[:, 0]
    return int(starts[np.argmin(np.abs(errors - np.median(errors)))])


def draw_prediction(ax: Axes, model: DeformationModel, data: Transitions, row: int, radius: float) -> float:
    """What becomes of the cable, grey, and what was predicted, in the colours of time; the last error [mm]."""
    actions = data.actions[row : row + AHEAD[-1]]
    predicted = np.asarray(rollout(model, data.keypoints[row], data.poses[row], actions))
    true = data.next_keypoints[row : row + AHEAD[-1]]
    scene.draw_cable(ax, scene.smooth(data.keypoints[row]), radius, palette.INK)
    for steps in AHEAD:
        scene.draw_cable(ax, scene.smooth(true[steps - 1]), radius, palette.OBSTACLE)
        color = style.TIME(steps / AHEAD[-1])
        ax.plot(*scene.smooth(predicted[steps - 1]).T, color=color, linewidth=1.2, zorder=6)
        ax.plot(*predicted[steps - 1].T, ".", color=color, markersize=4, zorder=7)
    ax.set_aspect("equal")
    ax.set_axis_off()
    return 1e3 * float(np.linalg.norm(predicted[-1] - true[-1]))


def prediction_figure(folder: Path) -> Figure:
    """A row for each set, a column for each model, all from the same start."""
    models = {name: load_model(name) for name in PREDICTED}
    tall, panels = len(DRAWN_ON) * (PANEL + 2 * BETWEEN), []
    figure = style.new_figure(style.DOUBLE, tall)
    for row, name in enumerate(DRAWN_ON):
        data = load_transitions(folder / "sets" / name)
        start = typical_window(models["transformer"], data)
        points = data.next_keypoints[start : start + AHEAD[-1]].reshape(-1, 2)
        middle, half = 0.5 * (points.min(axis=0) + points.max(axis=0)), 0.55 * float(np.ptp(points, axis=0).max())
        for column, (model_name, model) in enumerate(models.items()):
            bottom = tall - (row + 1) * (PANEL + 2 * BETWEEN)
            ax = style.add_axes(figure, BETWEEN + column * (PANEL + BETWEEN), bottom, PANEL, PANEL)
            error = draw_prediction(ax, model, data, start, TEST_SETS[name].cable.radius)
            ax.set_xlim(middle[0] - half, middle[0] + half)
            ax.set_ylim(middle[1] - half, middle[1] + half)
            style.title(ax, f"{model_name}: {error:.1f} mm")
            panels.append(ax)
    style.letter_panels(*panels)
    return figure


def comparison_figure(folder: Path) -> Figure:
    """Error against horizon on the nominal test set."""
    curves = json.loads((folder / "nominal.json").read_text())
    horizons = next(iter(curves.values()))["horizons"]
    bands = {name: curve["seeds"] for name, curve in curves.items() if curve["trainings"] > 1}
    return horizon_figure(horizons, {name: curve["mean"] for name, curve in curves.items()}, bands)


def training_figure(folder: Path, name: str = "T, plain") -> Figure:
    """Validation error of the plain transformer after each epoch, for trainings of more and more epochs."""
    figure = style.new_figure(style.SINGLE, HEIGHT + AXIS + 0.1)
    ax = style.add_axes(figure, LEFT, AXIS, style.SINGLE - LEFT - 1.0, HEIGHT)
    style.curve_axes(ax, "epoch", "validation error, one step [mm]", whole=True)
    paths = {5: model_path(folder, name, 0)} | {
        epochs: model_path(folder, f"{name}-{epochs}", 0) for epochs, wanted in LONGER.items() if name in wanted
    }
    for (epochs, path), color in zip(paths.items(), palette.SERIES, strict=False):
        errors = [entry["validation_error"] for entry in read_card(str(path))["history"]]
        ax.plot(range(1, len(errors) + 1), errors, color=color, linewidth=1.0, label=f"{epochs} epochs")
    style.log_axis(ax.xaxis)
    style.log_axis(ax.yaxis)
    style.legend_right(ax)
    return figure


def adaptation_figure(draws: dict[str, Sequence[Sequence[float]]]) -> Figure:
    """Of each set, every draw's error before and after: a line between two dots."""
    figure = style.new_figure(style.SINGLE, HEIGHT + AXIS + 0.1)
    ax = style.add_axes(figure, LEFT, AXIS, style.SINGLE - LEFT - 0.1, HEIGHT)
    style.curve_axes(ax, "", "stacked error after 20 steps [mm]")
    for place, pairs in enumerate(draws.values()):
        for before, after in pairs:
            ax.plot((place - 0.15, place + 0.15), (before, after), color=palette.MUTED, linewidth=0.8)
            ax.plot(place - 0.15, before, ".", color=palette.START, label="before")
            ax.plot(place + 0.15, after, ".", color=palette.GOAL, label="after 100 transitions")
    ax.set_xticks(range(len(draws)), list(draws))
    style.log_axis(ax.yaxis)
    handles, labels = ax.get_legend_handles_labels()
    ax.legend(
        handles[:2], labels[:2], frameon=False, fontsize=style.TICK, labelcolor=palette.INK, loc="upper center",
        bbox_to_anchor=(0.5, -0.1), ncols=2,
    )  # fmt: skip
    return figure


def main() -> None:
    """Draw all of them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--comparison", type=Path, default=Path("runs/comparison"))
    parser.add_argument("--out", type=Path, default=Path("docs/images"))
    given = parser.parse_args()
    draws = json.loads((given.comparison / "adaptation.json").read_text())["rod"]
    assert list(draws) == list(TEST_SETS)
    for name, figure in {
        "prediction": prediction_figure(given.comparison),
        "comparison": comparison_figure(given.comparison),
        "training": training_figure(given.comparison),
        "adaptation": adaptation_figure(draws),
    }.items():
        save(figure, given.out / f"models-{name}.png")
        print(given.out / f"models-{name}.png", flush=True)


if __name__ == "__main__":
    main()
