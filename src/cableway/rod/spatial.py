"""Equilibria of an elastic rod in space, twisted and heavy, clamped at both ends, in coordinates of its centre.

The isotropic, inextensible rod has bending stiffness B, twisting stiffness C and length L. Forces are counted in B/L^2,
moments in B/L, lengths in L; then it is told by kappa = C/B and its weight gamma = rho A g L^3/B. As in the plane
(`cableway.rod.planar`) it is a chain of N hinges, N even, whose first and last link are half as long. Where B is not
the same everywhere, N is N e^b at a hinge below, with b as `cableway.rod.material` has it; C is the same everywhere.

Let n_c and m_c be force and moment at the middle of the centre link, and t_i the direction of link i. Going outward, ::

    n(s) = n_c + gamma s e_z,     m <- m - l t x n over a length l,     tau = m . t the same everywhere,
    m = N kb + tau (t + t')/(1 + t . t') at a hinge,    kb = 2 t x t'/(1 + t . t'),

with n at the middle of each link's piece. The hinge's equation has the closed solution ::

    t' = ((1 - |w|^2) t + 2 w)/(1 + |w|^2),    w = (tau (m - tau t) -+ 2N t x m)/(tau^2 + 4 N^2)

to the right (-) and to the left (+), so one pass without trigonometry gives an exact equilibrium of the energy ::

    -2N sum log((1 + t . t')/2) + kappa/2 Theta^2 + gamma sum l z,    Theta = tau/kappa.

Frames are carried along without twist (Bergou et al. 2008, "Discrete elastic rods"), and turned by -+ tau/(2 kappa) at
the ends. The coordinates are ::

    q = (c, v, n, m)      centre [m], rotation vector of its frame [rad], force and moment there in this frame [-, -]

and the frame's x axis is the tangent. A gripper's pose is its position and unit quaternion (w, x, y, z), x along the
cable. A *step* of q turns the frame about the world's axes; derivatives are by steps. The world's z points upward.

The stability margin is the least eigenvalue of N times the second variation of the energy less the load, in the two
turns of each inner link, under held ends: 4 pi^2 for the straight unloaded rod, as in the plane.

Note:
    Not in the paper (Tang et al.). The coordinates are those of Bretl & McCarthy 2014 at the centre, with weight.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError
from cableway.geometry import rotations
from cableway.geometry.groups import SE3, Group
from cableway.rod import material, spatial_kernels, spatial_stability
from cableway.rod.fitting import LOAD_UNITS
from cableway.rod.held_rod import HeldRod
from cableway.rod.material import GRAVITY
from cableway.rod.planar import hinge_count

LOAD_RANGE = (30.0, 30.0, 30.0, 4.0, 6.0, 6.0)
"""Largest force and moment of a first guess; stable shapes have about these."""

LARGEST_GUESS = 150.0
"""Largest load of a guess from keypoints."""


@dataclass(frozen=True)
class SpatialRod(HeldRod):
    """An inextensible rod in space with n keypoints, with coordinates q (12,).

    Attributes:
        length: L [m].
        keypoints: n, both ends included.
        twist: kappa = C/B, the twisting stiffness by the bending stiffness; 2/3 for a solid round rod whose material
            keeps its volume.
        weight: gamma = rho A g L^3/B, the weight by the force B/L^2.
        modes: b_k, k = 1, 2, ..., of the logarithm of the bending stiffness along the rod, as in the plane; none of a
            uniform rod. C is the same everywhere.
    """

    length: float
    keypoints: int = 13
    twist: float = 2 / 3
    weight: float = 0.0
    modes: tuple[float, ...] = ()
    group: ClassVar[type[Group]] = SE3

    def __post_init__(self) -> None:
        for name in ("length", "twist"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"rod {name} must be positive and finite, got {value!r}")
        if not (np.isfinite(self.weight) and self.weight >= 0):
            raise InputError(f"rod weight must be finite and not negative, got {self.weight!r}")
        if not np.isfinite(self.modes).all():
            raise InputError(f"the modes of a rod's stiffness must be finite, got {self.modes!r}")
        if self.keypoints < 3:
            raise InputError(f"a rod needs at least 3 keypoints, got {self.keypoints!r}")

    @classmethod
    def of_material(
        cls, length: float, bending_stiffness: float, linear_density: float, keypoints: int = 13, twist: float = 2 / 3
    ) -> SpatialRod:
        """The rod of a cable of this length [m], B [N m^2] and mass per length [kg/m].

        >>> round(SpatialRod.of_material(0.34, 1e-3, 0.047967).weight, 1)
        18.5
        """
        return cls(length, keypoints, twist, linear_density * GRAVITY * length**3 / bending_stiffness)

    @cached_property
    def arrays(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "N"]]:
        """Parameters and stiffness of the hinges as `cableway.rod.spatial_kernels` takes them."""
        return np.array([self.length, self.twist, self.weight]), self.stiffness

    @cached_property
    def stiffness(self) -> Float[np.ndarray, "N"]:
        """Bending stiffness of the hinges, by B/L."""
        count = self.hinges
        if not self.modes:
            return np.full(count, float(count))
        return count * np.exp(np.array(self.modes) @ material.modes(count, len(self.modes)))

    @property
    def dof(self) -> int:
        """See `HeldRod.dof`."""
        return 12

    @property
    def units(self) -> Float[np.ndarray, "12"]:
        """See `HeldRod.units`."""
        return np.array([*[self.length] * 3, *[1.0] * 3, *[LOAD_UNITS[0]] * 3, *[LOAD_UNITS[2]] * 3])

    @property
    def loads(self) -> slice:
        """See `HeldRod.loads`."""
        return slice(6, 12)

    @property
    def hinges(self) -> int:
        """N, the number of hinges: even, so that a link is in the middle."""
        count = hinge_count(self.keypoints, self.length, self.weight)
        return count + count % 2 * (self.keypoints - 1)

    @property
    def stride(self) -> int:
        """Stations from one keypoint to the next."""
        return 2 * self.hinges // (self.keypoints - 1)

    def shapes(self, q: Float[np.ndarray, "t 12"]) -> tuple[Float[np.ndarray, "t s 3"], Float[np.ndarray, "t 2 7"]]:
        """Stations [m] and gripper poses [m, 1] of each row of q."""
        stations, _, poses, _ = spatial_kernels.batch_shapes(_rows(q), *self.arrays, 0)
        return stations, poses

    def jacobians(
        self, q: Float[np.ndarray, "t 12"]
    ) -> tuple[
        Float[np.ndarray, "t s 3"],
        Float[np.ndarray, "t s 3 12"],
        Float[np.ndarray, "t 2 7"],
        Float[np.ndarray, "t 2 6 12"],
    ]:
        """Stations and gripper poses of each row of q, each followed by its derivative by steps of q."""
        return spatial_kernels.batch_shapes(_rows(q), *self.arrays, self.dof)

    def stability(
        self, q: Float[np.ndarray, "t 12"], ceiling: float = 1e9
    ) -> tuple[Float[np.ndarray, "t"], Float[np.ndarray, "t 12"]]:
        """Stability margin of each row of q, and its derivative by steps of q (central differences at a held mode).

        A margin above `ceiling` comes back as `ceiling` with derivative zero. Where the two least eigenvalues coincide,
        as on a straight rod, the derivative is that of one of them.
        """
        return spatial_stability.batch_stability(_rows(q), *self.arrays, float(ceiling), self.units)

    def retract(self, q: Float[np.ndarray, "... 12"], step: Float[np.ndarray, "... 12"]) -> Float[np.ndarray, "... 12"]:
        """See `HeldRod.retract`; the rotation vector runs on."""
        out = q + step
        turned = rotations.product(rotations.from_vector(step[..., 3:6]), rotations.from_vector(q[..., 3:6]))
        out[..., 3:6] = _running_on(rotations.to_vector(turned), q[..., 3:6])
        return out

    def difference(self, a: Float[np.ndarray, "... 12"], b: Float[np.ndarray, "... 12"]) -> Float[np.ndarray, "... 12"]:
        """See `HeldRod.difference`: turned the short way."""
        out = b - a
        back = rotations.conjugate(rotations.from_vector(a[..., 3:6]))
        out[..., 3:6] = rotations.to_vector(rotations.product(rotations.from_vector(b[..., 3:6]), back))
        return out

    def guesses(self, keypoints: Float[np.ndarray, "t n 3"]) -> Float[np.ndarray, "t 12"]:
        """See `HeldRod.guesses`: from the bends of the polyline, which are linear in force and moment.

        The frame's second axis is level; keypoints do not say how the rod is rolled.
        """
        n = keypoints.shape[1]
        steps = np.diff(keypoints, axis=1)
        t = steps / np.maximum(np.linalg.norm(steps, axis=2, keepdims=True), 1e-12)
        before, after = t[:, :-1], t[:, 1:]
        bends = 2 * (n - 1) * np.cross(before, after) / np.maximum(1 + np.sum(before * after, 2, keepdims=True), 0.05)
        centre = (keypoints[:, (n - 1) // 2] + keypoints[:, n // 2]) / 2
        lever = (keypoints[:, 1:-1] - centre[:, None]) / self.length
        across = (
            np.eye(3)
            - np.einsum("tij,tik->tijk", before + after, before + after)
            / np.maximum(np.sum((before + after) ** 2, 2), 0.05)[..., None, None]
        )
        # m - (p - c) x n - gamma (integral of s t) x e_z, as far as it is across the rod, is the bend
        rows = np.concatenate([-across @ _crossing(lever), across], axis=3).reshape(len(keypoints), -1, 6)
        hanging = np.einsum("tijk,tik->tij", across, self._moments_of_weight(keypoints))
        normal = rows.swapaxes(1, 2) @ rows + 0.03**2 * np.eye(6)
        load = np.linalg.solve(normal, rows.swapaxes(1, 2) @ (bends + hanging).reshape(len(keypoints), -1, 1))
        frames = _level_frames(t[:, (n - 2) // 2] + t[:, (n - 1) // 2])
        vectors = rotations.to_vector(rotations.from_matrices(frames))
        own = (frames.swapaxes(1, 2)[:, None] @ load.reshape(-1, 2, 3, 1)).reshape(-1, 6)
        return np.column_stack([centre, vectors, np.clip(own, -LARGEST_GUESS, LARGEST_GUESS)])

    def _moments_of_weight(self, keypoints: Float[np.ndarray, "t n 3"]) -> Float[np.ndarray, "t k 3"]:
        """gamma (integral of s t from the centre) x e_z at each inner keypoint."""
        n = keypoints.shape[1]
        steps, s = np.diff(keypoints, axis=1) / self.length, (np.arange(n - 1) + 0.5) / (n - 1) - 0.5
        sums = np.concatenate([np.zeros((len(keypoints), 1, 3)), np.cumsum(s[:, None] * steps, axis=1)], axis=1)
        sums -= (sums[:, [(n - 1) // 2]] + sums[:, [n // 2]]) / 2
        return self.weight * np.cross(sums[:, 1:-1], [0.0, 0.0, 1.0])

    def guesses_between(self, poses: Float[np.ndarray, "2 7"], count: int) -> Float[np.ndarray, "k 12"]:
        """See `HeldRod.guesses_between`: the loads of a low-discrepancy sequence after none, as in the plane, in six
        numbers, each shape turned so that its chord and its ends' frames lie about those of the grippers."""
        root = max(np.roots([1, 0, 0, 0, 0, 0, -1, -1]).real)  # g^7 = 1 + g
        unit = (0.5 + np.arange(count)[:, None] / root ** np.arange(1, 7)) % 1.0
        q = np.zeros((count, self.dof))
        q[1:, 6:] = ((2 * unit - 1) * LOAD_RANGE)[1:]
        wanted = _pointers(poses[None], self.length)
        for _ in range(2):  # where there is weight, the shape changes as it is turned
            found = _pointers(self.end_poses(q), self.length)
            u, _, vt = np.linalg.svd(wanted.swapaxes(1, 2) @ found)
            u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
            q = self.retract(q, np.pad(rotations.to_vector(rotations.from_matrices(u @ vt)), ((0, 0), (3, 6))))
        q[:, :3] += poses[:, :3].mean(0) - self.end_poses(q)[:, :, :3].mean(1)
        return q

    def continued(self, q: Float[np.ndarray, "12"], poses: Float[np.ndarray, "2 7"]) -> Float[np.ndarray, "12"]:
        """See `HeldRod.continued`: quaternions tell no full turns apart, so `q` as it is."""
        return q.copy()

    def written_near(self, q: Float[np.ndarray, "12"], near: Float[np.ndarray, "12"]) -> Float[np.ndarray, "12"]:
        """See `HeldRod.written_near`."""
        return np.concatenate([q[:3], _running_on(q[3:6], near[3:6]), q[6:]])

    def energy(self, q: Float[np.ndarray, "t 12"]) -> Float[np.ndarray, "t"]:
        """Energy of bending, twist and weight in units of B/L; heights are from the middle between the grippers."""
        stations, poses = self.shapes(q)
        corners = np.concatenate([stations[:, :1], stations[:, 1::2], stations[:, -1:]], axis=1)
        links = np.diff(corners, axis=1)
        lengths = np.linalg.norm(links, axis=2)
        t = links / lengths[..., None]
        bending = -2 * np.sum(self.stiffness * np.log((1 + np.sum(t[:, :-1] * t[:, 1:], axis=2)) / 2), axis=1)
        heights = (corners[:, 1:, 2] + corners[:, :-1, 2]) / 2 - poses[:, :, 2].mean(1)[:, None]
        hanging = self.weight * np.sum(lengths * heights, axis=1) / self.length**2
        return bending + q[:, 9] ** 2 / (2 * self.twist) + hanging

    def passes_through_itself(self, stations: Float[np.ndarray, "s 3"]) -> bool:
        """See `HeldRod.passes_through_itself`: lines in space do so by chance alone."""
        return False


def _rows(q: Float[np.ndarray, "t 12"]) -> Float[np.ndarray, "t 12"]:
    rows = np.ascontiguousarray(q, dtype=float)
    if rows.ndim != 2 or rows.shape[1] != 12:
        raise InputError(f"coordinates of a rod in space must have shape (t, 12), got {rows.shape}")
    return rows


def _running_on(v: Float[np.ndarray, "... 3"], near: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
    """The rotation vectors of the same rotations that are nearest to others."""
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    size = np.linalg.norm(near, axis=-1, keepdims=True)
    axis = np.where(angle > 1e-9, v / np.maximum(angle, 1e-9), near / np.maximum(size, 1e-9))
    turns = np.round((np.sum(axis * near, axis=-1, keepdims=True) - angle) / (2 * np.pi))
    return v + 2 * np.pi * turns * axis


def _crossing(v: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3 3"]:
    """The matrices [v] with [v] w = v x w."""
    return np.swapaxes(np.cross(v[..., None, :], np.eye(3)), -1, -2)


def _level_frames(tangents: Float[np.ndarray, "t 3"]) -> Float[np.ndarray, "t 3 3"]:
    """Frames, as columns, with these first axes and a level second one."""
    first = tangents / np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-12)
    second = np.cross([0.0, 0.0, 1.0], first)
    size = np.linalg.norm(second, axis=1, keepdims=True)
    second = np.where(size > 1e-6, second / np.maximum(size, 1e-6), [0.0, 1.0, 0.0])
    return np.stack([first, second, np.cross(first, second)], axis=2)


def _pointers(poses: Float[np.ndarray, "t 2 7"], length: float) -> Float[np.ndarray, "t 7 3"]:
    """Directions that turn with the poses of two ends: three times their chord, in lengths, and the axes of both."""
    axes = rotations.matrices(poses[..., 3:]).swapaxes(-1, -2).reshape(len(poses), 6, 3)
    chord = 3 * (poses[:, [1], :3] - poses[:, [0], :3]) / length
    return np.concatenate([chord, axes], axis=1)
