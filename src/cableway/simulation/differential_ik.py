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

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any, NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float

from cableway.core.brief import Brief
from cableway.core.errors import FileFormatError, InputError, PlanningError
from cableway.core.extras import require
from cableway.core.quantities import limit_text
from cableway.core.reading import one_line
from cableway.core.time_limit import checkpoint
from cableway.records import Plan
from cableway.robot.kinematics import flange_poses
from cableway.scene.cell import ARMS
from cableway.scene.chains import Chain, ChainJoint, ChainSolid, Kind
from cableway.scene.described_arms import DescribedArm, DescribedArms
from cableway.scene.task import CONTROL_STEP, Task
from cableway.simulation.surroundings import add_obstacle

TIP, TIP_ANGLE = 2e-4, 2e-3
"""Distance [m] and angle [rad] of a hand from where the plan has it that are left."""

HAND = 0.002
"""Clearance [m] of a hand from the other arm, and, where grippers of the plan have no body, which stands for it, from
obstacles and the other hand."""

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

NEIGHBOURS = 2
"""Joints between two links of an arm that are not kept apart: shapes of neighbours overlap at their joint."""

FAR = 0.05
"""Distance [m] from which on pairs are not measured."""

UNLIMITED = 2.0
"""Height [m] of what nothing passes above."""

KINDS: dict[int, Kind] = {
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
    mujoco.mjtGeom.mjGEOM_MESH: "hull",
}


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
    robot = _Robot(arms, task)
    furthest = _Stuck(-1, "no arm reaches the start")
    for tried, hold in enumerate(robot.holds(plan.poses[0])):
        if tried >= TRIES:
            break
        found = robot.along(plan.poses, hold)
        if not isinstance(found, _Stuck):
            followed = robot.followed(found, hold)
            if not (fault := accept(followed)):
                return followed
            found = _Stuck(plan.steps, fault)
        furthest = max(furthest, found, key=lambda each: each.row)
    where = (
        "" if furthest.row < 0 else f" beyond {CONTROL_STEP * furthest.row:.1f} s of {CONTROL_STEP * plan.steps:.1f} s"
    )
    raise PlanningError(f"no motion of the arms {arms.name!r} was found{where}: {furthest.reason}")


class _Robot:
    """Both arms at the table."""

    def __init__(self, arms: DescribedArms, task: Task) -> None:
        self.arms, self.task = arms, task
        spec = mujoco.MjSpec()
        spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_BOX, pos=[0, 0, -0.05], size=[5, 5, 0.05])
        for index, obstacle in enumerate(task.scene.obstacles):
            stated = arms.obstacle_height if obstacle.height is None else obstacle.height
            top = UNLIMITED if stated is None else stated
            add_obstacle(spec, obstacle, (0.0, top), mujoco.mjtGeom.mjGEOM_CYLINDER, name=f"obstacles[{index}]")
        for index, arm in enumerate(arms.arms):
            _attach(spec, arm, index, arm.base(task.scene))
        try:
            self.model = spec.compile()
        except ValueError as error:
            raise FileFormatError(f"{arms.name}: the arms make no model: {one_line(error)}") from None
        self.data = mujoco.MjData(self.model)
        self._frames = [self._frame(index, arm) for index, arm in enumerate(arms.arms)]
        self.chained = [self._joints(index, arm) for index, arm in enumerate(arms.arms)]
        self.places = [self.model.jnt_qposadr[joints] for joints in self.chained]
        self._dofs = [self.model.jnt_dofadr[joints] for joints in self.chained]
        if len(self.places[0]) != len(self.places[1]):
            counts = " and ".join(str(len(each)) for each in self.places)
            raise InputError(f"{arms.name}: both arms must have as many joints, got {counts}")
        self._home = self._standing()
        self._pairs()

    def holds(self, poses: Float[np.ndarray, "2 3"]) -> Iterator[_Hold]:
        """Ways to hold the grippers at poses [m, m, rad]: first that with most room of each choice of arms and
        turns, then the second of each."""
        rng = np.random.default_rng(0)
        guesses = [self._home, *(self._drawn(rng) for _ in range(SEEDS))]
        found = {key: self._postures(*key, poses, guesses) for key in product(range(ARMS), range(2), (0, 1))}
        ranked: list[tuple[int, _Hold]] = []
        for holders, turns in product(((0, 1), (1, 0)), product((0, 1), (0, 1))):
            each = [found[arm, side, turn] for side, (arm, turn) in enumerate(zip(holders, turns, strict=True))]
            ways: list[_Hold] = []
            for left, right in product(*each):
                joints = self._home.copy()
                for arm, posture in zip(holders, (left, right), strict=True):
                    joints[self.places[arm]] = posture
                clearance = self._clearance(joints)
                if clearance > 0:
                    ways.append(_Hold(holders, turns, joints, clearance))
            ranked += enumerate(sorted(ways, key=lambda way: -way.clearance))
        yield from (way for _, way in sorted(ranked, key=lambda pair: (pair[0], -pair[1].clearance)))

    def along(self, poses: Float[np.ndarray, "t 2 3"], hold: _Hold) -> Float[np.ndarray, "t n"] | _Stuck:
        """Positions of all joints [rad] from one way to hold the first poses on; or where it ends."""
        import mink

        configuration = mink.Configuration(self.model, hold.joints)
        posture = mink.PostureTask(self.model, cost=POSTURE_COST)
        posture.set_target(hold.joints)
        tasks, rows = [self._task(arm) for arm in hold.holders], np.empty((len(poses), self.model.nq))
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
        joints = np.stack([rows[:, self.places[arm]] for arm in hold.holders], axis=1)
        left, right = (self._chain(arm) for arm in hold.holders)
        names = tuple(joint.name for joint in left.joints), tuple(joint.name for joint in right.joints)
        return Followed(joints=joints, names=names, holders=hold.holders, turns=hold.turns, chains=(left, right))

    def _chain(self, index: int) -> Chain:
        """One of the arms as plain numbers."""
        model, data = self.model, self.data
        data.qpos[:] = 0.0
        mujoco.mj_kinematics(model, data)
        joints = tuple(
            ChainJoint(
                name=model.joint(joint).name.removeprefix(_prefix(index)),
                axis=data.xaxis[joint].copy(),
                point=data.xanchor[joint].copy(),
                range=tuple(model.jnt_range[joint].tolist()) if model.jnt_limited[joint] else (-math.inf, math.inf),
            )
            for joint in self.chained[index]
        )
        solids = tuple(self._solid(geom, index) for geom in self._geoms[index])
        arm = self.arms.arms[index]
        return Chain(joints=joints, solids=solids, tip=self._tip(index), speed_limit=arm.speed_limit)

    def _solid(self, geom: int, index: int) -> ChainSolid:
        """A geom as plain numbers, with all joints at zero."""
        model, data = self.model, self.data
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]
        kind, vertices = KINDS[int(model.geom_type[geom])], np.zeros((0, 3))
        if kind == "hull":
            mesh = model.geom_dataid[geom]
            first = model.mesh_vertadr[mesh]
            vertices = model.mesh_vert[first : first + model.mesh_vertnum[mesh]].astype(float)
        return ChainSolid(
            name=f"arm {index}: {self._called(geom)}", link=self._link(geom, index), hand=geom in self._hands[index],
            kind=kind, size=model.geom_size[geom].copy(), pose=pose, vertices=vertices,
        )  # fmt: skip

    def _frame(self, index: int, arm: DescribedArm) -> tuple[int, str, str]:
        """Body, name and kind, as mink calls it, of the frame that holds the cable."""
        name = f"{_prefix(index)}{arm.frame}"
        site = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, name)
        if site >= 0:
            return int(self.model.site_bodyid[site]), name, "site"
        body = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, name)
        if body >= 0:
            return body, name, "body"
        known = [self.model.site(k).name for k in range(self.model.nsite)]
        known += [self.model.body(k).name for k in range(self.model.nbody)]
        own = ", ".join(each.removeprefix(_prefix(index)) for each in known if each.startswith(_prefix(index)))
        raise FileFormatError(f"{arm.model}: has no site, body or link {arm.frame!r}; it has {own}")

    def _joints(self, index: int, arm: DescribedArm) -> list[int]:
        """The hinges between the world and the frame, from the base on."""
        model, body, found = self.model, self._frames[index][0], []
        while body:
            first = model.body_jntadr[body]
            found += [first + k for k in reversed(range(model.body_jntnum[body]))]
            body = model.body_parentid[body]
        wrong = [k for k in found if model.jnt_type[k] != mujoco.mjtJoint.mjJNT_HINGE]
        if wrong or not found:
            what = f"its joint {model.joint(wrong[0]).name!r} is no hinge" if wrong else "no joint moves that frame"
            raise FileFormatError(f"{arm.model}: no arm with hinges leads to the frame {arm.frame!r}: {what}")
        return found[::-1]

    def _standing(self) -> Float[np.ndarray, "n"]:
        """All joints in the first keyframe of each file, or at their zero, within their ranges."""
        model, home = self.model, self.model.qpos0.copy()
        for index, places in enumerate(self.places):
            own = [k for k in range(model.nkey) if model.key(k).name.startswith(_prefix(index))]
            mine = [j for j in range(model.njnt) if model.joint(j).name.startswith(_prefix(index))]
            if own:
                at = model.jnt_qposadr[mine]
                home[at] = model.key_qpos[own[0]][at]
            home[places] = np.clip(home[places], *self._ranges(index))
        return home

    def _ranges(self, index: int) -> tuple[Float[np.ndarray, "j"], Float[np.ndarray, "j"]]:
        """Least and greatest angles [rad] of an arm's joints, half a turn to either side where there are none."""
        model, joints = self.model, self.chained[index]
        limited = model.jnt_limited[joints].astype(bool)[:, None]
        low, high = np.where(limited, model.jnt_range[joints], [-math.pi, math.pi]).T
        return np.maximum(low, -math.pi), np.minimum(high, math.pi)

    def _drawn(self, rng: np.random.Generator) -> Float[np.ndarray, "n"]:
        """A guess of a posture of both arms."""
        guess = self._home.copy()
        for index, places in enumerate(self.places):
            guess[places] = rng.uniform(*self._ranges(index))
        return guess

    def _pairs(self) -> None:
        """Which geoms must not meet, and the limits of motions that see to it."""
        import mink

        model, arms = self.model, range(ARMS)
        solid: list[int] = np.flatnonzero((model.geom_contype != 0) | (model.geom_conaffinity != 0)).tolist()
        of_arm = [[g for g in solid if self._called_body(g).startswith(_prefix(index))] for index in arms]
        for geoms, arm in zip(of_arm, self.arms.arms, strict=True):
            for geom in geoms:
                if int(model.geom_type[geom]) not in KINDS:
                    raise FileFormatError(f"{arm.model}: its geom {self._called(geom)} has a shape that is not known")
            if not geoms:
                raise FileFormatError(f"{arm.model}: has no geoms that touch anything, so nothing could be kept apart")
        self._geoms = of_arm
        self._hands = [self._hand(index) for index in arms]
        table, things = [solid[0]], [g for g in solid if self._called(g).startswith("obstacles[")]
        links = [[g for g in of_arm[k] if g not in self._hands[k]] for k in arms]
        own = [
            ([a], [b]) for k in arms for a, b in combinations(of_arm[k], 2)
            if abs(self._link(a, k) - self._link(b, k)) > NEIGHBOURS
        ]  # fmt: skip
        far = [(links[k], table + things) for k in arms] + [(links[0], links[1]), *own]
        near = [(self._hands[k], links[1 - k]) for k in arms]
        if self.task.grippers.body is None:
            near += [(self._hands[k], things) for k in arms] + [(self._hands[0], self._hands[1])]
        keep = self.arms.clearance + SPARE
        speeds = {
            model.joint(joint).name: arm.speed_limit
            for joints, arm in zip(self.chained, self.arms.arms, strict=True) for joint in joints
        }  # fmt: skip
        self._apart = [
            mink.CollisionAvoidanceLimit(model, [pair for pair in pairs if all(pair)],
                                         minimum_distance_from_collisions=least, collision_detection_distance=FAR)
            for pairs, least in ((far, keep), (near, HAND))
        ]  # fmt: skip
        self._ranged = mink.ConfigurationLimit(model)
        self._limits = [self._ranged, mink.VelocityLimit(model, speeds), *self._apart]
        moved = {int(dof) for dofs in self._dofs for dof in dofs}
        self._idle = [dof for dof in range(model.nv) if dof not in moved]

    def _hand(self, index: int) -> list[int]:
        """Geoms of the hand: what the last joint moves below its own body, or that where there is nothing below it."""
        last = int(self.model.jnt_bodyid[self.chained[index][-1]])
        moved = [g for g in self._geoms[index] if self._below(int(self.model.geom_bodyid[g]), last)]
        return [g for g in moved if self.model.geom_bodyid[g] != last] or moved

    def _below(self, body: int, top: int) -> bool:
        while body not in (0, top):
            body = int(self.model.body_parentid[body])
        return body == top

    def _link(self, geom: int, index: int) -> int:
        """How many of the arm's joints move a geom."""
        body = int(self.model.geom_bodyid[geom])
        return sum(self._below(body, int(self.model.jnt_bodyid[joint])) for joint in self.chained[index])

    def _called(self, geom: int) -> str:
        """A geom's name, or that of its body."""
        name = self.model.geom(geom).name
        return (name or self._called_body(geom)).split("/", 1)[-1]

    def _called_body(self, geom: int) -> str:
        return self.model.body(self.model.geom_bodyid[geom]).name

    def _tip(self, index: int) -> Float[np.ndarray, "4 4"]:
        """Pose of the frame that holds the cable, where the joints are."""
        _, name, kind = self._frames[index]
        at = self.data.site(name) if kind == "site" else self.data.body(name)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = at.xmat.reshape(3, 3), at.xpos
        return pose

    def _targets(self, poses: Float[np.ndarray, "t 3"], turn: int) -> Float[np.ndarray, "t 4 4"]:
        """Poses of a hand that holds the cable at gripper poses [m, m, rad]."""
        return flange_poses(poses, 0.0, self.task.cable.radius, turn)

    def _task(self, arm: int) -> Any:
        import mink

        _, name, kind = self._frames[arm]
        return mink.FrameTask(name, kind, position_cost=1.0, orientation_cost=ORIENTATION_COST)

    def _postures(
        self, arm: int, side: int, turn: int, poses: Float[np.ndarray, "2 3"], guesses: Sequence[Float[np.ndarray, "n"]]
    ) -> list[Float[np.ndarray, "j"]]:
        """Joints of an arm that hold one of the grippers, those with most room first, `POSTURES` at most."""
        import mink

        task, places, found = self._task(arm), self.places[arm], []
        task.set_target(mink.SE3.from_matrix(self._targets(poses[[side]], turn)[0]))
        for guess in guesses:
            checkpoint()
            configuration = mink.Configuration(self.model, guess.copy())
            if not self._settle(configuration, [task], [task], [self._ranged], 1.0, SETTLING):
                continue
            joints = configuration.q[places]
            if any(np.abs(joints - other).max() < ALIKE for _, other in found):
                continue
            alone = self._home.copy()
            alone[places] = joints
            clearance = self._clearance(alone, arm)
            low, high = self._ranges(arm)
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
            velocity[self._idle] = 0.0
            configuration.integrate_inplace(velocity, step)
        return self._met(wanted, configuration)

    def _met(self, tasks: Sequence[Any], configuration: Any) -> bool:
        errors = [task.compute_error(configuration) for task in tasks]
        return all(np.linalg.norm(e[:3]) < TIP and np.linalg.norm(e[3:]) < TIP_ANGLE for e in errors)

    def _clearance(self, joints: Float[np.ndarray, "n"], arm: int | None = None) -> float:
        """Least distance beyond what is kept [m], up to `FAR`, of all pairs, or of those without the other arm."""
        self.data.qpos[:] = joints
        mujoco.mj_kinematics(self.model, self.data)
        other = set() if arm is None else set(self._geoms[1 - arm])
        return min((gap for gap, a, b in self._gaps() if not {a, b} & other), default=FAR)

    def _gaps(self) -> Iterator[tuple[float, int, int]]:
        """Distance beyond what is kept [m] of each pair, where the joints are, and the pair."""
        for limit in self._apart:
            for a, b in limit.geom_id_pairs:
                gap = mujoco.mj_geomDistance(self.model, self.data, int(a), int(b), FAR, None)
                yield gap - limit.minimum_distance_from_collisions, int(a), int(b)

    def _why(
        self, poses: Float[np.ndarray, "2 3"], before: Float[np.ndarray, "n"], joints: Float[np.ndarray, "n"]
    ) -> str:
        """What keeps the arms from reaching gripper poses [m, m, rad] from where they were."""
        where = " and ".join(f"({x:.3f}, {y:.3f}) m" for x, y, _ in poses)
        for index, (places, arm) in enumerate(zip(self.places, self.arms.arms, strict=True)):
            names = [self.model.joint(k).name.removeprefix(_prefix(index)) for k in self.chained[index]]
            ranged = self.model.jnt_limited[self.chained[index]].astype(bool)
            room = np.min(np.abs(self.model.jnt_range[self.chained[index]].T - joints[places]), axis=0)
            moved = np.abs(joints - before)[places] / CONTROL_STEP
            if (at := np.flatnonzero(ranged & (room < SPARE))).size:
                return f"arm {index} is at the end of its {names[at[0]]}, with the grippers at {where}"
            if moved.max() > 0.99 * arm.speed_limit:
                limit = limit_text(arm.speed_limit, "rad/s")
                name = names[int(moved.argmax())]
                return f"arm {index} cannot turn its {name} faster than {limit}, at {where}: plan with a lower --speed"
        self.data.qpos[:] = joints
        mujoco.mj_kinematics(self.model, self.data)
        gap, a, b = min(self._gaps())
        if gap < SPARE:
            return f"{self._called(a)} and {self._called(b)} come too close to each other, with the grippers at {where}"
        return f"the arms do not reach the grippers at {where}"


def _prefix(index: int) -> str:
    return f"{index}/"


def _attach(spec: mujoco.MjSpec, arm: DescribedArm, index: int, base: Float[np.ndarray, "4 4"]) -> None:
    """Stand an arm at the table.

    Raises:
        FileFormatError: Its file cannot be read.
    """
    try:
        child = mujoco.MjSpec.from_file(arm.model)
        child.compiler.fusestatic = False  # as that of a URDF is, whose last links would be lost
        quat = np.empty(4)
        mujoco.mju_mat2Quat(quat, base[:3, :3].ravel())
        frame = spec.worldbody.add_frame(pos=base[:3, 3], quat=quat)
        spec.attach(child, prefix=_prefix(index), frame=frame)
    except ValueError as error:
        raise FileFormatError(f"{arm.model}: no arm that MuJoCo can read: {one_line(error)}") from None
