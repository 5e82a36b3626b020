"""A uniform elastic rod led by gripper poses, solved in link angles.

The rod is a chain of hinges with half links at its ends. Its energy 1/2 sum (theta_{i+1} - theta_i)^2 is stationary
under the closure of the chain; Newton's method on that (a KKT system) continues the shape from row to row, in
smaller steps where it does not converge. A shape whose energy is not a minimum has snapped.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cableway.geometry import polyline, se2

LINKS_PER_SEGMENT = 4
"""Links between two keypoints: twice as fine as the planner's chain."""


@dataclass(frozen=True)
class Followed:
    """What the rod did.

    Attributes:
        deviation: (k,) largest distance [m] of a keypoint to the plan at each row reached.
        curvature: (k,) largest curvature [1/m] at each row reached.
        stability: (k,) least eigenvalue of the energy's Hessian along the closure, times N^2, at each row reached.
        lines: (k, m, 2) the rod's vertices [m].
        lost_at: The row where no stable equilibrium was found any more, or None.
    """

    deviation: Float[np.ndarray, "k"]
    curvature: Float[np.ndarray, "k"]
    stability: Float[np.ndarray, "k"]
    lines: Float[np.ndarray, "k m 2"]
    lost_at: int | None


def follow(
    shapes: Float[np.ndarray, "t n 2"], poses: Float[np.ndarray, "t 2 3"], length: float, halvings: int = 4
) -> Followed:
    """Lead a rod of `length` [m] from the first shape through the gripper poses, quasi-statically."""
    chain = _Chain(length, LINKS_PER_SEGMENT * (shapes.shape[1] - 1))
    angles = chain.angles_of(shapes[0])
    rows, pose, lost_at = [], poses[0], None
    for t in range(len(shapes)):
        target = pose + se2.pose_step(pose, poses[t])
        reached = _continue(chain, angles, pose, target, halvings)
        if reached is None:
            lost_at = t
            break
        angles, margin = reached
        pose = target
        line = chain.vertices(pose, angles)
        gap = np.linalg.norm(chain.keypoints(line, shapes.shape[1]) - shapes[t], axis=1).max()
        rows.append((gap, np.abs(np.diff(chain.full(pose, angles))).max() / chain.spacing, margin, line))
    columns = list(zip(*rows, strict=True)) if rows else [(), (), (), ()]
    lines = np.array(columns[3]).reshape(len(rows), -1, 2) if rows else np.empty((0, 2, 2))
    return Followed(np.array(columns[0]), np.array(columns[1]), np.array(columns[2]), lines, lost_at)


def _continue(
    chain: _Chain, angles: np.ndarray, pose: np.ndarray, target: np.ndarray, halvings: int
) -> tuple[np.ndarray, float] | None:
    """The stable equilibrium at `target` reached from `angles` at `pose`; a step that fails is split in two."""
    solved = chain.solve(target, angles)
    if solved is not None and np.abs(solved - angles).max() < 0.5:
        margin = chain.stability(target, solved)
        if margin > 0:
            return solved, margin
    if halvings == 0:
        return None
    middle = 0.5 * (pose + target)
    half = _continue(chain, angles, pose, middle, halvings - 1)
    return None if half is None else _continue(chain, half[0], middle, target, halvings - 1)


class _Chain:
    """A chain of `hinges` hinges; its state is the angles of the links between the two half links at the ends."""

    def __init__(self, length: float, hinges: int) -> None:
        self.length, self.hinges, self.spacing = length, hinges, length / hinges
        links = np.full(hinges + 1, self.spacing)
        links[[0, -1]] /= 2
        self.links, self.arc = links, np.concatenate([[0.0], np.cumsum(links)])
        free = hinges - 1
        self.stiffness = 2 * np.eye(free) - np.eye(free, k=1) - np.eye(free, k=-1)

    def full(self, pose: np.ndarray, angles: np.ndarray) -> np.ndarray:
        """All link angles; the end links lie along the grippers, in the turn nearest to their neighbours."""
        ends = pose[:, 2] + 2 * np.pi * np.round((angles[[0, -1]] - pose[:, 2]) / (2 * np.pi))
        return np.concatenate([ends[:1], angles, ends[1:]])

    def vertices(self, pose: np.ndarray, angles: np.ndarray) -> np.ndarray:
        steps = self.links[:, None] * se2.direction(self.full(pose, angles))
        return np.vstack([pose[0, :2], pose[0, :2] + np.cumsum(steps, axis=0)])

    def keypoints(self, vertices: np.ndarray, count: int) -> np.ndarray:
        s = np.linspace(0, self.length, count)
        return np.column_stack([np.interp(s, self.arc, column) for column in vertices.T])

    def angles_of(self, keypoints: np.ndarray) -> np.ndarray:
        """Angles of the free links along a smooth curve through keypoints."""
        curve = polyline.spline(keypoints, 20)
        arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
        joints = np.column_stack([np.interp(self.arc[1:-1] * arc[-1] / self.length, arc, c) for c in curve.T])
        steps = np.diff(joints, axis=0)
        return np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))

    def solve(self, pose: np.ndarray, angles: np.ndarray, iterations: int = 40) -> np.ndarray | None:
        """The stationary shape near `angles`, or None."""
        angles, free = angles.copy(), len(angles)
        multipliers = None
        for _ in range(iterations):
            gradient, closure, rows, hessian = self._system(pose, angles, multipliers)
            if multipliers is None:
                multipliers = np.linalg.lstsq(rows.T, -gradient, rcond=None)[0]
                continue
            stationarity = gradient + rows.T @ multipliers
            if np.abs(stationarity).max() < 1e-10 and np.abs(closure).max() < 1e-10:
                return angles
            kkt = np.block([[hessian, rows.T], [rows, np.zeros((2, 2))]])
            try:
                step = np.linalg.solve(kkt, -np.concatenate([stationarity, closure]))
            except np.linalg.LinAlgError:
                return None
            size = np.abs(step[:free]).max()
            if not np.isfinite(size):
                return None
            scale = min(1.0, 0.3 / size) if size > 0 else 1.0
            angles += scale * step[:free]
            multipliers = multipliers + scale * step[free:]
        return None

    def _system(self, pose: np.ndarray, angles: np.ndarray, multipliers: np.ndarray | None) -> tuple[np.ndarray, ...]:
        """Gradient, closure error over L, its derivative, and the Hessian of the Lagrangian."""
        full = self.full(pose, angles)
        gradient = 2 * full[1:-1] - full[:-2] - full[2:]
        units = se2.direction(full) * self.links[:, None] / self.length
        closure = units.sum(0) - (pose[1, :2] - pose[0, :2]) / self.length
        inner = units[1:-1]
        rows = np.vstack([-inner[:, 1], inner[:, 0]])
        hessian = self.stiffness if multipliers is None else self.stiffness - np.diag(inner @ multipliers)
        return gradient, closure, rows, hessian

    def stability(self, pose: np.ndarray, angles: np.ndarray) -> float:
        """Least eigenvalue of the Hessian on the changes that keep the chain closed, times N^2."""
        gradient, _, rows, _ = self._system(pose, angles, None)
        multipliers = np.linalg.lstsq(rows.T, -gradient, rcond=None)[0]
        hessian = self._system(pose, angles, multipliers)[3]
        _, singular, vectors = np.linalg.svd(rows)
        null = vectors[int(np.sum(singular > 1e-9 * singular[0])) :]
        return float(np.linalg.eigvalsh(null @ hessian @ null.T)[0] * self.hinges**2)
