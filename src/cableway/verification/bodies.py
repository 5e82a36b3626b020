"""The pieces of a gripper beyond its disc: their clearance from the scene, from each other and from the cable."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import shapely
from jaxtyping import Float, Integer

from cableway.records import Check
from cableway.scene.bodies import Body
from cableway.scene.task import Task
from cableway.verification.ends import Ends
from cableway.verification.geometry import outline_at
from cableway.verification.swept import Closest, Measure, closest_approach, depths, to_scene

OUTLINE_SPACING = 0.004
"""Distance [m] of the vertices round a piece: the depth of an overlap is that of the deepest of them."""

SIDES = ("left", "right")


def body_checks(
    lines: Float[np.ndarray, "t m 2"],
    poses: Float[np.ndarray, "t 2 3"],
    task: Task,
    limit: float,
    ends: Ends | None = None,
) -> list[Check]:
    """Least clearances of the grippers' pieces over a motion; none where grippers are discs alone.

    Args:
        lines: (t, m, 2) the whole cable [m].
        poses: (t, 2, 3) grippers [m, m, rad].
        task: The task.
        limit: Least clearance [m]; contact fails in any case.
        ends: Where start and goal may keep less.
    """
    pieces = [body for body in task.grippers.bodies if len(body.outline) > 1]
    outlines = [outline_at(piece.outline, poses[:, piece.side], OUTLINE_SPACING) for piece in pieces]
    found: dict[str, list[Check]] = {}
    for piece, outline in zip(pieces, outlines, strict=True):
        to_obstacles = to_scene(task.scene, piece.heights[0], solid=True)
        check = _check("gripper body clearance", outline, to_obstacles, limit, ends)
        found.setdefault(check.name, []).append(_where(check, f"the {piece.name} and {{}}", task))
        if piece.heights[0] < 2 * task.cable.radius:
            free = _free(lines, piece, task, limit)
            moving, to_cable = np.concatenate([outline, free], axis=1), partial(_to_line, split=outline.shape[1])
            check = _check("gripper body from the cable", moving, to_cable, limit, ends, task.cable.radius)
            found.setdefault(check.name, []).append(replace(check, where=f"the {piece.name} and the cable"))
    for i, one in enumerate(pieces):
        for other, outline in zip(pieces[i + 1 :], outlines[i + 1 :], strict=True):
            if one.side == other.side or not _level(one, other):
                continue
            moving = np.concatenate([outlines[i], outline], axis=1)
            apart = partial(_to_outline, split=outlines[i].shape[1])
            check = _check("gripper bodies apart", moving, apart, limit, ends)
            found.setdefault(check.name, []).append(replace(check, where="both grippers"))
    return [min(checks, key=lambda check: check.value - check.limit) for checks in found.values()]


def piece_clearances(
    poses: Float[np.ndarray, "t 2 3"], lines: Float[np.ndarray, "t m 2"], task: Task
) -> Float[np.ndarray, "t"]:
    """Least of all the clearances [m] of `body_checks` in each row, from the walls and the obstacles of the task."""
    pieces = [body for body in task.grippers.bodies if len(body.outline) > 1]
    outlines = [outline_at(piece.outline, poses[:, piece.side], OUTLINE_SPACING) for piece in pieces]
    least = np.full(len(poses), np.inf)
    for i, (piece, outline) in enumerate(zip(pieces, outlines, strict=True)):
        least = np.minimum(least, to_scene(task.scene, piece.heights[0], solid=True)(outline)[0])
        if piece.heights[0] < 2 * task.cable.radius:
            moving = np.concatenate([outline, _free(lines, piece, task, 0.0)], axis=1)
            least = np.minimum(least, _to_line(moving, outline.shape[1])[0] - task.cable.radius)
        for other, beside in zip(pieces[i + 1 :], outlines[i + 1 :], strict=True):
            if piece.side != other.side and _level(piece, other):
                moving = np.concatenate([outline, beside], axis=1)
                least = np.minimum(least, _to_outline(moving, outline.shape[1])[0])
    return least


def _level(one: Body, other: Body) -> bool:
    return max(one.heights[0], other.heights[0]) < min(one.heights[1], other.heights[1])


def _free(lines: np.ndarray, piece: Body, task: Task, limit: float) -> np.ndarray:
    """The cable but for what the piece's own gripper holds, and what leaves it with a clearance of `limit` [m]."""
    held = np.abs(piece.outline[:, 0] + 1j * piece.outline[:, 1]).max() + task.cable.radius + limit
    count = lines.shape[1]
    first = min(count - 2, int(np.ceil(held / task.cable.length * (count - 1))))
    return lines[:, first:] if piece.side == 0 else lines[:, : count - first]


def _check(
    name: str,
    moving: Float[np.ndarray, "t m 2"],
    measure: Measure,
    limit: float,
    ends: Ends | None,
    radius: float = 0.0,
) -> Check:
    """Two things that move come nearer twice as fast as either."""
    asked = limit if ends is None else ends.clearance(limit, moving, measure, radius)
    found: Closest = closest_approach(moving, measure, asked, rate=2.0)
    value = found.distance - radius
    passed = found.wanted - 1e-9 <= value and value > 0
    return Check(name, value, "m", found.wanted, passed, str(found.obstacle), found.row)


def _where(check: Check, text: str, task: Task) -> Check:
    return replace(check, where=text.format(task.scene.name_of(int(check.where))))


def _to_line(lines: np.ndarray, split: int) -> tuple[Float[np.ndarray, "t"], Integer[np.ndarray, "t"]]:
    """Distance [m] of an outline, the first vertices, from a line, the others; negative by how deep that is inside."""
    outline, line = np.asarray(shapely.polygons(lines[:, :split])), shapely.linestrings(lines[:, split:])
    gap = np.asarray(shapely.distance(outline, line))
    for row in np.flatnonzero(gap == 0):
        gap[row] = -depths(lines[row : row + 1, split:], outline[row])[0]
    return gap, np.zeros(len(lines), int)


def _to_outline(lines: np.ndarray, split: int) -> tuple[Float[np.ndarray, "t"], Integer[np.ndarray, "t"]]:
    """The same between two outlines."""
    one, other = (np.asarray(shapely.polygons(part)) for part in (lines[:, :split], lines[:, split:]))
    gap = np.asarray(shapely.distance(one, other))
    for row in np.flatnonzero(gap == 0):
        inside = depths(lines[row : row + 1, split:], one[row]), depths(lines[row : row + 1, :split], other[row])
        gap[row] = -max(inside[0][0], inside[1][0])
    return gap, np.zeros(len(lines), int)
