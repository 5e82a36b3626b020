"""Which arm holds which end of the cable, and how: the joints of a cell's two arms along a motion of the grippers.

A tool of a given tilt leaves an arm eight branches, and a gripper that looks the same from either side two
turns. Branches meet in singularities only, which a motion keeps away from, so (arm, branch, turn) is chosen once for a
whole motion and each gripper: of all pairs, the one that keeps most room.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from cableway.core.brief import Brief
from cableway.core.errors import Point
from cableway.core.quantities import limit_text, quantity
from cableway.robot.kinematics import BRANCHES, branch_motion, flange_poses
from cableway.robot.links import Capsules, arm_clearances, arms_gaps, world_of_arms
from cableway.scene.cell import ARMS, TOOLS, Cell, Tool, Way
from cableway.scene.gripper_bodies import outward
from cableway.scene.grippers import SIDES
from cableway.scene.task import CONTROL_STEP, ENDS, Draft, Task

CLEARANCE = 0.010
"""Least clearance [m] of links in a motion."""

ENOUGH = 0.05
"""Clearance [m] beyond which more does not make a motion better."""

SINGULAR = 0.06
"""Least sine of the angles of elbow, wrist and shoulder: 3.4 degrees from a singularity."""

TURN = 5e-4
"""Way to the joints' limits of position that is left to corrections [rad]."""

SPEED_SHARE = 0.9
"""Share of the joints' speed limits that a motion uses."""


@dataclass(frozen=True)
class Track:
    """One arm along a motion of one gripper.

    Attributes:
        arm: Which of the cell's.
        turn: Of its tool, see `flange_poses`.
        branch: Of its inverse kinematics.
        joints: (t, 6) [rad], without jumps.
        clearance: (t,) of its links [m], see `arm_clearances`.
        placed: (t, k, 2, 3) ends of its capsules [m].
        effort: Greatest speed of a joint over its limit.
    """

    arm: int
    turn: int
    branch: int
    joints: Float[np.ndarray, "t 6"]
    clearance: Float[np.ndarray, "t"]
    placed: Float[np.ndarray, "t k 2 3"]
    effort: float


@dataclass(frozen=True, repr=False)
class ArmMotion(Brief):
    """Both arms along a motion of the grippers.

    Attributes:
        joints: (t, 2, 6) [rad] of the arms that hold the left and the right end of the cable.
        way: How they hold it.
        clearance: Least clearance of a link [m].
    """

    joints: Float[np.ndarray, "t 2 6"]
    way: Way
    clearance: float


@dataclass(frozen=True)
class NoMotion:
    """Why the arms cannot do it.

    Attributes:
        reason: One sentence.
        at: Where on the table [m].
    """

    reason: str
    at: Point


def arm_motion(
    poses: Float[np.ndarray, "t 2 3"], task: Task, cell: Cell, *, made: bool = False
) -> ArmMotion | NoMotion:
    """The joints along gripper poses [m, m, rad], a control step from row to row.

    Args:
        poses: Of the grippers.
        task: The task.
        cell: Its cell.
        made: Whether the grippers made this motion; if it kept clearance and limits is then left to the judge.
    """
    found = _motions(poses, PackedCell(task, cell, made))
    return found if isinstance(found, NoMotion) else found[0]


def arm_motions(poses: Float[np.ndarray, "t 2 3"], task: Task, cell: Cell) -> list[ArmMotion]:
    """The joints along gripper poses in all ways in which the arms can hold the cable, see `arm_motion`, that with most
    room first.
    """
    found = _motions(poses, PackedCell(task, cell))
    return [] if isinstance(found, NoMotion) else found


def _motions(poses: Float[np.ndarray, "t 2 3"], packed: PackedCell) -> list[ArmMotion] | NoMotion:
    found = _pairs(poses, packed)
    if isinstance(found, NoMotion):
        return found
    best = sorted(found, key=lambda pair: (-min(pair.clearance, ENOUGH), pair.effort))
    return [ArmMotion(np.stack([a.joints, b.joints], axis=1), _way(a, b), clearance) for a, b, clearance in best]


def end_fault(task: Task, cell: Cell) -> NoMotion | None:
    """Why the arms cannot hold the cable at start or goal, or at both in the same way; None if they can.

    No motion gets from one way of holding it to another.
    """
    found = common_ways(task, cell)
    return found if isinstance(found, NoMotion) else None


def common_ways(task: Task, cell: Cell) -> tuple[Way, ...] | NoMotion:
    """In which ways the arms can hold the cable at start and goal, that with most room first; or why there is none."""
    packed, ways = PackedCell(task, cell), []
    poses = task.cable.rod.shapes(np.array([task.start_equilibrium, task.goal_equilibrium]))[1]
    for end, held in zip(ENDS, poses, strict=True):
        found = possible_ways(held, packed)
        if isinstance(found, NoMotion):
            return replace(found, reason=f"at the {end}, {found.reason}")
        ways.append(found)
    start, goal = ways
    both = sorted((way for way in start if way in goal), key=lambda way: -min(start[way], goal[way], ENOUGH))
    if both:
        return tuple(both)
    return NoMotion(_apart(poses, start, goal), _point(poses[1, :, :2].mean(axis=0)))


def _apart(poses: Float[np.ndarray, "2 2 3"], start: Collection[Way], goal: Collection[Way]) -> str:
    """Why arms cannot hold the cable at both ends of a task alike, which they can at each."""
    places = [" and ".join(_place(_point(pose)) for pose in held) for held in poses]
    lefts = [{way.holders[0] for way in ways} for ways in (start, goal)]
    how = "in the same branches of their joints"
    if not lefts[0] & lefts[1]:
        how = f"since the left end is then arm {min(lefts[0])}'s, and at the goal arm {min(lefts[1])}'s"
    return f"the arms cannot hold the cable at the goal, {places[1]}, as they can at the start, {places[0]}, {how}"


def possible_ways(poses: Float[np.ndarray, "2 3"], packed: PackedCell) -> dict[Way, float] | NoMotion:
    """In which ways the arms can hold the grippers at poses [m, m, rad], with what clearance [m]; or why in none."""
    found = _pairs(poses[None], packed)
    return found if isinstance(found, NoMotion) else {_way(pair.left, pair.right): pair.clearance for pair in found}


class _Pair(NamedTuple):
    """Two arms that can follow both grippers without meeting."""

    left: Track
    right: Track
    clearance: float

    @property
    def effort(self) -> float:
        return max(self.left.effort, self.right.effort)


def _way(left: Track, right: Track) -> Way:
    """How arms hold the cable that take these tracks."""
    return Way(*zip(*((track.arm, track.turn, track.branch) for track in (left, right)), strict=True))


def _pairs(poses: Float[np.ndarray, "t 2 3"], packed: PackedCell) -> list[_Pair] | NoMotion:
    """All pairs, at least one, or only that of the way in which the cell holds the cable; or why there is none."""
    tracks, way = [], packed.cell.way
    for side in range(len(SIDES)):
        found, fault = _tracks(poses[:, side], packed, side, None if way is None else way.of(side))
        if not found:
            return fault
        tracks.append(found)
    pairs: list[_Pair] = []
    closest = (-np.inf, 0)
    for left, right in product(*tracks):
        if left.arm == right.arm:
            continue
        gaps = packed.gaps((left.arm, right.arm), left.placed, right.placed)
        closest = max(closest, (float(gaps.min()), int(gaps.argmin())))
        if gaps.min() >= packed.clearance:
            clearance = min(gaps.min(), left.clearance.min(), right.clearance.min())
            pairs.append(_Pair(left, right, float(clearance)))
    if pairs:
        return pairs
    gap, row = closest
    at = _point(poses[row, :, :2].mean(axis=0))
    if not np.isfinite(gap):
        both = " and ".join(_place(_point(pose)) for pose in poses[row])
        return NoMotion(f"one arm would have to hold both ends, {both}", at)
    near = f"come {limit_text(-gap)} into each other" if gap < 0 else f"come within {quantity(gap)} of each other"
    return NoMotion(f"the arms {near} {_place(at)}", at)


class PackedCell:
    """A cell's arms for the kernels, with its tool as it is closed where none is given."""

    def __init__(self, task: Draft, cell: Cell, made: bool = False, tool: Tool | None = None) -> None:
        self.clearance, self.singular, self.effort = (
            (-np.inf, 0.0, np.inf) if made else (CLEARANCE, SINGULAR, SPEED_SHARE)
        )
        self.cell, self.height = cell, task.cable.radius
        self.lengths = [np.array(model.lengths) for model in cell.models]
        self.bases = [arm.base(task.scene) for arm in cell.arms]
        self.reach, self.leans = cell.reach, tuple(outward(side, cell.tilt) for _, side in SIDES)
        self.capsules = [Capsules.of(model, tool or TOOLS[cell.tool]) for model in cell.models]
        self.world = world_of_arms(task.scene)

    def flanges(
        self, arm: int, poses: Float[np.ndarray, "t 3"], side: int, turn: int,
        raised: Float[np.ndarray, "t"] | float = 0.0,
    ) -> Float[np.ndarray, "t 4 4"]:  # fmt: skip
        """Poses of an arm's flange in its base's frame, where the gripper of a side is `raised` [m] at [m, m, rad]."""
        flanges = flange_poses(poses, self.reach, self.height + raised, turn, self.leans[side])
        return np.linalg.inv(self.bases[arm]) @ flanges

    def placed(
        self, arm: int, joints: Float[np.ndarray, "t 6"]
    ) -> tuple[Float[np.ndarray, "t k 2 3"], Float[np.ndarray, "t"]]:
        """Ends of an arm's capsules, and the clearance of its links [m], see `arm_clearances`, at joints [rad]."""
        capsules, joints = self.capsules[arm], np.ascontiguousarray(joints)
        ends = np.empty((len(joints), len(capsules.frame), 2, 3))
        return ends, arm_clearances(self.lengths[arm], self.bases[arm], joints, capsules, self.world, ends)

    def gaps(
        self, arms: tuple[int, int], left: Float[np.ndarray, "t k 2 3"], right: Float[np.ndarray, "t k 2 3"]
    ) -> Float[np.ndarray, "t"]:
        """Distance [m] of two arms from the ends of their capsules, see `arms_gaps`."""
        return arms_gaps(left, self.capsules[arms[0]], right, self.capsules[arms[1]])


def _tracks(
    poses: Float[np.ndarray, "t 3"], packed: PackedCell, side: int, only: tuple[int, int, int] | None
) -> tuple[list[Track], NoMotion]:
    """All tracks of a gripper, or only that of one arm, turn and branch; and why there are no more."""
    found: list[Track] = []
    name, reached, blocked = SIDES[side][0], 0, (-np.inf, 0)
    for arm, turn in product(range(ARMS), (0, 1)):
        flanges = packed.flanges(arm, poses, side, turn)
        for branch in range(BRANCHES):
            if only not in (None, (arm, turn, branch)):
                continue
            joints = np.empty((len(poses), 6))
            count = branch_motion(packed.lengths[arm], flanges, branch, packed.singular, joints)
            reached = max(reached, count)
            if count < len(poses):
                continue
            track = _track(joints, arm, turn, branch, packed)
            if track is None:
                continue
            least = int(track.clearance.argmin())
            blocked = max(blocked, (float(track.clearance[least]), least))
            if track.clearance[least] >= packed.clearance:
                found.append(track)
    if reached < len(poses):
        at = _point(poses[reached])
        return found, NoMotion(f"no arm reaches the {name} {_place(at)}", at)
    if not np.isfinite(blocked[0]):
        at = _point(poses[0])
        return found, NoMotion(f"no joints within their limits follow the {name} {_place(at)}", at)
    at = _point(poses[blocked[1]])
    gap = blocked[0]
    near = f"{limit_text(-gap)} into" if gap < 0 else f"within {quantity(gap)} of"
    links = f"links come {near} table, obstacle or arm"
    return found, NoMotion(f"no arm follows the {name}: {links} {_place(at)}", at)


def _track(joints: Float[np.ndarray, "t 6"], arm: int, turn: int, branch: int, packed: PackedCell) -> Track | None:
    """An arm that takes these joints; None where a joint would leave its limits of position or speed."""
    model = packed.cell.models[arm]
    joints = np.unwrap(joints, axis=0)
    joints -= 2 * np.pi * np.round((joints.max(axis=0) + joints.min(axis=0)) / (4 * np.pi))
    effort = float((np.abs(np.diff(joints, axis=0)).max(axis=0, initial=0.0) / CONTROL_STEP / model.speed_limit).max())
    beyond = effort > packed.effort or (np.abs(joints).max(axis=0) > np.array(model.position_limit) - TURN).any()
    if beyond and np.isfinite(packed.effort):
        return None
    placed, clearance = packed.placed(arm, joints)
    return Track(arm, turn, branch, joints, clearance, placed, effort)


def _point(at: Float[np.ndarray, "_"]) -> Point:
    return float(at[0]), float(at[1])


def _place(at: Point) -> str:
    return f"at ({at[0]:.3f}, {at[1]:.3f}) m"
