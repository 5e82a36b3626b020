"""What the pictures share: colours, the colour of time, axes in metres, saving."""

from __future__ import annotations

import io
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from cableway.core.files import write_atomically

INK = "#1d2733"
MUTED = "#6b7683"
GRID = "#e6e9ed"
OBSTACLE = "#c5cad1"
OBSTACLE_EDGE = "#868f9b"
BAD = "#c1272d"

BLUE, VERMILION, GREEN, ORANGE, SKY, PURPLE = "#0072b2", "#d55e00", "#009e73", "#e69f00", "#56b4e9", "#cc79a7"
"""The palette of Okabe and Ito, whose colours those who see red and green alike tell apart, too."""

START, GOAL = BLUE, VERMILION
PIVOT, PASSAGE, PATHS = GREEN, ORANGE, OBSTACLE_EDGE
LEFT, RIGHT = SKY, PURPLE
REFERENCE = ORANGE

SERIES = (INK, BLUE, VERMILION, GREEN, ORANGE, SKY, PURPLE)
DASHES = ("-", (0, (4, 2)), (0, (1, 1.5)))


def series(number: int) -> dict[str, Any]:
    """Colour and dashes of a curve: after the last colour the first one comes again, dashed."""
    return {
        "color": SERIES[number % len(SERIES)],
        "linestyle": DASHES[number // len(SERIES) % len(DASHES)],
    }


TIME = LinearSegmentedColormap.from_list("cableway-time", [START, "#6f5fae", "#b8558c", GOAL])
"""From the colour of the start to the colour of the goal."""

DOTS_PER_INCH = 150


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of that size [inch], bound to no window and to no global state."""
    figure = Figure(figsize=(width, height), facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def add_axes(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Axes at a place of the figure, all in inches."""
    whole, tall = figure.get_size_inches()
    return figure.add_axes((left / whole, bottom / tall, width / whole, height / tall))


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure to a PNG file, atomically."""
    write_atomically(path, lambda file: _write_png(figure, file, DOTS_PER_INCH))


def figure_png(figure: Figure, dots_per_inch: float = 100) -> bytes:
    """The content of a figure's PNG file."""
    file = io.BytesIO()
    _write_png(figure, file, dots_per_inch)
    return file.getvalue()


def _write_png(figure: Figure, file: IO[bytes], dots_per_inch: float) -> None:
    """Letters that the font lacks are boxes, without a warning."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        figure.savefig(file, format="png", dpi=dots_per_inch)


def title(ax: Axes, text: str, legend: int = 0) -> None:
    """A panel's title, left-aligned; where `legend` is not 0, with a legend of so many columns below it.

    The legend stands above the panel, so that it covers no curve.
    """
    rows = 0
    if legend:
        handles, _ = ax.get_legend_handles_labels()
        rows = -(-len(handles) // legend)
        ax.legend(
            loc="lower left", bbox_to_anchor=(0, 1), ncols=legend, frameon=False, fontsize=8, handlelength=1.5,
            columnspacing=1.2, handletextpad=0.5, labelcolor=INK, borderaxespad=0.2, borderpad=0.2, labelspacing=0.3,
        )  # fmt: skip
    pad = 8 + 12 * rows
    ax.set_title(text, loc="left", fontsize=11, fontweight="bold", color=INK, pad=pad, parse_math=False)


def legend_below(ax: Axes, handles: Sequence[Any], columns: int) -> None:
    """A legend below the panel, where it covers nothing."""
    height = ax.get_window_extent().height / ax.get_figure(root=True).dpi  # pyright: ignore[reportOptionalMemberAccess]
    ax.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.42 / height), ncols=columns, frameon=False,
        fontsize=8.5, handlelength=1.6, columnspacing=1.4, labelcolor=INK, borderaxespad=0,
    )  # fmt: skip


def log_axis(axis: Axis) -> None:
    """A logarithmic axis with plain numbers: at 1, 2 and 5 times the powers of ten, at every tick where it is short."""
    ax = axis.axes
    (ax.set_xscale if axis is ax.xaxis else ax.set_yscale)("log")

    def text(value: float, _: float) -> str:
        low, high = axis.get_view_interval()
        return f"{value:g}" if high < 5 * low or f"{value:e}"[0] in "125" else ""

    axis.set_major_formatter(FuncFormatter(text))
    axis.set_minor_formatter(FuncFormatter(text))


def curve_axes(ax: Axes, x: str, y: str, *, whole: bool = False) -> None:
    """Quiet axes for a curve over time: labels with units, a light grid, no box; `whole` where x counts something."""
    if ax.get_xscale() == "linear":
        ax.xaxis.set_major_locator(MaxNLocator("auto", steps=[1, 2, 5, 10], integer=whole))
    ax.set_xlabel(x, fontsize=9, color=MUTED)
    ax.set_ylabel(y, fontsize=9, color=MUTED)
    ax.grid(True, color=GRID, linewidth=0.8)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", colors=MUTED, labelsize=8.5, length=0)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        ax.spines[side].set_color("#b9c0c8")
