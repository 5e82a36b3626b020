"""Pictures of a benchmark: shares of success with their intervals, and how errors are distributed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from cableway.figures.style import INK, MUTED, curve_axes, new_figure, series, title

Share = tuple[float, float, float]
"""A share with the ends of its interval."""


def success_figure(shares: Mapping[str, Mapping[str, Share]]) -> Figure:
    """Shares of success: a panel for each suite, a row for each method.

    Args:
        shares: By suite and method.
    """
    methods = list(dict.fromkeys(name for rows in shares.values() for name in rows))
    figure = new_figure(1.8 + 1.7 * len(shares), 1.2 + 0.28 * len(methods))
    axes = np.atleast_1d(figure.subplots(1, len(shares), sharey=True))
    for ax, (suite, rows) in zip(axes, shares.items(), strict=True):
        title(ax, suite)
        for name, (value, low, high) in rows.items():
            place = methods.index(name)
            ax.plot([100 * low, 100 * high], [place, place], color=MUTED, linewidth=2, solid_capstyle="butt")
            ax.plot(100 * value, place, "o", color=INK, markersize=5)
        curve_axes(ax, "success [%]", "")
        ax.set_xlim(-4, 104)
    axes[0].set_yticks(range(len(methods)), methods)
    axes[0].invert_yaxis()
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
    figure = new_figure(3.6 * columns, 2.9 * rows + 0.5)
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
        ax.set_xscale("log")
        ax.set_ylim(0, 102)
        curve_axes(ax, "stacked error [mm]", "episodes below it [%]")
    for ax in axes[len(errors) :]:
        ax.set_visible(False)
    handles = [axes[0].plot([], [], label=name, **series(place))[0] for place, name in enumerate(methods)]
    figure.tight_layout(rect=(0, 0.5 / (2.9 * rows + 0.5), 1, 1))
    figure.legend(handles=handles, loc="lower center", ncols=min(5, len(methods)), fontsize=8, frameon=False)
    return figure
