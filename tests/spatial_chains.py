"""A heavy cable in space as a chain of links on ball joints in MuJoCo: what the rod in space is checked against."""

from __future__ import annotations

import mujoco
import numpy as np

from cableway.geometry import rotations
from cableway.rod.spatial import SpatialRod
from cableway.rod.spatial_kernels import walk

STIFFNESS = 1e-3
"""B [N m^2]; the joints bend and twist alike, so C = B."""


def frames_of(rod: SpatialRod, q: np.ndarray) -> np.ndarray:
    """Orientations (N + 1, 4) of all links, with the twist spread over the hinges."""
    p, count = rod.arrays
    frames, points = np.empty((count + 1, 2, 3)), np.empty((2 * count + 1, 3))
    empty = np.empty((2 * count + 1, 0, 3)), np.empty((2, 0, 3))
    walk(q, p, count, points, empty[0], frames, np.empty((2, 2, 3)), empty[1])
    axes = np.stack([frames[:, 0], frames[:, 1], np.cross(frames[:, 0], frames[:, 1])], axis=2)
    twist = q[9] / rod.twist * (np.arange(count + 1) / count - 0.5)
    about = rotations.from_vector(np.column_stack([twist, 0 * twist, 0 * twist]))
    return rotations.product(rotations.from_matrices(axes), about)


class Chain:
    """The chain of one rod, at rest in the shape of q (12,), with its last link held by a weld."""

    def __init__(self, rod: SpatialRod, q: np.ndarray, step: float = 0.002) -> None:
        count, link = rod.hinges, rod.length / rod.hinges
        density = rod.weight * STIFFNESS / (9.81 * rod.length**3)
        poses = rod.end_poses(q[None])[0]
        spec = mujoco.MjSpec()
        spec.option.timestep, spec.option.integrator = step, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        body = spec.worldbody
        for i in range(count + 1):
            length = link / 2 if i in (0, count) else link
            before = 0.0 if i == 0 else link / 2 if i == 1 else link
            place = poses[0, :3] if i == 0 else [before, 0, 0]
            body = body.add_body(name=f"link{i}", pos=place, quat=poses[0, 3:] if i == 0 else [1, 0, 0, 0])
            if i:
                body.add_joint(type=mujoco.mjtJoint.mjJNT_BALL, stiffness=count * STIFFNESS / rod.length, damping=2e-3)
            mass, thick = max(density, 1e-3) * length, 1e-6
            body.explicitinertial, body.mass, body.ipos = True, mass, [length / 2, 0, 0]
            body.inertia = [thick, max(mass * length**2 / 12, thick), max(mass * length**2 / 12, thick)]
            body.gravcomp = 0.0 if rod.weight > 0 else 1.0
        hold = spec.worldbody.add_body(name="hold", mocap=True, pos=poses[1, :3], quat=poses[1, 3:])
        weld = spec.add_equality(type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY)
        weld.name1, weld.name2 = hold.name, f"link{count}"
        weld.data = [link / 2, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0]  # anchor in the link, and in the hold
        weld.solref, weld.solimp = [2 * step, 1], [0.99, 0.9999, 0.001, 0.5, 2]
        self._model, self._rod = spec.compile(), rod
        self.data = mujoco.MjData(self._model)
        frames = frames_of(rod, q)
        self.data.qpos[:] = rotations.product(rotations.conjugate(frames[:-1]), frames[1:]).ravel()

    def settle(self, seconds: float, kick: float, rng: np.random.Generator) -> np.ndarray:
        """Hinges (N, 3) [m] after a kick of the joints [rad/s] and some seconds."""
        self.data.qvel[:] = kick * rng.normal(size=self._model.nv)
        for _ in range(round(seconds / self._model.opt.timestep)):
            mujoco.mj_step(self._model, self.data)
        return self.data.xpos[2 : self._rod.hinges + 2].copy()

    def lead_to(self, pose: np.ndarray) -> None:
        """Turn the right gripper to a pose (7,) at once."""
        self.data.mocap_pos[0], self.data.mocap_quat[0] = pose[:3], pose[3:]
