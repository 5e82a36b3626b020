"""Two arms of any kind along a plan, by differential inverse kinematics (mink) on their model in MuJoCo.

A hand holds the cable at one place, with its fingers straight down and the cable's tangent across them, and an arm with
more than six joints chooses among the motions that do so. The arms begin in one of several postures found from `SEEDS`
guesses, and from row to row solve a quadratic program: least error of both hands, near the posture, within the joints'
limits of position and speed, links and hands away from what they may not touch (Zakka, mink; solved by DAQP).

Note:
    Plans are made for the grippers and their bodies alone, so such arms may not be able to follow one that others can.
"""

# MuJoCo's bindings are compiled and carry no type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float

from cableway.core.brief import Brief
from cableway.core.errors import PlanningError
from cableway.core.extras import require
from cableway.core.quantities import limit_text
from cableway.core.time_limit import checkpoint
from cableway.records import Plan
from cableway.robot.kinematics import flange_poses
from cableway.scene.cell import ARMS
from cableway.scene.chains import Chain
from cableway.scene.described_arms import DescribedArms
from cableway.scene.task import CONTROL_STEP, Task
from cableway.simulation.described_robot import DescribedRobot, prefix

TIP, TIP_ANGLE = 2e-4, 2e-3
"""Distance [m] and angle [rad] of a hand from where the plan has it that are left."""

SEEDS = 40
"""Guesses of a posture besides the file's own."""

POSTURES = 6
"""Of the postures found for a hand, those that are tried."""

TRIES = 60
"""Pairs of postures that are followed, at most."""

SETTLING, STEPS = 60, 12
"""Iterations from a guess to a posture, and from row to row, at most."""

POSTURE_COST, ORIENTATION_COST, DAMPING = 1e-3, 0.3, 1e-6
"""Weights against an error of 1 m of a hand: of a joint's way from its posture [1/rad], and of a hand's angle."""

ROOM = 0.1
"""Clearance [m] that is as good as 1 rad of a joint to the end of its range, for who chooses a posture."""

ALIKE = 0.1
"""Difference [rad] of a joint from which on two postures are two."""

SPARE = 1e-3
"""What links keep beyond their clearance [m], as a linear program lets them come nearer between its steps."""

FAR = 0.05
"""Distance [m] from which on pairs are not measured: more than any clearance that a file may ask for."""


@dataclass(frozen=True, repr=False, kw_only=True)
class Followed(Brief):
    """Two arms along a plan.

    Attributes:
        joints: (T+1, 2, j) of the arms that hold the left and the right end [rad].
        names: Of the j joints of each of these.
        holders: Which of the two arms those are.
        turns: How their hands are turned, see `kinematics.flange_poses`.
        chains: These arms as they stand, for the judge.
    """

    joints: Float[np.ndarray, "t 2 j"]
    names: tuple[tuple[str, ...], tuple[str, ...]]
    holders: tuple[int, int]
    turns: tuple[int, int]
    chains: tuple[Chain, Chain]


class _Hold(NamedTuple):
    """A way of holding the cable at the start: which arms, how turned, and the joints of both."""

    holders: tuple[int, int]
    turns: tuple[int, int]
    joints: Float[np.ndarray, "n"]
    clearance: float


class _Stuck(NamedTuple):
    """How far a motion came, and why no farther."""

    row: int
    reason: str


def follow(plan: Plan, task: Task, arms: DescribedArms, accept: Callable[[Followed], str] = lambda _: "") -> Followed:
    """The joints of two arms along the gripper poses of a plan, a control step from row to row.

    Args:
        plan: The plan.
        task: The task that it is of.
        arms: The arms.
        accept: Says what is wrong with a motion, "" if nothing; where something is, others are tried.

    Raises:
        FileFormatError: A file of an arm cannot be read, or is of no arm with hinges.
        MissingExtraError: mink is not installed.
        PlanningError: No motion was found; the message says how far the arms came, and what stopped them.
    """
    require("arms", "arms of other kinds")
    motions = _Motions(DescribedRobot(arms, task))
    furthest = _Stuck(-1, "no arm reaches the start")
    for tried, hold in enumerate(motions.holds(plan.poses[0])):
        if tried >= TRIES:
            break
        found = motions.along(plan.poses, hold)
        if not isinstance(found, _Stuck):
            followed = motions.followed(found, hold)
            if not (fault := accept(followed)):
                return followed
            found = _Stuck(plan.steps, fault)
        furthest = max(furthest, found, key=lambda each: each.row)
    where = (
        "" if furthest.row < 0 else f" beyond {CONTROL_STEP * furthest.row:.1f} s of {CONTROL_STEP * plan.steps:.1f} s"
    )
    raise PlanningError(f"no motion of the arms {arms.name!r} was found{where}: {furthest.reason}")


class _Motions:
    """Postures and motions of both arms of a robot."""

    def __init__(self, robot: DescribedRobot) -> None:
        import mink

        self.robot, model = robot, robot.model
        speeds = {
            model.joint(joint).name: arm.speed_limit
            for joints, arm in zip(robot.chained, robot.arms.arms, strict=True) for joint in joints
        }  # fmt: skip
        self._apart = mink.CollisionAvoidanceLimit(
            model, robot.pairs, minimum_distance_from_collisions=robot.arms.clearance + SPARE,
            collision_detection_distance=FAR,
        )  # fmt: skip
        self._ranged = mink.ConfigurationLimit(model)
        self._limits = [self._ranged, mink.VelocityLimit(model, speeds), self._apart]

    def holds(self, poses: Float[np.ndarray, "2 3"]) -> Iterator[_Hold]:
        """Ways to hold the grippers at poses [m, m, rad]: first that with most room of each choice of arms and
        turns, then the second of each."""
        rng = np.random.default_rng(0)
        guesses = [self.robot.home, *(self._drawn(rng) for _ in range(SEEDS))]
        found = {key: self._postures(*key, poses, guesses) for key in product(range(ARMS), range(2), (0, 1))}
        ranked: list[tuple[int, _Hold]] = []
        for holders, turns in product(((0, 1), (1, 0)), product((0, 1), (0, 1))):
            each = [found[arm, side, turn] for side, (arm, turn) in enumerate(zip(holders, turns, strict=True))]
            ways: list[_Hold] = []
            for left, right in product(*each):
                joints = self.robot.home.copy()
                for arm, posture in zip(holders, (left, right), strict=True):
                    joints[self.robot.places[arm]] = posture
                clearance = self._clearance(joints)
                if clearance > 0:
                    ways.append(_Hold(holders, turns, joints, clearance))
            ranked += enumerate(sorted(ways, key=lambda way: -way.clearance))
        yield from (way for _, way in sorted(ranked, key=lambda pair: (pair[0], -pair[1].clearance)))

    def along(self, poses: Float[np.ndarray, "t 2 3"], hold: _Hold) -> Float[np.ndarray, "t n"] | _Stuck:
        """Positions of all joints [rad] from one way to hold the first poses on; or where it ends."""
        import mink

        configuration = mink.Configuration(self.robot.model, hold.joints)
        posture = mink.PostureTask(self.robot.model, cost=POSTURE_COST)
        posture.set_target(hold.joints)
        tasks, rows = [self._task(arm) for arm in hold.holders], np.empty((len(poses), self.robot.model.nq))
        rows[0] = hold.joints
        targets = [self._targets(poses[:, side], hold.turns[side]) for side in range(2)]
        for row in range(1, len(poses)):
            checkpoint()
            for side, task in enumerate(tasks):
                task.set_target(mink.SE3.from_matrix(targets[side][row]))
            if not self._settle(configuration, [*tasks, posture], tasks, self._limits, CONTROL_STEP / STEPS, STEPS):
                return _Stuck(row, self._why(poses[row], rows[row - 1], configuration.q))
            rows[row] = configuration.q
        return rows

    def followed(self, rows: Float[np.ndarray, "t n"], hold: _Hold) -> Followed:
        """What is to be told of positions of all joints [rad]."""
        joints = np.stack([rows[:, self.robot.places[arm]] for arm in hold.holders], axis=1)
        left, right = (self.robot.chain(arm) for arm in hold.holders)
        names = tuple(joint.name for joint in left.joints), tuple(joint.name for joint in right.joints)
        return Followed(joints=joints, names=names, holders=hold.holders, turns=hold.turns, chains=(left, right))

    def _drawn(self, rng: np.random.Generator) -> Float[np.ndarray, "n"]:
        """A guess of a posture of both arms."""
        guess = self.robot.home.copy()
        for index, places in enumerate(self.robot.places):
            guess[places] = rng.uniform(*self.robot.ranges(index))
        return guess

    def _targets(self, poses: Float[np.ndarray, "t 3"], turn: int) -> Float[np.ndarray, "t 4 4"]:
        """Poses of a hand that holds the cable at gripper poses [m, m, rad]."""
        return flange_poses(poses, 0.0, self.robot.task.cable.radius, turn)

    def _task(self, arm: int) -> Any:
        import mink

        _, name, kind = self.robot.frames[arm]
        return mink.FrameTask(name, kind, position_cost=1.0, orientation_cost=ORIENTATION_COST)

    def _postures(
        self, arm: int, side: int, turn: int, poses: Float[np.ndarray, "2 3"], guesses: Sequence[Float[np.ndarray, "n"]]
    ) -> list[Float[np.ndarray, "j"]]:
        """Joints of an arm that hold one of the grippers, those with most room first, `POSTURES` at most."""
        import mink

        task, places, found = self._task(arm), self.robot.places[arm], []
        task.set_target(mink.SE3.from_matrix(self._targets(poses[[side]], turn)[0]))
        for guess in guesses:
            checkpoint()
            configuration = mink.Configuration(self.robot.model, guess.copy())
            if not self._settle(configuration, [task], [task], [self._ranged], 1.0, SETTLING):
                continue
            joints = configuration.q[places]
            if any(np.abs(joints - other).max() < ALIKE for _, other in found):
                continue
            alone = self.robot.home.copy()
            alone[places] = joints
            clearance = self._clearance(alone, arm)
            low, high = self.robot.ranges(arm)
            if clearance > 0:
                found.append((min(clearance, ROOM * np.minimum(joints - low, high - joints).min()), joints))
        return [joints for _, joints in sorted(found, key=lambda each: -each[0])[:POSTURES]]

    def _settle(
        self, configuration: Any, tasks: Sequence[Any], wanted: Sequence[Any], limits: Sequence[Any], step: float,
        most: int,
    ) -> bool:  # fmt: skip
        """Move joints, at most so many steps [s], until the hands are where they are `wanted`; whether they are."""
        import mink

        for _ in range(most):
            if self._met(wanted, configuration):
                return True
            try:
                velocity = mink.solve_ik(configuration, tasks, step, solver="daqp", damping=DAMPING, limits=limits)
            except mink.NoSolutionFound:
                return False
            velocity[self.robot.idle] = 0.0
            configuration.integrate_inplace(velocity, step)
        return self._met(wanted, configuration)

    def _met(self, tasks: Sequence[Any], configuration: Any) -> bool:
        errors = [task.compute_error(configuration) for task in tasks]
        return all(np.linalg.norm(e[:3]) < TIP and np.linalg.norm(e[3:]) < TIP_ANGLE for e in errors)

    def _clearance(self, joints: Float[np.ndarray, "n"], arm: int | None = None) -> float:
        """Least distance beyond what is kept [m], up to `FAR`, of all pairs, or of those without the other arm."""
        self.robot.data.qpos[:] = joints
        mujoco.mj_kinematics(self.robot.model, self.robot.data)
        other = set() if arm is None else set(self.robot.geoms[1 - arm])
        return min((gap for gap, a, b in self._gaps() if not {a, b} & other), default=FAR)

    def _gaps(self) -> Iterator[tuple[float, int, int]]:
        """Distance beyond what is kept [m] of each pair, where the joints are, and the pair."""
        model, data, kept = self.robot.model, self.robot.data, self._apart.minimum_distance_from_collisions
        for a, b in self._apart.geom_id_pairs:
            yield mujoco.mj_geomDistance(model, data, int(a), int(b), FAR, None) - kept, int(a), int(b)

    def _why(
        self, poses: Float[np.ndarray, "2 3"], before: Float[np.ndarray, "n"], joints: Float[np.ndarray, "n"]
    ) -> str:
        """What keeps the arms from reaching gripper poses [m, m, rad] from where they were."""
        where = " and ".join(f"({x:.3f}, {y:.3f}) m" for x, y, _ in poses)
        for index, (places, arm) in enumerate(zip(self.robot.places, self.robot.arms.arms, strict=True)):
            names = [self.robot.model.joint(k).name.removeprefix(prefix(index)) for k in self.robot.chained[index]]
            ranged = self.robot.model.jnt_limited[self.robot.chained[index]].astype(bool)
            room = np.min(np.abs(self.robot.model.jnt_range[self.robot.chained[index]].T - joints[places]), axis=0)
            moved = np.abs(joints - before)[places] / CONTROL_STEP
            if (at := np.flatnonzero(ranged & (room < SPARE))).size:
                return f"arm {index} is at the end of its {names[at[0]]}, with the grippers at {where}"
            if moved.max() > 0.99 * arm.speed_limit:
                limit = limit_text(arm.speed_limit, "rad/s")
                name = names[int(moved.argmax())]
                return f"arm {index} cannot turn its {name} faster than {limit}, at {where}: plan with a lower --speed"
        self.robot.data.qpos[:] = joints
        mujoco.mj_kinematics(self.robot.model, self.robot.data)
        gap, a, b = min(self._gaps())
        if gap < SPARE:
            one, other = self.robot.called(a), self.robot.called(b)
            return f"{one} and {other} come too close to each other, with the grippers at {where}"
        return f"the arms do not reach the grippers at {where}"
