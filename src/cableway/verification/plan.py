"""Judge a plan: the whole cable, the grippers and the plug, swept, and a rod that must take the planned shapes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from jaxtyping import Float
from threadpoolctl import threadpool_limits

from cableway.core.errors import InputError
from cableway.core.time_limit import checkpoint
from cableway.records import Check, Plan, Verdict
from cableway.scene.files.loading import TaskSource, as_any_task, as_task
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.task import CONTROL_STEP, Task
from cableway.verification.arms import arm_checks
from cableway.verification.bodies import body_checks
from cableway.verification.ends import Ends
from cableway.verification.follower import Followed, follow
from cableway.verification.geometry import curve_through, pose_distance
from cableway.verification.hands import hand_checks
from cableway.verification.plug import insertion_checks, plug_clearance, require_port
from cableway.verification.swept import closest_approach, to_scene

PIECES = 4
"""Segments of the cable between two keypoints."""

Limit = Float[np.ndarray, "t"] | float
"""For all rows, or for each."""


@dataclass(frozen=True, kw_only=True)
class VerificationLimits:
    """What a plan must keep; near a start or goal that keeps less clearance or stability, see `verification.ends`.

    Attributes:
        clearance: Of the cable's surface, of grippers and plug from everything, swept [m].
        length: Relative error of the cable's length.
        follow: How far a keypoint of the rod may stray from the plan [m].
        end: Stacked distance of the first and last row from start and goal [m].
        pose: Distance of the grippers from the poses that a task states for start or goal [m].
        pose_angle: The same for their angles [rad].
        grasp: Distance of the end keypoints from the grippers [m].
        stability: Least margin mu of the rod that follows.
    """

    clearance: float = 0.004
    length: float = 0.02
    follow: float = 0.002
    end: float = 0.01
    pose: float = 0.002
    pose_angle: float = 0.02
    grasp: float = 0.001
    stability: float = 20.0


def verify_plan(plan: Plan, task: TaskSource | SpatialTask, limits: VerificationLimits | None = None) -> Verdict:
    """Judge a plan afresh, from its shapes and poses alone; of a task in space, as `verify_spatial_plan` does.

    Raises:
        InputError: The plan has another number of keypoints than the task, or one of them is in space.
    """
    task = as_any_task(task)
    if isinstance(task, SpatialTask):
        from cableway.verification.spatial_plan import verify_spatial_plan  # which builds on this module

        return verify_spatial_plan(plan, task)
    limits = limits or VerificationLimits()
    checks = [
        *_motion(plan, task, limits),
        *plug_clearance(plan.poses[:, 1], task, limits.clearance, Ends.of(plan, task)),
        end_check("start", plan.shapes[0], task.start, limits.end),
        end_check("goal", plan.shapes[-1], task.goal, limits.end),
        *_poses("start", plan.poses[0], task.start_poses, limits),
        *_poses("goal", plan.poses[-1], task.goal_poses, limits),
    ]
    return Verdict.of(checks, CONTROL_STEP * np.arange(len(plan.shapes)))


def verify_insertion_plan(plan: Plan, task: TaskSource, limits: VerificationLimits | None = None) -> Verdict:
    """Judge a plan that inserts the plug from the task's goal into the port.

    Raises:
        InputError: The plan has another number of keypoints than the task, or the task has no port.
    """
    limits, task = limits or VerificationLimits(), as_task(task)
    require_port(task)
    checks = [
        *_motion(plan, task, limits),
        *plug_clearance(plan.poses[:, 1], task, limits.clearance, inserting=True),
        *insertion_checks(plan.poses[:, 1], task),
        end_check("goal before the insertion", plan.shapes[0], task.goal, limits.end),
    ]
    return Verdict.of(checks, CONTROL_STEP * np.arange(len(plan.shapes)))


# Threads of the linear algebra library wait for each other at every eigenvalue of a small matrix: 8 times the work.
@threadpool_limits.wrap(limits=1, user_api="blas")
def _motion(plan: Plan, task: Task, limits: VerificationLimits) -> list[Check]:
    """What any plan must keep, wherever it begins and ends."""
    if plan.shapes.shape[2] != 2:
        raise InputError(f"the plan is in space, the task {task.name!r} is not")
    if plan.shapes.shape[1] != task.cable.keypoints:
        raise InputError(f"the plan has {plan.shapes.shape[1]} keypoints, the task {task.cable.keypoints}")
    lines = curve_through(plan.shapes, PIECES)
    followed, ends = follow(plan.shapes, plan.poses, task.cable), Ends.of(plan, task)
    to_obstacles = to_scene(task.scene)
    clearance = ends.clearance(limits.clearance, lines, to_obstacles, task.cable.radius)
    grippers = [
        ends.clearance(limits.clearance, plan.poses[:, side : side + 1, :2], to_obstacles, task.grippers.radius)
        for side in range(2)
    ]
    return [
        cable_clearance(lines, task, clearance),
        gripper_clearance(plan.poses, task, np.stack(grippers)),
        *body_checks(lines, plan.poses, task, limits.clearance, ends),
        length_check(lines, followed.keypoints, task.cable.length, limits.length),
        self_crossings(with_halves(lines)),
        self_clearance(with_halves(lines), task.cable.radius),
        grasp_check(plan, limits.grasp),
        gripper_separation(plan.poses, task),
        *_gripper_motion(plan.poses, task),
        *_gripper_ramps(plan.poses, task),
        *_following(followed, ends, clearance, task, limits),
        *_rod_coordinates(plan, task, limits),
        *_optional(plan, followed, task),
        *arm_checks(plan, task),
        *hand_checks(plan, task),
    ]


def at_most(name: str, values: Float[np.ndarray, "t"], unit: str, limit: float) -> Check:
    """A check that the largest of a value per row stays below `limit`; an empty one fails."""
    if len(values) == 0:
        return Check(name, float("nan"), unit, limit, False, "never reached")
    row = int(np.argmax(values))
    return Check(name, float(values[row]), unit, limit, bool(values[row] <= limit + 1e-9), row=row)


def at_least(name: str, values: Float[np.ndarray, "t"], unit: str, limit: Float[np.ndarray, "more"] | float) -> Check:
    """A check that a value per row stays above its limit, of which there may be more; an empty one fails."""
    if len(values) == 0:
        return Check(name, float("nan"), unit, float(np.max(limit)), False, "never reached")
    limits = np.broadcast_to(limit, max(len(values), np.size(limit)))[: len(values)]
    row = int(np.argmin(values - limits))
    value, least = float(values[row]), float(limits[row])
    return Check(name, value, unit, least, value >= least - 1e-9, row=row)


def cable_clearance(lines: Float[np.ndarray, "t m 2"], task: Task, limit: Limit) -> Check:
    """Least clearance of the cable's surface over a motion, where it is least above its limit."""
    return _clearance("cable clearance", lines, task, task.cable.radius, limit, "the cable")


def gripper_clearance(poses: Float[np.ndarray, "t 2 3"], task: Task, limit: Float[np.ndarray, "2 t"] | float) -> Check:
    """The same for both gripper discs."""
    limits = np.broadcast_to(limit, (2, len(poses)))
    checks = [
        _clearance(
            "gripper clearance", poses[:, k : k + 1, :2], task, task.grippers.radius, limits[k], f"the {side} gripper"
        )
        for k, side in enumerate(("left", "right"))
    ]
    return min(checks, key=lambda check: check.value - check.limit)


def _clearance(
    name: str, lines: Float[np.ndarray, "t m 2"], task: Task, radius: float, limit: Limit, who: str
) -> Check:
    found = closest_approach(lines, to_scene(task.scene), limit)
    value, least = found.distance - radius, found.wanted
    where = f"{who} and {task.scene.name_of(found.obstacle)}"
    first, second = lines[int(found.row)], lines[min(int(found.row) + 1, len(lines) - 1)]
    passed, line = value >= least - 1e-9, first + found.row % 1 * (second - first)
    at = None if passed else task.scene.overlap(line, radius).at
    return Check(name, value, "m", least, passed, where, found.row, at=at)


def self_crossings(lines: Float[np.ndarray, "t m 2"]) -> Check:
    """No line in which the cable crosses itself; lines are as from `with_halves`."""
    crossed = ~shapely.is_simple(shapely.linestrings(lines))
    first = int(np.argmax(crossed)) / 2 if crossed.any() else None
    return Check("self-crossings", float(crossed.sum()), "", 0.0, not crossed.any(), row=first)


def self_clearance(lines: Float[np.ndarray, "t m space"], radius: float) -> Check:
    """Least clearance of the cable's surface from itself, between parts at least half a turn of it apart.

    Lines are as from `with_halves`.

    Those are pi radius of arc length or more from each other: nearer ones cannot touch unless the cable bends more
    sharply than its radius.
    """
    starts, along = lines[:, :-1], np.diff(lines, axis=1)
    lengths = np.linalg.norm(along, axis=2)
    arcs = np.concatenate([np.zeros((len(lines), 1)), np.cumsum(lengths, axis=1)], axis=1)
    gap = np.full(len(lines), np.inf)
    for point in range(lines.shape[1]):
        checkpoint()
        offset = lines[:, point, None] - starts
        share = np.clip(np.sum(offset * along, axis=2) / np.maximum(lengths**2, 1e-30), 0.0, 1.0)
        distance = np.linalg.norm(offset - share[..., None] * along, axis=2)
        here = arcs[:, point, None]
        apart = np.maximum(arcs[:, :-1] - here, here - arcs[:, 1:])
        gap = np.minimum(gap, np.where(apart >= np.pi * radius, distance, np.inf).min(1))
    found = at_least("self-clearance", gap - 2 * radius, "m", 0.0)
    return replace(found, where="two parts of the cable", row=int(np.argmin(gap)) / 2)


def with_halves(lines: Float[np.ndarray, "t m space"]) -> Float[np.ndarray, "2*t-1 m space"]:
    """The lines of all rows, and half-way from each row to the next."""
    both = np.empty((2 * len(lines) - 1, *lines.shape[1:]))
    both[::2], both[1::2] = lines, (lines[:-1] + lines[1:]) / 2
    return both


def end_check(name: str, shape: np.ndarray, wanted: np.ndarray, limit: float) -> Check:
    """Stacked distance [m] of a shape from what a task has at an end."""
    distance = float(np.linalg.norm(shape - wanted))
    return Check(f"distance to {name}", distance, "m", limit, distance <= limit)


def _poses(name: str, poses: np.ndarray, wanted: np.ndarray | None, limits: VerificationLimits) -> list[Check]:
    """Where a task states gripper poses, the plan must have them."""
    if wanted is None:
        return []
    gap, turn = pose_distance(poses, wanted)
    checks = [
        at_most(f"gripper distance to {name}", gap, "m", limits.pose),
        at_most(f"gripper angle to {name}", turn, "rad", limits.pose_angle),
    ]
    return [replace(check, row=None) for check in checks]


def length_check(lines: np.ndarray, keypoints: np.ndarray, length: float, limit: float) -> Check:
    """Of the curve through the keypoints, which is shorter than a cable that bends sharply between them.

    Compared with the same curve through the keypoints of the rod, where that came so far, or else with the cable.
    """
    wanted = np.full(len(lines), length)
    reached = len(keypoints)
    if reached:
        wanted[:reached] = arc_lengths(curve_through(keypoints, PIECES))
    return at_most("length error", np.abs(arc_lengths(lines) / wanted - 1), "1", limit)


def arc_lengths(lines: Float[np.ndarray, "t m space"]) -> Float[np.ndarray, "t"]:
    """Length [m] of each polyline."""
    return np.linalg.norm(np.diff(lines, axis=1), axis=2).sum(1)


def grasp_check(plan: Plan, limit: float) -> Check:
    """Distance [m] of the end keypoints from the grippers."""
    at = plan.poses[:, :, : plan.shapes.shape[2]]
    gap = np.linalg.norm(at - plan.shapes[:, [0, -1]], axis=2).max(1)
    return at_most("grasp error", gap, "m", limit)


def gripper_separation(poses: Float[np.ndarray, "t 2 3"], task: Task, tolerance: float = 0.0) -> Check:
    """`separation` of the grippers of a task; they may be nearer by a tolerance [m]."""
    return separation(poses[..., :2], max(task.grippers.separation, 2 * task.grippers.radius) - tolerance)


def separation(places: Float[np.ndarray, "t 2 space"], least: float) -> Check:
    """The grippers' centres keep a distance [m], between rows too."""
    gap = places[:, 1] - places[:, 0]
    change = np.diff(gap, axis=0, append=gap[-1:])
    share = np.clip(-np.sum(gap * change, axis=1) / np.maximum(np.sum(change**2, axis=1), 1e-30), 0.0, 1.0)
    apart = np.linalg.norm(gap + share[:, None] * change, axis=1)
    return at_least("gripper separation", apart, "m", least)


def _gripper_motion(poses: np.ndarray, task: Task) -> list[Check]:
    """Angles run on from row to row: one that jumps by a turn is a step that no gripper makes."""
    move, turn = pose_distance(poses[:-1], poses[1:])[0], np.abs(np.diff(poses[:, :, 2], axis=0))
    return [
        at_most("gripper step", move.max(1), "m", task.grippers.max_step),
        at_most("gripper turn", turn.max(1), "rad", task.grippers.max_turn),
    ]


def _gripper_ramps(poses: np.ndarray, task: Task) -> list[Check]:
    """Acceleration and jerk of the grippers where the task limits them, from rest and to rest."""
    limits = task.grippers
    angles = np.unwrap(poses[:, :, 2], axis=0)
    checks = []
    for name, values, most, unit, order in (
        ("gripper acceleration", poses[:, :, :2], limits.max_acceleration, "m/s²", 2),
        ("gripper turn acceleration", angles[:, :, None], limits.max_turn_acceleration, "rad/s²", 2),
        ("gripper jerk", poses[:, :, :2], limits.max_jerk, "m/s³", 3),
        ("gripper turn jerk", angles[:, :, None], limits.max_turn_jerk, "rad/s³", 3),
    ):
        if most is not None:
            rate = np.pad(values, ((order, order), (0, 0), (0, 0)), mode="edge")
            for _ in range(order):
                rate = (rate[1:] - rate[:-1]) / CONTROL_STEP
            checks.append(at_most(name, np.sqrt((rate**2).sum(axis=2)).max(1), unit, most))
    return checks


def _following(
    followed: Followed, ends: Ends, clearance: Float[np.ndarray, "t"], task: Task, limits: VerificationLimits
) -> list[Check]:
    reached, rows = len(followed.lines), len(clearance)
    lost = rows - reached
    kept = followed.stability[[0, -1]] if lost == 0 else np.full(2, limits.stability)
    checks = [
        Check("rows the rod does not reach", float(lost), "", 0.0, lost == 0, row=followed.lost_at),
        at_most("rod deviation", followed.deviation, "m", limits.follow),
        at_least("rod stability", followed.stability, "", ends.stability(limits.stability, kept)),
    ]
    if reached > 1:
        clear = cable_clearance(followed.lines, task, np.maximum(0.0, clearance[:reached] - limits.follow))
        checks.append(replace(clear, name="rod clearance"))
    return checks


def _rod_coordinates(plan: Plan, task: Task, limits: VerificationLimits) -> list[Check]:
    """Where a plan has rod coordinates they are those of its shapes; the goal need not be a shape of the rod.

    Their angles run on; half the cable's length makes a distance of one that jumps.
    """
    if plan.q is None:
        return []
    rod = task.cable.rod
    stations, poses = rod.shapes(plan.q)
    jumped = np.abs(np.unwrap(poses[:, :, 2], axis=0) - poses[:, :, 2]).max(1) * task.cable.length / 2
    gap = np.maximum(np.linalg.norm(rod.at_keypoints(stations) - plan.shapes, axis=2).max(1), jumped)
    return [at_most("error of the rod coordinates", gap[:-1], "m", limits.follow)]


def _optional(plan: Plan, followed: Followed, task: Task) -> list[Check]:
    """What only some tasks ask for."""
    checks = []
    if task.cable.min_bend_radius > 0:
        radius = 1 / np.maximum(followed.curvature, 1e-9)
        checks.append(at_least("bend radius", radius, "m", task.cable.min_bend_radius))
    return checks
