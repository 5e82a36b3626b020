"""What was understood of a drawing or a model, in the scene that it makes."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np
import shapely
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cableway.core.errors import printable
from cableway.core.quantities import quantity, size_text
from cableway.drawings.arrangement import Arrangement
from cableway.figures import palette, style
from cableway.figures.scene import ABOVE, BELOW, LEFT, PANEL, draw_end_shapes, draw_scene, end_handles, panel_size
from cableway.scene.task import Draft

LINE, WIDE, SHOWN = 0.13, 74, 8
"""Height of a line [inch], letters in it, and lines of what was left out."""

FOUND, GONE = palette.GREEN, palette.PURPLE
"""Colours of outlines, and of what is not among the obstacles."""


def imported_figure(task: Draft, found: Arrangement, unit: str) -> Figure:
    """The scene with the outlines as drawn; edges of obstacles within one are where it was split.

    Args:
        task: The task, in that scene.
        found: What it is from.
        unit: Of the file, and who says so.
    """
    width, height = panel_size(task, 2 * PANEL)
    lines = _lines(found, unit)
    below = BELOW + 0.1 + LINE * len(lines)
    figure = style.new_figure(max(LEFT + width + 0.2, style.SINGLE), below + height + ABOVE)
    ax = style.add_axes(figure, LEFT, below, width, height)
    draw_scene(ax, task)
    for outline in found.outlines:
        ax.plot(*outline.region.exterior.xy, color=FOUND, linewidth=1.1, zorder=3)
        x, y = outline.region.representative_point().coords[0]
        label = outline.name if outline.height is None else f"{outline.name}\n{quantity(outline.height)}"
        ax.text(x, y, printable(label), fontsize=style.TICK, ha="center", va="center", zorder=9, parse_math=False)
    for each in found.left_out:
        if each.at is not None:
            for line in _lines_of(each.at):
                ax.plot(*line, color=GONE, linewidth=1.0, linestyle=(0, (3, 2)), zorder=3)
    draw_end_shapes(ax, task)
    style.title(ax, task.name)
    handles = [
        Line2D([], [], color=FOUND, label="outline"),
        Line2D([], [], color=GONE, linestyle=(0, (3, 2)), label="left out"),
    ]
    style.legend_below(ax, [*end_handles()[:2], *handles], 4)
    place = (LEFT / figure.get_figwidth(), 0.08 / figure.get_figheight())
    figure.text(*place, "\n".join(lines), fontsize=style.NOTE, color=palette.MUTED, va="bottom", parse_math=False)
    return figure


def _lines(found: Arrangement, unit: str) -> list[str]:
    counts = f"outlines: {len(found.outlines)} · convex obstacles: {len(found.scene.obstacles)}"
    facts = [f"unit: {unit} · workspace {size_text(found.scene.size)} · {counts}"]
    gone = [textwrap.shorten(f"left out: {printable(str(each))}", WIDE) for each in found.left_out]
    more = [f"and {len(gone) - SHOWN} more left out"] if len(gone) > SHOWN else []
    return [*facts, *gone[:SHOWN], *more]


def _lines_of(shape: shapely.Geometry) -> Sequence[np.ndarray]:
    """Coordinates (2, k) of its lines and edges."""
    edges = [part.boundary if isinstance(part, shapely.Polygon) else part for part in shapely.get_parts(shape)]
    return [shapely.get_coordinates(part).T for edge in edges for part in shapely.get_parts(edge)]
