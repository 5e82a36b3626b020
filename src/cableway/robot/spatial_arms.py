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

from cableway.core.quantities import limit_text, quantity
from cableway.geometry.spatial_convex import SpatialWorld
from cableway.robot.branches import CLEARANCE, ENOUGH, SINGULAR, SPEED_SHARE, TURN
from cableway.robot.free_spatial_arms import (
    FreeSpatialArms,
    SpatialArm,
    Surroundings,
    all_links,
    arm_joints,
    bends,
    own_room,
    rows_kept,
)
from cableway.robot.kinematics import BRANCHES
from cableway.robot.links import Capsules, arm_clearances, arms_gaps, world_of_arms
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

TRAVEL = 0.01
"""Clearance [m] that is as good as 1 rad less to turn a joint from start to goal, for who chooses a way."""

BENDS = np.array([0.8e-3, 8e-3])
"""How far a tool may be off between two rows of joints [m, rad]."""


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
            gap = float(arms_gaps(ends, all_links(one.capsules), others, all_links(other.capsules)).min())
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
        rows = rows_kept(np.ascontiguousarray(poses), np.ascontiguousarray(stations), self.held(way), found)
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
            off = np.empty((len(effort), 2))
            bends(arm, np.ascontiguousarray(joints[:, side]), off)
            effort = np.maximum(effort, np.sqrt(off / BENDS).max(axis=1))  # half as fast, a quarter as far off
        return effort

    def joints(self, poses: Float[np.ndarray, "t 2 7"], way: SpatialWay) -> Float[np.ndarray, "t 2 6"]:
        """Joints in [-pi, pi) at gripper poses; those before where an arm does not reach."""
        out, arms = np.zeros((len(poses), 2, 6)), self.held(way)
        for t, both in enumerate(np.ascontiguousarray(poses)):
            for side in range(len(SIDES)):
                if arm_joints(both[side], arms[side], out[t, side]) < 0:
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
                if min(arm_joints(pose, held, row) for pose, row in zip(poses, joints, strict=True)) < SINGULAR:
                    break
                if (held.position_limit - np.abs(joints)).min() >= TURN:
                    tried.append((float(np.abs(np.diff(joints, axis=0)).max()), turn, held, joints))
            if not tried:
                continue
            travel, turn, held, joints = min(tried, key=lambda each: each[0])
            ends, room = np.empty((2, len(held.capsules.frame), 2, 3)), math.inf
            for row in range(2):
                placed = ends[row : row + 1]
                found = own_room(held, joints[[row]], stations[row], bool(side), self._around, ENOUGH, placed)
                room = min(room, found)
            if room >= self._around.clearance:
                yield held, (arm, roll, turn, branch), room - TRAVEL * travel, ends
