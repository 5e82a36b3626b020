"""One simulated cable, moved by prescribing its gripper poses at every time step.

Chain coordinates (N + 3) are those of `cableway.simulation.model`. The centreline is the polyline from the left end
over the hinges to the right end, N + 2 vertices.
"""

# MuJoCo's bindings are compiled and carry no type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math

import mujoco
import numpy as np
from jaxtyping import Float
from mujoco import batch

from cableway.core.errors import InputError, SimulationError
from cableway.rod.planar import PlanarRod
from cableway.scene.cable import Cable
from cableway.scene.scene import Scene
from cableway.simulation.links import link_lengths, middle_link
from cableway.simulation.model import build_model
from cableway.simulation.surroundings import collected_warnings, gripper_bodies

SETTLED = 1e-6
"""Motion [m] of the centreline in `SETTLING_BLOCK` below which a cable counts as at rest."""

SETTLING_BLOCK = 0.1
"""[s]."""

LONGEST_SETTLING = 60.0
"""Time [s] after which a cable that does not come to rest is given up."""

_GRIPPER_INPUT = int(mujoco.mjtState.mjSTATE_MOCAP_POS | mujoco.mjtState.mjSTATE_MOCAP_QUAT)


class Chain:
    """A cable in a scene, simulated.

    Args:
        cable: The cable.
        scene: Workspace and obstacles that it can touch, or None for open space without walls.
        time_step: [s].
    """

    def __init__(self, cable: Cable, scene: Scene | None, time_step: float) -> None:
        self.rod = cable.rod
        self._block = math.ceil(SETTLING_BLOCK / time_step)
        self._settles = not cable.bends_as_rod
        self.model = build_model(cable, scene, time_step)
        self._batch = batch.Batch(self.model, nsim=1, nthread=1)
        self._initial = self.save()
        self._lengths = link_lengths(self.rod)

    def place(self, q: Float[np.ndarray, "6"]) -> Float[np.ndarray, "2 3"]:
        """Lay the chain into the equilibrium q of its uniform rod and return the gripper poses [m, m, rad] there.

        It is then at rest: a cable that does not bend as the rod does is first let settle between the grippers.

        Raises:
            SimulationError: It does not come to rest.
        """
        poses = self.rod.shapes(q[None])[1][0]
        self.restore(self._initial)
        self._batch.bind("qpos")[0] = chain_coordinates(self.rod, q)
        self._batch.bind("mocap_pos")[0], self._batch.bind("mocap_quat")[0] = gripper_bodies(poses)
        if self._settles:
            self._settle(poses)
        return poses

    def _settle(self, poses: Float[np.ndarray, "2 3"]) -> None:
        path = np.repeat(poses[None], self._block, axis=0)
        for _ in range(math.ceil(LONGEST_SETTLING / SETTLING_BLOCK)):
            rows = self.polylines(np.concatenate([self.coordinates[None], self.advance(path)]))
            if np.abs(rows - rows[-1]).max() < SETTLED:
                self._batch.bind("qvel")[0] = 0.0
                return
        raise SimulationError(f"the cable did not come to rest within {LONGEST_SETTLING:g} s between still grippers")

    def advance(self, poses: Float[np.ndarray, "k 2 3"]) -> Float[np.ndarray, "k c"]:
        """Take one time step towards each of the gripper poses in turn.

        Args:
            poses: Gripper poses [m, m, rad] at the end of each time step.

        Returns:
            Chain coordinates after each time step.

        Raises:
            SimulationError: MuJoCo gave up, or a state is not finite or out of bounds.
        """
        positions, quaternions = gripper_bodies(poses)
        inputs = np.concatenate([positions.reshape(len(poses), 6), quaternions.reshape(len(poses), 8)], axis=1)
        self._batch.warning[:] = 0
        with collected_warnings() as messages:
            try:
                record = self._batch.rollout(len(poses), inputs[None], _GRIPPER_INPUT, ("qpos",))
            except batch.SimulationError as error:
                raise SimulationError(f"the simulation stopped: {error}") from None
        coordinates = record["qpos"][0]
        if self._batch.warning.any() or not np.isfinite(coordinates).all():
            raise SimulationError(f"the simulation diverged: {' '.join(messages[:1]) or 'a state is not finite'}")
        return coordinates

    @property
    def coordinates(self) -> Float[np.ndarray, "c"]:
        """A copy of the present chain coordinates."""
        return self._batch.bind("qpos")[0].copy()

    def save(self) -> Float[np.ndarray, "s"]:
        """A copy of MuJoCo's whole integration state: time, positions, velocities, set, gripper poses."""
        return self._batch.state[0].copy()

    def restore(self, state: Float[np.ndarray, "s"]) -> None:
        """Go back to a state of `save`; what follows is the same bit for bit.

        Raises:
            InputError: The state is that of another model.
        """
        if np.shape(state) != self._batch.state[0].shape:
            raise InputError(f"the state has shape {np.shape(state)}, this model's {self._batch.state[0].shape}")
        self._batch.state[0] = state

    def polylines(self, coordinates: Float[np.ndarray, "k c"]) -> Float[np.ndarray, "k v 2"]:
        """The centreline [m] for each row of chain coordinates."""
        angles = self.link_angles(coordinates)
        lines = np.zeros((len(angles), len(self._lengths) + 1, 2))
        np.cumsum(self._lengths * np.cos(angles), axis=1, out=lines[:, 1:, 0])
        np.cumsum(self._lengths * np.sin(angles), axis=1, out=lines[:, 1:, 1])
        lines += (coordinates[:, :2] - lines[:, middle_link(self.rod)])[:, None]
        return lines

    def link_angles(self, coordinates: Float[np.ndarray, "k c"]) -> Float[np.ndarray, "k links"]:
        """Angle [rad] of each link from left to right; they run on without jumps."""
        right = len(self._lengths) - middle_link(self.rod)
        outward = np.cumsum(coordinates[:, 2 : 2 + right], axis=1)
        left = coordinates[:, 2:3] + np.cumsum(coordinates[:, 2 + right :], axis=1)
        return np.concatenate([left[:, ::-1], outward], axis=1)

    def end_poses(
        self, coordinates: Float[np.ndarray, "k c"], polylines: Float[np.ndarray, "k v 2"]
    ) -> Float[np.ndarray, "k 2 3"]:
        """Poses [m, m, rad] of the cable's ends, its centrelines being `polylines`; the angles run on without jumps."""
        right = 2 + len(self._lengths) - middle_link(self.rod)
        poses = np.empty((len(coordinates), 2, 3))
        poses[..., :2] = polylines[:, [0, -1]]
        poses[:, 0, 2] = coordinates[:, 2] + coordinates[:, right:].sum(axis=1)
        poses[:, 1, 2] = coordinates[:, 2:right].sum(axis=1)
        return poses

    def keypoints(self, polylines: Float[np.ndarray, "k v 2"]) -> Float[np.ndarray, "k n 2"]:
        """The n points at equal arc length along centrelines: both ends, and middles of links between them."""
        n = self.rod.keypoints
        links = np.arange(1, n - 1) * self.rod.hinges // (n - 1)
        inner = 0.5 * (polylines[:, links] + polylines[:, links + 1])
        return np.concatenate([polylines[:, :1], inner, polylines[:, -1:]], axis=1)


def chain_coordinates(rod: PlanarRod, q: Float[np.ndarray, "6"]) -> Float[np.ndarray, "c"]:
    """Chain coordinates of the equilibrium q."""
    stations, poses = rod.shapes(q[None])
    links = np.diff(stations[0, 1::2], axis=0)
    angles = np.concatenate([poses[0, :1, 2], np.arctan2(links[:, 1], links[:, 0]), poses[0, 1:, 2]])
    # no hinge bends by half a turn: the shape would be far from a rod's
    bends = np.diff(angles)
    bends -= 2 * np.pi * np.round(bends / (2 * np.pi))
    middle = middle_link(rod)
    angle = angles[0] + bends[:middle].sum()
    return np.concatenate([stations[0, 2 * middle - 1], [angle], bends[middle:], -bends[:middle][::-1]])
