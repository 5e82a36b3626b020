"""The path set: one path for each keypoint, all in the homotopy class of the pivot path.

Path i begins as a curve that is in free space whatever the scene: along the start cable from keypoint i to the
pivot keypoint, along the pivot path, and along the goal cable to keypoint i. All of these are homotopic by
construction. In each passage that the pivot path traverses it takes a detour to a place of its own, so that the
paths use the passage's width; between those places it is shortened, then smoothed, by changes that are each
rejected where they leave free space or pass over an obstacle.

Note:
    The paper transfers the pivot path linearly (`path_transfer`), which does not keep free space.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError
from cableway.geometry import polyline
from cableway.planning.routes import band
from cableway.planning.routes.passages import crossings, traversed_passages
from cableway.planning.routes.pivot import pivot_keypoint
from cableway.planning.routes.pivot_grid import subdivide
from cableway.records import Passage
from cableway.scene.task import Task
from cableway.scene.validity import SPLINE_PIECES
from cableway.tang2025.planning.config import PathSetConfig
from cableway.tang2025.planning.path_transfer import transferred_paths

SPACING = 0.006
"""Distance [m] between vertices while paths are shortened: fine against cables of some 0.3 m."""

SCALES = (4.0, 4.0, 2.0, 2.0, 1.0, 1.0, 0.5, 0.5)
"""Size of the sideways moves, in `SPACING`s, from coarse to fine."""

BENDING = 10.0
"""Weight of bending against length while paths are smoothed, per vertex: rounds corners over a few vertices."""

PULL = 500.0
"""Weight [1/m^2] of the squared distance to the reference against length: a bend of 5 cm radius is cut by 2 cm."""

CLEAR = 0.01
"""Weight [m] of 1/clearance against length: at 1 cm from an obstacle a detour of twice the length pays."""

SWEEPS = 20
"""Sweeps of smoothing; more change the paths by less than a millimetre."""


@dataclass(frozen=True)
class PathSet:
    """One path for each keypoint, all homotopic.

    Attributes:
        paths: (n, M, 2) [m]: from start to goal keypoint, at equal arc length along each path.
        pivot: (P, 2) [m]: the pivot path they follow.
        passages: (Q, 2, 2) [m]: ends of the passages that the pivot path traverses, in that order.
    """

    paths: Float[np.ndarray, "n M 2"]
    pivot: Float[np.ndarray, "P 2"]
    passages: Float[np.ndarray, "Q 2 2"]


def generate_path_set(
    task: Task, pivot: Float[np.ndarray, "P 2"], passages: tuple[Passage, ...], config: PathSetConfig
) -> PathSet:
    """One path for each keypoint about the pivot path.

    Args:
        task: Start and goal shapes, cable and scene.
        pivot: (P, 2) [m], from the pivot keypoint of the start to that of the goal.
        passages: Of the scene; those that the pivot does not traverse are left out.
        config: Kind of path set, its resolution and spread.

    Returns:
        Paths whose ends are exactly the start and goal keypoints, at equal arc length along each.

    Raises:
        InputError: The pivot does not run from the start's pivot keypoint to the goal's.
    """
    pivot = np.asarray(pivot, float)
    middle = pivot_keypoint(task.cable.keypoints)
    if pivot.ndim != 2 or not np.allclose(pivot[[0, -1]], [task.start[middle], task.goal[middle]], atol=1e-6):
        raise InputError(f"the pivot path must run from keypoint {middle} of the start to that of the goal")
    traversed = traversed_passages(passages, pivot)
    if config.kind == "homotopic":
        paths = _homotopic_paths(task, pivot, traversed, config)
    else:
        paths = transferred_paths(task, pivot, traversed, config)
    paths[:, 0], paths[:, -1] = task.start, task.goal
    ends = np.array([passage.ends for passage, _ in traversed]).reshape(-1, 2, 2)
    return PathSet(paths, pivot, ends)


def _homotopic_paths(
    task: Task, pivot: np.ndarray, traversed: list[tuple[Passage, float]], config: PathSetConfig
) -> Float[np.ndarray, "n M 2"]:
    places = _places(task, pivot, traversed, config)
    paths = []
    for i, pieces in enumerate(_initial_paths(task, pivot, places)):
        paths.append(_tighten(pieces, _reference(task, pivot, places, i), task, config))
    return np.array(paths)


def _tighten(
    pieces: list[Float[np.ndarray, "_ 2"]],
    references: list[Float[np.ndarray, "_ 2"]],
    task: Task,
    config: PathSetConfig,
) -> Float[np.ndarray, "M 2"]:
    """Shorten the pieces of a path one by one, draw the whole towards the reference, and smooth it."""
    world, points = task.scene.world.arrays, band.reference_points(task.scene.world)
    keep = task.cable.radius + config.margin
    for piece in pieces:
        band.shortcut(piece, world, keep, points, 1.0, 0.0, 1.0, 4)
    joined = np.vstack(pieces)
    lengths = [float(polyline.length(piece)) for piece in pieces]
    path = _even(joined, int(np.clip(sum(lengths) / SPACING, 12, config.waypoints)))
    before, target = path.copy(), _beside(path, lengths, references)
    pull = PULL * sum(lengths) / len(path)
    for scale in SCALES:
        band.relax(path, world, keep, target, pull, 1.0, CLEAR, scale * SPACING, 3)
        band.smooth(path, world, keep, points, BENDING, SWEEPS)
    loop = np.vstack([before, path[::-1]])
    if band.encloses(loop, 0, len(loop) - 1, points):
        path = before
    path = _even(path, config.waypoints)
    band.smooth(path, world, keep, points, BENDING, SWEEPS)
    return _even(path, config.waypoints)


def _beside(path: np.ndarray, lengths: list[float], references: list[np.ndarray]) -> np.ndarray:
    """For each vertex the point of the reference at the same fraction of the same piece."""
    cuts = np.concatenate([[0.0], np.cumsum(lengths)])
    arcs = np.linspace(0.0, cuts[-1], len(path))
    target = np.empty_like(path)
    for k, reference in enumerate(references):
        chosen = (arcs >= cuts[k]) & (arcs <= cuts[k + 1])
        share = (arcs[chosen] - cuts[k]) / max(lengths[k], 1e-12)
        target[chosen] = polyline.point_at(reference, share * float(polyline.length(reference)))
    return target


def _reference(
    task: Task, pivot: np.ndarray, places: list[tuple[float, Float[np.ndarray, "n 2"]]], i: int
) -> list[Float[np.ndarray, "_ 2"]]:
    """The pivot path moved by an offset that is linear between keypoint i's start, places and goal; in pieces."""
    arcs = np.array([0.0, *(arc for arc, _ in places), float(polyline.length(pivot))])
    marks = np.array([task.start[i], *(place[i] for _, place in places), task.goal[i]])
    offsets = marks - polyline.point_at(pivot, arcs)
    references = []
    for k in range(len(arcs) - 1):
        share = np.linspace(0.0, 1.0, 50)[:, None]
        along = polyline.point_at(pivot, arcs[k] + share[:, 0] * (arcs[k + 1] - arcs[k]))
        references.append(along + (1 - share) * offsets[k] + share * offsets[k + 1])
    return references


def _initial_paths(
    task: Task, pivot: np.ndarray, places: list[tuple[float, Float[np.ndarray, "n 2"]]]
) -> list[list[Float[np.ndarray, "_ 2"]]]:
    """For each keypoint the pieces of its first path, cut at its places in the passages."""
    n, middle = task.cable.keypoints, pivot_keypoint(task.cable.keypoints)
    cuts = [0.0, *(arc for arc, _ in places), float(polyline.length(pivot))]
    parts = [_part(pivot, a, b) for a, b in pairwise(cuts)]
    start, goal = polyline.spline(task.start, SPLINE_PIECES), polyline.spline(task.goal, SPLINE_PIECES)
    paths = []
    for i in range(n):
        ahead = _between(start, i * SPLINE_PIECES, middle * SPLINE_PIECES)
        behind = _between(goal, middle * SPLINE_PIECES, i * SPLINE_PIECES)
        marks = [ahead, *(place[i : i + 1] for _, place in places), behind]
        pieces = [
            np.vstack([first, part, last])
            for first, part, last in zip([ahead, *marks[1:-1]], parts, [*marks[1:-1], behind], strict=True)
        ]
        paths.append([subdivide(piece, SPACING) for piece in pieces])
    return paths


def _between(line: np.ndarray, first: int, last: int) -> np.ndarray:
    return line[first : last + 1] if first <= last else line[last : first + 1][::-1]


def _part(path: np.ndarray, first: float, last: float) -> np.ndarray:
    """The part of a path between two arc lengths."""
    arc = polyline.arc_length(path)
    inner = path[(arc > first) & (arc < last)]
    ends = polyline.point_at(path, np.array([first, last]))
    return np.vstack([ends[:1], inner, ends[1:]])


def _places(
    task: Task, pivot: np.ndarray, traversed: list[tuple[Passage, float]], config: PathSetConfig
) -> list[tuple[float, Float[np.ndarray, "n 2"]]]:
    """Where the paths cross each passage, with the arc length [m] at which the pivot does.

    In order and direction as the linearly transferred shape would, about the pivot's own crossing, scaled down to
    p_w = min(p_d - 2 (radius + margin), alpha L) if it is wider, and moved along the passage until it fits.

    Note:
        The paper always scales to p_w, which blows up arbitrary small differences where the cable passes
        lengthwise; it takes p_w = min(p_d, alpha L), which puts the outer paths on the obstacles. A passage that
        the start or the goal cable straddles is left out: its keypoints are already on both sides.
    """
    middle, total = pivot_keypoint(task.cable.keypoints), float(polyline.length(pivot))
    shapes = [polyline.spline(task.start, SPLINE_PIECES), polyline.spline(task.goal, SPLINE_PIECES)]
    found = []
    for passage, arc in traversed:
        if any(len(crossings(shape, passage.ends)[0]) for shape in shapes):
            continue
        along = (passage.ends[1] - passage.ends[0]) / passage.width
        crossing = polyline.point_at(pivot, np.array([arc]))[0]
        before, after = polyline.point_at(pivot, np.array([arc - 0.01, arc + 0.01]))
        tangent = (after - before) / max(float(np.linalg.norm(after - before)), 1e-12)
        share = arc / total
        offsets = (1 - share) * (task.start - task.start[middle]) + share * (task.goal - task.goal[middle])
        sine = tangent[0] * along[1] - tangent[1] * along[0]
        spread = (tangent[0] * offsets[:, 1] - tangent[1] * offsets[:, 0]) * np.sign(sine)
        border = min(task.cable.radius + config.margin, 0.5 * passage.width)
        widest = min(passage.width - 2 * border, config.spread * task.cable.length)
        spread = spread * min(1.0, widest / max(float(np.ptp(spread)), 1e-12))
        position = float((crossing - passage.ends[0]) @ along)
        position = np.clip(position, border - spread.min(), passage.width - border - spread.max())
        found.append((arc, passage.ends[0] + (position + spread)[:, None] * along))
    return found


def _even(path: np.ndarray, count: int) -> np.ndarray:
    """`count` points at equal arc length."""
    even = polyline.resample(path, count)
    even[0], even[-1] = path[0], path[-1]
    return even
