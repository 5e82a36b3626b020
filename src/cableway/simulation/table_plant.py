"""A second plant: a cable in space that lies on a table, led by grippers with servos, or by the arms of a cell.

It shares nothing with the planar rod of planner and estimator but the shape its settling starts from. The cable is a
chain of capsules of length h, the first and the last half as long, with ball joints that bend and twist with the
stiffness EI / h. It has weight, lies on the table, and rubs on table, obstacles and walls with elliptic friction cones.
Obstacles are prisms that stand on the table, as high as the task states and no lower than the cable is thick: it passes
above none. What moves the grippers is a `GripperDrive`: each is a first-order servo that follows the commanded motion
with the time constant `TableConfig.servo_time`, or arms carry them (`cableway.simulation.arms`). They report where they
are. A weld holds each end of the cable in its gripper.

Note:
    The twisting stiffness GJ equals EI; it is 0.67 EI for a solid rod of rubber. The cable does not collide with
    itself. Drag, plasticity and the friction of the cable's record are those of the planar plant and ignored here.
"""

# MuJoCo's bindings are compiled and carry no type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import mujoco
import numpy as np
from jaxtyping import Float

from cableway.core.checks import Bounds, Checked
from cableway.core.errors import InputError, SimulationError
from cableway.core.quantities import quantity
from cableway.geometry import polyline
from cableway.geometry.groups import SE2
from cableway.records import Measurement, Observation
from cableway.scene.cable import Cable
from cableway.scene.clearance import pieces_clearance
from cableway.scene.scene import Scene
from cableway.scene.task import CONTROL_STEP, Task
from cableway.simulation.drives import NAMES, FreeGrippers, GripperDrive
from cableway.simulation.perturbations.grasp import GraspConfig
from cableway.simulation.plant import PlantConfig, checked_action, nearest_start
from cableway.simulation.solid_grippers import SolidGrippers
from cableway.simulation.surroundings import (
    CABLE,
    CONTACT,
    SOLID,
    SURROUNDINGS,
    add_clip,
    add_plane,
    add_scene,
    collected_warnings,
    hold,
    turned,
)

HOLD = {"solref": [0.005, 1.0], "solimp": [0.99, 0.9999, 0.001, 0.5, 2.0]}
"""Stiffness of a grasp: a time constant of two time steps."""

ROLLING = [0.005, 0.0001]
"""Torsional and rolling friction [m], MuJoCo's defaults."""

SLIP_DISTANCE = 0.010
"""Distance [m] of a cable's end from where its gripper holds it beyond which the grasp counts as lost."""

REST = 0.002
"""Speed [m/s] of the centreline that counts as rest."""

LONGEST_SETTLING = 10.0
"""[s] that the cable may take to come to rest at the start."""

EVERY = 4
"""Time steps between two looks at the clearance."""

STATE = mujoco.mjtState.mjSTATE_INTEGRATION


@dataclass(frozen=True, kw_only=True)
class TableConfig(Checked):
    """What the table plant is.

    Attributes:
        segments: Of the chain.
        time_step: Of MuJoCo [s]; must divide the control step.
        friction: Coefficient between cable and table, along the cable.
        across: Friction across the cable over that along it.
        obstacle_friction: Coefficient between cable and obstacles.
        obstacle_height: Of obstacles whose height the task leaves open [m].
        servo_time: Time constant [s] of the servos of grippers that no arms carry.

    Raises:
        InputError: A value is out of range.
    """

    segments: Annotated[int, Bounds(10, 200)] = 41
    time_step: Annotated[float, Bounds(5e-4, 5e-3)] = 0.0025
    friction: Annotated[float, Bounds(0, 3)] = 0.3
    across: Annotated[float, Bounds(0.1, 10)] = 1.0
    obstacle_friction: Annotated[float, Bounds(0, 3)] = 0.3
    obstacle_height: Annotated[float, Bounds(0.01, 1)] = 0.05
    servo_time: Annotated[float, Bounds(0, 1)] = 0.05

    def __post_init__(self) -> None:
        super().__post_init__()
        if abs(CONTROL_STEP / self.time_step - self.substeps) > 1e-6:
            raise InputError(f"table.time_step must divide {CONTROL_STEP} s, got {self.time_step!r}")

    @property
    def substeps(self) -> int:
        """Time steps in one control step."""
        return round(CONTROL_STEP / self.time_step)


@dataclass(frozen=True)
class TableState:
    """All that the plant's future and its next measurement depend on; see `TablePlant.state`.

    Attributes:
        physics: MuJoCo's integration state.
        commanded: Gripper poses asked for so far [m, m, rad].
        drive: What moves the grippers, see `GripperDrive.state`.
        steps: Control steps since the start.
        clearances: Of the cable, and of grippers and arms, in the last step [m].
    """

    physics: Float[np.ndarray, "s"]
    commanded: Float[np.ndarray, "2 3"]
    drive: Float[np.ndarray, "2 k"]
    steps: int
    clearances: tuple[float, float]


class TablePlant:
    """A task's cable on a table; a step that fails leaves it as it was.

    Args:
        task: Scene, start and grippers as they are.
        cable: The true cable; the task's where None.
        grasp: Where its ends are in the grippers; a slip takes one control step.
        config: What the table plant is.
        nominal: The task that planner and controller know; `task` where None.
        drive: What moves the grippers; servos of their own where None.

    Raises:
        InputError: The cable is shorter than the distance of its ends at the start.
        SimulationError: The cable has no stable shape there, or something touches once it lies still; or the drive
            cannot bring the grippers there.
    """

    control_step = CONTROL_STEP
    """Time [s] that one step takes."""

    def __init__(
        self,
        task: Task,
        cable: Cable | None = None,
        grasp: GraspConfig | None = None,
        config: TableConfig | None = None,
        nominal: Task | None = None,
        drive: GripperDrive | None = None,
    ) -> None:
        self.task, self._scene = nominal or task, task.scene
        self.cable, self.grasp, self.config = cable or task.cable, grasp or GraspConfig(), config or TableConfig()
        servo, step, solid = self.config.servo_time, self.config.time_step, SolidGrippers(task)
        self._drive = drive or FreeGrippers(servo, step, self.cable.radius, solid)
        self.model = build_model(self.cable, task.scene, self.config, self._drive)
        self._data = mujoco.MjData(self.model)
        self._is_scene = self.model.geom_contype & SURROUNDINGS > 0
        self._is_scene[self.model.geom("table").id] = False
        self._is_cable = self.model.geom_contype == CABLE
        self._tip = self.cable.length / (2 * (self.config.segments - 1))
        self._steps, self._clearances = 0, (math.inf, math.inf)
        self._start(task)
        self._initial = self.state()

    @property
    def time(self) -> float:
        """[s] since the start."""
        return self._steps * self.control_step

    @property
    def unmodelled(self) -> tuple[str, ...]:
        """See `CableSimulator.unmodelled`."""
        notes = [] if self.task.plug is None else ["The plug does not collide."]
        if self.cable.drag or self.cable.yield_curvature:
            notes.append("A cable on this table has no drag and takes no set.")
        return tuple(notes)

    def reset(self) -> Observation:
        """Go back to the start; the same run after it gives the same result bit for bit."""
        self.restore(self._initial)
        return self._observe()

    def check(self, action: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "2 3"]:
        """See `CableSimulator.check`."""
        return checked_action(action, PlantConfig())

    def step(self, action: Float[np.ndarray, "2 3"]) -> Observation:
        """Move the targets of the grippers at constant speed by `action` [m, m, rad] in one control step.

        Raises:
            SimulationError: The action is refused, the simulation diverged or a grasp is lost.
        """
        target, before = SE2.plus(self._commanded, self.check(action)), self.state()
        try:
            self._clearances = self._lead(target)
        except SimulationError as error:
            self.restore(before)
            raise type(error)(f"{error} (step {self._steps + 1}, t = {self.time:.1f} s)") from None
        self._commanded, self._steps = target, self._steps + 1
        return self._observe()

    def measure(self) -> Measurement:
        """The truth after the last step, seen from above, with the least clearances during it."""
        line, joints = self._line(), self._drive.joints()
        ends = SE2.compose(self._reached, self.grasp.offsets(self.time - self.control_step / 2))
        return Measurement(self._keypoints(line), ends, line, *self._clearances, joints=joints)

    def state(self) -> TableState:
        """A copy of the whole state, to branch a run from."""
        physics = np.empty(mujoco.mj_stateSize(self.model, STATE))
        mujoco.mj_getState(self.model, self._data, physics, STATE)
        return TableState(physics, self._commanded.copy(), self._drive.state(), self._steps, self._clearances)

    def restore(self, state: TableState) -> None:
        """Go back to a state of this plant; what follows is the same bit for bit."""
        mujoco.mj_setState(self.model, self._data, state.physics, STATE)
        mujoco.mj_forward(self.model, self._data)
        self._drive.restore(state.drive)
        self._commanded = state.commanded.copy()
        self._steps, self._clearances = state.steps, state.clearances

    def _observe(self) -> Observation:
        return Observation(time=self.time, keypoints=self._keypoints(self._line()), poses=self._reached)

    @property
    def _reached(self) -> Float[np.ndarray, "2 3"]:
        """Where the grippers are [m, m, rad]; the angles run on."""
        return SE2.continued(self._drive.poses(), self._commanded)

    def _start(self, task: Task) -> None:
        """Lay the cable into the stable shape of its length nearest to the task's start, and let it come to rest."""
        poses = task.cable.rod.end_poses(task.start_equilibrium[None])[0]
        self._commanded = poses.copy()
        self._drive.begin(self.model, self._data, poses)
        start = nearest_start(self.cable, task, SE2.compose(poses, self.grasp.offsets(0.0)))
        self._lay(self.cable.rod.shapes(start[None])[0][0])
        for _ in range(round(LONGEST_SETTLING / self.control_step)):
            before = self._line()
            self._clearances = self._lead(poses)
            if np.abs(self._line() - before).max() < REST * self.control_step:
                break
        if min(self._clearances) <= 0:
            what = "the cable touches" if self._clearances[0] <= 0 else "a gripper or an arm touches"
            raise SimulationError(f"{what} something at the start, {quantity(-min(self._clearances))} deep")

    def _lay(self, line: Float[np.ndarray, "v 2"]) -> None:
        """Lay the chain along a planar curve of its length."""
        points = polyline.point_at(line, float(polyline.length(line)) * _joints(self.config))
        angles = np.unwrap(np.arctan2(*np.diff(points, axis=0).T[::-1]))
        quaternions = turned(np.r_[angles[:1], np.diff(angles)])
        self._data.qpos[:3] = [*points[0], self.cable.radius]
        self._data.qpos[3 : 3 + quaternions.size] = quaternions.ravel()

    def _lead(self, target: Float[np.ndarray, "2 3"]) -> tuple[float, float]:
        """Move the grippers' targets at constant speed in one control step; the least clearances on the way."""
        data, count = self._data, self.config.substeps
        offsets = self.grasp.offsets(self.time + self.control_step / 2)
        lines, poses, joints, deepest, kept_from = [], [], [], math.inf, math.inf
        data.warning.number[:] = 0
        with collected_warnings() as messages:
            for substep in range(1, count + 1):
                wanted = self._commanded + substep / count * (target - self._commanded)
                kept_from = min(kept_from, self._drive.lead(self.model, data, wanted, offsets))
                mujoco.mj_step(self.model, data)
                deepest = min(deepest, self._contact())
                if substep % EVERY == 0:
                    lines.append(self._line())
                    poses.append(self._reached)
                    joints.append(self._drive.joints())
        if data.warning.number.any() or not np.isfinite(data.qpos).all():
            raise SimulationError(f"the simulation diverged: {' '.join(messages[:1]) or 'a state is not finite'}")
        slip = np.linalg.norm(lines[-1][[0, -1]] - SE2.position(SE2.compose(poses[-1], offsets)), axis=1).max()
        if slip > SLIP_DISTANCE:
            raise SimulationError(f"the cable slipped in a gripper by {quantity(slip)}, pulled or pressed too hard")
        cable = float(self._scene.clearance(np.array(lines), self.cable.radius).min())
        discs = float(self._scene.signed_distance(np.array(poses)[:, :, :2]).min()) - self.task.grippers.radius
        pieces = pieces_clearance(np.array(lines), np.array(poses), self.task.in_scene(self._scene))
        arms = self._drive.clearance(np.array(joints))
        return min(cable, deepest), min(discs, float(pieces.min()), arms, kept_from)

    def _contact(self) -> float:
        """Distance [m] of the deepest contact of the cable with an obstacle or a wall; infinite without one."""
        if not self._data.ncon:
            return math.inf
        geoms = self._data.contact.geom
        touching = self._is_scene[geoms].any(axis=1) & self._is_cable[geoms].any(axis=1)
        return float(self._data.contact.dist[touching].min()) if touching.any() else math.inf

    def _line(self) -> Float[np.ndarray, "v 2"]:
        """The centreline seen from above [m]: both ends and all joints."""
        last = self.config.segments
        tip = self._data.xpos[last] + self._data.xmat[last].reshape(3, 3)[:, 0] * self._tip
        return np.vstack([self._data.xpos[1 : last + 1, :2], tip[:2]])

    def _keypoints(self, line: Float[np.ndarray, "v 2"]) -> Float[np.ndarray, "n 2"]:
        places = np.linspace(0.0, 1.0, self.cable.keypoints)
        return np.column_stack([np.interp(places, _joints(self.config), column) for column in line.T])


def build_model(cable: Cable, scene: Scene, config: TableConfig, drive: GripperDrive) -> mujoco.MjModel:
    """MuJoCo's model of a cable on a table among obstacles, its ends held by the grippers of a drive.

    Args:
        cable: Length, radius, weight per metre, stiffness, damping time, and the profiles of stiffness and rest
            curvature.
        scene: Obstacles and workspace.
        config: Everything else.
        drive: What moves the grippers.
    """
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    option = spec.option
    option.timestep, option.integrator = config.time_step, mujoco.mjtIntegrator.mjINT_DISCRETE
    option.cone, option.solver = mujoco.mjtCone.mjCONE_ELLIPTIC, mujoco.mjtSolver.mjSOL_NEWTON
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    # the approximate diagonal makes the grasps of a long chain soft
    option.enableflags |= mujoco.mjtEnableBit.mjENBL_DIAGEXACT
    add_plane(spec, [0.0, 0.0, 0.0], [0.0, 0.0, 1.0], name="table", **_surface(config.friction))
    _add_chain(spec, cable, config)
    drive.add(spec)
    last, share = config.segments - 1, cable.length / (2 * (config.segments - 1))
    for name, link, along in zip(NAMES, (0, last), (0.0, share), strict=True):
        hold(spec, name, f"segment {link}", along, **HOLD)
    if drive.joints() is not None:  # arms, whose hands may let go
        for name, link in zip(NAMES, (0, last), strict=True):
            add_clip(spec, f"{name} clip", f"segment {link}", **HOLD)
    stated = [config.obstacle_height if each.height is None else each.height for each in scene.obstacles]
    heights = [(0.0, max(height, 2 * cable.radius)) for height in stated]  # the cable passes above nothing
    add_scene(spec, scene, heights, mujoco.mjtGeom.mjGEOM_CYLINDER, **_surface(config.obstacle_friction))
    for name in ("table", *(f"obstacle {index}" for index in range(len(heights)))):
        spec.geom(name).contype |= SOLID
    model = spec.compile()
    bends = cable.length / (config.segments - 1) * cable.along("rest_curvature", _joints(config)[1:-1])
    model.qpos_spring[7 : 7 + 4 * len(bends)] = turned(bends).ravel()
    return model


def _joints(config: TableConfig) -> Float[np.ndarray, "v"]:
    """Where the ends and the joints of the chain are, from 0 to 1 along the cable."""
    inner = np.arange(config.segments - 1) + 0.5
    return np.concatenate([[0.0], inner / (config.segments - 1), [1.0]])


def _surface(friction: float) -> dict[str, object]:
    return {"contype": SURROUNDINGS, "conaffinity": CABLE, "condim": 3, "friction": [friction, *ROLLING], **CONTACT}


def _add_chain(spec: mujoco.MjSpec, cable: Cable, config: TableConfig) -> None:
    count, joints, body, before = config.segments, _joints(config), spec.worldbody, 0.0
    stiffness = cable.bending_stiffness * (count - 1) / cable.length * cable.along("stiffness_profile", joints)
    lengths = cable.length * np.diff(joints)
    for index in range(count):
        name, share = f"segment {index}", float(lengths[index])
        body, before = body.add_body(name=name, pos=[before, 0.0, 0.0]), share
        if index == 0:
            body.add_freejoint()
        else:
            joint = body.add_joint(type=mujoco.mjtJoint.mjJNT_BALL)
            joint.stiffness[0], joint.damping[0] = stiffness[index], cable.damping_time * stiffness[index]
        body.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[0.0, 0.0, 0.0, share, 0.0, 0.0],
            size=[cable.radius, 0.0, 0.0],
            mass=cable.linear_density * share,
            contype=CABLE,
            conaffinity=SURROUNDINGS,
            condim=3,
            friction=[0.0, *ROLLING],
            **CONTACT,
        )
        if config.across != 1.0:  # MuJoCo's first tangent of a capsule on a plane is along the capsule
            pair = spec.add_pair(geomname1="table", geomname2=name, condim=3, **CONTACT)
            pair.friction = [config.friction, config.across * config.friction, *ROLLING, ROLLING[-1]]
