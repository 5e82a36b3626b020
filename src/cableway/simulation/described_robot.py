"""Two arms of any kind at a task's table, each from a file of MuJoCo's format or a URDF: what of it motions need.

A model has many joints and shapes; here those between base and hand are told from others, which stay as they are, and
those shapes that must not meet.
"""

# MuJoCo's bindings are compiled and carry no type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from itertools import combinations
from warnings import catch_warnings

import mujoco
import numpy as np
from jaxtyping import Float

from cableway.core.errors import FileFormatError, InputError
from cableway.core.reading import one_line
from cableway.scene.cell import ARMS
from cableway.scene.chains import Chain, ChainJoint, ChainSolid, Kind
from cableway.scene.described_arms import DescribedArm, DescribedArms
from cableway.scene.task import Task
from cableway.simulation.surroundings import add_obstacle, collected_warnings

NEIGHBOURS = 2
"""Joints between two links of an arm that are not kept apart: shapes of neighbours overlap at their joint."""

UNLIMITED = 2.0
"""Height [m] of what nothing passes above."""

KINDS: dict[int, Kind] = {
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
    mujoco.mjtGeom.mjGEOM_MESH: "hull",
}


class DescribedRobot:
    """Both arms at the table.

    Args:
        arms: The arms.
        task: Whose table it is.

    Attributes:
        model: Of MuJoCo: arms, table and obstacles.
        data: Its state.
        frames: Body, name and kind, as mink calls it, of the frame at which each arm holds the cable.
        chained: The joints of each arm from its base to its hand.
        places: (j,) where these stand among all positions.
        idle: Degrees of freedom of others, such as fingers.
        home: (n,) all positions: those of the first keyframe of each file, or zero, within their ranges [rad].
        geoms: Of each arm, what touches things.
        pairs: Groups of geoms that must not meet.

    Raises:
        FileFormatError: A file cannot be read, or is of no arm with hinges.
        InputError: The arms have different numbers of joints.
    """

    def __init__(self, arms: DescribedArms, task: Task) -> None:
        self.arms, self.task = arms, task
        spec = mujoco.MjSpec()
        spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_BOX, pos=[0, 0, -0.05], size=[5, 5, 0.05])
        for index, obstacle in enumerate(task.scene.obstacles):
            stated = arms.obstacle_height if obstacle.height is None else obstacle.height
            top = UNLIMITED if stated is None else stated
            add_obstacle(spec, obstacle, (0.0, top), mujoco.mjtGeom.mjGEOM_CYLINDER, name=f"obstacles[{index}]")
        # MuJoCo warns, in two ways, that options of the files' dynamics differ, which nothing here uses
        with collected_warnings(), catch_warnings(action="ignore"):
            for index, arm in enumerate(arms.arms):
                _attach(spec, arm, index, arm.base(task.scene))
            try:
                self.model = spec.compile()
            except ValueError as error:
                raise FileFormatError(f"{arms.name}: the arms make no model: {one_line(error)}") from None
        self.data = mujoco.MjData(self.model)
        self.frames = [self._frame(index, arm) for index, arm in enumerate(arms.arms)]
        self.chained = [self._joints(index, arm) for index, arm in enumerate(arms.arms)]
        self.places = [self.model.jnt_qposadr[joints] for joints in self.chained]
        moved = {int(self.model.jnt_dofadr[joint]) for joints in self.chained for joint in joints}
        self.idle = [dof for dof in range(self.model.nv) if dof not in moved]
        if len(self.places[0]) != len(self.places[1]):
            counts = " and ".join(str(len(each)) for each in self.places)
            raise InputError(f"{arms.name}: both arms must have as many joints, got {counts}")
        self.home = self._standing()
        self._find_geoms()

    def chain(self, index: int) -> Chain:
        """One of the arms as plain numbers; other joints, as of fingers, where they stay."""
        model, data = self.model, self.data
        data.qpos[:] = self.home
        data.qpos[self.places[index]] = 0.0
        mujoco.mj_kinematics(model, data)
        joints = tuple(
            ChainJoint(
                name=model.joint(joint).name.removeprefix(prefix(index)),
                axis=data.xaxis[joint].copy(),
                point=data.xanchor[joint].copy(),
                range=tuple(model.jnt_range[joint].tolist()) if model.jnt_limited[joint] else (-math.inf, math.inf),
            )
            for joint in self.chained[index]
        )
        solids = tuple(self._solid(geom, index) for geom in self.geoms[index])
        arm = self.arms.arms[index]
        return Chain(joints=joints, solids=solids, tip=self._tip(index), speed_limit=arm.speed_limit)

    def ranges(self, index: int) -> tuple[Float[np.ndarray, "j"], Float[np.ndarray, "j"]]:
        """Least and greatest angles [rad] of an arm's joints, half a turn to either side where there are none."""
        model, joints = self.model, self.chained[index]
        limited = model.jnt_limited[joints].astype(bool)[:, None]
        low, high = np.where(limited, model.jnt_range[joints], [-math.pi, math.pi]).T
        return np.maximum(low, -math.pi), np.minimum(high, math.pi)

    def called(self, geom: int) -> str:
        """A geom's name, or that of its body."""
        name = self.model.geom(geom).name
        return (name or self._called_body(geom)).split("/", 1)[-1]

    def _find_geoms(self) -> None:
        """What touches things, and which of it must not meet."""
        model, arms = self.model, range(ARMS)
        solid: list[int] = np.flatnonzero((model.geom_contype != 0) | (model.geom_conaffinity != 0)).tolist()
        self.geoms = [[g for g in solid if self._called_body(g).startswith(prefix(index))] for index in arms]
        for geoms, arm in zip(self.geoms, self.arms.arms, strict=True):
            for geom in geoms:
                if int(model.geom_type[geom]) not in KINDS:
                    raise FileFormatError(f"{arm.model}: its geom {self.called(geom)} has a shape that is not known")
            if not geoms:
                raise FileFormatError(f"{arm.model}: has no geoms that touch anything, so nothing could be kept apart")
        self._hands = hands = [self._hand(index) for index in arms]
        links = [[g for g in self.geoms[k] if g not in hands[k]] for k in arms]
        table, things = [solid[0]], [g for g in solid if self.called(g).startswith("obstacles[")]
        pairs = [(links[0], links[1]), *((links[k], table + things) for k in arms)]
        pairs += [(hands[k], links[1 - k]) for k in arms]
        if self.task.grippers.body is None:  # else that stands for the hands, and the plan keeps it apart
            pairs += [(hands[0], hands[1]), *((hands[k], things) for k in arms)]
        pairs += [
            ([a], [b]) for k in arms for a, b in combinations(self.geoms[k], 2)
            if abs(self._link(a, k) - self._link(b, k)) > NEIGHBOURS
        ]  # fmt: skip
        self.pairs = [pair for pair in pairs if all(pair)]

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
            name=f"arm {index}: {self.called(geom)}", link=self._link(geom, index), hand=geom in self._hands[index],
            kind=kind, size=model.geom_size[geom].copy(), pose=pose, vertices=vertices,
        )  # fmt: skip

    def _frame(self, index: int, arm: DescribedArm) -> tuple[int, str, str]:
        """Body, name and kind, as mink calls it, of the frame that holds the cable."""
        name = f"{prefix(index)}{arm.frame}"
        site = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, name)
        if site >= 0:
            return int(self.model.site_bodyid[site]), name, "site"
        body = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, name)
        if body >= 0:
            return body, name, "body"
        known = [self.model.site(k).name for k in range(self.model.nsite)]
        known += [self.model.body(k).name for k in range(self.model.nbody)]
        own = ", ".join(each.removeprefix(prefix(index)) for each in known if each.startswith(prefix(index)))
        raise FileFormatError(f"{arm.model}: has no site, body or link {arm.frame!r}; it has {own}")

    def _joints(self, index: int, arm: DescribedArm) -> list[int]:
        """The hinges between the world and the frame, from the base on."""
        model, body, found = self.model, self.frames[index][0], []
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
            own = [k for k in range(model.nkey) if model.key(k).name.startswith(prefix(index))]
            mine = [j for j in range(model.njnt) if model.joint(j).name.startswith(prefix(index))]
            if own:
                at = model.jnt_qposadr[mine]
                home[at] = model.key_qpos[own[0]][at]
            home[places] = np.clip(home[places], *self.ranges(index))
        return home

    def _hand(self, index: int) -> list[int]:
        """Geoms of the hand: what the last joint moves below its own body, or that where there is nothing below it."""
        last = int(self.model.jnt_bodyid[self.chained[index][-1]])
        moved = [g for g in self.geoms[index] if self._below(int(self.model.geom_bodyid[g]), last)]
        return [g for g in moved if self.model.geom_bodyid[g] != last] or moved

    def _below(self, body: int, top: int) -> bool:
        while body not in (0, top):
            body = int(self.model.body_parentid[body])
        return body == top

    def _link(self, geom: int, index: int) -> int:
        """How many of the arm's joints move a geom."""
        body = int(self.model.geom_bodyid[geom])
        return sum(self._below(body, int(self.model.jnt_bodyid[joint])) for joint in self.chained[index])

    def _called_body(self, geom: int) -> str:
        return self.model.body(self.model.geom_bodyid[geom]).name

    def _tip(self, index: int) -> Float[np.ndarray, "4 4"]:
        """Pose of the frame that holds the cable, where the joints are."""
        _, name, kind = self.frames[index]
        at = self.data.site(name) if kind == "site" else self.data.body(name)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = at.xmat.reshape(3, 3), at.xpos
        return pose


def prefix(index: int) -> str:
    """Before the names of all that is of an arm."""
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
        spec.attach(child, prefix=prefix(index), frame=frame)
    except ValueError as error:
        raise FileFormatError(f"{arm.model}: no arm that MuJoCo can read: {one_line(error)}") from None
