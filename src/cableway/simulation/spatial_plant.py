"""A cable in space between two grippers with servos, simulated in MuJoCo: bending, twist, weight, damping and contact.

It shares nothing with the rod of the planner but the shape that it begins in. Each gripper is a first-order servo that
follows the commanded motion; a weld holds the end of the cable in it. A camera reports keypoints with noise and late.

Note:
    The cable does not touch itself. Bodies of grippers beyond their balls push the cable that they do not hold; of what
    else grippers meet, the clearance is measured.
"""

# MuJoCo's bindings are compiled and carry no type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

import mujoco
import numpy as np
from jaxtyping import Float

from cableway.core.checks import Bounds, Checked
from cableway.core.errors import InputError, SimulationError
from cableway.core.quantities import quantity
from cableway.geometry.groups import SE3
from cableway.geometry.spatial_convex import chain_distance, signed_distance
from cableway.motion.spatial import SpatialBodies
from cableway.motion.spatial_kernels import OTHER, WORLD
from cableway.records import Measurement, Observation
from cableway.rod.inverse import equilibria_at, meet_poses
from cableway.scene import checks
from cableway.scene.bodies import LEFT
from cableway.scene.cable import MOST_VALUES, PROFILES
from cableway.scene.spatial.cable import SpatialCable
from cableway.scene.spatial.obstacles import ConvexMesh, Cuboid, Cylinder, Sphere
from cableway.scene.spatial.scene import SpatialScene
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.task import CONTROL_STEP
from cableway.simulation.drives import NAMES
from cableway.simulation.spatial_chain import SpatialChain
from cableway.simulation.surroundings import (
    CABLE,
    CONTACT,
    SURROUNDINGS,
    add_free_gripper,
    add_hull,
    add_obstacle,
    add_plane,
    collected_warnings,
    hold,
)

HOLD = {"solref": [0.005, 1.0], "solimp": [0.99, 0.9999, 0.001, 0.5, 2.0]}
"""Stiffness of a grasp: a time constant of two time steps."""

SLIP_DISTANCE = 0.010
"""Distance [m] of a cable's end from where its gripper holds it beyond which the grasp counts as lost."""

REST = 0.001
"""Speed [m/s] of the centreline that counts as rest."""

EVERY = 4
"""Time steps between two looks at the clearance."""

LONGEST_SETTLING = 20.0
"""[s] that the cable may take to come to rest at the start."""


@dataclass(frozen=True, kw_only=True)
class SpatialConfig(Checked):
    """What the plant in space is.

    Attributes:
        links: Of the chain.
        stiffness_profile: Factors on bending and twisting stiffness at places evenly along the cable.
        time_step: Of MuJoCo [s]; must divide the control step.
        servo_time: Time constant of the grippers [s].
        friction: Coefficient between cable and obstacles.
        keypoint_noise: Standard deviation of each coordinate of a keypoint [m].
        measurement_delay: Control steps from when a frame is taken until it arrives.

    Raises:
        InputError: A value is out of range.
    """

    links: Annotated[int, Bounds(10, 200)] = 41
    stiffness_profile: Annotated[tuple[float, ...], "a list of factors", 1] = (1.0,)
    time_step: Annotated[float, Bounds(5e-4, 5e-3)] = 0.0025
    servo_time: Annotated[float, Bounds(0, 1)] = 0.05
    friction: Annotated[float, Bounds(0, 3)] = 0.3
    keypoint_noise: Annotated[float, Bounds(0, 1)] = 0.0
    measurement_delay: Annotated[int, Bounds(0, 100)] = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        quantity, place = PROFILES["stiffness_profile"], ("stiffness_profile",)
        object.__setattr__(self, place[0], checks.profile(self.stiffness_profile, place, MOST_VALUES, quantity))
        if abs(CONTROL_STEP / self.time_step - self.substeps) > 1e-6:
            raise InputError(f"time_step must divide {CONTROL_STEP} s, got {self.time_step!r}")

    @property
    def substeps(self) -> int:
        """Time steps in one control step."""
        return round(CONTROL_STEP / self.time_step)


class SpatialPlant:
    """A task's cable between two grippers in space.

    Args:
        task: Scene, start and cable.
        cable: The true cable; the task's where None. It comes to rest between the grippers of the start.
        grasps: (2, 7) poses of the cable's ends in the gripper frames; none off where None.
        config: Everything else.
        seed: Of the noise.

    Raises:
        SimulationError: The cable has no stable shape there, does not come to rest, or touches something then.
    """

    control_step = CONTROL_STEP
    """Time [s] that one step takes."""

    def __init__(
        self,
        task: SpatialTask,
        cable: SpatialCable | None = None,
        grasps: Float[np.ndarray, "2 7"] | None = None,
        config: SpatialConfig | None = None,
        seed: int = 0,
    ) -> None:
        self.task, self.cable, self.config = task, cable or task.cable, config or SpatialConfig()
        self._chain, self._steps = SpatialChain(self.cable, self.config.links, self.config.stiffness_profile), 0
        self._rng, self._clearances = np.random.default_rng(seed), (math.inf, math.inf)
        self._grasps = np.tile(SE3.identity, (2, 1)) if grasps is None else np.array(grasps, float)
        self.model = self._built()
        self._data = mujoco.MjData(self.model)
        self._is_cable = self.model.geom_contype == CABLE
        self._bodies = SpatialBodies.of(task.bodies, self.cable.radius)
        self._commanded = task.gripper_poses("start").copy()
        self._reached = self._commanded.copy()
        ends = SE3.compose(self._reached, self._grasps)
        start = nearest_start(task, self.cable, ends)
        line = self.cable.rod.shapes(start[None])[0][0]
        self._data.qpos[: self._chain.coordinates] = self._chain.laid(line, ends[0], start[9] / self.cable.twist_ratio)
        self._settle()
        self._frames = [self._keypoints()]

    @property
    def time(self) -> float:
        """[s] since the start."""
        return self._steps * self.control_step

    def reset(self) -> Observation:
        """What is seen at the start, where this plant is as long as no step was made.

        Raises:
            SimulationError: One was.
        """
        if self._steps:
            raise SimulationError("a plant in space makes one run")
        return self._observe()

    def step(self, action: Float[np.ndarray, "2 6"]) -> Observation:
        """Move the targets of the grippers at constant speed by `action` [m, rad] in one control step.

        Raises:
            SimulationError: The action is not finite, the simulation diverged or a grasp is lost.
        """
        if not np.isfinite(action).all():
            raise SimulationError(f"an action must be finite, got {np.asarray(action).tolist()}")
        self._clearances = self._lead(SE3.plus(self._commanded, action))
        self._steps += 1
        self._frames.append(self._keypoints())
        return self._observe()

    def measure(self) -> Measurement:
        """The truth after the last step, with the least clearances during it."""
        cable, balls = self._clearances
        return Measurement(self._keypoints(), self._reached.copy(), self._chain.line(self._data), cable, balls)

    def _observe(self) -> Observation:
        """The frame that arrives now, and the poses of the grippers now."""
        at = max(0, self._steps - self.config.measurement_delay)
        keypoints = self._frames[at] + self.config.keypoint_noise * self._rng.standard_normal(self._frames[at].shape)
        return Observation(self.time, keypoints, self._reached.copy(), taken=at * self.control_step)

    def _keypoints(self) -> Float[np.ndarray, "n 3"]:
        return self._chain.at(self._chain.line(self._data), np.linspace(0.0, 1.0, self.cable.keypoints))

    def _settle(self) -> None:
        """Let the cable come to rest between the grippers as they are."""
        for _ in range(round(LONGEST_SETTLING / self.control_step)):
            before = self._chain.line(self._data)
            self._clearances = self._lead(self._commanded)
            if np.abs(self._chain.line(self._data) - before).max() < REST * self.control_step:
                break
        else:
            raise SimulationError(f"the cable did not come to rest in {LONGEST_SETTLING:g} s between still grippers")
        if min(self._clearances) <= 0:
            what = "the cable" if self._clearances[0] <= 0 else "a gripper"
            raise SimulationError(f"{what} touches something at the start, {quantity(-min(self._clearances))} deep")

    def _lead(self, target: Float[np.ndarray, "2 7"]) -> tuple[float, float]:
        """Move the grippers' targets at constant speed in one control step; clearances of cable and grippers [m]."""
        data, count, deepest, lines, poses = self._data, self.config.substeps, math.inf, [], []
        kept = 1.0 - math.exp(-self.config.time_step / self.config.servo_time) if self.config.servo_time else 1.0
        data.warning.number[:] = 0
        with collected_warnings() as messages:
            for substep in range(1, count + 1):
                wanted = SE3.between(self._commanded, target, substep / count)
                self._reached = SE3.between(self._reached, wanted, kept)
                ends = SE3.compose(self._reached, self._grasps)
                places = np.concatenate([ends, self._reached])[: self.model.nmocap]
                data.mocap_pos[:], data.mocap_quat[:] = places[:, :3], places[:, 3:]
                mujoco.mj_step(self.model, data)
                deepest = min(deepest, self._contact())
                if substep % EVERY == 0:
                    lines.append(self._chain.line(data))
                    poses.append(self._reached)
        if data.warning.number.any() or not np.isfinite(data.qpos).all():
            raise SimulationError(f"the simulation diverged: {' '.join(messages[:1]) or 'a state is not finite'}")
        self._commanded, held = target, SE3.compose(self._reached, self._grasps)[:, :3]
        slip = float(np.linalg.norm(lines[-1][[0, -1]] - held, axis=1).max())
        if slip > SLIP_DISTANCE:
            raise SimulationError(f"the cable slipped in a gripper by {quantity(slip)}, pulled too hard")
        world = self.task.scene.world
        cable = float(chain_distance(np.array(lines), world)[0].min()) - self.cable.radius
        return min(cable, deepest), self._clearance(np.array(poses), np.array(lines))

    def _clearance(self, poses: Float[np.ndarray, "t 2 7"], lines: Float[np.ndarray, "t v 3"]) -> float:
        """The least clearance [m] of grippers from obstacles and walls and, of their hulls, from the other gripper."""
        world, bodies = self.task.scene.world, self._bodies
        balls = signed_distance(bodies.points(poses), world)[0] - bodies.radius
        far = np.array([math.inf, math.inf, 0.0])
        hulls = bodies.hull_gaps(poses, lines, world, self.cable.length, far)[0][..., [WORLD, OTHER]]
        return min(float(balls.min()), float(hulls.min(initial=math.inf)))

    def _contact(self) -> float:
        """Distance [m] of the deepest contact of the cable with anything; infinite without one."""
        if not self._data.ncon:
            return math.inf
        touching = self._is_cable[self._data.contact.geom].any(axis=1)
        contact = self._data.contact
        return float((contact.dist - contact.includemargin)[touching].min()) if touching.any() else math.inf

    def _built(self) -> mujoco.MjModel:
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        option = spec.option
        option.timestep, option.integrator = self.config.time_step, mujoco.mjtIntegrator.mjINT_DISCRETE
        option.cone, option.solver = mujoco.mjtCone.mjCONE_ELLIPTIC, mujoco.mjtSolver.mjSOL_NEWTON
        option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        # the approximate diagonal makes the grasps of a long chain soft
        option.enableflags |= mujoco.mjtEnableBit.mjENBL_DIAGEXACT
        surface = {"condim": 3, "friction": [self.config.friction, 0.005, 0.0001], **CONTACT}
        self._chain.add(spec, contype=CABLE, conaffinity=SURROUNDINGS, **surface)
        last, share = self._chain.links - 1, self.cable.length / (2 * (self._chain.links - 1))
        for name, link, along in zip(NAMES, (0, last), (0.0, share), strict=True):
            add_free_gripper(spec, name)
            hold(spec, name, f"segment {link}", along, **HOLD)
        if self.task.bodies[2:]:
            self._add_hands(spec, contype=SURROUNDINGS, conaffinity=CABLE, **surface)
        add_spatial_scene(spec, self.task.scene, contype=SURROUNDINGS, conaffinity=CABLE, **surface)
        return spec.compile()

    def _add_hands(self, spec: mujoco.MjSpec, **surface: Any) -> None:
        """What grippers have beyond balls, on bodies of its own, since a cable may be held askew."""
        places = self._chain.joints[:-1] * self.cable.length
        for side, name in enumerate(NAMES):
            hand = spec.worldbody.add_body(name=f"{name} hand", mocap=True)
            pieces = [body for body in self.task.bodies[2:] if body.side == side]
            held = max(body.held_arc(self.cable.radius) for body in pieces)
            for index, body in enumerate(pieces):
                named: dict[str, Any] = {"name": f"{name} hand {index}", **surface}
                if len(body.points) > 1:
                    add_hull(spec, hand, body.points, margin=body.radius, **named)
                else:
                    size, at = [body.radius, 0.0, 0.0], body.points[0].tolist()
                    hand.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=size, pos=at, **named)
            for link in np.flatnonzero(places <= held).tolist():
                segment = link if side == LEFT else self._chain.links - 1 - link
                spec.add_exclude(bodyname1=hand.name, bodyname2=f"segment {segment}")


def nearest_start(task: SpatialTask, cable: SpatialCable, ends: Float[np.ndarray, "2 7"]) -> Float[np.ndarray, "12"]:
    """The stable shape of a cable between its ends whose keypoints are nearest to those of the task's start.

    Raises:
        SimulationError: There is none.
    """
    rod, keypoints = cable.rod, task.keypoints("start")
    try:
        found = meet_poses(rod, ends, task.start[None])
        found = found[rod.stability(found)[0] > 0] if len(found) else found
        found = found if len(found) else equilibria_at(rod, ends)
    except InputError:
        found = np.empty((0, 12))
    if not len(found):
        raise SimulationError("the cable has no stable shape between the grippers of the start")
    places = np.linspace(0, 1, len(keypoints))
    shapes = rod.shapes(found)[0]
    at = np.linspace(0, shapes.shape[1] - 1, len(places)).round().astype(int)
    return found[int(np.argmin(np.linalg.norm(shapes[:, at] - keypoints, axis=(1, 2))))]


def add_spatial_scene(spec: mujoco.MjSpec, scene: SpatialScene, **surface: Any) -> None:
    """Obstacles, walls, ceiling and table; what never ends goes as high as the ceiling."""
    world, top = spec.worldbody, scene.size[2]
    for index, obstacle in enumerate(scene.obstacles):
        named: dict[str, Any] = {"name": f"obstacle {index}", **surface}
        match obstacle:
            case Cuboid():
                size = [edge / 2 for edge in obstacle.size]
                at = {"pos": list(obstacle.center), "quat": list(obstacle.orientation)}
                world.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=size, **at, **named)
            case Cylinder():
                size, at = [obstacle.radius, obstacle.height / 2, 0.0], {"pos": list(obstacle.center)}
                kind = mujoco.mjtGeom.mjGEOM_CYLINDER
                world.add_geom(type=kind, size=size, zaxis=list(obstacle.axis), **at, **named)
            case Sphere():
                size, at = [obstacle.radius, 0.0, 0.0], {"pos": list(obstacle.center)}
                world.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=size, **at, **named)
            case ConvexMesh():
                add_hull(spec, world, obstacle.points, **named)
            case _:
                height = obstacle.section.height
                faces = (0.0, top if height is None else height)
                add_obstacle(spec, obstacle.section, faces, mujoco.mjtGeom.mjGEOM_CYLINDER, **named)
    for axis in range(3):
        inward = np.eye(3)[axis]
        for name, point, normal in (("low", np.zeros(3), inward), ("high", np.array(scene.size), -inward)):
            add_plane(spec, point.tolist(), normal.tolist(), name=f"wall {axis} {name}", **surface)
