"""What is wrong, in a picture: a red ring about each place, with its number, and the sentences above."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cableway.core.errors import Point
from cableway.figures import palette, style
from cableway.verdict import Verdict

RING = 8.0
"""Radius of a ring in points: seen at any scale."""

SENTENCES = 6
"""Most sentences written out."""

LINE, CHARACTERS = 0.16, 17.0
"""Height [inch] of a line of them, and characters to the inch."""


class Mark(NamedTuple):
    """Something that is wrong.

    Attributes:
        sentence: What.
        at: Where [m], or None.
        line: (m, 2) the cable then [m], or None.
    """

    sentence: str
    at: Point | None = None
    line: Float[np.ndarray, "m 2"] | None = None


def marks_of(verdict: Verdict | None, lines: Float[np.ndarray, "t m 2"]) -> list[Mark]:
    """What did not pass of a motion with these rows [m]: at its place, else at the middle of the cable in its row."""
    marks = []
    for check in verdict.failures() if verdict else ():
        line = None if check.row is None else lines[min(round(check.row), len(lines) - 1)]
        middle = None if line is None else (float(line[len(line) // 2, 0]), float(line[len(line) // 2, 1]))
        marks.append(Mark(str(check), check.at or middle, line))
    return marks


def draw_marks(ax: Axes, marks: Sequence[Mark]) -> None:
    """A ring about each place, with its number from 1 where there are several marks, and the cables of the marks.

    Places whose rings would overlap share one, and one beyond the axes is marked at their edge.
    """
    for mark in marks[:SENTENCES]:
        if mark.line is not None:
            for color, width in (("white", 3.0), (palette.BAD, 1.4)):
                ax.plot(*mark.line.T, color=color, linewidth=width, zorder=10)
    places = [mark.at for mark in marks[:SENTENCES]]
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
        for color, width in (("white", 4.6), (palette.BAD, 2.2)):
            ax.plot(
                *at, marker="o", markersize=2 * RING, markerfacecolor="none", markeredgecolor=color,
                markeredgewidth=width, zorder=11, clip_on=False, gid="mark",
            )  # fmt: skip
        if len(places) > 1:
            x, y = np.where(at < (low + high) / 2, 1.0, -1.0)
            ax.annotate(
                ", ".join(map(str, numbers)), (float(at[0]), float(at[1])), textcoords="offset points",
                xytext=(1.05 * RING * x, 1.05 * RING * y), ha="left" if x > 0 else "right",
                va="bottom" if y > 0 else "top", fontsize=style.NOTE, fontweight="bold", color="white", zorder=12,
                bbox={"boxstyle": "round,pad=0.25", "facecolor": palette.BAD, "edgecolor": "white", "linewidth": 1.0},
            )  # fmt: skip


def sentence_lines(sentences: Sequence[str], width: float, opening: str = "") -> list[str]:
    """Sentences, numbered where there are several, broken into lines for a figure of that width [inch].

    Args:
        sentences: What is wrong.
        width: Room for a line [inch].
        opening: Words before a single sentence.
    """
    across = max(20, int(CHARACTERS * width))
    if len(sentences) == 1:
        return textwrap.wrap(opening + sentences[0], across)
    shown = [f"{number}  {text}" for number, text in enumerate(sentences[:SENTENCES], start=1)]
    if len(sentences) > len(shown):
        shown.append(f"... and {len(sentences) - len(shown)} more")
    return [line for text in shown for line in textwrap.wrap(text, across, subsequent_indent="    ")]


def write_lines(figure: Figure, left: float, lines: Sequence[str]) -> None:
    """Lines in red, `left` inches from the left and at the top of a figure."""
    wide, tall = figure.get_size_inches()
    for row, line in enumerate(lines):
        place = (left / wide, 1 - (0.14 + row * LINE) / tall)
        figure.text(*place, line, fontsize=style.LABEL, color=palette.BAD, va="top", parse_math=False)
