"""A controller's estimates of the cable, over time."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from cableway.figures import style
from cableway.records import Estimate, Rollout

HEADROOM = 0.2
"""Share of the panel above the curves, for the legend."""


def draw_estimates(ax: Axes, rollout: Rollout) -> None:
    """Each estimate's distance from its nominal value, in prior standard deviations: all fit one axis.

    The band about a curve is one standard deviation either way, drawn for those that turned out to differ; the legend
    says the last values, those in bold. What was taken as known has no curve.
    """
    assert rollout.estimates is not None
    assert rollout.deviations is not None
    found = rollout.estimated()
    moving = [(column, name) for column, name in enumerate(found) if found[name].prior > 0]
    for number, (column, name) in enumerate(moving):
        estimate, color = found[name], style.SERIES[number % len(style.SERIES)]
        dashes = "-" if number < len(style.SERIES) else (0, (3, 1.5))
        away = (rollout.estimates[:, column] - estimate.nominal) / estimate.prior
        ax.plot(
            rollout.times[1:], away, color=color, linestyle=dashes, linewidth=1.9 if estimate.differs else 0.9,
            label=last_value(name, estimate),
        )  # fmt: skip
        if estimate.differs:
            width = rollout.deviations[:, column] / estimate.prior
            ax.fill_between(rollout.times[1:], away - width, away + width, color=color, alpha=0.15, linewidth=0)
    style.curve_axes(ax, "time [s]", "distance from the prior [its standard deviations]")
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + HEADROOM / (1 - HEADROOM) * (high - low))
    legend = ax.legend(fontsize=6.8, frameon=False, loc="upper left", ncols=2, labelcolor=style.INK, columnspacing=1.0)
    for text, (_, name) in zip(legend.get_texts(), moving, strict=True):
        text.set_fontweight("bold" if found[name].differs else "normal")


def last_value(name: str, estimate: Estimate) -> str:
    """Name, value and standard deviation of an estimate; metres as millimetres.

    >>> last_value("length", Estimate(0.2971, 0.0004, 0.3, 0.006, "m"))
    'length 297.10 ± 0.40 mm'
    """
    scale, unit = (1000.0, "mm") if estimate.unit == "m" else (1.0, estimate.unit)
    value, deviation = scale * estimate.value, scale * estimate.deviation
    decimals = int(np.clip(1 - np.floor(np.log10(max(deviation, 1e-3))), 0, 3))
    return f"{name} {value:.{decimals}f} ± {deviation:.{decimals}f} {unit}".rstrip()
