"""The arms of a cell in MuJoCo: two chains of links with servos at their joints, which carry the grippers.

A body has the frame of its link in the Denavit-Hartenberg parameters, so that masses, capsules and tool are where
`cableway.scene.cell` has them. Links collide, as their capsules, with table, obstacles and the other arm, and so do
hands, as the pieces of their outlines. They pass through walls, cable and the arm's own links; clearance is measured.

A servo holds a joint where it is commanded, like a spring of the stiffness k of `ArmModel` with damping k `LAG`, within
the joint's torque limit: a command that runs on evenly is followed `LAG` later. As in the maker's controller, weight is
compensated, that of the tool included, and counts towards the limit. Commands are joint positions at every time step,
by inverse kinematics in the branch in which the arm holds the cable, as a driver sends them.
"""

# MuJoCo's bindings are compiled and carry no type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float

from cableway.core.errors import GraspError, SimulationError
from cableway.core.quantities import limit_text, told_apart
from cableway.geometry.groups import SE2
from cableway.robot.cell_kinematics import CellKinematics
from cableway.robot.kinematics import link_frames
from cableway.robot.ur_arm import LOOKAHEAD
from cableway.scene.arm_models import ArmModel, Mass
from cableway.scene.cell import TOOLS, Way
from cableway.scene.gripper_bodies import outward
from cableway.scene.grippers import SIDES
from cableway.scene.task import Task
from cableway.simulation.drives import NAMES
from cableway.simulation.surroundings import ARMS, CONTACT, SOLID, add_prism, turned

LAG = LOOKAHEAD
"""Time [s] by which a joint follows its command late: that of the maker's servoJ."""

PULL_TIME = 0.1
"""Time [s] over which the pull of the cable is averaged: what lasts shorter is a jerk of the simulated weld."""

ROTOR_INERTIA = 0.1
"""Of a joint's motor behind its gear [kg m²]; MuJoCo Menagerie's `armature` of all joints of the UR5e and UR10e."""

UPRIGHT = ((0.0, 0.0, 1.0, 0.0), (0.0, 1.0, 0.0, 0.0))
"""Quaternion of a gripper's frame, x along the cable and z upwards, in that of the flange of a tool that points
straight down, by its turn."""


class ArmDrive:
    """The two arms of a cell as a `GripperDrive`.

    Args:
        task: A task in a cell, its scene as it is.
        way: How the arms hold the cable.
        start: (2, 6) joint positions [rad] near which they begin, for the number of whole turns.
        time_step: Of the model [s].
        hold: Pull [N] at which a hand loses the cable.

    Raises:
        InputError: The task has no cell.
    """

    def __init__(
        self, task: Task, way: Way, start: Float[np.ndarray, "2 6"], time_step: float, hold: float = math.inf
    ) -> None:
        self._kinematics, self._task, self._way = CellKinematics(task, way), task, way
        assert task.cell is not None
        self._cell, self._models = task.cell, task.cell.models_of(way)
        self._commanded, self._time_step = np.array(start, float), time_step
        self._measured = self._commanded.copy()
        self._hold, self._pulled = hold, np.zeros((2, 1))
        self._places, self._welds = np.empty((2, 6), int), np.empty(2, int)

    def add(self, spec: mujoco.MjSpec) -> None:
        """See `GripperDrive`."""
        tool, radius = TOOLS[self._cell.tool], self._task.cable.radius
        for side, name in enumerate(NAMES):
            met = {"contype": ARMS[side], "conaffinity": SOLID | ARMS[1 - side], **CONTACT}
            base = self._cell.arms[self._way.holders[side]].base(self._task.scene)
            flange = _add_links(spec, name, self._models[side], base, met)
            _set_mass(flange.add_body(name=f"{name} tool"), tool.mass)
            upright = _upright(self._way.turns[side], outward(side, self._cell.tilt))
            gripper = flange.add_body(name=f"{name} gripper", pos=[0.0, 0.0, self._cell.reach], quat=upright)
            for index, part in enumerate(self._task.grippers.pieces):
                if part.side == side:
                    heights = (part.heights[0] - radius, part.heights[1] - radius)
                    add_prism(spec, gripper, part.outline, heights, name=f"{name} hand {index}", mass=0.0, **met)

    def begin(self, model: mujoco.MjModel, data: mujoco.MjData, poses: Float[np.ndarray, "2 3"]) -> None:
        """See `GripperDrive`."""
        for side, name in enumerate(NAMES):
            self._places[side] = [model.joint(f"{name} joint {k}").qposadr[0] for k in range(6)]
            self._welds[side] = model.equality(name).id
        self._commanded = self._measured = self._joints_at(poses)
        data.qpos[self._places], data.ctrl[:] = self._commanded, self._commanded.ravel()

    def lead(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        wanted: Float[np.ndarray, "2 3"],
        offsets: Float[np.ndarray, "2 3"],
    ) -> float:
        """See `GripperDrive`; what is hit pushes back in the model."""
        joints = self._joints_at(wanted)
        self._require_slow(joints)
        self._require_held(data)
        self.follow(data, joints)
        model.eq_data[self._welds, :2] = SE2.position(offsets)  # in the gripper; on the cable it is its end
        model.eq_data[self._welds, 6:10] = turned(-offsets[:, 2])
        return math.inf

    def follow(self, data: mujoco.MjData, joints: Float[np.ndarray, "2 6"]) -> None:
        """Ask for joint positions [rad] at the end of the next time step."""
        self._commanded, data.ctrl[:] = joints, joints.ravel()
        self._measured = data.qpos[self._places]  # which all positions belong to that the time step leaves in `data`

    def put(self, data: mujoco.MjData, joints: Float[np.ndarray, "2 6"]) -> None:
        """Be at joint positions [rad], wherever the arms were."""
        data.qpos[self._places] = joints
        self.follow(data, joints)

    def grip(self, data: mujoco.MjData, held: bool) -> None:
        """Hold the ends of the cable, or let go of them."""
        data.eq_active[self._welds], self._pulled = held, np.zeros((2, 1))

    def _require_held(self, data: mujoco.MjData) -> None:
        """Raise a GraspError where a hand is pulled harder than it holds, on average over `PULL_TIME`."""
        held = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        for side, weld in enumerate(self._welds):
            force = data.efc_force[held & (data.efc_id == weld)][:3]  # then come the torques
            self._pulled[side] += self._time_step / PULL_TIME * (np.linalg.norm(force) - self._pulled[side])
        side = int(self._pulled.argmax())
        if (pull := float(self._pulled[side, 0])) > self._hold:
            found, limit = told_apart(pull, self._hold, "N"), limit_text(self._hold, "N")
            raise GraspError(f"the {SIDES[side][0]} lost the cable, which pulls with {found} and is held with {limit}")

    def poses(self) -> Float[np.ndarray, "2 3"]:
        """See `GripperDrive`; by forward kinematics of the measured joints."""
        return self._kinematics.poses(self._measured)

    def joints(self) -> Float[np.ndarray, "2 6"]:
        """See `GripperDrive`."""
        return self._measured.copy()

    def clearance(self, joints: Float[np.ndarray, "t 2 6"]) -> float:
        """See `GripperDrive`."""
        return float(self._kinematics.clearance(joints).min())

    def state(self) -> Float[np.ndarray, "2 13"]:
        """See `GripperDrive`; joint positions commanded and measured last [rad], and the pull at each hand [N]."""
        return np.hstack([self._commanded, self._measured, self._pulled])

    def restore(self, state: Float[np.ndarray, "2 13"]) -> None:
        """See `GripperDrive`."""
        self._commanded, self._measured, self._pulled = np.hsplit(state.copy(), [6, 12])

    def _joints_at(self, poses: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "2 6"]:
        """Joint positions [rad] for gripper poses, within their limits; an error where there are none."""
        joints = self._kinematics.joints(poses, self._commanded)
        beyond = np.abs(joints) - self._kinematics.position_limit
        if beyond.max() > 0:
            side, joint = divmod(int(beyond.argmax()), beyond.shape[1])
            raise self._refusal(
                side, joint, "to", abs(float(joints[side, joint])), self._kinematics.position_limit[side, joint], "rad"
            )
        return joints

    def _require_slow(self, joints: Float[np.ndarray, "2 6"]) -> None:
        """Raise a SimulationError where joints would have to be faster than they can from those commanded last."""
        speeds = np.abs(joints - self._commanded) / self._time_step
        share = speeds / self._kinematics.speed_limit
        if share.max() > 1:
            side, joint = divmod(int(share.argmax()), share.shape[1])
            raise self._refusal(
                side, joint, "at", float(speeds[side, joint]), self._kinematics.speed_limit[side, joint], "rad/s"
            )

    def _refusal(self, side: int, joint: int, how: str, wanted: float, most: float, unit: str) -> SimulationError:
        name, found = self._models[side].joint_names[joint], told_apart(wanted, most, unit)
        limit = limit_text(most, unit)
        return SimulationError(
            f"the arm at the {SIDES[side][0]} would have to turn its {name} {how} {found}, limit {limit}"
        )


def _add_links(
    spec: mujoco.MjSpec, name: str, model: ArmModel, base: Float[np.ndarray, "4 4"], met: Mapping[str, Any]
) -> mujoco.MjsBody:
    """Add an arm with its servos, and return the body that has the frame of its flange."""
    frames, at_zero = np.tile(np.eye(4), (7, 1, 1)), np.empty((7, 3, 4))
    link_frames(np.array(model.lengths), base, np.zeros(6), at_zero)
    frames[:, :3] = at_zero
    body = spec.worldbody.add_body(name=f"{name} base", **_placed(frames[0]))
    for k in range(7):
        if k:
            step = np.linalg.inv(frames[k - 1]) @ frames[k]
            body = body.add_body(name=f"{name} link {k}", **_placed(step))
            _set_mass(body, model.links[k - 1])
            _add_joint(spec, body, f"{name} joint {k - 1}", model, k - 1, np.linalg.inv(step))
        for capsule in model.capsules:
            if capsule.frame == k:
                ends, size = [*capsule.start, *capsule.end], [capsule.radius, 0.0, 0.0]
                body.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=ends, size=size, mass=0.0, **met)
    return body


def _upright(turn: int, lean: float) -> Float[np.ndarray, "4"]:
    """The same of a tool that leans by so much [rad] about the gripper's y axis."""
    found, back = np.empty(4), [math.cos(lean / 2), 0.0, -math.sin(lean / 2), 0.0]
    mujoco.mju_mulQuat(found, np.array(UPRIGHT[turn]), np.array(back))
    return found


def _add_joint(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, model: ArmModel, index: int, before: Float[np.ndarray, "4 4"]
) -> None:
    """Add a joint about the z axis of the frame before that of its link, in which it is given, and its servo."""
    limit, torque = model.position_limit[index], model.torque_limit[index]
    joint = body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=before[:3, 2], pos=before[:3, 3])
    joint.limited, joint.range = mujoco.mjtLimited.mjLIMITED_TRUE, [-limit, limit]
    joint.actfrclimited, joint.actfrcrange = mujoco.mjtLimited.mjLIMITED_TRUE, [-torque, torque]
    joint.actgravcomp, joint.armature = True, ROTOR_INERTIA
    servo = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    servo.gaintype, servo.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
    stiffness = model.stiffness[index]
    servo.gainprm[0], servo.biasprm[1], servo.biasprm[2] = stiffness, -stiffness, -stiffness * LAG


def _set_mass(body: mujoco.MjsBody, mass: Mass) -> None:
    body.mass, body.ipos, body.fullinertia = mass.mass, list(mass.center), list(mass.inertia)
    body.explicitinertial, body.gravcomp = True, 1.0


def _placed(frame: Float[np.ndarray, "4 4"]) -> dict[str, Any]:
    """Position and quaternion of a frame."""
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, frame[:3, :3].ravel())
    return {"pos": frame[:3, 3], "quat": quat}
