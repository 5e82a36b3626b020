"""Two arms of a cell that hold a cable in space: from which side each hand takes hold, and whether arms can be there.

A gripper without a body may take hold of the cable from any side: its *roll* is the angle about the cable's tangent,
the gripper's x axis, from the gripper's z axis to where the hand is. Arm, roll, turn and branch (see
`cableway.robot.branches`) are chosen once for a whole plan, of those in which the arms can hold start and goal alike.

Links and hands keep their clearance from obstacles, the table, each other and the cable, but for the walls of the
workspace, over which arms come.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from cableway.core.compiled import kernel
from cableway.core.quantities import limit_text, quantity
from cableway.geometry.pose_kernels import turned
from cableway.geometry.spatial_convex import SpatialWorld
from cableway.geometry.spatial_convex_kernels import chain_distances
from cableway.robot.branches import CLEARANCE, ENOUGH, SINGULAR, SPEED_SHARE, TURN
from cableway.robot.free_arms import DIFFERENCE, ROOM
from cableway.robot.kinematics import BRANCHES, branch_joints, link_frames
from cableway.robot.links import Capsules, arm_clearances, arms_gaps, segment_gap, world_of_arms
from cableway.rod.spatial import SpatialRod
from cableway.scene.cell import ARMS, TOOLS, Cell
from cableway.scene.grippers import SIDES
from cableway.scene.scene import Scene
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.task import CONTROL_STEP, ENDS

ROLLS = 24
"""Rolls that are tried, evenly round the cable."""

HELD = 0.05
"""Length of cable [m] from its end on that the hand which holds it may be near to."""

FAR = 100.0
"""Of walls [m], which arms come over."""

SHOULDER = 2
"""Frame from which on links may come near to the table, on which arms stand."""

TRAVEL = 0.01
"""Clearance [m] that is as good as 1 rad less to turn a joint from start to goal, for who chooses a way."""


BENDS = np.array([0.8e-3, 8e-3])
"""How far a tool may be off between two rows of joints [m, rad]."""

CLEARANCES = np.array([1, 4, 6])
"""Where in a room clearances stand."""


class SpatialWay(NamedTuple):
    """How the arms hold a cable in space, of the gripper at its left end and at its right one.

    Attributes:
        holders: Which of the cell's arms.
        rolls: Of the hands [rad].
        turns: Of the tools: 0 or 1, with the flange's x axis against the cable's tangent or along it.
        branches: Of the inverse kinematics.
    """

    holders: tuple[int, int]
    rolls: tuple[float, float]
    turns: tuple[int, int]
    branches: tuple[int, int]

    @classmethod
    def of_record(cls, metadata: Mapping[str, Any]) -> SpatialWay | None:
        """That of a plan; None where it says of none, or of none that there is."""
        held = metadata.get("arms")
        given: list[Any] = [held.get(name) for name in cls._fields] if isinstance(held, dict) else []
        if not given or not all(isinstance(pair, list) and len(pair) == ARMS for pair in given):
            return None
        holders, rolls, turns, branches = given
        known = holders in ([0, 1], [1, 0]) and all(turn in (0, 1) for turn in turns)
        if not known or not all(isinstance(roll, int | float) and math.isfinite(roll) for roll in rolls):
            return None
        return cls(*map(tuple, given)) if all(branch in range(BRANCHES) for branch in branches) else None

    def described(self) -> dict[str, list[Any]]:
        """What the metadata of a plan with such joints say of them, as `arms`."""
        return {name: list(value) for name, value in self._asdict().items()}


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
def _arm_joints(pose, arm, out):
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
def _own_room(arm, joints, stations, last_first, around, enough, placed):
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
        away = -np.inf
        for i in range(3):
            low, high = min(ends[0, i], ends[1, i]), max(ends[0, i], ends[1, i])
            away = max(away, max(box[i] - high, low - box[3 + i]))
        if away - radius - around.radius >= least:
            continue
        for s in range(spared if k >= capsules.hand else 0, last):
            a, b = (last - s, last - s - 1) if last_first else (s, s + 1)
            gap = segment_gap(ends[0], ends[1], stations[a], stations[b])
            least = min(least, gap - radius - around.radius)
    return least


@kernel
def _whole(capsules):
    """The same capsules, all of them those of links: hands of two arms must not meet either."""
    return Capsules(capsules.frame, capsules.ends, capsules.radius, len(capsules.frame))


@kernel
def _reach(poses, arms, joints):
    """See `spatial_arms_reach`; writes the joints (2, 1, 6) of arms that do."""
    left, right, _ = arms
    for side in range(2):
        arm = left if side == 0 else right
        if _arm_joints(poses[side], arm, joints[side, 0]) < SINGULAR:
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
    if _own_room(left, joints[0], stations, False, around, wanted, ends_left) < wanted:
        return False
    if _own_room(right, joints[1], stations, True, around, wanted, ends_right) < wanted:
        return False
    gap = arms_gaps(ends_left, _whole(left.capsules), ends_right, _whole(right.capsules))[0]
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
            away[side] = _arm_joints(poses[t, side], left if side == 0 else right, joints[side, 0])
        if away.min() < 0:
            continue
        for side in range(2):
            arm = left if side == 0 else right
            ends = ends_left if side == 0 else ends_right
            out[t, 3 * side] = away[side]
            out[t, 3 * side + 1] = _own_room(arm, joints[side], stations[t], side == 1, around, enough, ends)
            out[t, 3 * side + 2] = (arm.position_limit - np.abs(joints[side, 0])).min()
        gap = arms_gaps(ends_left, _whole(left.capsules), ends_right, _whole(right.capsules))[0]
        out[t, 6] = min(enough, gap)


@kernel
def _rows_kept(poses, stations, arms, joints):
    """How many rows of a motion arms keep, one after the other; writes their joints (t, 2, 1, 6)."""
    for t in range(len(poses)):
        if not _keep(poses[t], stations[t], arms, joints[t]):
            return t
    return len(poses)


@kernel
def _bends(arm, joints, out):
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


class SpatialArms:
    """The arms of a task's cell.

    Args:
        task: The task, in a cell.
        clearance: That links and hands keep [m].
    """

    def __init__(self, task: SpatialTask, clearance: float = CLEARANCE) -> None:
        assert task.cell is not None
        self.cell: Cell = task.cell
        self._task = task
        solids, size = [obstacle.solid for obstacle in task.scene.obstacles], np.full(3, 2 * FAR)
        low = np.array([-FAR, -FAR, 0.0])
        worlds = SpatialWorld.of(solids, size, low).arrays, SpatialWorld.of(solids, size, low - [0, 0, FAR]).arrays
        table = world_of_arms(Scene(size=task.scene.size[:2]))
        self._around = Surroundings(worlds, table, task.cable.radius, HELD, clearance)
        self._bases = [arm.base(task.scene) for arm in self.cell.arms]
        self._capsules = [Capsules.of(model, TOOLS[self.cell.tool]) for model in self.cell.models]
        self._rolls = [0.0] if task.bodies[2:] else [2 * math.pi * k / ROLLS for k in range(ROLLS)]

    def held(self, way: SpatialWay) -> FreeSpatialArms:
        """The arms as they hold the cable in a way."""
        left, right = (self._arm(*each) for each in zip(*way, strict=True))
        return left, right, self._around

    def ways(self) -> list[SpatialWay] | str:
        """In which ways the arms can hold start and goal, of each choice of arms and branches that with most room and
        least to turn, the best first; or why there is none."""
        shown = [self._task.rod.shapes(np.array(getattr(self._task, end))[None]) for end in ENDS]
        poses, stations = (np.concatenate([each[k] for each in shown]) for k in (1, 0))
        tracks = [list(self._at_ends(poses[:, side], stations, side)) for side in range(len(SIDES))]
        for side, found in enumerate(tracks):
            if not found:
                return f"no arm can hold the {SIDES[side][0]} at start and goal in the same way, clear of everything"
        best: dict[tuple[Any, ...], tuple[float, SpatialWay]] = {}
        closest = -math.inf
        for (one, left, room, ends), (other, right, more, others) in product(*tracks):
            if left[0] == right[0]:
                continue
            score = min(room, more)
            key = (left[0], left[3], right[0], right[3])
            if score <= best.get(key, (-math.inf,))[0]:
                continue
            gap = float(arms_gaps(ends, _whole(one.capsules), others, _whole(other.capsules)).min())
            closest = max(closest, gap)
            if gap >= self._around.clearance:
                (arm, roll, turn, branch), (arm2, roll2, turn2, branch2) = left, right
                best[key] = score, SpatialWay((arm, arm2), (roll, roll2), (turn, turn2), (branch, branch2))
        if best:
            return [way for _, way in sorted(best.values(), key=lambda each: -each[0])]
        if not math.isfinite(closest):
            return "one arm would have to hold both ends of the cable"
        near = f"come {limit_text(-closest)} into" if closest < 0 else f"come within {quantity(closest)} of"
        return f"the arms {near} each other at start or goal"

    def along(
        self, poses: Float[np.ndarray, "t 2 7"], stations: Float[np.ndarray, "t s 3"], way: SpatialWay
    ) -> Float[np.ndarray, "t 2 6"] | str:
        """Joints [rad] along a motion, without jumps; or why there are none.

        Args:
            poses: Of the grippers, a control step from row to row.
            stations: Of the cable [m].
            way: How the arms hold it.
        """
        found = np.empty((len(poses), 2, 1, 6))
        rows = _rows_kept(np.ascontiguousarray(poses), np.ascontiguousarray(stations), self.held(way), found)
        if rows < len(poses):
            return (
                f"the arms cannot follow beyond {CONTROL_STEP * rows:.1f} s of {CONTROL_STEP * (len(poses) - 1):.1f} s"
            )
        joints = self.unwound(found[:, :, 0], way)
        if not isinstance(joints, str) and (share := float(self.effort(joints, way).max(initial=0.0))) > 1.0:
            return f"the arms need {share:.1f} control steps from row to row"
        return joints

    def unwound(self, joints: Float[np.ndarray, "t 2 6"], way: SpatialWay) -> Float[np.ndarray, "t 2 6"] | str:
        """Joints [rad] from those in [-pi, pi), without jumps and within their limits of position; or why not."""
        joints = np.unwrap(joints, axis=0)
        joints -= 2 * np.pi * np.round((joints.max(axis=0) + joints.min(axis=0)) / (4 * np.pi))
        for side, model in enumerate(self.cell.models[arm] for arm in way.holders):
            if (np.abs(joints[:, side]).max(axis=0) > np.array(model.position_limit) - TURN).any():
                return f"a joint of the arm at the {SIDES[side][0]} leaves its limits of position"
        return joints

    def effort(self, joints: Float[np.ndarray, "t 2 6"], way: SpatialWay) -> Float[np.ndarray, "t-1"]:
        """Control steps that joints [rad] need from row to row, for their speed, and to lead the tools along."""
        limits = np.array([self.cell.models[arm].speed_limit for arm in way.holders])
        joints = np.unwrap(joints, axis=0)
        effort = (np.abs(np.diff(joints, axis=0)) / (SPEED_SHARE * CONTROL_STEP * limits)).max(axis=(1, 2))
        for side, arm in enumerate(self.held(way)[:2]):
            bends = np.empty((len(effort), 2))
            _bends(arm, np.ascontiguousarray(joints[:, side]), bends)
            effort = np.maximum(effort, np.sqrt(bends / BENDS).max(axis=1))  # half as fast, a quarter as far off
        return effort

    def joints(self, poses: Float[np.ndarray, "t 2 7"], way: SpatialWay) -> Float[np.ndarray, "t 2 6"]:
        """Joints in [-pi, pi) at gripper poses; those before where an arm does not reach."""
        out, arms = np.zeros((len(poses), 2, 6)), self.held(way)
        for t, both in enumerate(np.ascontiguousarray(poses)):
            for side in range(len(SIDES)):
                if _arm_joints(both[side], arms[side], out[t, side]) < 0:
                    out[t, side] = out[max(0, t - 1), side]
        return out

    def links(
        self, joints: Float[np.ndarray, "2 6"], holders: tuple[int, int]
    ) -> list[tuple[Float[np.ndarray, "k 2 3"], Float[np.ndarray, "k"]]]:
        """Ends [m] and radii [m] of the capsules of the arms at the left and the right gripper, hands included."""
        found = []
        for arm, row in zip(holders, joints, strict=True):
            capsules, ends = self._capsules[arm], np.empty((1, len(self._capsules[arm].frame), 2, 3))
            arm_clearances(
                np.array(self.cell.models[arm].lengths), self._bases[arm], row[None].copy(), capsules,
                self._around.table, ends,
            )  # fmt: skip
            found.append((ends[0], capsules.radius))
        return found

    def _arm(self, arm: int, roll: float, turn: int, branch: int) -> SpatialArm:
        model, base = self.cell.models[arm], self._bases[arm]
        limit = np.array(model.position_limit)
        limit[limit >= np.pi] = np.inf
        hand = np.array([0.0, -math.sin(roll), math.cos(roll)])
        return SpatialArm(
            np.array(model.lengths), base, np.linalg.inv(base), hand, 2.0 * turn - 1.0, TOOLS[self.cell.tool].reach,
            branch, limit, self._capsules[arm],
        )  # fmt: skip

    def _at_ends(
        self, poses: Float[np.ndarray, "2 7"], stations: Float[np.ndarray, "2 s 3"], side: int
    ) -> Iterator[tuple[SpatialArm, tuple[int, float, int, int], float, Float[np.ndarray, "2 k 2 3"]]]:
        """Arms that can hold a gripper at start and goal: how, how good that is [m], and the ends of their capsules."""
        for arm, roll, branch in product(range(ARMS), self._rolls, range(BRANCHES)):
            tried = []
            for turn in (0, 1):  # turns the last joint by half a turn, and nothing else
                held, joints = self._arm(arm, roll, turn, branch), np.empty((2, 6))
                if min(_arm_joints(pose, held, row) for pose, row in zip(poses, joints, strict=True)) < SINGULAR:
                    break
                if (held.position_limit - np.abs(joints)).min() >= TURN:
                    tried.append((float(np.abs(np.diff(joints, axis=0)).max()), turn, held, joints))
            if not tried:
                continue
            travel, turn, held, joints = min(tried, key=lambda each: each[0])
            ends, room = np.empty((2, len(held.capsules.frame), 2, 3)), math.inf
            for row in range(2):
                placed = ends[row : row + 1]
                found = _own_room(held, joints[[row]], stations[row], bool(side), self._around, ENOUGH, placed)
                room = min(room, found)
            if room >= self._around.clearance:
                yield held, (arm, roll, turn, branch), room - TRAVEL * travel, ends
