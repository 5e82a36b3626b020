"""Pictures of deformation models: how one was learned, and how far several can look ahead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cableway.figures import style

WIDTH, HEIGHT = 5.0, 3.4
"""Size [inch] of a panel."""


def learning_figure(losses: Sequence[float], errors: Sequence[float]) -> Figure:
    """Loss, and validation error [mm], after each epoch."""
    figure = style.new_figure(2 * WIDTH + 1.6, HEIGHT + 1.1)
    epochs = range(1, len(losses) + 1)
    for place, (values, name) in enumerate(((losses, "loss"), (errors, "validation error, one step [mm]"))):
        ax = style.add_axes(figure, 0.75 + place * (WIDTH + 0.7), 0.6, WIDTH, HEIGHT)
        style.curve_axes(ax, "epoch", name, whole=True)
        ax.plot(epochs, values, color=style.START, linewidth=1.6, marker="o", markersize=3)
        style.log_axis(ax.yaxis)
    return figure


def horizon_figure(
    horizons: Sequence[int], curves: Mapping[str, Sequence[float]], bands: Mapping[str, tuple[Sequence[float], ...]]
) -> Figure:
    """Error [mm] against the number of steps predicted without looking; the legend in the order of the curves' ends.

    Args:
        horizons: Numbers of steps.
        curves: A line for each model.
        bands: Lower and upper edge of the band around a line, for those that have one.
    """
    figure = style.new_figure(WIDTH + 3.6, HEIGHT + 1.5)
    ax = style.add_axes(figure, 0.75, 0.6, WIDTH, HEIGHT + 0.6)
    style.curve_axes(ax, "prediction horizon [steps]", "stacked error [mm]", whole=True)
    handles: list[tuple[float, Line2D]] = []
    for place, (name, values) in enumerate(curves.items()):
        look = style.series(place)
        ax.plot(horizons[: len(values)], values, linewidth=1.6, **look)
        if name in bands:
            low, high = bands[name]
            ax.fill_between(horizons[: len(low)], low, high, color=look["color"], alpha=0.12, linewidth=0)
        handles.append((values[-1], Line2D([], [], label=name, **look)))
    style.log_axis(ax.yaxis)
    ordered = [handle for _, handle in sorted(handles, key=lambda pair: -pair[0])]
    ax.legend(handles=ordered, loc="upper left", bbox_to_anchor=(1.02, 1.0), frameon=False, fontsize=8.5)
    return figure
