"""A cable in space between two grippers with servos, simulated in MuJoCo: bending, twist, weight, damping and contact.

It shares nothing with the rod of the planner but the shape that it begins in. Each gripper is a first-order servo that
follows the commanded motion; a weld holds the end of the cable in it.

Note:
    The cable does not touch itself, and the grippers have no bodies: their clearance is to be judged by their poses.
"""

# MuJoCo's bindings are compiled and carry no type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float

from cableway.core.checks import Bounds, Checked
from cableway.core.errors import InputError, SimulationError
from cableway.core.quantities import quantity
from cableway.geometry.groups import SE3
from cableway.rod.spatial import SpatialRod
from cableway.scene.task import CONTROL_STEP
from cableway.simulation.chain import collected_warnings
from cableway.simulation.spatial_chain import SpatialChain
from cableway.simulation.surroundings import CABLE, CONTACT, SURROUNDINGS, add_free_gripper, hold

NAMES = ("left", "right")

HOLD = {"solref": [0.005, 1.0], "solimp": [0.99, 0.9999, 0.001, 0.5, 2.0]}
"""Stiffness of a grasp: a time constant of two time steps."""

SLIP_DISTANCE = 0.010
"""Distance [m] of a cable's end from where its gripper holds it beyond which the grasp counts as lost."""

REST = 0.001
"""Speed [m/s] of the centreline that counts as rest."""

LONGEST_SETTLING = 20.0
"""[s] that the cable may take to come to rest at the start."""


@dataclass(frozen=True, kw_only=True)
class SpatialConfig(Checked):
    """What the plant in space is.

    Attributes:
        links: Of the chain.
        time_step: Of MuJoCo [s]; must divide the control step.
        servo_time: Time constant of the grippers [s].
        friction: Coefficient between cable and obstacles.

    Raises:
        InputError: A value is out of range.
    """

    links: Annotated[int, Bounds(10, 200)] = 41
    time_step: Annotated[float, Bounds(5e-4, 5e-3)] = 0.0025
    servo_time: Annotated[float, Bounds(0, 1)] = 0.05
    friction: Annotated[float, Bounds(0, 3)] = 0.3

    def __post_init__(self) -> None:
        super().__post_init__()
        if abs(CONTROL_STEP / self.time_step - self.substeps) > 1e-6:
            raise InputError(f"time_step must divide {CONTROL_STEP} s, got {self.time_step!r}")

    @property
    def substeps(self) -> int:
        """Time steps in one control step."""
        return round(CONTROL_STEP / self.time_step)


class SpatialMeasurement(NamedTuple):
    """The truth after a control step.

    Attributes:
        line: Both ends and all joints of the chain [m].
        keypoints: At equal arc length, both ends included [m].
        poses: Of the grippers: position [m] and unit quaternion (w, x, y, z).
        contact: Distance [m] of the deepest contact of the cable during the step; infinite without one.
    """

    line: Float[np.ndarray, "v 3"]
    keypoints: Float[np.ndarray, "n 3"]
    poses: Float[np.ndarray, "2 7"]
    contact: float


class SpatialPlant:
    """A cable between two grippers in space.

    Args:
        chain: The true cable.
        rod: The rod whose shape the cable begins in; it comes to rest between the same grippers.
        start: (12,) coordinates of that shape.
        surround: Adds what the cable can touch to a model; nothing where None. Geoms for the cable are to have
            `SURROUNDINGS` as their `contype` and `CABLE` as their `conaffinity`.
        grasps: (2, 7) poses of the cable's ends in the gripper frames; none off where None.
        config: Everything else.

    Raises:
        SimulationError: The cable does not come to rest, or touches something then.
    """

    control_step = CONTROL_STEP
    """Time [s] that one step takes."""

    def __init__(
        self,
        chain: SpatialChain,
        rod: SpatialRod,
        start: Float[np.ndarray, "12"],
        surround: Callable[[mujoco.MjSpec], None] | None = None,
        grasps: Float[np.ndarray, "2 7"] | None = None,
        config: SpatialConfig | None = None,
    ) -> None:
        self.config, self._chain = config or SpatialConfig(), chain
        self._places, self._steps = np.linspace(0.0, 1.0, rod.keypoints), 0
        still = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (2, 1))
        self._grasps = still if grasps is None else grasps
        self.model = self._built(surround)
        self._data = mujoco.MjData(self.model)
        self._is_cable = self.model.geom_contype == CABLE
        stations, poses = rod.shapes(start[None])
        self._commanded, self._reached = poses[0].copy(), poses[0].copy()
        left = SE3.compose(poses[0, 0], self._grasps[0])
        self._data.qpos[: chain.coordinates] = chain.laid(stations[0], left, start[9] / rod.twist)
        self._settle()

    @property
    def time(self) -> float:
        """[s] since the start."""
        return self._steps * self.control_step

    def step(self, action: Float[np.ndarray, "2 6"]) -> SpatialMeasurement:
        """Move the targets of the grippers at constant speed by `action` [m, rad] in one control step.

        Raises:
            SimulationError: The action is not finite, the simulation diverged or a grasp is lost.
        """
        if not np.isfinite(action).all():
            raise SimulationError(f"an action must be finite, got {np.asarray(action).tolist()}")
        measured = self._lead(SE3.plus(self._commanded, action))
        self._steps += 1
        return measured

    def measure(self) -> SpatialMeasurement:
        """The truth now; no contact was looked for."""
        line = self._chain.line(self._data)
        return SpatialMeasurement(line, self._chain.at(line, self._places), self._reached.copy(), math.inf)

    def _settle(self) -> None:
        """Let the cable come to rest between the grippers as they are."""
        for _ in range(round(LONGEST_SETTLING / self.control_step)):
            before = self._chain.line(self._data)
            measured = self._lead(self._commanded)
            if np.abs(measured.line - before).max() < REST * self.control_step:
                break
        else:
            raise SimulationError(f"the cable did not come to rest in {LONGEST_SETTLING:g} s between still grippers")
        if measured.contact <= 0:
            raise SimulationError(f"the cable touches something at the start, {quantity(-measured.contact)} deep")

    def _lead(self, target: Float[np.ndarray, "2 7"]) -> SpatialMeasurement:
        data, count, deepest = self._data, self.config.substeps, math.inf
        kept = 1.0 - math.exp(-self.config.time_step / self.config.servo_time) if self.config.servo_time else 1.0
        data.warning.number[:] = 0
        with collected_warnings() as messages:
            for substep in range(1, count + 1):
                wanted = SE3.between(self._commanded, target, substep / count)
                self._reached = SE3.between(self._reached, wanted, kept)
                ends = SE3.compose(self._reached, self._grasps)
                data.mocap_pos[:], data.mocap_quat[:] = ends[:, :3], ends[:, 3:]
                mujoco.mj_step(self.model, data)
                deepest = min(deepest, self._contact())
        if data.warning.number.any() or not np.isfinite(data.qpos).all():
            raise SimulationError(f"the simulation diverged: {' '.join(messages[:1]) or 'a state is not finite'}")
        self._commanded, measured = target, self.measure()
        held = SE3.compose(self._reached, self._grasps)[:, :3]
        slip = float(np.linalg.norm(measured.line[[0, -1]] - held, axis=1).max())
        if slip > SLIP_DISTANCE:
            raise SimulationError(f"the cable slipped in a gripper by {quantity(slip)}, pulled too hard")
        return measured._replace(contact=deepest)

    def _contact(self) -> float:
        """Distance [m] of the deepest contact of the cable with anything; infinite without one."""
        if not self._data.ncon:
            return math.inf
        touching = self._is_cable[self._data.contact.geom].any(axis=1)
        return float(self._data.contact.dist[touching].min()) if touching.any() else math.inf

    def _built(self, surround: Callable[[mujoco.MjSpec], None] | None) -> mujoco.MjModel:
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        option = spec.option
        option.timestep, option.integrator = self.config.time_step, mujoco.mjtIntegrator.mjINT_DISCRETE
        option.cone, option.solver = mujoco.mjtCone.mjCONE_ELLIPTIC, mujoco.mjtSolver.mjSOL_NEWTON
        option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        # the approximate diagonal makes the grasps of a long chain soft
        option.enableflags |= mujoco.mjtEnableBit.mjENBL_DIAGEXACT
        friction = [self.config.friction, 0.005, 0.0001]
        self._chain.add(spec, contype=CABLE, conaffinity=SURROUNDINGS, condim=3, friction=friction, **CONTACT)
        last, share = self._chain.links - 1, self._chain.length / (2 * (self._chain.links - 1))
        for name, link, along in zip(NAMES, (0, last), (0.0, share), strict=True):
            add_free_gripper(spec, name)
            hold(spec, name, f"segment {link}", along, **HOLD)
        if surround is not None:
            surround(spec)
        return spec.compile()
