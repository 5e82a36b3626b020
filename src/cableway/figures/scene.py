"""The scene, cables at their true thickness, grippers as discs; and the picture of a task."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch, Polygon, Rectangle
from matplotlib.path import Path
from matplotlib.ticker import MaxNLocator

from cableway.core.errors import TaskError, printable
from cableway.core.quantities import limit_text, size_text
from cableway.figures import palette, style
from cableway.figures.marks import LINE, Mark, draw_marks, sentence_lines, write_lines
from cableway.geometry import polyline, se2
from cableway.scene.bodies import outer_bodies
from cableway.scene.scene import Scene
from cableway.scene.task import ENDS, SPLINE_PIECES, Draft, Task

TICKS = 4
"""Most intervals between the numbers on an axis of a scene."""

TASKS_SHOWN = 60
"""Most tasks in one picture."""

PANEL = 2.9
"""Longer side [inch] of a panel that shows a scene, two of which fit across two columns."""

LEAST_PANEL = 2.0
"""Shorter side [inch] at least: the curves beside it need as much."""

LEFT, BETWEEN, BELOW, ABOVE, BAR, RIGHT = 0.5, 0.2, 0.72, 0.28, 0.62, 0.1
"""Inches left of the first panel, between panels, below them with their legends, above with their titles, for a colour
bar, and right of the last panel."""


def draw_scene(ax: Axes, task: Draft) -> None:
    """Workspace, obstacles and port, drawn in metres at equal scale; the axes say millimetres."""
    width, height = task.scene.size
    frame(ax, np.zeros(2), np.array(task.scene.size))
    draw_solids(ax, task.scene)
    walls = Rectangle((0, 0), width, height, fill=False, edgecolor=palette.INK, linewidth=1.4, zorder=8, clip_on=False)
    ax.add_patch(walls)
    if task.port_walls is not None:
        _draw_port(ax, task.port_walls)


def frame(ax: Axes, low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"]) -> None:
    """What is between two corners [m], at equal scale; the axes say millimetres."""
    ax.set_aspect("equal")
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])
    for axis, name in ((ax.xaxis, "x"), (ax.yaxis, "y")):
        axis.set_label_text(f"{name} [mm]", fontsize=style.LABEL, color=palette.MUTED)
        axis.labelpad = 2
        axis.set_major_locator(MaxNLocator(TICKS, steps=[1, 2, 5, 10]))
        axis.set_major_formatter(lambda metres, _: f"{1000 * metres:g}")
    ax.tick_params(colors=palette.MUTED, labelsize=style.TICK, length=2, pad=2)
    for spine in ax.spines.values():
        spine.set_visible(False)


def draw_solids(ax: Axes, scene: Scene, **options: Any) -> PathCollection:
    """The obstacles; `options` go to Matplotlib's collection."""
    solids = [polygon_path(solid) for solid in scene.solids]
    settings = {
        "facecolor": palette.OBSTACLE,
        "edgecolor": palette.OBSTACLE_EDGE,
        "linewidth": 0.9,
        "zorder": 2,
        **options,
    }
    return _add_paths(ax, solids, **settings)


def _draw_port(ax: Axes, walls: Float[np.ndarray, "4 2"]) -> None:
    ax.fill(*walls.T, color="white", zorder=3, linewidth=0)
    ax.plot(*walls.T, color=palette.INK, linewidth=1.6, zorder=3, solid_capstyle="butt")


def polygon_path(polygon: shapely.Polygon) -> Path:
    """A polygon, holes included, as one path."""
    rings = [polygon.exterior, *polygon.interiors]
    return Path.make_compound_path(*(Path(shapely.get_coordinates(ring), closed=True) for ring in rings))


def cable_path(curve: Float[np.ndarray, "m 2"], radius: float) -> Path:
    """The area that a cable covers: its centreline [m] grown by `radius` [m]."""
    area = shapely.LineString(curve).buffer(radius, quad_segs=6)
    return polygon_path(area)  # pyright: ignore[reportArgumentType]


def smooth(shapes: Float[np.ndarray, "... n space"]) -> Float[np.ndarray, "... m space"]:
    """The cable between its keypoints."""
    return polyline.spline(shapes, SPLINE_PIECES)


def draw_cable(ax: Axes, curve: Float[np.ndarray, "m 2"], radius: float, color: Any, **options: Any) -> PathPatch:
    """One cable at its true thickness; `options` go to Matplotlib's patch."""
    settings = {"facecolor": color, "edgecolor": "white", "linewidth": 0.6, "zorder": 4, **options}
    patch = PathPatch(cable_path(curve, radius), **settings)
    ax.add_patch(patch)
    return patch


def draw_cables(
    ax: Axes, curves: Float[np.ndarray, "b m 2"], radius: float, colors: Any, **options: Any
) -> PathCollection:
    """Many cables at their true thickness, later ones above earlier ones."""
    paths = [cable_path(curve, radius) for curve in curves]
    return _add_paths(ax, paths, facecolors=colors, **{"linewidths": 0.4, "zorder": 4, **options})


def draw_grippers(ax: Axes, points: Float[np.ndarray, "k 2"], radius: float, **options: Any) -> PathCollection:
    """Grippers as discs of their footprint [m]."""
    discs = [Path.circle((float(x), float(y)), radius) for x, y in points]
    return _add_paths(ax, discs, facecolors=palette.INK, **{"linewidths": 0.8, "zorder": 7, **options})


def draw_bodies(ax: Axes, task: Draft, poses: Float[np.ndarray, "k 2 3"], **options: Any) -> None:
    """What the grippers at `poses` [m, m, rad] have beyond their discs, seen from above."""
    for body in outer_bodies(task.grippers.pieces, [None]):
        outlines = [Path(outline, closed=True) for outline in body.placed(poses[:, body.side])]
        settings = {"facecolors": palette.MUTED, "alpha": 0.05, "linewidths": 0.0, "zorder": 3.5, **options}
        _add_paths(ax, outlines, **settings)


def _add_paths(ax: Axes, paths: Sequence[Path], **options: Any) -> PathCollection:
    collection = PathCollection(paths, **{"edgecolor": "white", **options})
    ax.add_collection(collection)
    return collection


def plug_corners(task: Draft, pose: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 2"]:
    """Corners [m] of the plug ahead of the right gripper at `pose`."""
    assert task.plug is not None
    return task.plug.body.placed(pose, task.plug.length)[:-1]


def draw_end_shapes(ax: Axes, task: Draft, letters: bool = True) -> None:
    """Start and goal of the cable with their grippers (L, R) and the plug, as far as they are known."""
    for end, color in zip(ENDS, (palette.START, palette.GOAL), strict=True):
        shape: np.ndarray | None = getattr(task, end)
        poses: np.ndarray | None = getattr(task, f"{end}_poses")
        if shape is not None and len(shape) > 1:
            draw_cable(ax, smooth(shape), task.cable.radius, color, zorder=6)
        elif poses is not None:
            shape = poses[:, :2]
            ax.plot(*shape.T, color=color, linewidth=1.6, linestyle=(0, (2, 2)), zorder=6)
            for pose in poses:
                ahead = pose[:2] + 2 * task.grippers.radius * se2.direction(pose[2])
                ax.plot(*np.transpose([pose[:2], ahead]), color=color, linewidth=2.4, zorder=6)
        else:
            continue
        if task.plug is not None and task.ends_somewhere(end):
            corners = plug_corners(task, task.plug_pose(end))
            ax.add_patch(Polygon(corners, facecolor=color, edgecolor="white", linewidth=0.6, alpha=0.65, zorder=6))
        if task.ends_somewhere(end):
            draw_bodies(ax, task, task.gripper_poses(end)[None], facecolors=color, alpha=0.3)
        draw_grippers(ax, shape[[0, -1]], task.grippers.radius)
        if letters:
            _draw_letters(ax, shape, color, aside=task.plug is not None)


def _draw_letters(ax: Axes, shape: np.ndarray, color: str, aside: bool) -> None:
    """L and R beyond the ends of the cable, or beside the right end where a plug lies ahead of it."""
    inner = min(2, len(shape) - 1)
    for letter, end, within in (("L", shape[0], shape[inner]), ("R", shape[-1], shape[-1 - inner])):
        outward = (end - within) / max(float(np.linalg.norm(end - within)), 1e-9)
        if aside and letter == "R":
            outward = np.array([-outward[1], outward[0]])
        ax.annotate(
            letter, end, xytext=(8 * outward[0], 8 * outward[1]), textcoords="offset points", ha="center",
            va="center", fontsize=style.LABEL, fontweight="bold", color=color, zorder=9,
        )  # fmt: skip


def end_handles() -> list[Any]:
    """Legend entries of what `draw_end_shapes` and `draw_scene` draw."""
    return [
        Patch(facecolor=palette.START, label="start"),
        Patch(facecolor=palette.GOAL, label="goal"),
        Line2D([], [], marker="o", color="none", markerfacecolor=palette.INK, markersize=5, label="gripper"),
        Patch(facecolor=palette.OBSTACLE, edgecolor=palette.OBSTACLE_EDGE, label="obstacle"),
    ]


def _plug_handles(task: Draft) -> list[Any]:
    """Legend entries of plug and port, where there are any."""
    handles: list[Any] = []
    if task.plug is not None:
        handles.append(Patch(facecolor=palette.GOAL, alpha=0.65, label="plug"))
    if task.port is not None:
        handles.append(Patch(facecolor="white", edgecolor=palette.INK, linewidth=1.4, label="port"))
    return handles


def panel_size(task: Draft, longest: float = PANEL) -> tuple[float, float]:
    """Width and height [inch] of a panel for the task's workspace, the longer one of which is given."""
    return _panel(*task.scene.size, longest)


def _panel(width: float, height: float, longest: float = PANEL) -> tuple[float, float]:
    scale, least = longest / max(width, height), min(LEAST_PANEL, longest)
    return max(least, scale * width), max(least, scale * height)


def panel_row(task: Draft, count: int, below: float = 0.0, above: float = 0.0) -> tuple[Figure, list[Axes]]:
    """A figure with panels for the task's scene in rows of up to three; see `finish_row`.

    Args:
        task: The task.
        count: Number of panels.
        below: Height [inch] left free below them.
        above: And above.
    """
    columns = min(count, 2 if count == 4 else 3)
    rows, whole = -(-count // columns), style.SINGLE if count == 1 else style.DOUBLE
    pitch = PANEL + BETWEEN if columns == 2 else (whole - LEFT - RIGHT + BETWEEN) / columns
    width, height = panel_size(task, min(PANEL, pitch - BETWEEN))
    figure = style.new_figure(whole, below + rows * (ABOVE + height + BELOW) + above)
    panels = []
    for place in range(count):
        row, column = divmod(place, columns)
        bottom = below + (rows - 1 - row) * (ABOVE + height + BELOW) + BELOW
        panels.append(style.add_axes(figure, LEFT + column * pitch, bottom, width, height))
    return figure, panels


def finish_row(panels: Sequence[Axes]) -> None:
    """When scenes are drawn in panels of the same size: letters, and the y axis on the first panel of a row alone."""
    first = min(ax.get_position().x0 for ax in panels)
    for ax in panels:
        if ax.get_position().x0 > first + 1e-6:
            ax.set_ylabel("")
            ax.set_yticks([])
    style.letter_panels(*panels)


def task_figure(task: Draft, faults: Sequence[TaskError] = ()) -> Figure:
    """The picture of a task: its scene, start and goal, with its name and description; and what is wrong with it.

    Each of `faults` is a sentence above the panel, with its number in a red ring at its place.
    """
    low, high = _view(task) if faults else (np.zeros(2), np.array(task.scene.size))
    height = _panel(*(high - low))[1]
    lines = sentence_lines([fault.sentence for fault in faults], PANEL)
    cable = task.cable
    facts = f"cable {limit_text(cable.length)} long, {limit_text(2 * cable.radius)} thick"
    facts += f" · workspace {size_text(task.scene.size)}"
    text = [*textwrap.wrap(printable(task.description), 60), facts]
    below = BELOW + 0.06 + 0.13 * len(text)
    tall = below + height + ABOVE + (0.1 + LINE * len(lines) if lines else 0.0)
    figure = style.new_figure(style.SINGLE, tall)
    ax = style.add_axes(figure, LEFT, below, PANEL, height)
    draw_scene(ax, task)
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])
    draw_end_shapes(ax, task)
    style.title(ax, task.name)
    style.legend_below(ax, [*end_handles(), *_plug_handles(task)], 4)
    draw_marks(ax, [Mark(fault.sentence, fault.at and fault.at[:2]) for fault in faults])
    write_lines(figure, LEFT, lines)
    place = (LEFT / style.SINGLE, 0.08 / tall)
    figure.text(*place, "\n".join(text), fontsize=style.NOTE, color=palette.MUTED, va="bottom", parse_math=False)
    return figure


def _view(task: Draft) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Corners [m] of what is shown of a task part of which is outside its workspace; at most as much again of that."""
    size = np.array(task.scene.size)
    ends = (task.start, task.goal, task.start_poses, task.goal_poses)
    around = [end[:, :2] + side * task.grippers.radius for end in ends if end is not None for side in (-1, 1)]
    around += [shapely.get_coordinates(solid) for solid in task.scene.solids]
    points = np.vstack([np.zeros(2), size, *around])
    low, high = np.maximum(points.min(axis=0), -size), np.minimum(points.max(axis=0), 2 * size)
    return np.where(low < 0, low - 0.02 * size, low), np.where(high > size, high + 0.02 * size, high)


def tasks_figure(tasks: Sequence[Task]) -> Figure:
    """Many tasks in one picture, up to `TASKS_SHOWN` of them, in rows."""
    shown = tasks[:TASKS_SHOWN]
    figure, panels = small_panels([task.name for task in shown], 6, 1.06)
    for ax, task in zip(panels, shown, strict=True):
        draw_scene(ax, task)
        draw_end_shapes(ax, task, letters=False)
        leave_bare(ax)
    return figure


def small_panels(titles: Sequence[str], across: int, side: float) -> tuple[Figure, list[Axes]]:
    """A figure with square panels for scenes, in rows of up to `across`; `side` is in inches."""
    across, gap, above = min(len(titles), across), 0.1, 0.2
    down = -(-len(titles) // across)
    figure, panels = style.new_figure(across * (side + gap) + gap, down * (side + above) + gap), []
    for k, name in enumerate(titles):
        row, column = divmod(k, across)
        ax = style.add_axes(figure, gap + column * (side + gap), gap + (down - 1 - row) * (side + above), side, side)
        ax.set_title(name, loc="left", fontsize=style.NOTE, color=palette.INK, pad=3)
        panels.append(ax)
    return figure, panels


def leave_bare(ax: Axes) -> None:
    """No ticks and no names of axes on a scene that was drawn."""
    ax.set_xticks([])
    ax.set_yticks([])
    ax.set_xlabel("")
    ax.set_ylabel("")
