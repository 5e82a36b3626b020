"""The picture of an insertion: the plug on its way into the port, and its misalignment; dashed what is allowed."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Polygon

from cableway.figures import palette, scene, style
from cableway.figures.plan import AXIS
from cableway.figures.replanning import change_of, draw_actual_scene
from cableway.outcome import PORT_ANGLE, PORT_LATERAL
from cableway.records import Rollout
from cableway.scene.task import Task

SIDE = scene.PANEL
"""Side [inch] of the view of the port."""

AROUND = 1.6
"""Half the side of that view in lengths of the plug."""

SHOWN = 4
"""Places of the plug that are drawn."""


def insertion_figure(task: Task, rollout: Rollout) -> Figure:
    """The plug before and in the port on the left; on the right how far the tip is off the axis, and turned from it."""
    assert task.plug is not None
    assert task.port is not None
    figure = style.new_figure(style.DOUBLE, scene.BELOW + SIDE + scene.ABOVE)
    ax = style.add_axes(figure, scene.LEFT, scene.BELOW, SIDE, SIDE)
    _draw_port_view(ax, task, rollout)
    style.title(ax, f"{task.name}: into the port")
    found = task.port.alignment(task.plug, rollout.poses[:, 1])
    left = scene.LEFT + SIDE + scene.BETWEEN + scene.LEFT
    half = (scene.BELOW + SIDE + scene.ABOVE) / 2 - AXIS - scene.ABOVE
    panels = [ax]
    upper = AXIS + half + scene.ABOVE + AXIS
    curves = (
        (upper, "off the axis", "distance", "mm", 1000 * np.abs(found.lateral), 1000 * PORT_LATERAL),
        (AXIS, "turned from the axis", "angle", "deg", np.degrees(np.abs(found.angle)), np.degrees(PORT_ANGLE)),
    )
    for bottom, name, what, unit, values, limit in curves:
        below = style.add_axes(figure, left, bottom, style.DOUBLE - scene.RIGHT - left, half)
        panels.append(below)
        below.plot(1000 * found.depth, values, color=palette.LEFT, linewidth=1.3)
        below.plot([0.0, 1000 * task.port.depth], [limit, limit], color=palette.BAD, linewidth=1.0, linestyle="--")
        below.axvline(0.0, color=palette.INK, linewidth=1.0, linestyle=":")
        style.title(below, f"tip {name}, {values[-1]:.2f} {unit} at the end")
        style.curve_axes(below, "depth of the tip in the port [mm], negative before it", f"{what} [{unit}]")
        top = 1.15 * max(float(values.max()), limit)
        below.set_ylim(0, top)
        for x, y, text, color in (
            (0.5, limit, "allowed", palette.BAD),
            (0.0, 0.5 * top, " mouth of the port", palette.INK),
        ):
            below.text(x, y, text, fontsize=style.NOTE, color=color, va="bottom")
    style.letter_panels(*panels)
    return figure


def _draw_port_view(ax: Axes, task: Task, rollout: Rollout) -> None:
    """The scene about the port, with cable and plug at the beginning, in between and at the end."""
    assert task.plug is not None
    assert task.port is not None
    draw_actual_scene(ax, task, change_of(task, rollout))
    for patch in ax.patches:
        patch.set_clip_on(True)  # the walls are drawn beyond their axes
    depths = task.port.alignment(task.plug, rollout.poses[:, 1]).depth
    rows = [int(np.argmin(np.abs(depths - depth))) for depth in np.linspace(depths[0], depths[-1], SHOWN)]
    for row, share in zip(rows, np.linspace(0, 1, SHOWN), strict=True):
        color = style.TIME(share)
        scene.draw_cable(ax, rollout.centreline[row], task.cable.radius, color)
        corners = scene.plug_corners(task, rollout.poses[row, 1])
        ax.add_patch(Polygon(corners, facecolor=color, edgecolor="white", linewidth=0.6, alpha=0.7, zorder=6))
    scene.draw_grippers(ax, rollout.poses[rows, 1, :2], task.grippers.radius)
    (x, y), half = task.port.position, AROUND * task.plug.length
    ax.set_xlim(x - 1.5 * half, x + 0.5 * half)
    ax.set_ylim(y - half, y + half)
    ends = (("cable and plug at first", 0.0), ("at the end", 1.0))
    style.legend_below(ax, [Patch(facecolor=style.TIME(share), label=name) for name, share in ends], 2)
