"""Pictures of deformation models: how one was learned, and how far several can look ahead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cableway.figures import palette, style

WIDTH, HEIGHT = 2.9, 2.0
"""Size [inch] of a panel."""

LEFT, AXIS, ABOVE = 0.5, 0.42, 0.28
"""Inches left of a panel, below it and above it, for its axes and its title."""

NAMES, FEW, RIGHT = 0.85, 5, 0.1
"""Inches right of a panel for the names of its curves; most curves in one column's width; and above it otherwise."""


def learning_figure(losses: Sequence[float], errors: Sequence[float]) -> Figure:
    """Loss, and validation error [mm], after each epoch."""
    figure = style.new_figure(style.DOUBLE, AXIS + HEIGHT + ABOVE)
    epochs = range(1, len(losses) + 1)
    panels = [style.add_axes(figure, LEFT + place * (WIDTH + LEFT + 0.2), AXIS, WIDTH, HEIGHT) for place in (0, 1)]
    texts = (("loss", "loss"), ("validation, one step", "error [mm]"))
    for ax, values, (heading, name) in zip(panels, (losses, errors), texts, strict=True):
        style.title(ax, heading)
        style.curve_axes(ax, "epoch", name, whole=True)
        ax.plot(epochs, values, color=palette.START, linewidth=1.3, marker="o", markersize=2.5)
        style.log_axis(ax.yaxis)
    style.letter_panels(*panels)
    return figure


def horizon_figure(
    horizons: Sequence[int], curves: Mapping[str, Sequence[float]], bands: Mapping[str, tuple[Sequence[float], ...]]
) -> Figure:
    """Error [mm] against the number of steps predicted without looking, each curve with its name at its end.

    Args:
        horizons: Numbers of steps.
        curves: A line for each model.
        bands: Lower and upper edge of the band around a line, for those that have one.
    """
    wide, tall = (style.SINGLE, HEIGHT) if len(curves) <= FEW else (5.3, 3.2)
    figure = style.new_figure(wide, AXIS + tall + RIGHT)
    ax = style.add_axes(figure, LEFT, AXIS, wide - LEFT - NAMES, tall)
    draw_horizons(ax, horizons, curves, bands)
    return figure


def horizons_figure(
    panels: Mapping[str, Mapping[str, Sequence[float]]], bands: Mapping[str, Mapping[str, tuple[Sequence[float], ...]]]
) -> Figure:
    """The same, a panel for each data set, with horizons from 1."""
    rows, wide, tall = -(-len(panels) // 2), (style.DOUBLE - 2 * (LEFT + NAMES)) / 2, 1.6
    figure = style.new_figure(style.DOUBLE, rows * (AXIS + tall + ABOVE))
    drawn = []
    for place, (name, curves) in enumerate(panels.items()):
        row, column = divmod(place, 2)
        bottom = (rows - 1 - row) * (AXIS + tall + ABOVE) + AXIS
        ax = style.add_axes(figure, LEFT + column * style.DOUBLE / 2, bottom, wide, tall)
        style.title(ax, name)
        horizons = range(1, 1 + max(map(len, curves.values())))
        draw_horizons(ax, horizons, curves, bands.get(name, {}))
        drawn.append(ax)
    style.letter_panels(*drawn)
    return figure


def draw_horizons(
    ax: Axes,
    horizons: Sequence[int],
    curves: Mapping[str, Sequence[float]],
    bands: Mapping[str, tuple[Sequence[float], ...]],
) -> None:
    """Errors against horizons, as in `horizon_figure`."""
    style.curve_axes(ax, "prediction horizon [steps]", "stacked error [mm]", whole=True)
    for place, (name, values) in enumerate(curves.items()):
        look = style.series(place)
        ax.plot(horizons[: len(values)], values, linewidth=1.3, label=name, **look)
        if name in bands:
            low, high = bands[name]
            ax.fill_between(horizons[: len(low)], low, high, color=look["color"], alpha=0.12, linewidth=0)
    style.log_axis(ax.yaxis)
    style.name_curves(ax)
