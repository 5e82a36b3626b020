"""The arms of a cell along a plan in space: kinematics of `verification.arms`, distances by Coal.

The motion is looked at as in `verification.arms`. Links and hands are compared with the table, the obstacles, the other
arm and the cable, a hand not with what it holds of that.
"""

from __future__ import annotations

import math
from itertools import chain, product
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation, Slerp

from cableway.core.extras import require
from cableway.records import Check, Plan
from cableway.scene.cell import TOOLS, Cell
from cableway.scene.spatial.task import SpatialTask
from cableway.verification.arms import (
    CLEARANCE,
    TIP,
    TIP_ANGLE,
    TOOL,
    Solid,
    closest_pair,
    flanges_of,
    joint_checks,
    meeting_pairs,
    most,
    moving_solids,
)
from cableway.verification.geometry import curve_through
from cableway.verification.spatial_distance import BEYOND, between, capsule, nearest, placed, shape_of

HELD = 0.05
"""Length of cable [m] from its end on that the hand which holds it may be near to."""

PIECES = 4
"""Of the cable from keypoint to keypoint."""

FIRST = 2
"""Number of the joint from which on links may come near to the table, on which arms stand."""


class _Held(NamedTuple):
    """How a plan says that arms hold the cable."""

    holders: list[int]
    rolls: list[float]
    turns: list[int]


def spatial_arm_checks(plan: Plan, task: SpatialTask) -> list[Check]:
    """Whether a cell's arms hold the grippers of a plan in space, within their joints' limits, and touch nothing.

    None where the task has no cell; a plan without joints, or that does not say how arms hold the cable, fails.

    Raises:
        MissingExtraError: Coal is not installed.
    """
    cell = task.cell
    if cell is None:
        return []
    require("cell", "the verification of arms")
    held = _how_held(plan)
    if plan.joints is None or plan.joints.shape[2] != 6 or held is None:
        return [Check("arms", 0.0, "", 2.0, False, "the plan has no joints of the cell's two arms")]
    at, dense, solids, step = moving_solids(plan.joints, held.holders, task, cell)
    left, right = ([each for each in arm if each.link == TOOL] for arm in solids)
    hands = [(one, other) for one in left for other in right]
    return [
        *_tips(plan, task, cell, held, at, dense),
        *joint_checks(plan.joints, held.holders, cell),
        closest_pair([*meeting_pairs(solids), *hands], at, step, CLEARANCE),
        _off_scene(solids, task, at, step / 2),
        _off_cable(solids, plan, task, at, step),
    ]


def _how_held(plan: Plan) -> _Held | None:
    """None where the plan does not say."""
    arms: Any = plan.metadata.get("arms")
    if not isinstance(arms, dict):
        return None
    holders, rolls, turns = (arms.get(name) for name in _Held._fields)
    if holders not in ([0, 1], [1, 0]) or turns not in ([0, 0], [0, 1], [1, 0], [1, 1]) or not isinstance(rolls, list):
        return None
    if len(rolls) != 2 or not all(isinstance(roll, int | float) and math.isfinite(roll) for roll in rolls):
        return None
    return _Held([int(arm) for arm in holders], [float(roll) for roll in rolls], [int(turn) for turn in turns])


def _tips(
    plan: Plan,
    task: SpatialTask,
    cell: Cell,
    held: _Held,
    at: Float[np.ndarray, "s"],
    dense: Float[np.ndarray, "s 2 6"],
) -> list[Check]:
    """How far hands are from the grippers' poses, and from where the bodies of these have them, if they have any."""
    rows, off, askew = np.arange(len(plan.poses)), [], []
    rolls = [0.0, 0.0] if task.bodies[2:] else held.rolls
    for side in range(2):
        flange = flanges_of(cell, held.holders[side], dense[:, side], task)
        tip = flange[:, :3, 3] + TOOLS[cell.tool].reach * flange[:, :3, 2]
        wanted = np.column_stack([np.interp(at, rows, column) for column in plan.poses[:, side, :3].T])
        off.append(np.linalg.norm(tip - wanted, axis=1))
        grippers = Slerp(rows, Rotation.from_quat(plan.poses[:, side, 3:], scalar_first=True))(at)
        hand = Rotation.from_euler("x", rolls[side])
        mounted = Rotation.from_matrix(np.diag([-1.0, 1.0, -1.0] if held.turns[side] == 0 else [1.0, -1.0, -1.0]))
        askew.append(((grippers * hand * mounted).inv() * Rotation.from_matrix(flange[:, :3, :3])).magnitude())
    return [
        most("tool distance", np.max(off, axis=0), "m", TIP, at),
        most("tool angle", np.max(askew, axis=0), "rad", TIP_ANGLE, at),
    ]


def _off_scene(solids: list[list[Solid]], task: SpatialTask, at: Float[np.ndarray, "s"], step: float) -> Check:
    """Least clearance of links and hands from the table and the obstacles."""
    every = [*chain(*solids)]
    best, row, who = math.inf, 0, ""
    for solid in (each for each in every if each.link >= FIRST):
        heights = solid.ends[:, :, 2].min(axis=1) - solid.radius
        if (low := float(heights.min())) < best:
            best, row, who = low, int(heights.argmin()), f"{solid.name} and the table"
    shapes = [shape_of(each, task.scene.size[2] + BEYOND) for each in task.scene.obstacles]
    pairs = [*product(every, range(len(shapes)))]
    if pairs:
        balls = [((each.low + each.high) / 2, float(np.linalg.norm(each.high - each.low) / 2)) for each in shapes]
        bounds = np.array([
            np.linalg.norm(solid.ends.mean(axis=1) - balls[k][0], axis=1) - _half(solid) - balls[k][1]
            for solid, k in pairs
        ])  # fmt: skip

        def gap(pair: int, look: int) -> float:
            solid, k = pairs[pair]
            ends = solid.ends[look]
            return between(capsule(ends, solid.radius), placed(ends), shapes[k].solid, shapes[k].place)

        least, pair, look = nearest(bounds, gap)
        if least < best:
            solid, k = pairs[pair]
            best, row, who = least, look, f"{solid.name} and {task.scene.name_of(k)}"
    return _clear("arm clearance from the scene", best - step, who, float(at[row]))


def _off_cable(
    solids: list[list[Solid]], plan: Plan, task: SpatialTask, at: Float[np.ndarray, "s"], step: float
) -> Check:
    """Least clearance of links and hands from the cable, of which hands hold an end."""
    radius = task.cable.radius
    fine = curve_through(plan.shapes, PIECES)
    row = np.minimum(at.astype(int), len(fine) - 2)
    lines = fine[row] + (at - row)[:, None, None] * (fine[row + 1] - fine[row])
    pieces = np.stack([lines[:, :-1], lines[:, 1:]], axis=2)
    middles, halves = pieces.mean(axis=2), np.linalg.norm(pieces[:, :, 1] - pieces[:, :, 0], axis=2) / 2
    spared = math.ceil(HELD / task.cable.length * pieces.shape[1])
    pairs, bounds = [], []
    for side, arm in enumerate(solids):
        for solid in arm:
            free = np.arange(spared if solid.link == TOOL else 0, pieces.shape[1])
            for piece in free if side == 0 else pieces.shape[1] - 1 - free:
                away = np.linalg.norm(solid.ends.mean(axis=1) - middles[:, piece], axis=1)
                pairs.append((solid, int(piece)))
                bounds.append(away - _half(solid) - halves[:, piece] - radius)

    def gap(pair: int, look: int) -> float:
        solid, piece = pairs[pair]
        ends, held = solid.ends[look], pieces[look, piece]
        return between(capsule(ends, solid.radius), placed(ends), capsule(held, radius), placed(held))

    least, pair, look = nearest(np.array(bounds), gap)
    return _clear("arm clearance from the cable", least - step, f"{pairs[pair][0].name} and the cable", float(at[look]))


def _half(solid: Solid) -> Float[np.ndarray, "s"]:
    """Radius [m] of a ball about a capsule's middle."""
    return np.linalg.norm(solid.ends[:, 1] - solid.ends[:, 0], axis=1) / 2 + solid.radius


def _clear(name: str, value: float, who: str, row: float) -> Check:
    return Check(name, value, "m", CLEARANCE, value >= CLEARANCE and value > 0, who, row)
