"""The arms of a cell along a motion: own kinematics, as a product of exponentials, and distances by Coal.

Between rows joints move evenly. The motion is looked at where no capsule has moved by more than `STEP`, and what it may
have come nearer in between is taken off the clearance.
"""

from __future__ import annotations

import math
from itertools import chain, combinations, product
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from cableway.core.extras import require
from cableway.records import Check, Plan, Rollout
from cableway.scene.arm_models import ArmModel, Capsule
from cableway.scene.cell import TOOLS, Cell, Tool
from cableway.scene.gripper_bodies import ABOVE_TABLE, AXIS, gripper_body
from cableway.scene.obstacles import to_shapely
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.task import CONTROL_STEP, Task
from cableway.verification.bodies import lift_of_hand
from cableway.verification.geometry import pose_distance
from cableway.verification.grasps import tool_poses
from cableway.verification.spatial_distance import capsule, library, nearest, placed

STEP = 0.004
"""Greatest way [m] of an end of a capsule between two looks at the motion."""

CLEARANCE = 0.004
"""Least clearance [m] of an arm's links."""

TIP, TIP_ANGLE = 0.001, 0.01
"""Distance [m] and angle [rad] of a tool from its gripper's pose."""

NEIGHBOURS = 2
"""Joints between two links of an arm that cannot touch each other, but for those of `FOLDED`."""

FOLDED = ((1, 3), (2, 4))
"""Links on either side of the elbow, which meet where it folds: shoulder and forearm, upper arm and first wrist."""

FINEST = 64
"""Looks from row to row."""


class Solid(NamedTuple):
    """A capsule along a motion.

    Attributes:
        name: Of its arm.
        link: Number of the joint that moves it; the tool's have `TOOL`.
        ends: (s, 2, 3) [m].
        radius: [m].
    """

    name: str
    link: int
    ends: Float[np.ndarray, "s 2 3"]
    radius: float


TOOL = 7


def arm_checks(record: Plan | Rollout, task: Task, clearance: float = CLEARANCE) -> list[Check]:
    """Whether a cell's arms hold the grippers of a record, within their joints' limits, and touch nothing.

    None where the task has no cell; a record without joints, or that does not say which arm holds which end, fails.

    Args:
        record: The record.
        task: The task that it is of.
        clearance: Least clearance of links [m].

    Raises:
        MissingExtraError: Coal is not installed.
    """
    cell = task.cell
    if cell is None:
        return []
    require("cell", "the verification of arms")
    holders, turns = how_held(record)
    if record.joints is None or record.joints.shape[2] != 6 or not holders:
        arms = record.metadata.get("arms")
        fault = arms.get("fault") if isinstance(arms, dict) else None
        why = str(fault or "the record has no joints of the cell's two arms")
        return [Check("arms", 0.0, "", 2.0, False, why)]
    at, dense, solids, step = moving_solids(record.joints, holders, task, cell)
    flanges = [flanges_of(cell, holders[side], dense[:, side], task) for side in range(2)]
    return [
        *_tip_checks(flanges, turns, record, task, cell, at),
        *joint_checks(record.joints, holders, cell),
        closest_pair(meeting_pairs(solids), at, step, clearance),
        lowest_link(solids, task, at, step, clearance),
        _lowest_finger(flanges, turns, cell, at, min(clearance, ABOVE_TABLE / 2)),
    ]


def how_held(record: Plan | Rollout) -> tuple[list[int], list[int]]:
    """Which arm holds each end and how its tool is turned; empty where the record does not say so."""
    arms = record.metadata.get("arms")
    if not isinstance(arms, dict):
        return [], []
    holders, turns = arms.get("holders"), arms.get("turns")
    if holders not in ([0, 1], [1, 0]) or turns not in ([0, 0], [0, 1], [1, 0], [1, 1]):
        return [], []
    return [int(arm) for arm in holders], [int(turn) for turn in turns]


def moving_solids(
    joints: Float[np.ndarray, "t 2 6"], holders: list[int], task: Task | SpatialTask, cell: Cell
) -> tuple[Float[np.ndarray, "s"], Float[np.ndarray, "s 2 6"], list[list[Solid]], float]:
    """What is looked at of a motion: see `dense_joints`, the solids of both arms there, and how far one moves at most
    between two looks [m]."""
    at, dense = dense_joints(joints, holders, task, cell)
    solids = [solids_of(cell, holders[side], dense[:, side], task) for side in range(2)]
    step = max(float(np.linalg.norm(np.diff(each.ends, axis=0), axis=2).max(initial=0.0)) for each in chain(*solids))
    return at, dense, solids, step


def dense_joints(
    joints: Float[np.ndarray, "t 2 6"], holders: list[int], task: Task | SpatialTask, cell: Cell
) -> tuple[Float[np.ndarray, "s"], Float[np.ndarray, "s 2 6"]]:
    """Fractional rows between which no capsule moves farther than `STEP`, and the joints there."""
    solids = [*chain(*(solids_of(cell, holders[side], joints[:, side], task) for side in range(2)))]
    moved = np.max([np.linalg.norm(np.diff(each.ends, axis=0), axis=2).max(axis=1) for each in solids], axis=0)
    looks = np.clip(np.ceil(moved / STEP), 1, FINEST).astype(int)
    at = np.concatenate([*(row + np.arange(count) / count for row, count in enumerate(looks)), [len(joints) - 1]])
    row = np.minimum(at.astype(int), max(0, len(joints) - 2))
    share = (at - row)[:, None, None]
    return at, joints[row] + share * (joints[np.minimum(row + 1, len(joints) - 1)] - joints[row])


def _tip_checks(
    flanges: list[Float[np.ndarray, "s 4 4"]], turns: list[int], record: Plan | Rollout, task: Task, cell: Cell,
    at: Float[np.ndarray, "s"],
) -> list[Check]:  # fmt: skip
    """How far the tools are from the grippers' poses, and from the cell's tilt."""
    rows, poses = np.arange(len(record.poses)), tool_poses(record)
    wanted = np.stack([[np.interp(at, rows, column) for column in poses[:, side].T] for side in range(2)])
    off, askew = [], []
    for side, flange in enumerate(flanges):
        found, height, tilt = tips(flange, side, turns[side], cell)
        gap, turn = pose_distance(found, wanted[side].T)
        off.append(np.hypot(gap, height - task.cable.radius))
        askew.append(np.maximum(turn, tilt))
    return [
        most("tool distance", np.max(off, axis=0), "m", TIP, at),
        most("tool angle", np.max(askew, axis=0), "rad", TIP_ANGLE, at),
    ]


def tips(
    flange: Float[np.ndarray, "s 4 4"], side: int, turn: int, cell: Cell
) -> tuple[Float[np.ndarray, "s 3"], Float[np.ndarray, "s"], Float[np.ndarray, "s"]]:
    """Where a tool holds the cable, seen from above [m, m, rad], how high that is [m], and what it leans too far [rad].

    A hand of a cell with a tilt leans away from the cable: against its tangent at the left end, along it at the right.
    """
    reach = TOOLS[cell.tool].reach + lift_of_hand(gripper_body(cell.tool), cell.tilt)
    tip = flange @ np.array([0.0, 0.0, reach, 1.0])
    along = flange[:, :3, 0] * (-1.0 if turn == 0 else 1.0)
    seen = np.column_stack([tip[:, :2], np.arctan2(along[:, 1], along[:, 0])])
    ahead = math.sin(cell.tilt) * (-1.0 if side == 0 else 1.0)
    wanted = np.column_stack([ahead * np.cos(seen[:, 2]), ahead * np.sin(seen[:, 2])])
    upright = -flange[:, 2, 2] * math.cos(cell.tilt) - np.sum(flange[:, :2, 2] * wanted, axis=1)
    return seen, tip[:, 2], np.arccos(np.clip(upright, -1.0, 1.0))


def joint_checks(joints: Float[np.ndarray, "t 2 6"], holders: list[int], cell: Cell) -> list[Check]:
    """Joints over their limits of position and speed."""
    models = [cell.models[arm] for arm in holders]
    angle = np.max([np.abs(joints[:, k]) / models[k].position_limit for k in range(2)], axis=(0, 2))
    speed = np.abs(np.diff(joints, axis=0)) / CONTROL_STEP
    share = np.max([speed[:, k] / models[k].speed_limit for k in range(2)], axis=(0, 2))
    return [
        most("joint position", angle, "1", 1.0, np.arange(len(angle))),
        most("joint speed", share, "1", 1.0, np.arange(len(share))),
    ]


def most(name: str, values: Float[np.ndarray, "s"], unit: str, limit: float, at: np.ndarray) -> Check:
    """A check that a value per row, whose rows are `at`, stays below its limit."""
    if len(values) == 0:
        return Check(name, 0.0, unit, limit, True)
    worst = int(np.argmax(values))
    return Check(name, float(values[worst]), unit, limit, bool(values[worst] <= limit + 1e-9), row=float(at[worst]))


def _exponentials(model: ArmModel, joints: Float[np.ndarray, "s 6"]) -> list[Float[np.ndarray, "s 4 4"]]:
    """Motions of the links from where they are with all joints at zero, in the frame of the base.

    Joint i turns about an axis through a point, both as they are at zero (Lynch and Park 2017, Modern Robotics, 4.1).
    """
    d1, a2, a3, d4, d5, _ = model.lengths
    down, front = (0.0, 0.0, -1.0), (0.0, -1.0, 0.0)
    axes = ((0.0, 0.0, 1.0), front, front, front, down, front)
    points = ((0, 0, 0), (0, 0, d1), (a2, 0, d1), (a2 + a3, 0, d1), (a2 + a3, -d4, d1), (a2 + a3, -d4, d1 - d5))
    moved, out = np.tile(np.eye(4), (len(joints), 1, 1)), []
    for axis, point, angle in zip(axes, points, joints.T, strict=True):
        turn = np.tile(np.eye(4), (len(joints), 1, 1))
        turn[:, :3, :3] = Rotation.from_rotvec(angle[:, None] * np.array(axis)).as_matrix()
        turn[:, :3, 3] = np.array(point) - turn[:, :3, :3] @ np.array(point, float)
        moved = moved @ turn
        out.append(moved)
    return out


def _homes(model: ArmModel) -> list[Float[np.ndarray, "4 4"]]:
    """The frames of base and links with all joints at zero."""
    d1, a2, a3, d4, d5, d6 = model.lengths
    upright = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    over = Rotation.from_euler("x", 180, degrees=True).as_matrix()
    places = (
        (np.eye(3), (0, 0, 0)), (upright, (0, 0, d1)), (upright, (a2, 0, d1)), (upright, (a2 + a3, 0, d1)),
        (over, (a2 + a3, -d4, d1)), (upright, (a2 + a3, -d4, d1 - d5)), (upright, (a2 + a3, -d4 - d6, d1 - d5)),
    )  # fmt: skip
    homes = []
    for turn, at in places:
        home = np.eye(4)
        home[:3, :3], home[:3, 3] = turn, at
        homes.append(home)
    return homes


def flanges_of(
    cell: Cell, arm: int, joints: Float[np.ndarray, "s 6"], task: Task | SpatialTask
) -> Float[np.ndarray, "s 4 4"]:
    """Poses of an arm's flange along a motion."""
    model = cell.models[arm]
    return cell.arms[arm].base(task.scene) @ _exponentials(model, joints)[-1] @ _homes(model)[-1]


def solids_of(
    cell: Cell, arm: int, joints: Float[np.ndarray, "s 6"], task: Task | SpatialTask, tool: Tool | None = None
) -> list[Solid]:
    """An arm's capsules and its tool's along a motion; the tool is closed where none is given."""
    model, base = cell.models[arm], cell.arms[arm].base(task.scene)
    still = np.tile(np.eye(4), (len(joints), 1, 1))
    frames = [
        base @ moved @ home for moved, home in zip([still, *_exponentials(model, joints)], _homes(model), strict=True)
    ]

    def solid(capsule: Capsule, link: int) -> Solid:
        frame, ends = frames[capsule.frame], np.array([capsule.start, capsule.end], float)
        return Solid(f"arm {arm}", link, frame[:, None, :3, 3] + ends @ frame[:, :3, :3].swapaxes(1, 2), capsule.radius)

    return [
        *(solid(each, each.frame) for each in model.capsules),
        *(solid(each, TOOL) for each in (tool or TOOLS[cell.tool]).capsules),
    ]


def meeting_pairs(solids: list[list[Solid]]) -> list[tuple[Solid, Solid]]:
    """What could touch: arm and arm but for their tools, whose outlines are compared as bodies; an arm's own links."""
    left, right = solids
    both = [(a, b) for a, b in product(left, right) if a.link != TOOL or b.link != TOOL]
    own = [pair for arm in solids for pair in combinations(arm, 2)]
    return [*both, *((a, b) for a, b in own if _could_touch(*sorted((min(a.link, 6), min(b.link, 6)))))]


def _could_touch(inner: int, outer: int) -> bool:
    """Whether two links of an arm could."""
    return outer - inner > NEIGHBOURS or (inner, outer) in FOLDED


def closest_pair(pairs: list[tuple[Solid, Solid]], at: Float[np.ndarray, "s"], step: float, limit: float) -> Check:
    """Least clearance of pairs, nearest by their enclosing spheres first, until none can be nearer."""

    def sphere(solid: Solid) -> tuple[np.ndarray, np.ndarray]:
        middle = solid.ends.mean(axis=1)
        return middle, np.linalg.norm(solid.ends[:, 1] - middle, axis=1) + solid.radius

    least = []
    for a, b in pairs:
        (at_a, r_a), (at_b, r_b) = sphere(a), sphere(b)
        least.append(np.linalg.norm(at_a - at_b, axis=1) - r_a - r_b)
    shapes = {id(solid): capsule(solid.ends[0], solid.radius) for pair in pairs for solid in pair}
    coal = library()
    request, result = coal.DistanceRequest(), coal.DistanceResult()

    def gap(pair: int, row: int) -> float:
        a, b = pairs[pair]
        result.clear()
        at_a, at_b = placed(a.ends[row]), placed(b.ends[row])
        return float(coal.distance(shapes[id(a)], at_a, shapes[id(b)], at_b, request, result))

    best, pair, row = nearest(np.array(least), gap)
    a, b = pairs[pair]
    who = f"{a.name} and {b.name if b.name != a.name else 'itself'}"
    value = best - step
    return Check("arm clearance", value, "m", limit, value >= limit and value > 0, who, float(at[row]))


def _lowest_finger(
    flanges: list[Float[np.ndarray, "s 4 4"]], turns: list[int], cell: Cell, at: Float[np.ndarray, "s"], limit: float
) -> Check:
    """Least height above the table of the corners of a closed hand."""
    lows = [(*corner, part.heights[0]) for part in gripper_body(cell.tool) for corner in part.outline]
    x, y, z = np.array(lows).T
    found = []
    for flange, turn in zip(flanges, turns, strict=True):
        ahead = -1.0 if turn == 0 else 1.0
        corners = np.column_stack([ahead * x, -ahead * y, TOOLS[cell.tool].reach + AXIS - z])
        found.append((flange[:, 2, :3] @ corners.T).min(axis=1) + flange[:, 2, 3])
    lowest = np.min(found, axis=0)
    row = int(lowest.argmin())
    value = float(lowest[row])
    passed = value >= limit and value > 0
    return Check("hand clearance from the table", value, "m", limit, passed, "a hand and the table", float(at[row]))


def lowest_link(solids: list[list[Solid]], task: Task, at: Float[np.ndarray, "s"], step: float, limit: float) -> Check:
    """Least clearance of links, from the shoulder on, from the table and what stands on it.

    Of a link only the part that is lower than an obstacle's top and the link's radius is compared, seen from above.
    """
    best, place, who = np.inf, 0.0, ""
    for solid in (each for arm in solids for each in arm if 2 <= each.link < TOOL):
        heights = solid.ends[:, :, 2].min(axis=1) - solid.radius
        row = int(np.argmin(heights))
        if heights[row] < best:
            best, place, who = float(heights[row]), float(at[row]), f"{solid.name} and the table"
        for index, obstacle in enumerate(task.scene.obstacles):
            top = np.inf if obstacle.height is None else obstacle.height
            low = np.flatnonzero(heights < top)
            if not len(low):
                continue
            lines = shapely.linestrings([_below(solid.ends[k], top + solid.radius) for k in low])
            gaps = np.asarray(shapely.distance(lines, to_shapely(obstacle))) - solid.radius
            nearest = int(np.argmin(gaps))
            if gaps[nearest] < best:
                best, place = float(gaps[nearest]), float(at[low[nearest]])
                who = f"{solid.name} and {task.scene.name_of(index)}"
    value = best - step / 2
    return Check("arm clearance from the table", value, "m", limit, value >= limit and value > 0, who, place)


def _below(ends: Float[np.ndarray, "2 3"], height: float) -> Float[np.ndarray, "2 2"]:
    """The part of a segment below a height, seen from above; it has one."""
    ordered = ends[np.argsort(ends[:, 2])]
    (bottom, top), seen = ordered[:, 2], ordered[:, :2]
    if top <= height:
        return seen
    return np.stack([seen[0], seen[0] + (height - bottom) / (top - bottom) * (seen[1] - seen[0])])
