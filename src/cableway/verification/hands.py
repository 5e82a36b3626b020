"""The approach to the cable and the retreat from it: open hands straight above its ends, by the judge's own code."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.records import Check, Plan
from cableway.scene.bodies import Body
from cableway.scene.cell import TOOLS, Cell
from cableway.scene.gripper_bodies import OPENINGS, open_hand
from cableway.scene.task import CONTROL_STEP, Task
from cableway.verification.arms import (
    CLEARANCE,
    TIP,
    TIP_ANGLE,
    closest_pair,
    dense_joints,
    flanges_of,
    how_held,
    joint_checks,
    lowest_link,
    meeting_pairs,
    most,
    solids_of,
    tips,
)
from cableway.verification.bodies import OUTLINE_SPACING, hand_pieces, level, to_line, to_outline
from cableway.verification.geometry import curve_through, outline_at, pose_distance
from cableway.verification.swept import to_scene

RISEN = 0.05
"""Height [m] above where they hold the cable from which hands must come, and to which they must rise."""

MET = 1e-6
"""Difference [rad] of joints up to which one motion begins where another ends."""

PIECES = 4
"""Segments of the cable between two keypoints."""


def hand_checks(plan: Plan, task: Task) -> list[Check]:
    """Whether a plan's approach and retreat lead straight to and from where it holds the cable, and touch nothing.

    None of a plan without.
    """
    found = [("the approach", plan.approach, 0), ("the retreat", plan.retreat, -1)]
    return [check for name, rows, row in found if rows is not None for check in _checks(name, rows, row, plan, task)]


def _checks(name: str, rows: Float[np.ndarray, "t 2 j"], row: int, plan: Plan, task: Task) -> list[Check]:
    """All checks of one of the two, which meets the plan in a row; the last one, or else it begins there."""
    holders, turns = how_held(plan)
    opening, fault = _opening(plan.metadata, row), ""
    if task.cell is None or not holders or rows.shape[2] != 6 or plan.joints is None:
        fault = f"{name} is of no arms"
    elif opening is None:
        fault = f"the plan does not say how wide the hands are open in {name}"
    elif np.abs(rows[-1 - row] - plan.joints[row]).max() > MET:
        fault = f"{name} does not meet the rest of the plan"
    if fault or task.cell is None or opening is None:
        return [Check("open hands", 0.0, "", 2.0, False, fault)]
    cell, tool = task.cell, TOOLS[task.cell.tool].opened(opening)
    at, dense = dense_joints(rows, holders, task, cell)
    solids = [solids_of(cell, holders[side], dense[:, side], task, tool) for side in range(2)]
    flanges = [flanges_of(cell, holders[side], dense[:, side], task) for side in range(2)]
    seen = [tips(flange, side, turns[side], cell) for side, flange in enumerate(flanges)]
    step = max(float(np.linalg.norm(np.diff(each.ends, axis=0), axis=2).max(initial=0.0)) for each in chain(*solids))
    line = curve_through(plan.shapes[row], PIECES)
    checks = [
        *_straight(seen, plan.poses[row], at, task),
        *_highest(name, [height for _, height, _ in seen], row, task),
        *joint_checks(rows, holders, cell),
        _accelerations(rows, holders, cell),
        *_hands(np.stack([poses for poses, _, _ in seen], axis=1), line, opening, task),
        closest_pair(meeting_pairs(solids), at, step, CLEARANCE),
        lowest_link(solids, task, at, step, CLEARANCE),
    ]
    return [replace(each, row=None, where=each.where or name) for each in checks]


def _opening(metadata: dict[str, Any], row: int) -> float | None:
    """How wide hands are open [m], as the record has it; None where it does not say so."""
    arms = metadata.get("arms")
    stated = arms.get("opening") if isinstance(arms, dict) else None
    if not isinstance(stated, list) or len(stated) != 2:
        return None
    return next((known for known in OPENINGS if known == stated[row]), None)


def _straight(
    seen: list[tuple[np.ndarray, np.ndarray, np.ndarray]], poses: Float[np.ndarray, "2 3"],
    at: Float[np.ndarray, "s"], task: Task,
) -> list[Check]:  # fmt: skip
    """How far tools are from above the grippers' poses, or below where they hold the cable; and from their tilt."""
    off, askew = [], []
    for (found, height, tilt), wanted in zip(seen, poses, strict=True):
        gap, turn = pose_distance(found, np.broadcast_to(wanted, found.shape))
        off.append(np.hypot(gap, np.minimum(height - task.cable.radius, 0.0)))
        askew.append(np.maximum(turn, tilt))
    return [
        most("tool distance", np.max(off, axis=0), "m", TIP, at),
        most("tool angle", np.max(askew, axis=0), "rad", TIP_ANGLE, at),
    ]


def _highest(name: str, heights: list[Float[np.ndarray, "s"]], row: int, task: Task) -> list[Check]:
    """Both tools must come from above the cable, or go there, and touch down where the plan has them."""
    far, near = (min(float(each[k]) for each in heights) - task.cable.radius for k in (row, -1 - row))
    low = max(float(each[-1 - row]) for each in heights) - task.cable.radius
    faults = [(far < RISEN, f"{name} is not from above"), (max(abs(near), low) > TIP, f"{name} misses the cable")]
    return [Check("open hands", 0.0, "", 2.0, False, why) for wrong, why in faults if wrong]


def _accelerations(rows: Float[np.ndarray, "t 2 6"], holders: list[int], cell: Cell) -> Check:
    """Joints over their limits of acceleration, from rest to rest."""
    rates = np.diff(rows, axis=0, prepend=rows[:1], append=rows[-1:]) / CONTROL_STEP
    found = np.abs(np.diff(rates, axis=0)) / CONTROL_STEP
    limits = np.array([cell.models[arm].acceleration_limit for arm in holders])
    share = (found / limits).max(axis=(1, 2))
    return most("joint acceleration", share, "1", 1.0, np.arange(len(share)))


def _hands(
    poses: Float[np.ndarray, "s 2 3"], line: Float[np.ndarray, "m 2"], opening: float, task: Task
) -> list[Check]:
    """Least clearance of open hands from what stands on the table, the cable and each other.

    All of it stands on the table, so that hands that are lowest where they hold the cable are nearest to it there.
    """
    assert task.cell is not None
    bodies = hand_pieces(open_hand(task.cell.tool, opening), task, "open hand of the ")
    outlines = [outline_at(body.outline, poses[:, body.side], OUTLINE_SPACING) for body in bodies]
    lines, found = np.broadcast_to(line, (len(poses), *line.shape)), []
    for index, (body, outline) in enumerate(zip(bodies, outlines, strict=True)):
        gaps, nearest = to_scene(task.scene, body.heights[0], solid=True)(outline)
        lowest = int(gaps.argmin())
        found.append((float(gaps[lowest]), f"the {body.name} and {task.scene.name_of(int(nearest[lowest]))}"))
        if body.heights[0] < 2 * task.cable.radius:
            gaps = to_line(np.concatenate([outline, lines], axis=1), outline.shape[1])[0] - task.cable.radius
            found.append((float(gaps.min()), f"the {body.name} and the cable"))
        found += _apart(body, outline, bodies[index + 1 :], outlines[index + 1 :])
    value, who = min(found)
    return [Check("open hand clearance", value, "m", CLEARANCE, value >= CLEARANCE - 1e-9, who)]


def _apart(
    body: Body, outline: Float[np.ndarray, "s k 2"], others: list[Body], beside: list[np.ndarray]
) -> list[tuple[float, str]]:
    """Distance [m] of a piece of one hand from those of the other one."""
    pairs = [(other, at) for other, at in zip(others, beside, strict=True) if other.side != body.side]
    return [
        (float(to_outline(np.concatenate([outline, at], axis=1), outline.shape[1])[0].min()), "the open hands")
        for other, at in pairs
        if level(body, other)
    ]
