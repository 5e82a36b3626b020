"""A heavy elastic rod in space led by gripper poses, solved in the orientations of its links.

It shares nothing with `cableway.rod.spatial`: other unknowns, another discrete energy, another solver. The rod is a
chain of links with unit quaternions a_i, half links at its ends, which the grippers hold. With r = conj(a_i) a_{i+1}
the turn at hinge i, the energy [B/L] is

    sum_i 2N (kappa r_x^2 + r_y^2 + r_z^2) + gamma sum_i l_i z_i,

stationary under the closure of the chain, sum_i l_i t_i. The direction t_i of a link is a quadratic form of a_i, so
all derivatives are short polynomials; Newton's method on the spheres of unit quaternions continues the shape from pose
to pose, in smaller steps where it does not converge. A shape whose energy is not a minimum has snapped.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.linalg import eigvalsh, solve_banded
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from cableway.core.errors import InputError
from cableway.core.time_limit import checkpoint

HINGES = 48
"""Twice as many as the rod of `cableway.rod.spatial` has where it is short."""

ITERATIONS = 30
"""Most Newton steps to an equilibrium; four are usual."""

LARGEST_TURN = 0.3
"""Of a link in one Newton step [rad]."""

JUMP = 0.3
"""Turn of a link [rad] above which a solved step is another branch."""

STIFF = 1e3
"""Second derivative given to what the held ends do not allow: far above the least."""

LEVEL = 1e-9
"""Largest slope of the energy [B/L] and largest gap [L] of what counts as solved."""

# r_k = a' TURNS[k] b of conj(a) b, and t_k = a' ALONG[k] a
TURNS = np.zeros((3, 4, 4))
for _k, (_i, _j) in enumerate([(2, 3), (3, 1), (1, 2)]):
    TURNS[_k, 0, _k + 1], TURNS[_k, _k + 1, 0], TURNS[_k, _i, _j], TURNS[_k, _j, _i] = 1.0, -1.0, -1.0, 1.0
ALONG = np.zeros((3, 4, 4))
ALONG[0] = np.diag([1.0, 1.0, -1.0, -1.0])
ALONG[1, 1, 2] = ALONG[1, 2, 1] = ALONG[1, 0, 3] = ALONG[1, 3, 0] = 1.0
ALONG[2, 1, 3] = ALONG[2, 3, 1] = 1.0
ALONG[2, 0, 2] = ALONG[2, 2, 0] = -1.0


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


@threadpool_limits.wrap(limits=1, user_api="blas")  # systems so small that threads wait longer than they work
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
    reached, margins, twists, lost_at = [], [], [], None
    for t, target in enumerate(poses):
        found = _continued(chain, state, pose, target, halvings)
        if found is None:
            lost_at = t
            break
        (state, margin), pose = found, target
        margins.append(margin)
        twists.append(chain.twist(state[0]))
        reached.append(chain.stations(state[0], target, stations.shape[1]))
    lines = np.array(reached).reshape(-1, *stations.shape[1:])
    deviation = np.linalg.norm(lines - stations[: len(lines)], axis=2).max(axis=1, initial=0.0)
    return FollowedInSpace(lines, deviation, np.array(margins), np.array(twists), lost_at)


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
        links = np.full(HINGES + 1, 1 / HINGES)
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

    def stations(self, rows: np.ndarray, pose: np.ndarray, count: int) -> np.ndarray:
        """Points [m] at equal arc length."""
        arc = np.concatenate([[0.0], np.cumsum(self._links)])
        corners = np.vstack([np.zeros(3), np.cumsum(self._links[:, None] * _directions(rows), axis=0)])
        at = np.linspace(0, 1, count)
        return pose[0, :3] + self._length * np.stack([np.interp(at, arc, column) for column in corners.T], axis=1)

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
        for _ in range(ITERATIONS):
            slope, blocks, beside, closure = self._derivatives(rows, force)
            gap = self._links @ _directions(rows) - chord
            if max(np.abs(slope).max(), np.abs(gap).max()) < LEVEL:
                return (rows, force), self._margin(blocks, beside, closure)
            try:
                moved = solve_banded((5, 5), _banded(blocks, beside), np.column_stack([slope, closure.T]))
                pull = np.linalg.solve(closure @ moved[:, 1:], gap - closure @ moved[:, 0])
            except np.linalg.LinAlgError:
                return None
            step = np.concatenate([-moved[:, 0] - moved[:, 1:] @ pull, pull])
            share = min(1.0, LARGEST_TURN / max(np.abs(step[:-3]).max(), 1e-12))
            moved = np.einsum("iak,ik->ia", _tangents(rows[1:-1]), step[:-3].reshape(-1, 3)) / 2
            rows[1:-1] += share * moved
            rows[1:-1] /= np.linalg.norm(rows[1:-1], axis=1, keepdims=True)
            force += share * step[-3:]
        return None

    def _margin(self, blocks: np.ndarray, beside: np.ndarray, closure: np.ndarray) -> float:
        """Least eigenvalue of N times the second derivative, on turns that keep the ends."""
        second = _dense(blocks, beside)
        held, kept, _ = np.linalg.svd(closure.T, full_matrices=False)
        held = held[:, kept > 1e-9 * kept[0]]
        along = second @ held
        second -= along @ held.T + held @ along.T - held @ (held.T @ along) @ held.T - STIFF * held @ held.T
        return float(HINGES * eigvalsh(second, subset_by_index=[0, 0], check_finite=False)[0])

    def twist(self, rows: np.ndarray) -> float:
        """From end to end [rad]."""
        turn = np.einsum("kij,hi,hj->hk", TURNS, rows[:-1], rows[1:])
        return float(2 * np.sum(np.arctan2(turn[:, 0], np.sum(rows[:-1] * rows[1:], axis=1))))

    def _derivatives(
        self, rows: np.ndarray, force: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Slope and second derivative of the energy with its constraint, by turns [rad] of the inner links, and the
        derivative of the closure. Of the second derivative, the blocks (l, 3, 3) of links and of neighbours."""
        a, b = rows[:-1], rows[1:]
        by_a, by_b = _times(TURNS, b), _times(TURNS.swapaxes(1, 2), a)
        turn = np.matmul(by_a, a[:, :, None])[..., 0]
        stiff = 4 * HINGES * self._stiffness
        slope, blocks = np.zeros((HINGES + 1, 4)), np.zeros((HINGES + 1, 4, 4))
        stiff_a, moment = (stiff[:, None] * by_a).swapaxes(1, 2), stiff * turn
        slope[:-1] += np.matmul(moment[:, None], by_a)[:, 0]
        slope[1:] += np.matmul(moment[:, None], by_b)[:, 0]
        blocks[:-1] += np.matmul(stiff_a, by_a)
        blocks[1:] += np.matmul((stiff[:, None] * by_b).swapaxes(1, 2), by_b)
        across = np.matmul(stiff_a, by_b) + (moment @ TURNS.reshape(3, -1)).reshape(-1, 4, 4)
        pull = self._links[:, None] * force + self._hanging[:, None] * [0.0, 0.0, 1.0]
        quadratic = 2 * (pull @ ALONG.reshape(3, -1)).reshape(-1, 4, 4)
        slope += np.matmul(quadratic, rows[:, :, None])[..., 0]
        blocks += quadratic
        inner, tangents = rows[1:-1], _tangents(rows[1:-1]) / 2
        blocks[1:-1] -= np.sum(slope[1:-1] * inner, axis=1)[:, None, None] * np.eye(4)
        own = np.matmul(tangents.swapaxes(1, 2), np.matmul(blocks[1:-1], tangents))
        beside = np.matmul(tangents[:-1].swapaxes(1, 2), np.matmul(across[1:-1], tangents[1:]))
        closure = np.matmul(_times(ALONG, (2 * self._links[1:-1])[:, None] * inner), tangents).swapaxes(0, 1)
        flat = np.matmul(slope[1:-1, None], tangents).ravel()
        return flat, own, beside, closure.reshape(3, -1)


def _times(forms: Float[np.ndarray, "3 4 4"], rows: Float[np.ndarray, "l 4"]) -> Float[np.ndarray, "l 3 4"]:
    """Three bilinear forms with their second argument given."""
    return (rows @ forms.reshape(12, 4).T).reshape(-1, 3, 4)


def _dense(blocks: Float[np.ndarray, "l 3 3"], beside: Float[np.ndarray, "l-1 3 3"]) -> np.ndarray:
    """The symmetric matrix with these blocks on its diagonal and above it."""
    count = len(blocks)
    second, i = np.zeros((count, 3, count, 3)), np.arange(count)
    second[i, :, i] = blocks
    second[i[:-1], :, i[1:]] = beside
    second[i[1:], :, i[:-1]] = beside.swapaxes(1, 2)
    return second.reshape(3 * count, -1)


def _banded(blocks: Float[np.ndarray, "l 3 3"], beside: Float[np.ndarray, "l-1 3 3"]) -> np.ndarray:
    """The same in the form of `solve_banded`, with five diagonals on either side."""
    count = len(blocks)
    banded = np.zeros((11, count, 3))
    for i in range(3):
        for j in range(3):
            banded[5 + i - j, :, j] = blocks[:, i, j]
            banded[2 + i - j, 1:, j] = beside[:, i, j]
            banded[8 + i - j, :-1, j] = beside[:, j, i]
    return banded.reshape(11, -1)


def _directions(rows: np.ndarray) -> np.ndarray:
    """Directions (l, 3) of links."""
    return np.matmul(_times(ALONG, rows), rows[:, :, None])[..., 0]


def _tangents(rows: np.ndarray) -> np.ndarray:
    """Changes (l, 4, 3) of unit quaternions, twice those by turns about the axes of their own frames."""
    w, x, y, z = rows.T
    return np.stack([[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]]).transpose(2, 0, 1)
