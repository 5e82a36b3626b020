"""The pieces of a gripper beyond its disc: their clearance from the scene, from each other and from the cable."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float, Integer
from scipy.spatial.transform import Rotation

from cableway.records import Check
from cableway.scene.bodies import Body
from cableway.scene.gripper_bodies import ABOVE_TABLE, AXIS, BodyPart, gripper_body
from cableway.scene.grippers import SIDES
from cableway.scene.task import Task
from cableway.verification.ends import Ends
from cableway.verification.geometry import outline_at, plug_outline
from cableway.verification.swept import Measure, closest_approach, depths, to_scene

OUTLINE_SPACING = 0.004
"""Distance [m] of the vertices round a piece: the depth of an overlap is that of the deepest of them."""


LAYER = 0.01
"""Height [m] over which one outline holds a tilted hand, unless something ends between."""


def hand_pieces(parts: Sequence[BodyPart], task: Task, name: str = "") -> list[Body]:
    """The pieces of both grippers, cut into level layers where they are tilted; `name` comes before those of grippers.

    A cut at the height of everything on the table: what is below it meets that, what is above does not.
    """
    if not task.grippers.tilt:
        return [Body(f"{name}{who}", side, part.outline, heights=part.heights) for part in parts for who, side in SIDES]
    tops, lift = [top for top in task.scene.heights if top is not None], lift_of_hand(parts, task.grippers.tilt)
    return [
        Body(f"{name}{who}", side, outline, heights=heights)
        for part in parts
        for who, side in SIDES
        for outline, heights in _layers(
            leaning(part, task.grippers.tilt * (1 if side else -1), lift), [2 * task.cable.radius, *tops]
        )
    ]


def leaning(part: BodyPart, lean: float, lift: float) -> Float[np.ndarray, "2 k 3"]:
    """Corners [m] of a piece, below and above, lifted and turned by `lean` [rad] about the cable's axis; z is 0 on the
    table."""
    turn = Rotation.from_euler("y", lean).as_matrix()
    ends = [np.column_stack([part.outline, np.full(len(part.outline), z - AXIS + lift)]) for z in part.heights]
    return np.array(ends) @ turn.T + (0.0, 0.0, AXIS)


def lift_of_hand(parts: Sequence[BodyPart], tilt: float) -> float:
    """By how much [m] a tilted hand is lifted along its own axis, so that its lowest corner keeps `ABOVE_TABLE`."""
    if not tilt:
        return 0.0
    lowest = min((leaning(part, lean, 0.0)[..., 2].min() for part in parts for lean in (tilt, -tilt)), default=np.inf)
    return max(0.0, (ABOVE_TABLE - float(lowest)) / float(np.cos(tilt)))


def _layers(
    ends: Float[np.ndarray, "2 k 3"], cuts: list[float]
) -> Iterator[tuple[Float[np.ndarray, "k 2"], tuple[float, float]]]:
    """Outlines [m] of a piece with such corners below and above, between two heights each [m]."""
    corners, count = ends.reshape(-1, 3), ends.shape[1]
    ring = np.arange(count)
    edges = np.vstack(
        [np.column_stack([a, b]) for a, b in (
            (ring, (ring + 1) % count), (ring + count, (ring + 1) % count + count), (ring, ring + count))]
    )  # fmt: skip
    low, high = corners[:, 2].min(), corners[:, 2].max()
    levels = np.unique([low, *(cut for cut in cuts if low < cut < high), *np.arange(low, high, LAYER), high])
    for under, over in pairwise(levels.tolist()):
        inside = corners[(corners[:, 2] >= under) & (corners[:, 2] <= over)]
        crossings = [
            a + (level - a[2]) / (b[2] - a[2]) * (b - a)
            for a, b in corners[edges]
            for level in (under, over)
            if min(a[2], b[2]) < level < max(a[2], b[2])
        ]
        hull = shapely.MultiPoint(np.array([*inside, *crossings])[:, :2]).convex_hull
        if isinstance(hull, shapely.Polygon):
            yield shapely.get_coordinates(hull.exterior)[:-1], (under, over)


class Meeting(NamedTuple):
    """A piece of a gripper and what it may meet.

    Attributes:
        name: Of the check.
        who: The two, with {} for the obstacle.
        moving: (t, m, 2) vertices [m] of what moves.
        measure: Its distance from what it may meet.
        radius: Of the cable [m] where that is met.
    """

    name: str
    who: str
    moving: Float[np.ndarray, "t m 2"]
    measure: Measure
    radius: float = 0.0


def _meetings(
    lines: Float[np.ndarray, "t m 2"],
    poses: Float[np.ndarray, "t 2 3"],
    task: Task,
    limit: float,
    held: Float[np.ndarray, "t 2 3"] | None = None,
) -> Iterator[Meeting]:
    """All that pieces of the grippers may meet: what stands on the table, the cable, each other, the plug."""
    held = poses if held is None else held
    pieces = hand_pieces(gripper_body(task.grippers.body), task)
    outlines = [outline_at(piece.outline, poses[:, piece.side], OUTLINE_SPACING) for piece in pieces]
    plug = [] if task.plug is None else [plug_outline(task.plug, held[:, 1], OUTLINE_SPACING)]
    for i, (piece, outline) in enumerate(zip(pieces, outlines, strict=True)):
        scene = to_scene(task.scene, piece.heights[0], solid=True)
        yield Meeting("gripper body clearance", f"the {piece.name} and {{}}", outline, scene)
        split = outline.shape[1]
        if piece.heights[0] < 2 * task.cable.radius:
            moving = np.concatenate([outline, _free(lines, piece, task, limit)], axis=1)
            who, measure = f"the {piece.name} and the cable", partial(to_line, split=split)
            yield Meeting("gripper body from the cable", who, moving, measure, task.cable.radius)
        for beside in plug if piece.side == 0 else ():
            moving, measure = np.concatenate([outline, beside], axis=1), partial(to_outline, split=split)
            yield Meeting("gripper body from the plug", f"the {piece.name} and the plug", moving, measure)
        for other, beside in zip(pieces[i + 1 :], outlines[i + 1 :], strict=True):
            if piece.side != other.side and level(piece, other):
                moving, measure = np.concatenate([outline, beside], axis=1), partial(to_outline, split=split)
                yield Meeting("gripper bodies apart", "both grippers", moving, measure)


def body_checks(
    lines: Float[np.ndarray, "t m 2"],
    poses: Float[np.ndarray, "t 2 3"],
    task: Task,
    limit: float,
    ends: Ends | None = None,
    held: Float[np.ndarray, "t 2 3"] | None = None,
) -> list[Check]:
    """Least clearances of the grippers' pieces over a motion; none where grippers are discs alone.

    Args:
        lines: (t, m, 2) the whole cable [m].
        poses: (t, 2, 3) grippers [m, m, rad].
        task: The task.
        limit: Least clearance [m]; contact fails in any case.
        ends: Where start and goal may keep less.
        held: (t, 2, 3) ends of the cable [m, m, rad], whose right one has the plug; by default, as the grippers.
    """
    worst: dict[str, Check] = {}
    for name, who, moving, measure, radius in _meetings(lines, poses, task, limit, held):
        asked = limit if ends is None else ends.clearance(limit, moving, measure, radius)
        found = closest_approach(moving, measure, asked, rate=2.0)  # two that move near each other twice as fast
        value = found.distance - radius
        passed, where = found.wanted - 1e-9 <= value and value > 0, who.format(task.scene.name_of(found.obstacle))
        check = Check(name, value, "m", found.wanted, passed, where, found.row)
        worst[name] = min(worst.get(name, check), check, key=lambda each: each.value - each.limit)
    return list(worst.values())


def piece_clearances(
    poses: Float[np.ndarray, "t 2 3"], lines: Float[np.ndarray, "t m 2"], task: Task
) -> Float[np.ndarray, "t"]:
    """Least of the clearances [m] of `body_checks` in each row; infinite where grippers are discs alone."""
    rows = [meeting.measure(meeting.moving)[0] - meeting.radius for meeting in _meetings(lines, poses, task, 0.0)]
    return np.min([np.full(len(poses), np.inf), *rows], axis=0)


def level(one: Body, other: Body) -> bool:
    """Whether two pieces have a height in common."""
    return max(one.heights[0], other.heights[0]) < min(one.heights[1], other.heights[1])


def _free(lines: np.ndarray, piece: Body, task: Task, limit: float) -> np.ndarray:
    """The cable but for what the piece's own gripper holds, and what leaves it with a clearance of `limit` [m]."""
    held = np.abs(piece.outline[:, 0] + 1j * piece.outline[:, 1]).max() + task.cable.radius + limit
    count = lines.shape[1]
    first = min(count - 2, int(np.ceil(held / task.cable.length * (count - 1))))
    return lines[:, first:] if piece.side == 0 else lines[:, : count - first]


def to_line(lines: np.ndarray, split: int) -> tuple[Float[np.ndarray, "t"], Integer[np.ndarray, "t"]]:
    """Distance [m] of an outline, the first vertices, from a line, the others; negative by how deep that is inside."""
    outline, line = np.asarray(shapely.polygons(lines[:, :split])), shapely.linestrings(lines[:, split:])
    gap = np.asarray(shapely.distance(outline, line))
    for row in np.flatnonzero(gap == 0):
        gap[row] = -depths(lines[row : row + 1, split:], outline[row])[0]
    return gap, np.zeros(len(lines), int)


def to_outline(lines: np.ndarray, split: int) -> tuple[Float[np.ndarray, "t"], Integer[np.ndarray, "t"]]:
    """The same between two outlines."""
    one, other = (np.asarray(shapely.polygons(part)) for part in (lines[:, :split], lines[:, split:]))
    gap = np.asarray(shapely.distance(one, other))
    for row in np.flatnonzero(gap == 0):
        inside = depths(lines[row : row + 1, split:], one[row]), depths(lines[row : row + 1, :split], other[row])
        gap[row] = -max(inside[0][0], inside[1][0])
    return gap, np.zeros(len(lines), int)
