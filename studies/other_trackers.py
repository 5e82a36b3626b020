"""Trackers that do not know what a rod is, to compare with: a smooth curve, and registration of a set of points.

Both get what the rod tracker gets, points of the axis in no order and the measured grippers, go on from the frame
before, and are tied to the grippers' positions and directions. Curves are rows of nodes at equal distances along them.

Sources:
    Kass, Witkin, Terzopoulos 1988, "Snakes: active contour models".
    Myronenko, Song 2010, "Point set registration: coherent point drift", with what Xiang et al. 2023, "TrackDLO", and
    Wang et al. 2021, "Tracking partially-occluded deformable objects while enforcing geometric constraints", add for
    cables: coherence along the cable, ends that are tied to grippers, and a length that stays.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.geometry.groups import SE2

NODES = 37
"""Of a curve: three for each distance between two keypoints."""

TIED = 1e3
"""Weight of a tie to a gripper, in those of a point."""


def resampled(curve: Float[np.ndarray, "m 2"], count: int) -> Float[np.ndarray, "k 2"]:
    """A polyline by points at equal distances along it."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    wanted = np.linspace(0.0, along[-1], count)
    return np.column_stack([np.interp(wanted, along, part) for part in curve.T])


def moved(curve: Float[np.ndarray, "m 2"], before: np.ndarray, now: np.ndarray) -> Float[np.ndarray, "m 2"]:
    """A curve whose grippers moved: every node goes with both, the nearer one more."""
    share = np.linspace(0.0, 1.0, len(curve))[:, None]
    at = np.column_stack([curve, np.zeros(len(curve))])
    moves = [SE2.compose(pose, SE2.inverse(old)) for old, pose in zip(before, now, strict=True)]
    ends = [SE2.position(SE2.compose(np.tile(move, (len(at), 1)), at)) for move in moves]
    return (1 - share) * ends[0] + share * ends[1]


def tied(poses: Float[np.ndarray, "2 3"], spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """The nodes that grippers hold, two at each end, and where they are [m]."""
    ahead = spacing * np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    left, right = SE2.position(poses)
    return np.array([0, 1, NODES - 2, NODES - 1]), np.array([left, left + ahead[0], right - ahead[1], right])


class SplineTracker:
    """A curve of least bending between the grippers, through the points.

    Args:
        start: (m, 2) its first curve [m].
        poses: (2, 3) of the grippers then.
        stiffness: Weight of the squared second differences of the nodes, in those of all points over one node.
        gate: Distance [m] beyond which a point is of something else.
        passes: Times that points are assigned to the curve.
    """

    def __init__(
        self, start: Float[np.ndarray, "m 2"], poses: np.ndarray, stiffness: float = 0.3, gate: float = 0.02,
        passes: int = 6,
    ) -> None:  # fmt: skip
        self._curve, self._poses = resampled(start, NODES), np.array(poses)
        self._stiffness, self._gate, self._passes = stiffness, gate, passes
        third = np.diff(np.eye(NODES), 2, axis=0)
        self._bending = third.T @ third

    def update(self, points: Float[np.ndarray, "k 2"], poses: Float[np.ndarray, "2 3"], count: int) -> np.ndarray:
        """Keypoints (count, 2) [m] after a frame."""
        curve, self._poses = moved(self._curve, self._poses, poses), np.array(poses)
        for _ in range(self._passes):
            spacing = float(np.linalg.norm(np.diff(curve, axis=0), axis=1).mean())
            normal, wanted = self._stiffness * self._bending, np.zeros((NODES, 2))
            at, share, off = _nearest(points, curve)
            used = off <= self._gate
            over = np.bincount(at[used], minlength=NODES)[at[used]]
            for j, t, point, w in zip(at[used], share[used], points[used], 1 / over, strict=True):
                # across the curve only: a picture does not say which place of the cable a point is
                row = np.array([1 - t, t])
                normal[np.ix_([j, j + 1], [j, j + 1])] += w * np.outer(row, row)
                along = curve[j + 1] - curve[j]
                along /= max(np.linalg.norm(along), 1e-9)
                foot = row @ curve[[j, j + 1]]
                wanted[[j, j + 1]] += w * np.outer(row, foot + (point - foot) - along * (along @ (point - foot)))
            nodes, places = tied(poses, spacing)
            normal[nodes, nodes] += TIED
            wanted[nodes] += TIED * places
            curve = resampled(np.linalg.solve(normal + 1e-9 * np.eye(NODES), wanted), NODES)
        self._curve = curve
        return resampled(curve, count)


class RegisteringTracker:
    """Nodes of the frame before, moved coherently onto the points, their distances kept.

    Args:
        start: (m, 2) its first curve [m].
        poses: (2, 3) of the grippers then.
        reach: Along the cable within which nodes move alike, in lengths.
        stiffness: Weight of the coherence.
        outliers: Share of points that are something else's.
        passes: Of expectation and maximisation.
    """

    def __init__(
        self, start: Float[np.ndarray, "m 2"], poses: np.ndarray, reach: float = 0.1, stiffness: float = 0.1,
        outliers: float = 0.1, passes: int = 20,
    ) -> None:  # fmt: skip
        self._curve, self._poses = resampled(start, NODES), np.array(poses)
        self._stiffness, self._outliers, self._passes = stiffness, outliers, passes
        apart = np.abs(np.subtract.outer(np.arange(NODES), np.arange(NODES))) / (NODES - 1)
        self._alike = np.exp(-apart / reach)
        self._length = float(np.linalg.norm(np.diff(self._curve, axis=0), axis=1).sum())

    def update(self, points: Float[np.ndarray, "k 2"], poses: Float[np.ndarray, "2 3"], count: int) -> np.ndarray:
        """Keypoints (count, 2) [m] after a frame."""
        begin, self._poses = moved(self._curve, self._poses, poses), np.array(poses)
        curve, spacing = begin, self._length / (NODES - 1)
        nodes, places = tied(poses, spacing)
        variance = spacing**2
        for _ in range(self._passes if len(points) else 1):
            away = np.sum((points[None] - curve[:, None]) ** 2, axis=2)
            shares = np.exp(-away / (2 * variance))
            rest = 2 * np.pi * variance * self._outliers / (1 - self._outliers) * NODES
            shares /= shares.sum(axis=0) + rest
            weight, wanted = shares.sum(axis=1), shares @ points
            weight[nodes] += TIED
            wanted[nodes] += TIED * places
            system = weight[:, None] * self._alike + self._stiffness * variance * 1e2 * np.eye(NODES)
            curve = begin + self._alike @ np.linalg.solve(system, wanted - weight[:, None] * begin)
            curve = self._lengths_kept(curve, nodes, places)
            total = max(float(shares.sum()), 1e-9)
            variance = max(float(np.sum(shares * away)) / (2 * total), (0.001) ** 2)
        self._curve = resampled(curve, NODES)
        return resampled(curve, count)

    def _lengths_kept(self, curve: np.ndarray, nodes: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Neighbours moved to the distance that they had at first, a few times over, the held ones excepted."""
        curve, wanted = curve.copy(), self._length / (NODES - 1)
        for _ in range(10):
            curve[nodes] = places
            step = np.diff(curve, axis=0)
            size = np.linalg.norm(step, axis=1, keepdims=True)
            push = 0.5 * (1 - wanted / np.maximum(size, 1e-9)) * step
            curve[:-1] += 0.5 * push
            curve[1:] -= 0.5 * push
        curve[nodes] = places
        return curve


def _nearest(points: np.ndarray, curve: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each point the piece of the curve that is nearest, the place on it, and the distance [m]."""
    along = np.diff(curve, axis=0)
    from_first = points[:, None] - curve[None, :-1]
    share = np.clip(np.sum(from_first * along, axis=2) / np.maximum(np.sum(along**2, axis=1), 1e-12), 0.0, 1.0)
    away = np.linalg.norm(from_first - share[..., None] * along, axis=2)
    at = np.argmin(away, axis=1) if len(points) else np.empty(0, int)
    rows = np.arange(len(points))
    return at, share[rows, at], away[rows, at]
