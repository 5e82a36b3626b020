"""Arms that leave the cable in sight: of the ways in which they can follow a plan, that which hides least from cameras.

A plan fixes where the grippers are, and leaves each arm up to eight branches of its joints. Planning takes those with
most room; cameras may see the cable past others.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cableway.geometry import polyline
from cableway.perception.placement import camera_at
from cableway.records import Plan
from cableway.robot.branches import ArmMotion, PackedCell, arm_motions
from cableway.robot.grasping import with_hands
from cableway.robot.sight import hidden_from
from cableway.scene.cell import Way
from cableway.scene.task import Task
from cableway.verification import VerificationLimits, verify_plan

ROOM = 0.03
"""Clearance of links [m] down to which it counts for more that the cable is seen."""

GAIN = 0.05
"""Share of the cable, over the whole plan, that must come into sight for another way to be taken."""

ROWS, POINTS = 24, 33
"""Rows of a plan that are looked at, and points of the cable in each."""


def in_sight(plan: Plan, task: Task, places: Sequence[str], limits: VerificationLimits) -> Plan:
    """The plan, its arms in the way that leaves most of the cable in sight, over the whole plan.

    Ways that come nearer to anything than `ROOM`, and nearer than the plan's own, are left out, and those in which
    hands cannot get to the cable or away from it where they can in the plan's own. The plan is as it was where no arms
    hold the cable, or no way hides less. `metadata["in_sight"]` says what share of the cable is `hidden`, and what was
    `before`.

    Args:
        plan: The plan, verified.
        task: The task.
        places: Where the cameras stand, of `cableway.perception.placement.PLACES`.
        limits: By which the plan is verified anew.

    Raises:
        UnknownNameError: There is no such place.
    """
    own = Way.of_record(plan.metadata)
    if task.cell is None or own is None or task.cell.way is not None:
        return plan
    packed = PackedCell(task, task.cell)
    eyes = [camera_at(place, task.scene.size).pinhole.pose[:3, 3] for place in places]
    rows = np.unique(np.linspace(0, plan.steps, ROWS).round().astype(int))
    shapes = np.array([polyline.resample(shape, POINTS) for shape in plan.shapes[rows]])

    def hidden(motion: ArmMotion) -> float:
        return float(hidden_from(eyes, shapes, ArmMotion(motion.joints[rows], motion.way, 0.0), packed).mean())

    motions = arm_motions(plan.poses, task, task.cell)
    taken = next((motion for motion in motions if motion.way == own), None)
    if taken is None:
        return plan
    before, room = hidden(taken), min(ROOM, taken.clearance)
    shares = [(hidden(motion), motion) for motion in motions if motion.clearance >= room]
    for share, motion in sorted(shares, key=lambda each: each[0]):
        if share > before - GAIN:
            break
        held = with_hands(plan, motion, task)
        if any(getattr(plan, way) is not None and getattr(held, way) is None for way in ("approach", "retreat")):
            continue
        verdict = verify_plan(held, task, limits)
        if verdict.passed:
            return held.judged(verdict).noted(in_sight={"hidden": share, "before": before})
    return plan
