"""A heavy elastic rod in space led by gripper poses, solved in the orientations of its links.

It shares nothing with `cableway.rod.spatial`: other unknowns, another discrete energy, another solver. The rod is a
chain of links with unit quaternions a_i, half links at its ends, which the grippers hold. With r = conj(a_i) a_{i+1}
the turn at hinge i, the energy [B/L] is

    sum_i 2N (kappa r_x^2 + r_y^2 + r_z^2) + gamma sum_i l_i z_i,

stationary under the closure of the chain, sum_i l_i t_i. Newton's method on the spheres of unit quaternions continues
the shape from pose to pose, in smaller steps where it does not converge. A shape whose energy is not a minimum has
snapped.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from cableway.core.errors import InputError
from cableway.core.time_limit import checkpoint
from cableway.verification import spatial_follower_kernels as kernels

HINGES, LIGHT = 48, 60.0
"""Of a rod up to this weight gamma, a heavier one has more, as the square root of its weight: at least twice as many as
the rod of `cableway.rod.spatial` of up to half a metre."""

JUMP = 0.3
"""Turn of a link [rad] above which a solved step is another branch."""


@dataclass(frozen=True)
class FollowedInSpace:
    """What the rod did.

    Attributes:
        stations: (k, s, 3) of the rod [m] at each row reached, at the arc lengths of those given.
        deviation: (k,) largest distance [m] of one to the one given.
        stability: (k,) least eigenvalue of N times the energy's second derivative by turns of the links, the ends held.
        twist: (k,) from end to end [rad].
        lost_at: The row where no stable equilibrium was found any more, or None.
    """

    stations: Float[np.ndarray, "k s 3"]
    deviation: Float[np.ndarray, "k"]
    stability: Float[np.ndarray, "k"]
    twist: Float[np.ndarray, "k"]
    lost_at: int | None


def follow_in_space(
    stations: Float[np.ndarray, "t s 3"],
    poses: Float[np.ndarray, "t 2 7"],
    *,
    length: float,
    twist: float,
    weight: float,
    twisted: float = 0.0,
    halvings: int = 6,
) -> FollowedInSpace:
    """Lead a rod from the first shape through the gripper poses, quasi-statically.

    Args:
        stations: (t, s, 3) [m] at equal arc length, ends included: what the rod is expected to do.
        poses: (t, 2, 7) of the grippers: position [m] and unit quaternion (w, x, y, z), x along the rod.
        length: L [m].
        twist: kappa = C/B.
        weight: gamma = rho A g L^3/B.
        twisted: Twist of the first shape [rad], by which its full turns are counted.
        halvings: How often a step from row to row is split where it does not converge.

    Raises:
        InputError: The arrays do not fit each other.
    """
    if len(stations) != len(poses) or len(poses) == 0 or stations.shape[1] < 3:
        raise InputError(f"a motion needs as many shapes as poses, of 3 points or more, got {stations.shape}")
    chain = _Chain(length, twist, weight)
    state, pose = chain.first(stations[0], poses[0], twisted), poses[0]
    reached, margins, lost_at = [], [], None
    for t, target in enumerate(poses):
        found = _continued(chain, state, pose, target, halvings)
        if found is None:
            lost_at = t
            break
        (state, margin), pose = found, target
        margins.append(margin)
        reached.append(state[0])
    rows = np.array(reached).reshape(-1, chain.hinges + 1, 4)
    lines = chain.stations(rows, poses[: len(rows)], stations.shape[1])
    deviation = np.linalg.norm(lines - stations[: len(lines)], axis=2).max(axis=1, initial=0.0)
    return FollowedInSpace(lines, deviation, np.array(margins), chain.twist(rows), lost_at)


State = tuple[Float[np.ndarray, "links 4"], Float[np.ndarray, "3"]]
"""Orientations of all links, and the force that closes the chain."""


def _continued(
    chain: _Chain, state: State, pose: np.ndarray, target: np.ndarray, halvings: int
) -> tuple[State, float] | None:
    """The stable equilibrium at `target` reached from the one at `pose`; a step that fails is split in two."""
    checkpoint()
    solved = chain.solved(state, target)
    if solved is not None and chain.turned(state[0], solved[0][0]) < JUMP and solved[1] > 0:
        return solved
    if halvings == 0:
        return None
    middle = _half_way(pose, target)
    half = _continued(chain, state, pose, middle, halvings - 1)
    return None if half is None else _continued(chain, half[0], middle, target, halvings - 1)


def _half_way(pose: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Poses in the middle of two, turned the short way."""
    sign = np.where(np.sum(pose[:, 3:] * target[:, 3:], axis=1, keepdims=True) < 0, -1.0, 1.0)
    turn = pose[:, 3:] + sign * target[:, 3:]
    return np.column_stack([(pose[:, :3] + target[:, :3]) / 2, turn / np.linalg.norm(turn, axis=1, keepdims=True)])


class _Chain:
    """The chain, in lengths of the rod; its state is a `State`."""

    def __init__(self, length: float, twist: float, weight: float) -> None:
        self.hinges = 2 * math.ceil(HINGES / 2 * math.sqrt(max(1.0, weight / LIGHT)))
        links = np.full(self.hinges + 1, 1 / self.hinges)
        links[[0, -1]] /= 2
        after = np.cumsum(links[::-1])[::-1] - links
        self._length, self._links, self._stiffness = length, links, np.array([twist, 1.0, 1.0])
        self._hanging = weight * links * (after + links / 2)  # of a link's direction, on the height of all after it

    def first(self, stations: np.ndarray, pose: np.ndarray, twisted: float) -> State:
        """A state near given stations: their tangents, with the twist between the grippers spread evenly."""
        arc = np.linspace(0, 1, len(stations))
        hinges = np.concatenate([[0.0], np.cumsum(self._links)])
        directions = np.diff(CubicSpline(arc, stations)(hinges), axis=0)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        first, last = (Rotation.from_quat(each[3:], scalar_first=True) for each in pose)
        frames = [first]
        for direction in directions[1:]:
            tangent = frames[-1].apply([1.0, 0.0, 0.0])
            axis = np.cross(tangent, direction)
            size = np.linalg.norm(axis)
            angle = np.arctan2(size, tangent @ direction)
            frames.append(Rotation.from_rotvec(axis / max(size, 1e-12) * angle) * frames[-1])
        twist = (frames[-1].inv() * last).as_rotvec()[0]
        twist += 2 * np.pi * np.round((twisted - twist) / (2 * np.pi))
        spread = Rotation.from_rotvec(np.outer(np.linspace(0, 1, len(frames)) * twist, [1.0, 0.0, 0.0]))
        rows = (Rotation.concatenate(frames) * spread).as_quat(scalar_first=True)
        for before, row in pairwise(rows):
            row *= 1.0 if before @ row > 0 else -1.0
        return rows, np.zeros(3)

    def stations(self, rows: Float[np.ndarray, "k links 4"], poses: np.ndarray, count: int) -> np.ndarray:
        """Points (k, count, 3) [m] at equal arc length."""
        arc = np.concatenate([[0.0], np.cumsum(self._links)])
        corners = np.zeros((len(rows), self.hinges + 2, 3))
        np.cumsum(self._links[:, None] * _directions(rows), axis=1, out=corners[:, 1:])
        at = np.linspace(0, 1, count)
        first = np.clip(np.searchsorted(arc, at, side="right") - 1, 0, self.hinges)
        share = ((at - arc[first]) / self._links[first])[:, None]
        return poses[:, None, 0, :3] + self._length * ((1 - share) * corners[:, first] + share * corners[:, first + 1])

    def turned(self, before: np.ndarray, after: np.ndarray) -> float:
        """Largest turn of a link [rad]."""
        return float(2 * np.arccos(np.clip(np.abs(np.sum(before * after, axis=1)), 0, 1)).max())

    def solved(self, state: State, pose: np.ndarray) -> tuple[State, float] | None:
        """The equilibrium near a state with the grippers at `pose`, by Newton's method, and its margin; None where it
        does not converge."""
        rows, force = state[0].copy(), state[1].copy()
        for side in (0, -1):
            rows[side] = pose[side, 3:] * (1.0 if pose[side, 3:] @ rows[side] > 0 else -1.0)
        chord = (pose[1, :3] - pose[0, :3]) / self._length
        try:
            if not kernels.settle(rows, force, chord, *self._material):
                return None
        except np.linalg.LinAlgError:
            return None
        return (rows, force), kernels.margin(rows, force, *self._material)

    def twist(self, rows: Float[np.ndarray, "k links 4"]) -> Float[np.ndarray, "k"]:
        """From end to end [rad]."""
        (w, x, y, z), (a, b, c, d) = rows[:, :-1].transpose(2, 0, 1), rows[:, 1:].transpose(2, 0, 1)
        return 2 * np.sum(np.arctan2(w * b - x * a - y * d + z * c, w * a + x * b + y * c + z * d), axis=1)

    @property
    def _material(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self._links, 4 * self.hinges * self._stiffness, self._hanging


def _directions(rows: Float[np.ndarray, "... 4"]) -> Float[np.ndarray, "... 3"]:
    """Directions of links."""
    w, x, y, z = np.moveaxis(rows, -1, 0)
    return np.stack([w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=-1)
