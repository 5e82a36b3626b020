"""Whether two arms that hold a cable in one way can be where its grippers are; compiled, for search and optimisation.

The *room* of gripper poses is what the arms have left there: distances from singularities (`branch_joints`),
clearances of links [m] and ways to the joints' limits of position [rad], of the arm at the left gripper, then of the
other, and the distance of the arms from each other [m].
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from cableway.core.compiled import kernel
from cableway.robot.branches import CLEARANCE, SINGULAR, TURN, PackedCell
from cableway.robot.kinematics import branch_joints
from cableway.robot.links import Capsules, arm_clearances, arms_gaps
from cableway.scene.task import Draft

ROOM = 7
"""Numbers of a room."""

LEAST = np.array([SINGULAR, CLEARANCE, TURN, SINGULAR, CLEARANCE, TURN, CLEARANCE])
"""The room that motions keep."""

TURNS = np.array([2, 5])
"""Where in a room ways to limits of position stand."""

SPARED = np.where(np.isin(np.arange(ROOM), TURNS), 0.03, 1.2 * LEAST)
"""What a search keeps, which looks a few millimetres apart. Where gripper poses that are kept are nearer to a limit of
position, it goes as near as a motion may: most motions from such a pose first turn a joint a little farther."""

WANTED = np.where(np.isin(np.arange(ROOM), TURNS), 0.06, 2 * LEAST)
"""Room under which an optimisation pushes arms back."""

DIFFERENCE = 1e-6
"""By which poses are changed for a slope [m, rad]."""


class Arm(NamedTuple):
    """An arm for the kernels, as it holds its gripper.

    Attributes:
        lengths: See `ArmModel`.
        base: Its pose in the workspace.
        inverse: The inverse of that.
        turn: 1.0 or -1.0, see `flange_poses`.
        upright, aside: Cosine and sine of the lean of its tool, see `flange_poses`.
        height: Of its flange above the table [m].
        ahead: Of its flange from the gripper, along the cable's tangent [m].
        branch: Of its inverse kinematics.
        position_limit: Of its joints [rad]; infinite where it leaves a whole turn, since then a joint that is beyond it
            may be turned back.
        capsules: Its links.
    """

    lengths: Float[np.ndarray, "6"]
    base: Float[np.ndarray, "4 4"]
    inverse: Float[np.ndarray, "4 4"]
    turn: float
    upright: float
    aside: float
    height: float
    ahead: float
    branch: int
    position_limit: Float[np.ndarray, "6"]
    capsules: Capsules


FreeArms = tuple[tuple[Arm, Arm], tuple[np.ndarray, ...], Float[np.ndarray, "7"]]
"""The arms at the left and the right gripper, what links may touch, and the room that they keep."""


def free_arms(task: Draft, kept: Float[np.ndarray, "k 2 3"]) -> FreeArms | None:
    """The arms that hold a task's cable, which never keep more room than at gripper poses `kept` [m, m, rad].

    None where the task has no cell, or it is open how its arms hold the cable.
    """
    cell = task.cell
    if cell is None or cell.way is None:
        return None
    packed, sides = PackedCell(task, cell), []
    for (arm, turn, branch), lean in zip(map(cell.way.of, range(2)), packed.leans, strict=True):
        base, upright, aside = packed.bases[arm], math.cos(lean), math.sin(lean)
        height, ahead = packed.height + packed.reach * upright, packed.reach * aside
        limit = np.array(cell.models[arm].position_limit)
        limit[limit >= np.pi] = np.inf
        sides.append(
            Arm(packed.lengths[arm], base, np.linalg.inv(base), 1.0 - 2.0 * turn, upright, aside, height, ahead, branch,
                limit, packed.capsules[arm])
        )  # fmt: skip
    arms: FreeArms = ((sides[0], sides[1]), packed.world, np.full(ROOM, -np.inf))
    kept_room = rooms(kept, arms).min(axis=0, initial=np.inf) - 1e-6
    least = np.minimum(SPARED, kept_room)
    least[TURNS] = np.where(least[TURNS] < SPARED[TURNS], np.minimum(TURN, kept_room[TURNS]), least[TURNS])
    return (*arms[:2], least)


@kernel
def arms_room(poses, arms, out):
    """Write the room (7,) of gripper poses (2, 3) into `out`; all -1 where an arm does not reach its gripper."""
    sides, world, _ = arms
    most = max(len(sides[0].capsules.frame), len(sides[1].capsules.frame))
    joints, placed, flange = np.empty((2, 1, 6)), np.empty((2, 1, most, 2, 3)), np.empty((3, 4))
    out[:] = -1.0
    for side in range(2):
        arm, inverse = sides[side], sides[side].inverse
        c, s, up = np.cos(poses[side, 2]), np.sin(poses[side, 2]), arm.height
        x, y = poses[side, 0] + arm.ahead * c, poses[side, 1] + arm.ahead * s
        for i in range(3):
            tangent, normal = c * inverse[i, 0] + s * inverse[i, 1], c * inverse[i, 1] - s * inverse[i, 0]
            flange[i, 0] = -arm.turn * (arm.upright * tangent - arm.aside * inverse[i, 2])
            flange[i, 1] = arm.turn * normal
            flange[i, 2] = -arm.upright * inverse[i, 2] - arm.aside * tangent
            flange[i, 3] = inverse[i, 0] * x + inverse[i, 1] * y + inverse[i, 2] * up + inverse[i, 3]
        away = branch_joints(arm.lengths, flange, arm.branch, joints[side, 0])
        if away < 0:
            out[:] = -1.0
            return
        out[3 * side], out[3 * side + 2] = away, (arm.position_limit - np.abs(joints[side, 0])).min()
    for side in range(2):
        arm = sides[side]
        out[3 * side + 1] = arm_clearances(arm.lengths, arm.base, joints[side], arm.capsules, world, placed[side])[0]
    out[6] = arms_gaps(placed[0], sides[0].capsules, placed[1], sides[1].capsules)[0]


@kernel
def arms_keep(poses, arms):
    """Whether arms keep their room at gripper poses (2, 3); True, without more code, where there are none."""
    if arms is None:
        return True
    room = np.empty(ROOM)
    arms_room(poses, arms, room)
    return (room >= arms[2]).all()


@kernel
def _rooms(poses, arms, out):
    for t in range(len(poses)):
        arms_room(poses[t], arms, out[t])


@kernel
def _slopes(poses, arms, wanted, room, step, out):
    """Write slopes (t, 7, 2, 3) of rooms (t, 7) that are below `wanted` (7,) by the poses (t, 2, 3) into `out`."""
    other, moved = np.empty(ROOM), np.empty((2, 3))
    for t in range(len(poses)):
        if room[t, 0] < 0 or (room[t] >= wanted).all():
            continue
        for side in range(2):
            for k in range(3):
                moved[:] = poses[t]
                moved[side, k] += step
                arms_room(moved, arms, other)
                if other[0] >= 0:
                    for i in range(ROOM):
                        if room[t, i] < wanted[i]:
                            out[t, i, side, k] = (other[i] - room[t, i]) / step


def rooms(poses: Float[np.ndarray, "t 2 3"], arms: FreeArms) -> Float[np.ndarray, "t 7"]:
    """The room at gripper poses [m, m, rad]; -1 all over where an arm does not reach its gripper."""
    out = np.empty((len(poses), ROOM))
    _rooms(np.ascontiguousarray(poses), arms, out)
    return out


def room_shortfall(
    poses: Float[np.ndarray, "t 2 3"], arms: FreeArms, wanted: Float[np.ndarray, "7"]
) -> tuple[Float[np.ndarray, "t 7"], Float[np.ndarray, "t 7 2 3"]]:
    """How far the room at gripper poses is below `wanted`, and the slope by the poses, by differences."""
    poses = np.ascontiguousarray(poses)
    room, slopes = rooms(poses, arms), np.zeros((len(poses), ROOM, 2, 3))
    _slopes(poses, arms, wanted, room, DIFFERENCE, slopes)
    return np.maximum(0.0, wanted - room), -slopes
