"""Joints of two arms of any kind along a plan: by differential inverse kinematics, then checked by other code."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cableway.core.errors import InputError
from cableway.core.provenance import describe
from cableway.motion.resampling import smoothed
from cableway.records import Plan, Rollout, Verdict
from cableway.scene.described_arms import DescribedArms
from cableway.scene.task import Task
from cableway.simulation.differential_ik import Followed, follow
from cableway.verification.described_arms import described_arm_checks


def follow_plan(record: Plan | Rollout, task: Task, arms: DescribedArms, source: str = "the record") -> Followed:
    """The joints of two arms along a plan, which other code finds within their limits and touching nothing.

    Args:
        record: The plan.
        task: The task that it is of.
        arms: The arms.
        source: What the plan is called in errors.

    Raises:
        InputError: It is no plan, or the task has arms of its own.
        PlanningError: No motion was found that verifies; the message says how far the arms came, and what stopped them.
        FileFormatError: A file of an arm cannot be read.
        MissingExtraError: mink or Coal is not installed.
    """
    if not isinstance(record, Plan):
        raise InputError(f"{source}: only a plan can be followed by other arms, not a rollout")
    if task.cell is not None:
        raise InputError(f"{source}: is a plan for the arms of the cell {task.cell.name!r}, not for others")
    rows = np.arange(-1.0, len(record.poses) + 1)

    def fault(found: Followed) -> str:
        curve = smoothed(record.poses, rows), smoothed(found.joints, rows)
        for poses, joints in ((record.poses, found.joints), curve):  # a trajectory has either, by its rate
            checks = described_arm_checks(poses, joints, found.chains, found.turns, task, arms.obstacle_height)
            if faults := Verdict(tuple(checks)).failures():
                return str(faults[0])
        return ""

    return follow(record, task, arms, fault)


def arms_header(followed: Followed, arms: DescribedArms) -> dict[str, Any]:
    """What the header of a trajectory says of such arms."""
    return {
        "described": arms.name,
        "models": [Path(arms.arms[holder].model).name for holder in followed.holders],
        "holders": list(followed.holders),
        "turns": list(followed.turns),
        "bases": [describe({"position": each.position, "angle": each.angle}) for each in arms.arms],
        "made_by": "differential inverse kinematics along the plan's gripper poses; the arms hold the cable already",
    }
