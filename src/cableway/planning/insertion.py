"""The insertion: from the goal, before the port, along its axis until the plug is in.

The right end first moves and turns onto the axis, as far as the goal is beside it, and then goes straight. The left
gripper goes along, so that the cable keeps its shape, or stands still; the first that verifies is taken. In between the
cable is led as the rod that it is, and must not snap. In a cell, arms go on as they hold the cable at the goal.

Note:
    The paper (Tang et al.) inserts an HDMI plug as a case study and is silent on how it is aligned and inserted.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from cableway.core.deprecation import renamed
from cableway.core.errors import PlanningError
from cableway.core.provenance import versions
from cableway.geometry.groups import SE2
from cableway.motion.time_parametrization import require_rows
from cableway.records import INSERTION, Attempt, Plan
from cableway.robot.branches import NoMotion, arm_motion
from cableway.rod.continuation import lead
from cableway.scene.cell import Way
from cableway.scene.files.loading import TaskSource, as_task
from cableway.scene.task import Task
from cableway.verification import VerificationLimits, verify_insertion_plan
from cableway.verification.plug import require_port

STEP = 0.002
"""Travel [m] in a control step: 2 cm/s, slow enough for a hand to stop it."""

TURN = 0.02
"""Turn [rad] in a control step."""

SHARES = {1.0: "goes along", 0.0: "stands still"}
"""Shares of the right gripper's travel that the left one makes, in the order they are tried."""


def plan_insertion(task: TaskSource, limits: VerificationLimits | None = None, after: Plan | None = None) -> Plan:
    """The verified plan of an insertion; `metadata["part"]` is "insertion".

    Args:
        task: A task with a port.
        limits: What the plan must keep, the defaults where None.
        after: In a cell, the plan at whose end arms hold the cable as it says; None where that is open.

    Raises:
        InputError: The task has no port.
        PlanningError: Neither way verifies; `attempt` holds the last one.
    """
    task = as_task(task)
    require_port(task)
    reasons, attempt = [], None
    for share, name in SHARES.items():
        poses = _poses(task, share)
        led = lead(task.cable.rod, task.goal_equilibrium, poses)
        if led.snap is not None:
            steps = f"{led.snap:.1f} of {len(poses) - 1} control steps"
            reasons.append(f"the cable snaps after {steps} if the left gripper {name}")
            continue
        made_by = {"part": INSERTION, "left gripper": name, "versions": versions()}
        plan = _with_arms(Plan.of(task.cable.rod, led.q, made_by), task, after)
        if isinstance(plan, NoMotion):
            reasons.append(f"if the left gripper {name}: {plan.reason}")
            attempt = Attempt(reasons[-1], at=plan.at)
            continue
        verdict = verify_insertion_plan(plan, task, limits)
        if verdict.passed:
            return plan.judged(verdict)
        reasons.append(f"if the left gripper {name}: {verdict}")
        attempt = Attempt(reasons[-1], plan.shapes, plan.poses, verdict)
    raise PlanningError(f"the plug cannot be inserted: {'; '.join(reasons)}", attempt)


def _with_arms(plan: Plan, task: Task, after: Plan | None) -> Plan | NoMotion:
    """A plan with the joints of a cell's arms, as another one that ends where it begins has them; or why not."""
    if task.cell is None:
        return plan
    way = task.cell.way if after is None else Way.of_record(after.metadata)
    motion = arm_motion(plan.poses, task, replace(task.cell, way=way))
    if isinstance(motion, NoMotion):
        return motion
    turns = 0.0 if after is None or after.joints is None else np.round((after.joints[-1] - motion.joints[0]) / math.tau)
    joints = motion.joints + math.tau * turns
    return replace(plan, joints=joints, metadata={**plan.metadata, "arms": motion.way.described()})


def _poses(task: Task, share: float) -> Float[np.ndarray, "t 2 3"]:
    """Gripper poses: the right one onto the axis and along it, the left one doing `share` of its travel."""
    assert task.plug is not None
    assert task.port is not None
    first = task.cable.rod.shapes(task.goal_equilibrium[None])[1][0]
    outside, inside = (task.port.pose(task.plug, depth) for depth in (-task.port.standoff, task.port.depth))
    before = SE2.continued(outside, first[1])
    after = SE2.plus(before, SE2.minus(inside, outside))
    right = np.vstack([_straight(task, first[1], before), _straight(task, before, after)[1:]])
    left = np.repeat(first[:1], len(right), axis=0)
    left[:, : SE2.space] += share * (SE2.position(right) - SE2.position(right[0]))
    return np.stack([left, right], axis=1)


def _straight(task: Task, a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"]) -> Float[np.ndarray, "k 3"]:
    """Poses from a to b, both included, no farther apart than `STEP` and `TURN` and the limits of the grippers."""
    moved, turned = SE2.distance(a, b)
    steps, turns = moved / min(STEP, task.grippers.max_step), turned / min(TURN, task.grippers.max_turn)
    require_rows(float(max(steps, turns)), task.cable.keypoints)
    return np.linspace(a, b, max(1, int(np.ceil(max(steps, turns) - 1e-9))) + 1)


__getattr__ = renamed(__name__, {"plan_push": "plan_insertion"})
