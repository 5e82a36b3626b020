"""Judge a plan in space: cable and grippers swept, and a rod that must take the planned shapes without snapping.

The rod (`cableway.verification.spatial_follower`) is led through the gripper poses at twice their number; distances are
Coal's. A way between two rows is straight, and turned the short way.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from cableway.core.errors import InputError
from cableway.records import Check, Plan, Verdict
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.task import CONTROL_STEP, ENDS
from cableway.verification.ends import Ends
from cableway.verification.geometry import curve_through
from cableway.verification.plan import (
    PIECES,
    at_least,
    at_most,
    end_check,
    grasp_check,
    length_check,
    self_clearance,
    separation,
    with_halves,
)
from cableway.verification.spatial_arms import spatial_arm_checks
from cableway.verification.spatial_bodies import bodies_off_cable, bodies_off_scene, with_half_poses
from cableway.verification.spatial_distance import ToScene
from cableway.verification.spatial_follower import FollowedInSpace, follow_in_space
from cableway.verification.swept import Measure, closest_approach

TWIST = 0.2
"""Of the greatest twist [rad], by which the judge's rod, a finer chain, may be twisted more."""


@dataclass(frozen=True, kw_only=True)
class SpatialVerificationLimits:
    """What a plan in space must keep; near a start or goal that keeps less, see `verification.ends`.

    Attributes:
        clearance: Of the cable's surface and of grippers from everything, swept [m].
        rod_clearance: The same of the surface of the rod that follows [m].
        length: Relative error of the cable's length.
        follow: How far a keypoint of the rod may stray from the plan [m]. Chains of 24 and of 48 hinges are up to 6 mm
            apart where the cable is heavy (docs/space.md).
        end: Stacked distance of the first and last row from start and goal [m].
        pose: Distance of the grippers from their poses there [m].
        pose_angle: The same for their orientations [rad].
        grasp: Distance of the end keypoints from the grippers [m].
        stability: Least margin of the rod that follows, twist free: 6.6 of the straight rod where C/B = 2/3.
    """

    clearance: float = 0.004
    rod_clearance: float = 0.002
    length: float = 0.02
    follow: float = 0.006
    end: float = 0.01
    pose: float = 0.002
    pose_angle: float = 0.02
    grasp: float = 0.001
    stability: float = 1.0


@threadpool_limits.wrap(limits=1, user_api="blas")
def verify_spatial_plan(plan: Plan, task: SpatialTask, limits: SpatialVerificationLimits | None = None) -> Verdict:
    """Judge a plan afresh, from its shapes and poses alone.

    Raises:
        InputError: The plan is one of the plane, or has another number of keypoints than the task.
        MissingExtraError: Coal is not installed.
    """
    limits = limits or SpatialVerificationLimits()
    if plan.shapes.shape[2] != 3:
        raise InputError(f"the task {task.name!r} is in space, the plan is not")
    if plan.shapes.shape[1] != task.cable.keypoints:
        raise InputError(f"the plan has {plan.shapes.shape[1]} keypoints, the task {task.cable.keypoints}")
    lines, ends = curve_through(plan.shapes, PIECES), Ends.of(plan, task)
    followed = _followed(plan, task)
    to_cable, to_balls = ToScene(task.scene, task.cable.radius), ToScene(task.scene, task.grippers.radius)
    clearance = ends.clearance(limits.clearance, lines, to_cable, task.cable.radius)
    keypoints = followed.stations[::2, ::PIECES]
    checks = [
        swept_clearance("cable clearance", lines, task, to_cable, task.cable.radius, clearance, "the cable"),
        *_balls(plan.poses, task, to_balls, ends, limits.clearance),
        *bodies_off_scene(plan.poses, task, limits.clearance),
        bodies_off_cable(lines, plan.poses, task),
        length_check(lines, keypoints, task.cable.length, limits.length),
        self_clearance(with_halves(lines), task.cable.radius),
        grasp_check(plan, limits.grasp),
        separation(plan.poses[..., :3], task.grippers.least_span),
        *gripper_motion(plan.poses, task),
        *_following(followed, plan, task, limits, ends),
        *_rod_coordinates(plan, task, limits),
        *_ends(plan, task, limits),
        *spatial_arm_checks(plan, task),
    ]
    if len(followed.stations) > 1:
        rows = np.arange(len(followed.stations)) / 2
        wanted = np.maximum(0.0, np.interp(rows, np.arange(len(lines)), clearance) - limits.clearance)
        wanted = wanted + limits.rod_clearance
        found = swept_clearance(
            "rod clearance", followed.stations, task, to_cable, task.cable.radius, wanted, "the cable"
        )
        checks.append(replace(found, row=(found.row or 0.0) / 2))
    return Verdict.of(checks, CONTROL_STEP * np.arange(len(plan.shapes)))


def _followed(plan: Plan, task: SpatialTask) -> FollowedInSpace:
    """The judge's rod, led through the poses and half-way between each two; row 2t is that of the plan's row t."""
    shapes, poses = with_halves(plan.shapes), with_half_poses(plan.poses)
    rod = task.rod
    return follow_in_space(
        curve_through(shapes, PIECES), poses, length=rod.length, twist=rod.twist, weight=rod.weight,
        twisted=float(task.start[9]) / rod.twist,
    )  # fmt: skip


def swept_clearance(
    name: str, lines: np.ndarray, task: SpatialTask, measure: Measure, radius: float, limit: np.ndarray | float,
    who: str,
) -> Check:  # fmt: skip
    """The clearance [m] of moving lines of a radius [m] from the scene, swept; and whether it keeps a limit [m]."""
    found = closest_approach(lines, measure, limit + radius)
    value, least = found.distance - radius, found.wanted - radius
    where = f"{who} and {task.scene.name_of(found.obstacle)}"
    return Check(name, value, "m", least, value >= least - 1e-6, where, found.row)


def _balls(poses: np.ndarray, task: SpatialTask, measure: ToScene, ends: Ends, limit: float) -> list[Check]:
    """The worse clearance of the balls about the ends of the cable."""
    found, radius = [], task.grippers.radius
    for side, name in enumerate(("the left gripper", "the right gripper")):
        places = poses[:, side : side + 1, :3]
        wanted = ends.clearance(limit, places, measure, radius)
        found.append(swept_clearance("gripper clearance", places, task, measure, radius, wanted, name))
    return [min(found, key=lambda check: check.value - check.limit)]


def gripper_motion(poses: np.ndarray, task: SpatialTask) -> list[Check]:
    """Steps and turns of the grippers from row to row."""
    move, turn = _pose_distance(poses[:-1], poses[1:])
    return [
        at_most("gripper step", move.max(1), "m", task.grippers.max_step),
        at_most("gripper turn", turn.max(1), "rad", task.grippers.max_turn),
    ]


def _pose_distance(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance [m] and turn [rad] between poses."""
    same = np.sum(a[..., 3:] * b[..., 3:], axis=-1, keepdims=True)
    chord = np.linalg.norm(a[..., 3:] - np.where(same < 0, -1.0, 1.0) * b[..., 3:], axis=-1)
    return np.linalg.norm(b[..., :3] - a[..., :3], axis=-1), 4 * np.arcsin(np.clip(chord / 2, 0, 1))


def _following(
    followed: FollowedInSpace, plan: Plan, task: SpatialTask, limits: SpatialVerificationLimits, ends: Ends
) -> list[Check]:
    """Whether the judge's rod comes along, how far it strays, and how near it is to snapping."""
    reached, rows = len(followed.stations), 2 * len(plan.shapes) - 1
    lost = rows - reached
    kept = followed.stability[[0, -1]] if lost == 0 else np.full(2, limits.stability)
    at_keypoints = followed.stations[::2, ::PIECES]
    off = np.linalg.norm(at_keypoints - plan.shapes[: len(at_keypoints)], axis=2).max(1, initial=0.0)
    wanted = np.interp(np.arange(rows) / 2, np.arange(len(plan.shapes)), ends.stability(limits.stability, kept))
    stable = at_least("rod stability", followed.stability, "", wanted)
    most = task.cable.max_twist + TWIST
    twist = at_most("twist", np.abs(followed.twist), "rad", most)
    lost_row = None if followed.lost_at is None else followed.lost_at / 2
    halved = [replace(each, row=None if each.row is None else each.row / 2) for each in (stable, twist)]
    return [
        Check("rows the rod does not reach", float(lost), "", 0.0, lost == 0, row=lost_row),
        at_most("rod deviation", off, "m", limits.follow),
        *halved,
    ]


def _rod_coordinates(plan: Plan, task: SpatialTask, limits: SpatialVerificationLimits) -> list[Check]:
    """Where a plan has rod coordinates they are those of its shapes and poses."""
    if plan.q is None:
        return []
    stations, poses = task.rod.shapes(plan.q)
    off = np.linalg.norm(task.rod.at_keypoints(stations) - plan.shapes, axis=2).max(1)
    move, turn = _pose_distance(poses, plan.poses)
    off = np.maximum(off, np.maximum(move.max(1), turn.max(1) * task.cable.length / 2))
    return [at_most("error of the rod coordinates", off, "m", limits.follow)]


def _ends(plan: Plan, task: SpatialTask, limits: SpatialVerificationLimits) -> list[Check]:
    checks = []
    for name, row in zip(ENDS, (0, -1), strict=True):
        move, turn = _pose_distance(plan.poses[row], task.gripper_poses(name))
        checks += [
            end_check(name, plan.shapes[row], task.keypoints(name), limits.end),
            replace(at_most(f"gripper distance to {name}", move, "m", limits.pose), row=None),
            replace(at_most(f"gripper angle to {name}", turn, "rad", limits.pose_angle), row=None),
        ]
    return checks
