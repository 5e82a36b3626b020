"""What was found on a table by depth images: outlines on the pictures, and from above."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import UInt8
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from cableway.figures import palette, style
from cableway.figures.scene import draw_scene, polygon_path
from cableway.perception.calibration import CalibratedCamera
from cableway.perception.survey import Survey
from cableway.scene.obstacles import Polygon, to_shapely
from cableway.scene.task import Draft

SIDE, BELOW, GAP, LEFT = 2.9, 0.85, 0.15, 0.55
"""Inches: height of the panels, room below them, between them, and left of the plan."""

FOUND, UNSEEN = palette.VERMILION, palette.BLUE
"""Colours of obstacles, and of what no camera saw."""


def survey_figure(
    task: Draft, survey: Survey, images: Sequence[UInt8[np.ndarray, "h w 3"]], cameras: Sequence[CalibratedCamera]
) -> Figure:
    """The pictures of all cameras with the outlines on them, and the table from above.

    Args:
        task: With what was found in its scene.
        survey: What was found.
        images: Of each camera.
        cameras: The cameras.
    """
    across = [SIDE * image.shape[1] / image.shape[0] for image in images]
    width, height = task.scene.size
    plan = SIDE * width / height
    total = sum(across) + GAP * len(images) + LEFT + plan + GAP
    figure = style.new_figure(total, SIDE + BELOW)
    left = 0.0
    for image, camera, wide in zip(images, cameras, across, strict=True):
        ax = style.add_axes(figure, left, BELOW, wide, SIDE)
        ax.imshow(image)
        for obstacle in survey.obstacles:
            for pixels in _edges(obstacle, camera):
                ax.plot(*pixels.T, color=FOUND, linewidth=0.9)
        ax.set_xlim(-0.5, image.shape[1] - 0.5)
        ax.set_ylim(image.shape[0] - 0.5, -0.5)
        ax.set_axis_off()
        left += wide + GAP
    ax = style.add_axes(figure, left + LEFT - GAP, BELOW, plan, SIDE)
    draw_scene(ax, task)
    for patch in survey.hidden:
        ax.add_patch(_hatched(patch))
    for obstacle in survey.obstacles:
        ax.plot(*np.vstack([obstacle.vertices, obstacle.vertices[:1]]).T, color=FOUND, linewidth=0.9, zorder=3)
        x, y = obstacle.vertices.mean(axis=0)
        ax.text(x, y, f"{1000 * (obstacle.height or 0.0):.0f}", fontsize=style.TICK, ha="center", va="center", zorder=9)
    if task.start is not None:
        ax.plot(*task.start.T, color=palette.INK, linewidth=1.2, zorder=4)
    handles = [
        Line2D([], [], color=FOUND, label="obstacle, height [mm]"),
        Patch(facecolor="none", edgecolor=UNSEEN, hatch="////", label="not seen"),
        Line2D([], [], color=palette.INK, label="start"),
    ]
    style.legend_below(ax, handles, 3)
    return figure


def _edges(obstacle: Polygon, camera: CalibratedCamera) -> list[np.ndarray]:
    """Pixels (k, 2) of its lower and upper edge."""
    corners = np.vstack([obstacle.vertices, obstacle.vertices[:1]])
    return [camera.project(np.column_stack([corners, np.full(len(corners), z)]))[0] for z in (0.0, obstacle.height)]


def _hatched(patch: Polygon) -> Patch:
    from matplotlib.patches import PathPatch

    return PathPatch(
        polygon_path(to_shapely(patch)), facecolor="none", edgecolor=UNSEEN, hatch="////", linewidth=0.5, zorder=3
    )
