"""Pictures of a benchmark: shares of success with their intervals, and how errors are distributed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from cableway.figures.palette import INK, MUTED
from cableway.figures.style import DOUBLE, NOTE, SINGLE, curve_axes, log_axis, new_figure, series, title

Share = tuple[float, float, float]
"""A share with the ends of its interval."""

BESIDE, ACROSS = 5, 4
"""Most panels in a row, and most methods in a row of a legend."""


def success_figure(shares: Mapping[str, Mapping[str, Share]]) -> Figure:
    """Shares of success: a panel for each suite, a row for each method; a row for each suite where there is one method.

    Args:
        shares: By suite and method, or by method and group.
    """
    methods = list(dict.fromkeys(name for rows in shares.values() for name in rows))
    if len(methods) == 1:
        (only,), suites = methods, [suite for suite, rows in shares.items() if rows]
        shares, methods = {only: {suite: shares[suite][only] for suite in suites}}, suites
    columns = min(BESIDE, len(shares))
    lines = -(-len(shares) // columns)
    figure = new_figure(DOUBLE if len(shares) > 2 else SINGLE, lines * (0.7 + 0.16 * len(methods)))
    axes = figure.subplots(lines, columns, sharey=True, squeeze=False).ravel()
    for ax, (suite, rows) in zip(axes, shares.items(), strict=False):
        title(ax, suite)
        for name, (value, low, high) in rows.items():
            place = methods.index(name)
            ax.plot([100 * low, 100 * high], [place, place], color=MUTED, linewidth=1.6, solid_capstyle="butt")
            ax.plot(100 * value, place, "o", color=INK, markersize=3.5)
        curve_axes(ax, "success [%]", "")
        ax.set_xlim(-4, 104)
    for ax in axes[len(shares) :]:
        ax.set_visible(False)
    axes[0].set_yticks(range(len(methods)), methods)
    axes[0].set_ylim(len(methods) - 0.5, -0.5)
    figure.tight_layout()
    return figure


def error_figure(errors: Mapping[str, Mapping[str, Sequence[float]]], bounds: Sequence[float]) -> Figure:
    """Share of episodes below an error, over the error: a panel for each suite, a line for each method.

    Args:
        errors: Final stacked errors [m] by suite and method; infinite for an episode that failed otherwise.
        bounds: Errors [m] to mark.
    """
    methods = list(dict.fromkeys(name for rows in errors.values() for name in rows))
    columns = min(3, len(errors))
    rows = -(-len(errors) // columns)
    below = 0.1 + 0.16 * -(-len(methods) // ACROSS)
    tall = 1.9 * rows + below
    figure = new_figure(SINGLE if columns == 1 else DOUBLE, tall)
    axes = np.atleast_1d(figure.subplots(rows, columns, sharey=True, squeeze=False)).ravel()
    for ax, (suite, found) in zip(axes, errors.items(), strict=False):
        title(ax, suite)
        for name, values in found.items():
            ordered = 1000 * np.sort(np.asarray(values, float))
            shares = 100 * np.arange(1, len(ordered) + 1) / len(ordered)
            kept = np.isfinite(ordered)
            ax.step(ordered[kept], shares[kept], where="post", label=name, **series(methods.index(name)))
        for bound in bounds:
            ax.axvline(1000 * bound, color=MUTED, linewidth=0.8, linestyle=":")
            ax.text(1000 * bound, 2, f" {100 * bound:g} cm", fontsize=NOTE, color=MUTED)
        log_axis(ax.xaxis)
        ax.set_ylim(0, 102)
        curve_axes(ax, "stacked error [mm]", "episodes below it [%]")
    for ax in axes[len(errors) :]:
        ax.set_visible(False)
    handles = [axes[0].plot([], [], label=name, **series(place))[0] for place, name in enumerate(methods)]
    figure.tight_layout(rect=(0, below / tall, 1, 1))
    figure.legend(handles=handles, loc="lower center", ncols=min(ACROSS, len(methods)), fontsize=NOTE, frameon=False)
    return figure
