"""The paper's path set: linear transfer of the pivot path, spread over the width of the passages (Tang et al.).

x_i(sigma) = x_p(sigma) + d_i(sigma), with d_i linear in sigma from the start shape's offset to the goal shape's. In
each traversed passage the paths of the shrunken shapes give the order; their crossings are moved to the middle of
the passage and scaled to p_w = min(p_d, alpha L). Between passages the offsets are linear again.

Note:
    As written it keeps free space in no way: the outer paths of a narrow passage lie on the obstacles, and the
    stretches to the full-size end shapes may cut through them. Crossings that nearly coincide are spread out in an
    order that means nothing.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.geometry import polyline
from cableway.planning.routes.passages import crossings
from cableway.planning.routes.pivot import pivot_keypoint
from cableway.records import Passage
from cableway.scene.task import Task
from cableway.tang2025.planning.config import PathSetConfig


def transferred_paths(
    task: Task, pivot: Float[np.ndarray, "P 2"], traversed: list[tuple[Passage, float]], config: PathSetConfig
) -> Float[np.ndarray, "n M 2"]:
    """One path for each keypoint, by linear transfer and redistribution; `traversed` as `traversed_passages` gives."""
    middle = pivot_keypoint(task.cable.keypoints)
    length = max(float(polyline.length(pivot)), 1e-12)
    ends = np.stack([task.start - task.start[middle], task.goal - task.goal[middle]])
    shares, offsets = [0.0], [ends[0]]
    for passage, arc in traversed:
        places = _redistribute(
            _crossing_places(pivot, ends, passage, arc / length, config.shrink), passage, task, config
        )
        shares.append(arc / length)
        offsets.append(places - polyline.point_at(pivot, np.array([arc])))
    shares.append(1.0)
    offsets.append(ends[1])
    return np.array([_path(pivot, np.array(shares), np.array(offsets)[:, i], config) for i in range(len(task.start))])


def _path(pivot: np.ndarray, shares: np.ndarray, offsets: np.ndarray, config: PathSetConfig) -> np.ndarray:
    """The pivot path moved by offsets that are linear between the given shares of its length."""
    length = float(polyline.length(pivot))
    share = np.union1d(np.linspace(0.0, 1.0, config.waypoints), shares)
    offset = np.column_stack([np.interp(share, shares, offsets[:, axis]) for axis in range(2)])
    return polyline.resample(polyline.point_at(pivot, share * length) + offset, config.waypoints)


def _crossing_places(
    pivot: np.ndarray, ends: np.ndarray, passage: Passage, share: float, shrink: float
) -> Float[np.ndarray, "n"]:
    """Where the paths of the shrunken shapes cross the passage's line, as distances [m] from its first end."""
    length = float(polyline.length(pivot))
    shares = polyline.arc_length(pivot)[:, None] / max(length, 1e-12)
    along = (passage.ends[1] - passage.ends[0]) / passage.width
    # the line beyond the passage counts too, so that a shrunken path that misses it still has its place in the order
    line = passage.ends.mean(axis=0) + np.outer([-1.0, 1.0], along) * (passage.width + length)
    places = []
    for start, goal in zip(ends[0], ends[1], strict=True):
        path = pivot + shrink * ((1 - shares) * start + shares * goal)
        arcs, _ = crossings(path, line)
        at = arcs[np.argmin(np.abs(arcs - share * polyline.length(path)))] if len(arcs) else share * length
        places.append((polyline.point_at(path, np.array([at]))[0] - passage.ends[0]) @ along)
    return np.array(places)


def _redistribute(
    places: Float[np.ndarray, "n"], passage: Passage, task: Task, config: PathSetConfig
) -> Float[np.ndarray, "n 2"]:
    """The same order about the middle of the passage, over the width min(p_d, alpha L)."""
    width = min(passage.width, config.spread * task.cable.length)
    spread = places - 0.5 * (places.min() + places.max())
    scale = width / max(float(np.ptp(places)), 1e-12)
    along = (passage.ends[1] - passage.ends[0]) / passage.width
    return passage.ends.mean(axis=0) + (scale * spread)[:, None] * along
