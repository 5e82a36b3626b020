"""What the pictures share: widths and letters as in a journal, colours, the colour of time, quiet axes, saving."""

from __future__ import annotations

import io
import string
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator
from matplotlib.transforms import ScaledTranslation
from scipy.optimize import isotonic_regression

from cableway.core.errors import InputError
from cableway.core.files import write_atomically
from cableway.figures.palette import DASHES, GRID, INK, MUTED, SERIES, TIME_COLORS

SINGLE, DOUBLE = 3.5, 7.16
"""Widths [inch] of a picture in one column and across two, as journals have them (IEEE)."""

HEADING, LABEL, TICK, NOTE = 9.0, 8.0, 7.5, 7.0
"""Sizes [points] of letters: titles of panels; names of axes; numbers and legends; what is written among curves."""


def series(number: int) -> dict[str, Any]:
    """Colour and dashes of a curve: after the last colour the first one comes again, dashed."""
    return {
        "color": SERIES[number % len(SERIES)],
        "linestyle": DASHES[number // len(SERIES) % len(DASHES)],
    }


TIME = LinearSegmentedColormap.from_list("cableway-time", TIME_COLORS)
"""From the colour of the start to the colour of the goal."""

TITLE, LETTER = "title", "letter"
"""What the title and the letter of a panel are called among its artists, and in an SVG file."""

DOTS_PER_INCH, SMALL = 200, 130
"""Of a PNG file, and of one that is to be small."""

FORMATS: dict[str, dict[str, Any]] = {
    ".png": {"dpi": DOTS_PER_INCH},
    ".svg": {"metadata": {"Date": None}},
    ".pdf": {"metadata": {"CreationDate": None}},
}
"""Endings of files that pictures are written to, and what they ask of Matplotlib; nothing that depends on the day."""

WRITING: dict[Any, Any] = {"svg.fonttype": "path", "svg.hashsalt": "cableway", "pdf.fonttype": 42}
"""Letters are outlines in SVG, which so looks alike whatever fonts there are, and TrueType in PDF, as journals ask;
names within the SVG file follow from its content."""


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
    """Write a figure to a file, atomically: PNG, SVG or PDF by its ending. The same figure gives the same file.

    Raises:
        InputError: It ends otherwise.
    """
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"{path}: a picture is written to a file that ends in {', '.join(FORMATS)}")
    write_atomically(path, lambda file: _write(figure, file, path.suffix.lower()))


def figure_png(figure: Figure) -> bytes:
    """The content of a figure's PNG file, small: for pages that show many."""
    file = io.BytesIO()
    _write(figure, file, ".png", dpi=SMALL)
    return file.getvalue()


def _write(figure: Figure, file: IO[bytes], ending: str, **options: Any) -> None:
    """Letters that the font lacks are boxes, without a warning."""
    with warnings.catch_warnings(), matplotlib.rc_context(WRITING):
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        figure.savefig(file, format=ending[1:], **FORMATS[ending] | options)


def title(ax: Axes, text: str, *, legend: bool = False) -> None:
    """A panel's title, left-aligned; with a legend between it and the panel, where that covers no curve."""
    rows = 0
    if legend:
        _, names = ax.get_legend_handles_labels()
        columns = min(len(names), max(1, int(_width(ax) / (0.29 + NOTE / 145 * max(map(len, names))))))
        rows = -(-len(names) // columns)
        ax.legend(
            loc="lower left", bbox_to_anchor=(0, 1), ncols=columns, frameon=False, fontsize=NOTE, handlelength=1.4,
            columnspacing=1.0, handletextpad=0.5, labelcolor=INK, borderaxespad=0.2, borderpad=0.2, labelspacing=0.3,
        )  # fmt: skip
    pad = 5 + 11 * rows
    ax.set_title(text, loc="left", fontsize=HEADING, color=INK, pad=pad, parse_math=False, gid=TITLE)


def _width(ax: Axes) -> float:
    """Of a panel [inch]."""
    return ax.get_window_extent().width / ax.get_figure(root=True).dpi  # pyright: ignore[reportOptionalMemberAccess]


def letter_panels(*panels: Axes) -> None:
    """The letters a, b, c, ... left of the titles of a figure's panels, for its caption to refer to."""
    for letter, ax in zip(string.ascii_lowercase, panels, strict=False):
        figure = ax.get_figure(root=True)
        assert figure is not None
        (heading,) = ax.findobj(lambda artist: artist.get_gid() == TITLE)
        aside = ScaledTranslation(-5 / 72, 0, figure.dpi_scale_trans)
        ax.text(
            0, 1, letter, transform=heading.get_transform() + aside, ha="right", va="baseline", fontsize=HEADING + 1,
            fontweight="bold", color=INK, gid=LETTER,
        )  # fmt: skip


def legend_below(ax: Axes, handles: Sequence[Any], columns: int, *, wide: bool = False) -> None:
    """A legend below the panel, where it covers nothing: in its middle, or from its left edge where it is wider."""
    height = ax.get_window_extent().height / ax.get_figure(root=True).dpi  # pyright: ignore[reportOptionalMemberAccess]
    ax.legend(
        handles=handles, loc="upper left" if wide else "upper center",
        bbox_to_anchor=(0.0 if wide else 0.5, -0.36 / height), ncols=columns, frameon=False,
        fontsize=TICK, handlelength=1.5, columnspacing=1.2, handletextpad=0.5, labelcolor=INK, borderaxespad=0,
        labelspacing=0.3,
    )  # fmt: skip


def legend_right(ax: Axes, handles: Sequence[Any] | None = None) -> None:
    """A legend right of the panel, where it covers nothing."""
    ax.legend(
        handles=handles, loc="upper left", bbox_to_anchor=(1.02, 1.0), frameon=False, fontsize=TICK,
        labelcolor=INK, borderaxespad=0, handlelength=1.6,
    )  # fmt: skip


def name_curves(ax: Axes) -> None:
    """The name of each curve right of the panel, in its colour, where it ends or as near as the others leave room."""
    figure, curves = ax.get_figure(root=True), [line for line in ax.lines if str(line.get_label())[0] != "_"]
    assert figure is not None
    ends = [max(np.asarray(line.get_xydata()), key=lambda point: point[0]) for line in curves]
    ax.set_xlim(right=max(x for x, _ in ends))
    heights = ax.transAxes.inverted().transform(ax.transData.transform(ends))[:, 1]
    order = np.argsort(heights)
    apart = 1.15 * NOTE / 72 * figure.dpi / ax.get_window_extent().height * np.arange(len(order))
    places = isotonic_regression(heights[order] - apart).x + apart
    places -= max(0.0, float(places[-1]) - 1)
    for line, height, place in zip((curves[k] for k in order), heights[order], places, strict=True):
        look: dict[str, Any] = {"color": line.get_color(), "linestyle": line.get_linestyle(), "linewidth": 1.0}
        leader = ax.plot((1, 1.06), (height, place), transform=ax.transAxes, clip_on=False, **look)
        leader[0].set_label("_")
        ax.text(
            1.07, place, str(line.get_label()), transform=ax.transAxes, va="center", fontsize=NOTE, color=look["color"]
        )


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
    ax.set_xlabel(x, fontsize=LABEL, color=MUTED, labelpad=2)
    ax.set_ylabel(y, fontsize=LABEL, color=MUTED, labelpad=3)
    ax.grid(True, color=GRID, linewidth=0.6)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", colors=MUTED, labelsize=TICK, length=0, pad=3)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        ax.spines[side].set_color("#b9c0c8")
