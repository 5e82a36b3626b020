"""The simulated cable: a planar chain of hinges in MuJoCo, held at both ends, among the obstacles of a scene.

The chain is that of `cableway.rod.equilibrium`: N hinges at spacing L/N, N + 1 links of which the first and last are
half as long. Hinge stiffness is k = EI N/L and hinge damping tau k, so that the chain bends like a rod of stiffness
EI and creeps with time constant tau. The first link carries two slides and a hinge; both end links are welded to
bodies without dynamics, the grippers, whose poses are prescribed at every time step.

The plane is z = 0 with no gravity in it. A capsule of the cable's radius covers each link; capsules meet obstacles and
walls, not each other. A disc is a sphere about z = 0 and a wall a half space, for which MuJoCo's contacts are exact;
a box is a box and a polygon a convex mesh, both `HALF_HEIGHT` high, enough that the way out is always in the plane.

Note:
    Simulator and contact are ours; the paper (Tang et al.) simulates without contact between cable and obstacles.
"""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float
from mujoco import batch

from cableway.errors import InputError, SimulationError
from cableway.rod.equilibrium import Rod
from cableway.scene.cable import Cable
from cableway.scene.obstacles import Box, Disc, Obstacle, Polygon
from cableway.scene.scene import Scene

HALF_HEIGHT = 0.1
"""Half height of boxes and polygons [m]: far more than any penetration, so that no contact points out of the plane."""

GRASP_TIME_CONSTANT = 0.05
"""Time constant of the welds in time steps: as good as rigid, and stable under the `discrete` integrator."""

GRASP_IMPEDANCE = (0.99, 0.9999)
"""Least and greatest impedance of the welds."""

CONTACT_IMPEDANCE = (0.99, 0.999)
"""Least and greatest impedance of contacts, whose time constant is one time step."""

_GRIPPER_INPUT = mujoco.mjtState.mjSTATE_MOCAP_POS | mujoco.mjtState.mjSTATE_MOCAP_QUAT


class Chain:
    """One chain in MuJoCo, moved by prescribing its gripper poses.

    Args:
        cable: The cable.
        scene: Workspace and obstacles it can touch, or None for open space without walls.
        time_step: [s].
    """

    def __init__(self, cable: Cable, scene: Scene | None, time_step: float) -> None:
        self.cable = cable
        self.rod: Rod = cable.rod
        self.model = build_spec(cable, scene, time_step).compile()
        self._batch = batch.Batch(self.model, nsim=1, nthread=1)
        lengths = link_lengths(self.rod)
        self._lengths = lengths
        self._keypoint_links = np.arange(1, cable.keypoints - 1) * self.rod.hinges // (cable.keypoints - 1)

    def place(self, q: Float[np.ndarray, "6"]) -> None:
        """Lay the chain at rest into the equilibrium q, the grippers at its ends."""
        coordinates, poses = self.equilibrium(q)
        self._batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        self._batch.bind("qpos")[0] = coordinates
        self._batch.bind("mocap_pos")[0], self._batch.bind("mocap_quat")[0] = _gripper_bodies(poses)

    def equilibrium(self, q: Float[np.ndarray, "6"]) -> tuple[Float[np.ndarray, "c"], Float[np.ndarray, "2 3"]]:
        """Chain coordinates (x, y, angle of the first link, then the bend at each hinge) and gripper poses of q."""
        stations, poses = self.rod.shapes(q[None])
        links = np.diff(stations[0, 1::2], axis=0)
        angles = np.concatenate([[poses[0, 0, 2]], np.arctan2(links[:, 1], links[:, 0]), [poses[0, 1, 2]]])
        angles[:-1] = np.unwrap(angles[:-1])
        bends = np.diff(angles)
        bends[-1] -= 2 * np.pi * np.round(bends[-1] / (2 * np.pi))
        return np.concatenate([poses[0, 0], bends]), poses[0]

    def advance(self, poses: Float[np.ndarray, "k 2 3"]) -> Float[np.ndarray, "k c"]:
        """Take one time step towards each of the gripper poses in turn.

        Args:
            poses: Gripper poses [m, m, rad] at the end of each time step.

        Returns:
            Chain coordinates after each time step.

        Raises:
            SimulationError: MuJoCo gave up or the state grew out of bounds.
        """
        positions, quaternions = _gripper_bodies(poses)
        control = np.concatenate([positions.reshape(len(poses), 6), quaternions.reshape(len(poses), 8)], axis=1)
        self._batch.warning[:] = 0
        try:
            record = self._batch.rollout(len(poses), control[None], control_spec=int(_GRIPPER_INPUT), record=("qpos",))
        except batch.SimulationError as error:
            raise SimulationError(f"the simulation stopped: {error}") from None
        coordinates = record["qpos"][0]
        if self._batch.warning.any() or not np.isfinite(coordinates).all():
            raise SimulationError("the simulation diverged: MuJoCo warns of a bad state")
        return coordinates

    @property
    def coordinates(self) -> Float[np.ndarray, "c"]:
        """A copy of the present chain coordinates."""
        return self._batch.bind("qpos")[0].copy()

    def polylines(self, coordinates: Float[np.ndarray, "k c"]) -> Float[np.ndarray, "k v 2"]:
        """The chain's vertices [m]: left end, hinges, right end."""
        return chain_polylines(coordinates, self._lengths)

    def end_poses(self, coordinates: Float[np.ndarray, "k c"]) -> Float[np.ndarray, "k 2 3"]:
        """Poses [m, m, rad] of the cable's ends; the angles run on without jumps."""
        right = np.concatenate([self.polylines(coordinates)[:, -1], coordinates[:, 2:].sum(1)[:, None]], axis=1)
        return np.stack([coordinates[:, :3], right], axis=1)

    def keypoints(self, polylines: Float[np.ndarray, "k v 2"]) -> Float[np.ndarray, "k n 2"]:
        """The n points at equal arc length: both ends, and middles of links between them."""
        j = self._keypoint_links
        inner = 0.5 * (polylines[:, j] + polylines[:, j + 1])
        return np.concatenate([polylines[:, :1], inner, polylines[:, -1:]], axis=1)

    def save(self) -> Float[np.ndarray, "s"]:
        """A copy of MuJoCo's whole integration state: time, positions, velocities, warm start, gripper poses."""
        return self._batch.state[0].copy()

    def restore(self, state: Float[np.ndarray, "s"]) -> None:
        """Go back to a state of `save`; what follows is the same bit for bit.

        Raises:
            InputError: The state is that of another model.
        """
        if np.shape(state) != self._batch.state[0].shape:
            raise InputError(f"the state has shape {np.shape(state)}, this model's {self._batch.state[0].shape}")
        self._batch.state[0] = state


def link_lengths(rod: Rod) -> Float[np.ndarray, "N+1"]:
    """Lengths [m] of the N + 1 links."""
    lengths = np.full(rod.hinges + 1, rod.length / rod.hinges)
    lengths[[0, -1]] /= 2
    return lengths


def chain_polylines(
    coordinates: Float[np.ndarray, "k c"], lengths: Float[np.ndarray, "N+1"]
) -> Float[np.ndarray, "k N+2 2"]:
    """Vertices of chains from their coordinates (x, y, angle of the first link, bends)."""
    angles = np.cumsum(coordinates[:, 2:], axis=1)
    steps = lengths[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    start = coordinates[:, None, :2]
    return np.concatenate([start, start + np.cumsum(steps, axis=1)], axis=1)


def _gripper_bodies(
    poses: Float[np.ndarray, "... 2 3"],
) -> tuple[Float[np.ndarray, "... 2 3"], Float[np.ndarray, "... 2 4"]]:
    """Positions and quaternions of planar poses."""
    positions = np.array(poses, dtype=float)
    half = positions[..., 2] / 2
    zero = np.zeros_like(half)
    positions[..., 2] = 0.0
    return positions, np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1)


# ------------------------------------------------------------------------------------------------ the model
def build_spec(cable: Cable, scene: Scene | None, time_step: float) -> mujoco.MjSpec:
    """The MuJoCo specification of a cable in a scene."""
    spec = mujoco.MjSpec()
    option = spec.option
    option.timestep = time_step
    option.gravity = [0.0, 0.0, 0.0]
    option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.tolerance = 1e-10
    # with the approximate diagonal the welds give: 18 mrad of slip instead of 0.01
    option.enableflags |= mujoco.mjtEnableBit.mjENBL_DIAGEXACT
    # a state out of bounds must be seen, not silently replaced by the initial one; islands only cost time here
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET | mujoco.mjtDisableBit.mjDSBL_ISLAND
    spec.compiler.degree = False
    _add_links(spec, cable, time_step)
    _add_grippers(spec, cable, time_step)
    if scene is not None:
        for index, obstacle in enumerate(scene.obstacles):
            _add_obstacle(spec, f"obstacle {index}", obstacle)
        _add_walls(spec, scene)
    return spec


def _add_links(spec: mujoco.MjSpec, cable: Cable, time_step: float) -> None:
    lengths = link_lengths(cable.rod)
    stiffness = cable.bending_stiffness * cable.rod.hinges / cable.length
    body, offset = spec.worldbody, 0.0
    for index, length in enumerate(lengths):
        body = body.add_body(name=f"link {index}", pos=[offset, 0.0, 0.0])
        if index == 0:
            for name, axis in (("x", [1.0, 0.0, 0.0]), ("y", [0.0, 1.0, 0.0])):
                body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        hinge = body.add_joint(name=f"hinge {index}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 0.0, 1.0])
        if index > 0:
            hinge.stiffness[0] = stiffness
            hinge.damping[0] = cable.damping_time * stiffness
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[0.0, 0.0, 0.0, length, 0.0, 0.0],
            size=[cable.radius, 0.0, 0.0],
            mass=cable.linear_density * length,
            contype=1,
            conaffinity=0,
            condim=1,
            solref=[time_step, 1.0],
            solimp=[*CONTACT_IMPEDANCE, 0.001, 0.5, 2.0],
            priority=1,
        )
        offset = length


def _add_grippers(spec: mujoco.MjSpec, cable: Cable, time_step: float) -> None:
    last = cable.rod.hinges
    ends = (("left gripper", 0, 0.0), ("right gripper", last, float(link_lengths(cable.rod)[-1])))
    for name, link, along in ends:
        spec.worldbody.add_body(name=name, mocap=True)
        weld = spec.add_equality(
            type=mujoco.mjtEq.mjEQ_WELD,
            objtype=mujoco.mjtObj.mjOBJ_BODY,
            name1=f"link {link}",
            name2=name,
            solref=[GRASP_TIME_CONSTANT * time_step, 1.0],
            solimp=[*GRASP_IMPEDANCE, 0.001, 0.5, 2.0],
        )
        # anchor in the gripper, position and quaternion of the gripper in the link, torque scale
        weld.data = [0.0, 0.0, 0.0, along, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]


def _add_obstacle(spec: mujoco.MjSpec, name: str, obstacle: Obstacle) -> None:
    common = {"name": name, "contype": 0, "conaffinity": 1, "condim": 1}
    if isinstance(obstacle, Disc):
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            pos=[*obstacle.center, 0.0],
            size=[obstacle.radius, 0.0, 0.0],
            **common,
        )
    elif isinstance(obstacle, Box):
        half = obstacle.angle / 2
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[*obstacle.center, 0.0],
            quat=[np.cos(half), 0.0, 0.0, np.sin(half)],
            size=[obstacle.size[0] / 2, obstacle.size[1] / 2, HALF_HEIGHT],
            **common,
        )
    elif isinstance(obstacle, Polygon):
        spec.add_mesh(name=name, uservert=_prism(obstacle.vertices).ravel().tolist())
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, **common)


def _prism(vertices: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "2k 3"]:
    low, high = (np.column_stack([vertices, np.full(len(vertices), z)]) for z in (-HALF_HEIGHT, HALF_HEIGHT))
    return np.vstack([low, high])


def _add_walls(spec: mujoco.MjSpec, scene: Scene) -> None:
    width, height = scene.size
    walls = (
        ("left wall", (0.0, 0.0), (1.0, 0.0)),
        ("bottom wall", (0.0, 0.0), (0.0, 1.0)),
        ("right wall", (width, height), (-1.0, 0.0)),
        ("top wall", (width, height), (0.0, -1.0)),
    )
    for name, point, inward in walls:
        spec.worldbody.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            pos=[*point, 0.0],
            zaxis=[*inward, 0.0],
            size=[1.0, 1.0, 1.0],
            contype=0,
            conaffinity=1,
            condim=1,
        )
