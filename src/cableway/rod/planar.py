"""Equilibria of a planar elastic rod clamped at both ends, in coordinates of its centre.

The uniform rod of length L is a chain of N hinges at spacing L/N, so N + 1 links of which the first and last are half
as long. A rod under no load but at its ends carries one force F along its whole length, and the moment at a point p
is M + F x (p - c), c the rod's centre. With a = F L^2/EI (in the frame of the centre) and m = M L/EI the bend at
hinge j is ::

    phi_j = (m + a x (p_j - c)/L) / N,

and going outward from the centre link gives the whole shape without solving anything (Bretl & McCarthy 2014,
"Quasi-static manipulation of a Kirchhoff elastic rod based on a geometric analysis of equilibrium configurations",
here for a planar chain). So ::

    q = (c_x, c_y, theta_c, a_x, a_y, m)      [m, m, rad, -, -, -]

holds a shape and the gripper poses that make it, for any EI, and every q is an equilibrium. Whether the rod stays
there is a matter of the stability margin mu: the least eigenvalue of N^2 tridiag(-1, 2, -1) + diag(a . e_i) on the
changes of the free link angles that keep the ends in place (e_i: direction of link i). mu = 4 pi^2 for a straight
unloaded rod; where mu < 0 the rod moves away. Rods that are stiffer at one place or curved at rest
(`cableway.rod.material`) have other bends phi_j, and their stiffness in mu.

Stations are the 2N + 1 points at equal arc length L/(2N): even ones are link middles and ends, odd ones hinges.
Keypoints are every 2N/(n - 1)-th station.

Note:
    Not in the paper (Tang et al.), whose planned shapes need not be shapes a cable takes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError
from cableway.geometry import polyline, se2
from cableway.geometry.groups import SE2, Group
from cableway.rod import fitting, kernels, material
from cableway.rod.held_rod import HeldRod

STRAIGHT_STABILITY = 4 * np.pi**2
"""Stability margin of the straight unloaded rod, the largest scale to compare margins with."""

LEAST_HINGES = 24
"""Hinges of a rod of up to `LONGEST_COARSE` [m]."""

LONGEST_COARSE = 0.5

LOAD_RANGE = (30.0, 30.0, 6.0)
"""Largest |a_x|, |a_y|, |m| of a first guess, beside the turn between the grippers: stable shapes have about these."""


HEAVIEST_COARSE = 100.0
"""Weight gamma above which a rod in space has more: it bends most within sqrt(2 / gamma) L of its ends."""


def hinge_count(keypoints: int, length: float = LONGEST_COARSE, weight: float = 0.0) -> int:
    """Number N of hinges for n keypoints: a multiple of n - 1, at least 24, and more for a long or heavy rod.

    A chain is off its rod by an amount that goes with L / N^2, and with gamma.

    >>> hinge_count(13), hinge_count(10), hinge_count(25, 1.2), hinge_count(13, 0.5, 240.0)
    (24, 27, 48, 48)
    """
    finer = max(1.0, length / LONGEST_COARSE) * max(1.0, weight / HEAVIEST_COARSE)
    least = math.ceil(LEAST_HINGES * math.sqrt(finer))
    return (keypoints - 1) * -(-least // (keypoints - 1))


@dataclass(frozen=True)
class PlanarRod(HeldRod):
    """An inextensible planar rod with n keypoints, with coordinates q (6,).

    Attributes:
        length: L [m].
        keypoints: n, both ends included.
        modes: (b_1..b_K, r_1..r_K) of its stiffness and of its turn at rest, see `cableway.rod.material`; none where it
            is uniform.
    """

    length: float
    keypoints: int = 13
    modes: tuple[float, ...] = ()
    group: ClassVar[type[Group]] = SE2

    def __post_init__(self) -> None:
        if not (np.isfinite(self.length) and self.length > 0):
            raise InputError(f"rod length must be positive and finite, got {self.length!r}")
        if self.keypoints < 3:
            raise InputError(f"a rod needs at least 3 keypoints, got {self.keypoints!r}")
        if len(self.modes) not in (0, 2 * material.MODES) or not np.isfinite(self.modes).all():
            raise InputError(f"a rod has no modes or {2 * material.MODES} finite ones, got {self.modes!r}")

    @cached_property
    def arrays(self) -> tuple[Float[np.ndarray, "p"], Float[np.ndarray, "K N"]]:
        """Parameters and modes as `cableway.rod.kernels` takes them."""
        if not self.modes:
            return kernels.uniform(self.length, self.hinges)
        return np.array([self.length, *self.modes]), material.modes(self.hinges)

    @cached_property
    def bending(self) -> tuple[Float[np.ndarray, "N"], Float[np.ndarray, "N"]]:
        """`bending_at` the hinges."""
        return self.bending_at((np.arange(self.hinges) + 0.5) / self.hinges)

    def bending_at(self, places: Float[np.ndarray, "k"]) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k"]]:
        """Factors on the stiffness, and the turn [rad] at rest, per length of the rod, at shares (k,) of the length."""
        if not self.modes:
            return np.ones_like(places), np.zeros_like(places)
        stiffness, turn = np.reshape(self.modes, (2, -1)) @ material.modes_at(places)
        return np.exp(stiffness), turn

    @property
    def dof(self) -> int:
        """See `HeldRod.dof`."""
        return 6

    @property
    def units(self) -> Float[np.ndarray, "6"]:
        """See `HeldRod.units`; loads are about as large over the shapes of a cable bent by less than half a turn."""
        return np.array([self.length, self.length, 1.0, *fitting.LOAD_UNITS])

    @property
    def loads(self) -> slice:
        """See `HeldRod.loads`."""
        return slice(3, 6)

    @property
    def hinges(self) -> int:
        """N, the number of hinges."""
        return hinge_count(self.keypoints, self.length)

    @property
    def stride(self) -> int:
        """Stations from one keypoint to the next."""
        return 2 * self.hinges // (self.keypoints - 1)

    def shapes(self, q: Float[np.ndarray, "t 6"]) -> tuple[Float[np.ndarray, "t s 2"], Float[np.ndarray, "t 2 3"]]:
        """Stations [m] and gripper poses [m, m, rad] of each row of q. The angles are not wrapped."""
        stations, _, poses, _ = kernels.batch_shapes(_rows(q), *self.arrays, 0)
        return stations, poses

    def jacobians(
        self, q: Float[np.ndarray, "t 6"]
    ) -> tuple[
        Float[np.ndarray, "t s 2"],
        Float[np.ndarray, "t s 2 6"],
        Float[np.ndarray, "t 2 3"],
        Float[np.ndarray, "t 2 3 6"],
    ]:
        """Stations and gripper poses of each row of q, each followed by its derivative by q."""
        return kernels.batch_shapes(_rows(q), *self.arrays, self.dof)

    def stability(
        self, q: Float[np.ndarray, "t 6"], ceiling: float = 1e9
    ) -> tuple[Float[np.ndarray, "t"], Float[np.ndarray, "t 6"]]:
        """Stability margin mu of each row of q, and its derivative by q.

        A margin above `ceiling` comes back as `ceiling` with derivative zero, some thirty times faster.
        """
        return kernels.batch_stability(_rows(q), *self.arrays, float(ceiling))

    def retract(self, q: Float[np.ndarray, "... 6"], step: Float[np.ndarray, "... 6"]) -> Float[np.ndarray, "... 6"]:
        """See `HeldRod.retract`."""
        return q + step

    def difference(self, a: Float[np.ndarray, "... 6"], b: Float[np.ndarray, "... 6"]) -> Float[np.ndarray, "... 6"]:
        """See `HeldRod.difference`; the angle of the centre is not wrapped."""
        return b - a

    def guesses(self, keypoints: Float[np.ndarray, "t n 2"]) -> Float[np.ndarray, "t 6"]:
        """See `HeldRod.guesses`: from the bends of the polyline; phi_j N = m + a x (p_j - c)/L is linear in (a, m)."""
        n = keypoints.shape[1]
        steps = np.diff(keypoints, axis=1)
        angles = np.unwrap(np.arctan2(steps[..., 1], steps[..., 0]), axis=1)
        bends = np.diff(angles, axis=1) * (n - 1)
        centre = np.array([polyline.resample(line, 3)[1] for line in keypoints]).reshape(-1, 2)
        theta = (angles[:, (n - 2) // 2] + angles[:, (n - 1) // 2]) / 2
        x, y = np.moveaxis(keypoints[:, 1:-1] - centre[:, None], 2, 0) / self.length
        c, s = np.cos(theta)[:, None], np.sin(theta)[:, None]
        # a x p = a_x p_y - a_y p_x; a pull to zero where the points cannot distinguish the loads
        rows = np.stack([c * y - s * x, -c * x - s * y, np.ones_like(bends)], axis=2)
        normal = rows.swapaxes(1, 2) @ rows + 0.03**2 * np.eye(3)
        load = np.linalg.solve(normal, rows.swapaxes(1, 2) @ bends[..., None])[..., 0]
        return np.column_stack([centre, theta, np.clip(load, -150, 150)])

    def guesses_between(self, poses: Float[np.ndarray, "2 3"], count: int) -> Float[np.ndarray, "k 6"]:
        """See `HeldRod.guesses_between`; one more than a multiple of four.

        The loads are a low-discrepancy sequence (multiples of powers of 1/g, g^4 = 1 + g, modulo 1: Roberts 2018, "The
        unreasonable effectiveness of quasirandom sequences") in all four images under mirroring and reversal, after
        none.
        """
        g = 1.2207440846057596
        unit = (0.5 + np.arange(-(-(count - 1) // 4))[:, None] / g ** np.arange(1, 4)) % 1.0
        unit[:, 0] = 2 * unit[:, 0] - 1
        images = np.array([[1, 1, 1], [1, -1, -1], [1, 1, -1], [1, -1, 1]])
        q = np.zeros((1 + 4 * len(unit), self.dof))
        q[1:, 3:] = (unit[:, None] * images * LOAD_RANGE).reshape(-1, 3)
        q[:, 5] += float(se2.wrap_angle(poses[1, 2] - poses[0, 2]))
        target = poses[1, :2] - poses[0, :2]
        ends = self.end_poses(q)
        between = ends[:, 1, :2] - ends[:, 0, :2]
        q[:, 2] = np.arctan2(target[1], target[0]) - np.arctan2(between[:, 1], between[:, 0])
        if np.linalg.norm(target) < 0.2 * self.length:
            turns = poses[:, 2] - ends[:, :, 2]
            q[:, 2] = turns[:, 0] + se2.wrap_angle(turns[:, 1] - turns[:, 0]) / 2
        q[:, :2] = poses[:, :2].mean(0) - self.end_poses(q)[:, :, :2].mean(1)
        return q

    def continued(self, q: Float[np.ndarray, "6"], poses: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "6"]:
        """See `HeldRod.continued`: the angle of the centre goes on by full turns."""
        turns = poses[:, 2] - self.end_poses(q[None])[0, :, 2]
        return q + [0.0, 0.0, 2 * np.pi * np.round(turns.mean() / (2 * np.pi)), 0.0, 0.0, 0.0]

    def written_near(self, q: Float[np.ndarray, "6"], near: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6"]:
        """See `HeldRod.written_near`."""
        return np.concatenate([SE2.continued(q[:3], near[:3]), q[3:]])

    def energy(self, q: Float[np.ndarray, "t 6"]) -> Float[np.ndarray, "t"]:
        """Bending energy in units of EI/L: N/2 times the sum of the squared bends from rest, by their stiffness."""
        stations, poses = self.shapes(q)
        links = np.diff(stations[:, 1::2], axis=1)
        inner = np.unwrap(np.arctan2(links[..., 1], links[..., 0]), axis=1)
        first, last = (
            end + 2 * np.pi * np.round((near - end) / (2 * np.pi))
            for end, near in ((poses[:, 0, 2], inner[:, 0]), (poses[:, 1, 2], inner[:, -1]))
        )
        angles = np.column_stack([first, inner, last])
        stiffness, rest = self.bending
        return 0.5 * self.hinges * np.sum(stiffness * (np.diff(angles, axis=1) - rest / self.hinges) ** 2, axis=1)

    def passes_through_itself(self, stations: Float[np.ndarray, "s 2"]) -> bool:
        """See `HeldRod.passes_through_itself`."""
        return polyline.crosses_itself(stations[::2])


def _rows(q: Float[np.ndarray, "t 6"]) -> Float[np.ndarray, "t 6"]:
    rows = np.ascontiguousarray(q, dtype=float)
    if rows.ndim != 2 or rows.shape[1] != 6:
        raise InputError(f"rod coordinates must have shape (t, 6), got {rows.shape}")
    return rows
