"""What the record of a run says of itself, and whether its arrays agree: times, keypoints, grasps, motion, shape, end.

No bound is that of one plant: what is measured is the most that `studies/true_rollouts.py` finds, on all its plants.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from cableway.core.checks import Bounds, shown
from cableway.core.errors import InputError
from cableway.core.files import LARGEST
from cableway.core.provenance import describe
from cableway.records import THEN_FAILED, Check, Rollout
from cableway.scene.cable import Cable
from cableway.scene.task import CONTROL_STEP, Task
from cableway.verification.bodies import piece_clearances
from cableway.verification.follower import follow
from cableway.verification.geometry import at_equal_arcs, turn
from cableway.verification.grasps import GRASP_OFFSET, stated
from cableway.verification.plan import at_most
from cableway.verification.swept import distances

ROW_JITTER = 0.5
"""Share of the usual time between rows by which one may differ; a row left out makes it twice as long."""

LONGEST_CONTROL_STEP = 1.0
"""Time [s] that one step of a plant takes at most."""

CLEARANCE_ERROR = 5e-4
"""Distance [m] by which a clearance may be recorded above that of its row."""

GRASP_ANGLE = 0.2
"""Angle [rad] between a gripper and the cable's end: held askew by 10 degrees and more; measured: 1.5 degrees."""

KEYPOINT_ERROR = 0.002
"""Distance [m] of a keypoint from its place along the cable; measured: less than 0.01 mm."""

OTHER_LENGTH = 0.05
"""Difference [m] of a plant's cable from the task's. At 50 mm no gripper poses bring it within 3 cm of a goal of the
catalogue: the least error is 34 mm."""

SNAP = 0.4
"""Lengths of the cable that a part of it moves in one control step beyond what the grippers move it; measured: 0.03 in
runs that succeed, 0.14 where a cable of damping time 0.02 s snaps."""

AT_REST = 0.005
"""The same [m] in the last row, where a run has come to rest; measured: 0.2 mm."""

ASTRAY = 0.05
"""Lengths of the cable by which a row may lie off the way between its neighbours, beyond what the grippers move.
Measured: 0.002 where a cable snaps."""

BEND = 20.0
"""Largest root mean square of curvature times length; measured: 7 in runs that succeed, 12 where cables snap."""

SHARPER = 1.5
"""By how much a tracked cable bends more sharply than it may; measured: 1.22, of a cable of which a third is stiff."""

KINK = 40.0
"""Largest change of curvature times length from one of `PIECES` to the next: the bending moment is continuous along a
cable. Measured: 5 in runs that succeed, 32 where grippers turn by half a turn."""

ROD = 0.4
"""Lengths of the cable that a keypoint may be away from an elastic rod between the same grippers. Friction, set, rest
curvature, graded stiffness and motion bring it there: 0.18 measured, of a slow cable of which a third is stiff."""

LAID_ANEW = 10
"""Times that rod is laid into the recorded shape again, as where the cable has snapped to another one."""

PIECES = 24
"""Pieces of a cable in which its bends are measured."""

COMMAND_LAG = 1.0
"""Time [s] by which grippers may lag behind their commands; a run ends where they are off by 20 mm."""


def plant_length(rollout: Rollout, task: Task) -> float | None:
    """Length [m] of the plant's cable, where the metadata state one; None where it is the task's, in the task's start.

    Raises:
        InputError: They state something else than a length.
    """
    length = stated(rollout, "plant", "cable", "length")
    if length is None:
        return None
    if not Bounds(0, LARGEST, open=True).hold(length, whole=False):
        raise InputError(f"plant.cable.length must be positive and at most {LARGEST:g} m, got {shown(length)}")
    differs = any(stated(rollout, "plant", name) is not None for name in ("start", "table"))
    same = stated(rollout, "plant", "cable") == describe(task.cable)
    return None if same and not differs else float(length)


def recording_checks(rollout: Rollout, task: Task, length: float | None) -> list[Check]:
    """All that can be checked of a record without another run of the plant; `length` as for `verify_rollout`."""
    measured = np.linalg.norm(np.diff(rollout.centreline, axis=1), axis=2).sum(1)
    truth = task.cable.length if length is None else length
    plant = _length_of_plant(truth, task)
    return [
        _ending(rollout),
        *_clearances(rollout, task),
        plant,
        at_most("length error", np.abs(measured / truth - 1), "1", 0.02),
        *_grasps(rollout),
        *_times(rollout),
        *_gripper_motion(rollout, task),
        *_cable_motion(rollout, truth),
        *_bends(rollout, task.cable.min_bend_radius / truth),
        *([_rod(rollout, truth)] if plant.passed else []),
    ]


def _length_of_plant(length: float, task: Task) -> Check:
    differs = abs(length - task.cable.length)
    return Check("difference to the task's cable", differs, "m", OTHER_LENGTH, differs <= OTHER_LENGTH)


def _ending(rollout: Rollout) -> Check:
    """The run was led to its end, and nothing was particular to that."""
    said = [str(text) for text in rollout.status if THEN_FAILED in str(text)]
    if not rollout.outcome.finished or rollout.detail:
        said.insert(0, f"{rollout.outcome}: {rollout.detail}" if rollout.detail else rollout.outcome.value)
    return Check("failures recorded", float(len(said)), "", 0.0, not said, "; ".join(said))


def _clearances(rollout: Rollout, task: Task) -> list[Check]:
    """Recorded clearances are positive, and not above those of the same row.

    A record is the least since the row before, so it may be below. Of displaced obstacles only the walls count.
    """
    scene = replace(task.scene, obstacles=()) if stated(rollout, "plant", "obstacles") else task.scene
    discs = np.min([distances(rollout.poses[:, k : k + 1, :2], scene)[0] for k in range(2)], axis=0)
    pieces = piece_clearances(rollout.poses, rollout.centreline, task.in_scene(scene))
    grippers = np.minimum(discs - task.grippers.radius, pieces)
    checks = []
    lines, poses = rollout.centreline[:, None], rollout.poses[:, :, None, :2]
    for name, recorded, found, error, bodies in (
        ("cable", rollout.clearance, distances(rollout.centreline, scene)[0] - task.cable.radius, 0.0, lines),
        ("gripper", rollout.gripper_clearance, grippers, GRASP_OFFSET, poses),
    ):
        row, what = int(np.argmin(recorded)), f"recorded {name} clearance"
        least = float(recorded[row])
        at = None if least > 0 else max(task.scene.overlap(line, 0.0) for line in bodies[row]).at
        checks += [
            Check(what, least, "m", 0.0, least > 0, row=row, at=at),
            at_most(f"{what} above that of its row", recorded - found, "m", CLEARANCE_ERROR + error),
        ]
    return checks


def _grasps(rollout: Rollout) -> list[Check]:
    """Keypoints at equal arc length from the left end to the right one, and the ends where and as they are held."""
    line, poses = rollout.centreline, rollout.poses
    places = at_equal_arcs(line, rollout.keypoints.shape[1])
    directions, turns = _turns_along(line)
    askew = np.abs(turn(directions[:, [0, -1]] - poses[:, :, 2]))
    if turns.shape[1]:  # within its first and last piece the cable bends as much as to the next
        askew -= np.abs(turns[:, [0, -1]])
    held = np.linalg.norm(poses[:, :, :2] - line[:, [0, -1]], axis=2).max(1)
    off = np.linalg.norm(rollout.keypoints - places, axis=2).max(1)
    return [
        at_most("keypoints off their places along the cable", off, "m", KEYPOINT_ERROR),
        at_most("grasp error", held, "m", 0.003),
        at_most("grasp angle", askew.max(1), "rad", GRASP_ANGLE),
    ]


def _times(rollout: Rollout) -> list[Check]:
    """Rows follow each other at the pace of the control steps."""
    steps = np.diff(rollout.times)
    if not len(steps):
        return []
    usual = float(np.median(steps))
    irregular = (steps <= 0) | (np.abs(steps - usual) > ROW_JITTER * usual)
    steps_stated = (stated(rollout, "control_step"), stated(rollout, "plant", "control_step"))
    possible = Bounds(0, LONGEST_CONTROL_STEP, open=True)
    wanted = min((step for step in steps_stated if possible.hold(step, whole=False)), default=CONTROL_STEP)
    first = int(np.argmax(irregular)) + 1 if irregular.any() else None
    return [
        Check("rows out of time", float(irregular.sum()), "", 0.0, not irregular.any(), row=first),
        at_most("time between rows", steps, "s", (1 + ROW_JITTER) * wanted),
    ]


def _gripper_motion(rollout: Rollout, task: Task, tolerance: float = 1.05) -> list[Check]:
    """Gripper steps within the limits, where a plant's grippers may catch up by a few percent, and as commanded."""
    steps = np.diff(rollout.times)
    if not len(steps) or steps.min() <= 0:
        return []
    share = (CONTROL_STEP / steps)[:, None]
    move, turned = (_gripper_moves(rollout.poses) * share).max(1), (_gripper_turns(rollout.poses) * share).max(1)
    sent = rollout.actions[:, :, :2]
    way = np.cumsum(np.linalg.norm(sent, axis=2), axis=0)
    rows = math.ceil(COMMAND_LAG / float(np.median(steps)))
    recent = way - np.concatenate([np.zeros_like(way[:rows]), way[:-rows]])
    off = np.linalg.norm(rollout.poses[1:, :, :2] - rollout.poses[0, :, :2] - np.cumsum(sent, axis=0), axis=2)
    return [
        at_most("gripper step", move, "m", tolerance * task.grippers.max_step),
        at_most("gripper turn", turned, "rad", tolerance * task.grippers.max_turn),
        at_most("grippers away from their commands", (off - recent).max(1), "m", 2 * GRASP_OFFSET),
    ]


def _gripper_moves(poses: Float[np.ndarray, "t 2 3"]) -> Float[np.ndarray, "t-1 2"]:
    return np.linalg.norm(np.diff(poses[:, :, :2], axis=0), axis=2)


def _gripper_turns(poses: Float[np.ndarray, "t 2 3"]) -> Float[np.ndarray, "t-1 2"]:
    """Turns [rad] from row to row: as recorded, or the short way where all angles of a gripper are within one turn."""
    angles = poses[:, :, 2]
    turns = np.diff(angles, axis=0)
    return np.abs(np.where(np.ptp(angles, axis=0) <= 2 * np.pi, turn(turns), turns))


def _cable_motion(rollout: Rollout, length: float) -> list[Check]:
    """No part of the cable moves far beyond what the grippers lead it: their moves, and their turns of half of it."""
    if not rollout.steps:
        return []
    led = (_gripper_moves(rollout.poses) + length / 2 * np.abs(turn(np.diff(rollout.poses[:, :, 2], axis=0)))).max(1)
    steps = np.diff(at_equal_arcs(rollout.centreline, PIECES + 1), axis=0)
    moves = np.linalg.norm(steps, axis=2)
    beyond = moves.max(1) - led
    round_about = (moves[:-1] + moves[1:] - np.linalg.norm(steps[:-1] + steps[1:], axis=2)).max(1) / 2
    checks = [
        at_most("cable step beyond the grippers'", beyond, "m", SNAP * length),
        replace(at_most("cable step to the last row", beyond[-1:], "m", AT_REST), row=rollout.steps),
    ]
    if rollout.steps > 1:
        astray = round_about - np.maximum(led[:-1], led[1:])
        checks.append(at_most("row off the way between its neighbours", astray, "m", ASTRAY * length))
    return checks


def _turns_along(line: Float[np.ndarray, "t m 2"]) -> tuple[Float[np.ndarray, "t p"], Float[np.ndarray, "t q"]]:
    """Directions [rad] of a cable's pieces, and the turns from each to the next."""
    pieces = np.diff(at_equal_arcs(line, min(PIECES, line.shape[1] - 1) + 1), axis=1)
    directions = np.arctan2(pieces[:, :, 1], pieces[:, :, 0])
    return directions, turn(np.diff(directions, axis=1))


def _bends(rollout: Rollout, radius: float) -> list[Check]:
    """The cable is bent as a cable can be: not wound up, without kinks, and not more sharply than it may be.

    Args:
        rollout: The rollout.
        radius: Least bend radius, in lengths of the cable.
    """
    turns = _turns_along(rollout.centreline)[1]
    curvatures = turns * (turns.shape[1] + 1)
    checks = []
    if turns.shape[1] > 0:
        checks.append(at_most("bending", np.sqrt(np.mean(curvatures**2, axis=1)), "", BEND))
        if radius > 0:
            checks.append(at_most("sharpest bend", radius * np.abs(curvatures).max(1), "", SHARPER))
    if turns.shape[1] > 1:
        checks.append(at_most("kink", np.abs(np.diff(curvatures, axis=1)).max(1), "", KINK))
    return checks


def _rod(rollout: Rollout, length: float) -> Check:
    """Distance of the keypoints from an elastic rod that the same grippers lead from row to row.

    Where the cable is too far from it, or it has no stable shape any more, it is laid anew into the cable's shape, as
    after a snap; the cable is too far away where it then is again, or the rod cannot lie like that in the rows after.
    """
    shapes, poses, limit = rollout.keypoints, rollout.poses, ROD * length
    cable = Cable(length=length, radius=min(length / 8, 0.004), keypoints=shapes.shape[1])  # its rod has no thickness
    first, most, away = 0, (0.0, 0), None
    for _ in range(LAID_ANEW):
        off = follow(shapes[first:], poses[first:], cable).deviation
        near = int(np.argmax(off > limit)) if (off > limit).any() else len(off)
        if near:
            most, away = max(most, (float(off[:near].max()), first + int(np.argmax(off[:near])))), None
        if near < len(off):
            away = away or (float(off[near]), first + near)
        first += max(near, 1)
        if first >= len(shapes):
            break
    value, row = away or most
    return Check("distance from the rod", value, "m", limit, value <= limit, row=row)
