"""Whether two arms that hold a cable in space in one way can be where its grippers are; compiled, for search and
optimisation, as `cableway.robot.free_arms` on the table.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from cableway.core.compiled import kernel
from cableway.geometry.pose_kernels import turned
from cableway.geometry.spatial_convex_kernels import box_gap, chain_distances
from cableway.robot.branches import SINGULAR, TURN
from cableway.robot.free_arms import DIFFERENCE, ROOM
from cableway.robot.kinematics import branch_joints, link_frames
from cableway.robot.links import Capsules, arm_clearances, arms_gaps, segment_gap
from cableway.rod.spatial import SpatialRod

SHOULDER = 2
"""Frame from which on links may come near to the table, on which arms stand."""

CLEARANCES = np.array([1, 4, 6])
"""Where in a room clearances stand."""


class SpatialArm(NamedTuple):
    """An arm for the kernels, as it holds its gripper.

    Attributes:
        lengths: See `ArmModel`.
        base: Its pose in the workspace.
        inverse: The inverse of that.
        hand: Where the hand is from the cable, in the gripper's frame, of length 1.
        sense: 1.0 or -1.0, of the flange's x axis to the cable's tangent.
        reach: From the flange to the cable [m].
        branch: Of its inverse kinematics.
        position_limit: Of its joints [rad].
        capsules: Its links, then its hand.
    """

    lengths: Float[np.ndarray, "6"]
    base: Float[np.ndarray, "4 4"]
    inverse: Float[np.ndarray, "4 4"]
    hand: Float[np.ndarray, "3"]
    sense: float
    reach: float
    branch: int
    position_limit: Float[np.ndarray, "6"]
    capsules: Capsules


class Surroundings(NamedTuple):
    """What arms keep away from, for the kernels.

    Attributes:
        worlds: Obstacles with the table, and without it; see `SpatialWorld.arrays`.
        table: The table alone, see `links.world_of_arms`.
        radius: Of the cable [m].
        held: See `HELD`.
        clearance: That is kept [m].
    """

    worlds: tuple[Any, Any]
    table: tuple[Any, ...]
    radius: float
    held: float
    clearance: float


FreeSpatialArms = tuple[SpatialArm, SpatialArm, Surroundings]
"""The arms at the left and the right gripper, and what they keep away from."""


@kernel
def arm_joints(pose, arm, out):
    """Write the joints (6,) in [-pi, pi) that hold a gripper at a pose (7,) into `out`.

    Returns the distance from singularities, see `branch_joints`, negative where the arm does not reach.
    """
    along, hand, side, frame = np.zeros(3), np.empty(3), np.empty(3), np.zeros(7)
    frame[3:], along[0] = pose[3:], arm.sense
    turned(frame, along, side)
    turned(frame, arm.hand, hand)
    world, flange = np.empty((3, 4)), np.empty((3, 4))
    for i in range(3):
        world[i, 0], world[i, 2], world[i, 3] = side[i], -hand[i], pose[i] + arm.reach * hand[i]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        world[i, 1] = world[j, 2] * world[k, 0] - world[k, 2] * world[j, 0]
    for i in range(3):
        for column in range(4):
            flange[i, column] = arm.inverse[i, 3] if column == 3 else 0.0
            for k in range(3):
                flange[i, column] += arm.inverse[i, k] * world[k, column]
    return branch_joints(arm.lengths, flange, arm.branch, out)


@kernel
def own_room(arm, joints, stations, last_first, around, enough, placed):
    """Least clearance of an arm at joints (1, 6) from everything but the other arm, `enough` where there is more; or
    something below what it keeps.

    `stations` (s, 3) are of the cable, from its other end on if `last_first`; writes ends into `placed`.
    """
    capsules, wanted = arm.capsules, around.clearance
    least = min(enough, arm_clearances(arm.lengths, arm.base, joints, capsules, around.table, placed)[0])
    last, length, box = len(stations) - 1, 0.0, np.empty(6)
    for s in range(last):
        length += math.sqrt(((stations[s + 1] - stations[s]) ** 2).sum())
    for i in range(3):
        box[i], box[3 + i] = stations[:, i].min(), stations[:, i].max()
    low, high = np.empty(3), np.empty(3)
    spared = math.ceil(around.held / length * last)
    for k in range(len(capsules.frame)):
        if least < wanted:
            return least
        world = around.worlds[0 if capsules.frame[k] >= SHOULDER else 1]
        radius, ends = capsules.radius[k], placed[0, k]
        reached = least + radius
        gap = chain_distances(placed[:, k], world, reached)[0][0]
        if gap < reached:
            least = gap - radius
        for i in range(3):
            low[i], high[i] = min(ends[0, i], ends[1, i]), max(ends[0, i], ends[1, i])
        if box_gap(low, high, box) - radius - around.radius >= least:
            continue
        for s in range(spared if k >= capsules.hand else 0, last):
            a, b = (last - s, last - s - 1) if last_first else (s, s + 1)
            gap = segment_gap(ends[0], ends[1], stations[a], stations[b])
            least = min(least, gap - radius - around.radius)
    return least


@kernel
def all_links(capsules):
    """The same capsules, all of them those of links: hands of two arms must not meet either."""
    return Capsules(capsules.frame, capsules.ends, capsules.radius, len(capsules.frame))


@kernel
def _reach(poses, arms, joints):
    """See `spatial_arms_reach`; writes the joints (2, 1, 6) of arms that do."""
    left, right, _ = arms
    for side in range(2):
        arm = left if side == 0 else right
        if arm_joints(poses[side], arm, joints[side, 0]) < SINGULAR:
            return False
        if (arm.position_limit - np.abs(joints[side, 0])).min() < TURN:
            return False
    return True


@kernel
def spatial_arms_reach(poses, arms):
    """Whether arms reach grippers at poses (2, 7), away from singularities and limits of position; True, without more
    code, where there are none."""
    if arms is None:
        return True
    return _reach(poses, arms, np.empty((2, 1, 6)))


@kernel
def _keep(poses, stations, arms, joints):
    """See `spatial_arms_keep`; writes the joints (2, 1, 6) of arms that reach their grippers."""
    left, right, around = arms
    if not _reach(poses, arms, joints):
        return False
    ends_left = np.empty((1, len(left.capsules.frame), 2, 3))
    ends_right = np.empty((1, len(right.capsules.frame), 2, 3))
    wanted = around.clearance
    if own_room(left, joints[0], stations, False, around, wanted, ends_left) < wanted:
        return False
    if own_room(right, joints[1], stations, True, around, wanted, ends_right) < wanted:
        return False
    gap = arms_gaps(ends_left, all_links(left.capsules), ends_right, all_links(right.capsules))[0]
    return gap >= wanted


@kernel
def spatial_arms_keep(poses, stations, arms):
    """Whether arms can hold grippers at poses (2, 7) and a cable along stations (s, 3) clear of everything; True,
    without more code, where there are none."""
    if arms is None:
        return True
    return _keep(poses, stations, arms, np.empty((2, 1, 6)))


@kernel
def _rooms(poses, stations, arms, enough, out):
    """Write the rooms (t, 7) of gripper poses (t, 2, 7) into `out`, clearances up to `enough`; -1 all over where an arm
    does not reach its gripper."""
    left, right, around = arms
    joints, away = np.empty((2, 1, 6)), np.empty(2)
    ends_left = np.empty((1, len(left.capsules.frame), 2, 3))
    ends_right = np.empty((1, len(right.capsules.frame), 2, 3))
    for t in range(len(poses)):
        out[t] = -1.0
        for side in range(2):
            away[side] = arm_joints(poses[t, side], left if side == 0 else right, joints[side, 0])
        if away.min() < 0:
            continue
        for side in range(2):
            arm = left if side == 0 else right
            ends = ends_left if side == 0 else ends_right
            out[t, 3 * side] = away[side]
            out[t, 3 * side + 1] = own_room(arm, joints[side], stations[t], side == 1, around, enough, ends)
            out[t, 3 * side + 2] = (arm.position_limit - np.abs(joints[side, 0])).min()
        gap = arms_gaps(ends_left, all_links(left.capsules), ends_right, all_links(right.capsules))[0]
        out[t, 6] = min(enough, gap)


@kernel
def rows_kept(poses, stations, arms, joints):
    """How many rows of a motion arms keep, one after the other; writes their joints (t, 2, 1, 6)."""
    for t in range(len(poses)):
        if not _keep(poses[t], stations[t], arms, joints[t]):
            return t
    return len(poses)


@kernel
def bends(arm, joints, out):
    """Write how far the tool is halfway between rows of joints (t, 6) from halfway between where it is at them into
    `out` (t-1, 2): the place of its tip [m], and how it is turned [rad]."""
    frames, rows = np.empty((7, 3, 4)), np.empty((3, 3, 4))
    for t in range(len(joints) - 1):
        for k in range(3):
            link_frames(arm.lengths, arm.base, joints[t] + 0.5 * k * (joints[t + 1] - joints[t]), frames)
            rows[k] = frames[6]
            rows[k, :, 3] += arm.reach * rows[k, :, 2]
        off, turn = 0.0, 0.0
        for i in range(3):
            off += (rows[1, i, 3] - 0.5 * (rows[0, i, 3] + rows[2, i, 3])) ** 2
            j, k, slower = (i + 1) % 3, (i + 2) % 3, 0.0
            for m in range(3):
                slower += (rows[0, m, j] + rows[2, m, j]) * rows[1, m, k]
                slower -= (rows[0, m, k] + rows[2, m, k]) * rows[1, m, j]
            turn += (0.25 * slower) ** 2
        out[t, 0], out[t, 1] = math.sqrt(off), math.sqrt(turn)


def spatial_room_shortfall(
    rod: SpatialRod, q: Float[np.ndarray, "t 12"], arms: FreeSpatialArms, wanted: Float[np.ndarray, "7"], sloped: bool
) -> tuple[Float[np.ndarray, "t 7"], Float[np.ndarray, "t 7 12"]]:
    """How far the room of arms, see `cableway.robot.free_arms`, is below `wanted` where they hold a rod at q.

    The slopes by steps of q are differences, zeros unless `sloped`. Where an arm does not reach its gripper, the
    distance from singularities falls short, without a slope.
    """
    left, right, around = arms
    arms = left, right, around._replace(clearance=-math.inf)
    enough = float(wanted[CLEARANCES].max())

    def rooms(q: np.ndarray) -> np.ndarray:
        stations, poses = rod.shapes(q)
        out = np.empty((len(q), ROOM))
        _rooms(np.ascontiguousarray(poses), np.ascontiguousarray(stations), arms, enough, out)
        return out

    room, slopes = rooms(q), np.zeros((len(q), ROOM, rod.dof))
    reached = room[:, 0] >= 0
    short = np.maximum(0.0, wanted - room)
    short[~reached, 1:] = 0.0
    rows = np.flatnonzero(short.any(axis=1) & reached)
    if sloped and len(rows):
        steps = DIFFERENCE * rod.units
        moved = rooms(rod.retract(np.repeat(q[rows], rod.dof, axis=0), np.tile(np.diag(steps), (len(rows), 1))))
        moved = moved.reshape(len(rows), rod.dof, ROOM)
        change = (moved - room[rows, None]) / steps[:, None] * (moved[..., :1] >= 0)
        slopes[rows] = -change.swapaxes(1, 2) * (short[rows, :, None] > 0)
    return short, slopes
