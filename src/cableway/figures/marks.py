"""Marks on a picture: a red ring about each place where something is wrong, with its number, and the sentences."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cableway.core.errors import Point
from cableway.figures import style

RING = 11.0
"""Radius of a ring in points: seen at any scale."""

SENTENCES = 6
"""Most sentences written out."""

LINE, CHARACTERS = 0.19, 14.5
"""Height [inch] of a line of them, and characters to the inch."""


def draw_marks(ax: Axes, places: Sequence[Point | None]) -> None:
    """A ring about each place [m], with its number from 1 where there are several places; None has no ring.

    Places whose rings would overlap share one, and one beyond the axes is marked at their edge.
    """
    low, high = np.array([ax.get_xlim(), ax.get_ylim()]).T
    dots = RING * ax.get_figure(root=True).dpi / 72  # pyright: ignore[reportOptionalMemberAccess]
    rings: list[tuple[np.ndarray, list[int]]] = []
    for number, place in enumerate(places, start=1):
        if place is None:
            continue
        at = np.clip(place, low, high)
        there = ax.transData.transform(at)
        shared = (ring for ring in rings if np.linalg.norm(ax.transData.transform(ring[0]) - there) < 2 * dots)
        ring = next(shared, None)
        if ring is None:
            rings.append((at, [number]))
        else:
            ring[1].append(number)
    for at, numbers in rings:
        for color, width in (("white", 4.6), (style.BAD, 2.2)):
            ax.plot(
                *at, marker="o", markersize=2 * RING, markerfacecolor="none", markeredgecolor=color,
                markeredgewidth=width, zorder=11, clip_on=False, gid="mark",
            )  # fmt: skip
        if len(places) > 1:
            x, y = np.where(at < (low + high) / 2, 1.0, -1.0)
            ax.annotate(
                ", ".join(map(str, numbers)), (float(at[0]), float(at[1])), textcoords="offset points",
                xytext=(1.05 * RING * x, 1.05 * RING * y), ha="left" if x > 0 else "right",
                va="bottom" if y > 0 else "top", fontsize=9, fontweight="bold", color="white", zorder=12,
                bbox={"boxstyle": "round,pad=0.25", "facecolor": style.BAD, "edgecolor": "white", "linewidth": 1.0},
            )  # fmt: skip


def sentence_lines(sentences: Sequence[str], width: float) -> list[str]:
    """Sentences, numbered where there are several, broken into lines for a figure of that width [inch]."""
    across = max(20, int(CHARACTERS * width))
    if len(sentences) == 1:
        return textwrap.wrap(sentences[0], across)
    shown = [f"{number}  {text}" for number, text in enumerate(sentences[:SENTENCES], start=1)]
    if len(sentences) > len(shown):
        shown.append(f"... and {len(sentences) - len(shown)} more")
    return [line for text in shown for line in textwrap.wrap(text, across, subsequent_indent="    ")]


def write_lines(figure: Figure, left: float, lines: Sequence[str]) -> None:
    """Lines in red, `left` inches from the left and at the top of a figure."""
    wide, tall = figure.get_size_inches()
    for row, line in enumerate(lines):
        place = (left / wide, 1 - (0.14 + row * LINE) / tall)
        figure.text(*place, line, fontsize=10, color=style.BAD, va="top", parse_math=False)
