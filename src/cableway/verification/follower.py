"""An elastic rod led by gripper poses, solved in link angles.

The rod is a chain of hinges with half links at its ends. Its energy 1/2 sum k_i (theta_{i+1} - theta_i - r_i)^2, k = 1
and r = 0 where it is uniform, is stationary under the closure of the chain; Newton's method on that (a KKT system)
continues the shape from row to row, in smaller steps where it does not converge. A shape whose energy is not a minimum
has snapped.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cableway.core.compiled import inlined, kernel
from cableway.core.time_limit import checkpoint
from cableway.scene.cable import Cable
from cableway.verification.geometry import curve_through, turn

LINKS_PER_SEGMENT = 4
"""Links between two keypoints: twice as fine as the planner's chain."""

ITERATIONS = 40
"""Most Newton steps to an equilibrium; four are usual."""

FORBIDDEN = 1e3
"""Eigenvalue given to directions that would open the chain; those of the energy are at most about four."""


@dataclass(frozen=True)
class Followed:
    """What the rod did.

    Attributes:
        keypoints: (k, n, 2) of the rod [m] at each row reached.
        deviation: (k,) largest distance [m] of one to the plan.
        curvature: (k,) largest curvature [1/m] at each row reached.
        stability: (k,) least eigenvalue of the energy's Hessian along the closure, times N^2, at each row reached, or
            half-way to it where it is less than at both rows.
        lines: (k, m, 2) the rod's vertices [m].
        lost_at: The row where no stable equilibrium was found any more, or None.
    """

    keypoints: Float[np.ndarray, "k n 2"]
    deviation: Float[np.ndarray, "k"]
    curvature: Float[np.ndarray, "k"]
    stability: Float[np.ndarray, "k"]
    lines: Float[np.ndarray, "k m 2"]
    lost_at: int | None


def follow(
    shapes: Float[np.ndarray, "t n 2"], poses: Float[np.ndarray, "t 2 3"], cable: Cable, halvings: int = 4
) -> Followed:
    """Lead a cable from the first shape through the gripper poses, quasi-statically."""
    chain = _Chain(cable, LINKS_PER_SEGMENT * (shapes.shape[1] - 1))
    angles = chain.angles_of(shapes[0])
    rows, pose, lost_at = [], poses[0], None
    for t in range(len(shapes)):
        target = poses[t].copy()
        target[:, 2] = pose[:, 2] + turn(target[:, 2] - pose[:, 2])
        halfway = _continue(chain, angles, pose, 0.5 * (pose + target), halvings)
        reached = halfway and _continue(chain, halfway[0], 0.5 * (pose + target), target, halvings)
        if halfway is None or reached is None:
            lost_at = t
            break
        before = rows[-1][3] if rows else np.inf
        angles, margin = reached[0], halfway[1] if halfway[1] < min(before, reached[1]) else reached[1]
        pose = target
        line = chain.vertices(pose, angles)
        keypoints = chain.keypoints(line, shapes.shape[1])
        gap = np.linalg.norm(keypoints - shapes[t], axis=1).max()
        rows.append((keypoints, gap, np.abs(np.diff(chain.full(pose, angles))).max() / chain.spacing, margin, line))
    columns = [np.array(column) for column in zip(*rows, strict=True)] if rows else [np.empty(0)] * 5
    count = (len(rows), -1, 2) if rows else (0, 2, 2)
    keypoints, deviation, curvature, stability, lines = columns
    return Followed(keypoints.reshape(count), deviation, curvature, stability, lines.reshape(count), lost_at)


def _continue(
    chain: _Chain, angles: np.ndarray, pose: np.ndarray, target: np.ndarray, halvings: int
) -> tuple[np.ndarray, float] | None:
    """The stable equilibrium at `target` reached from `angles` at `pose`; a step that fails is split in two."""
    checkpoint()
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


CURVE_PIECES = 20
"""Segments between two keypoints of the curve that the first angles are taken from."""


class _Chain:
    """A chain of `hinges` hinges; its state is the angles of the links between the two half links at the ends."""

    def __init__(self, cable: Cable, hinges: int) -> None:
        length = cable.length
        self.length, self.hinges, self.spacing = length, hinges, length / hinges
        stiffness, rest = cable.rod.bending_at((np.arange(hinges) + 0.5) / hinges)
        self._stiffness, self._rest = stiffness, rest / hinges
        links = np.full(hinges + 1, self.spacing)
        links[[0, -1]] /= 2
        self.links, self.arc = links, np.concatenate([[0.0], np.cumsum(links)])

    def full(self, pose: np.ndarray, angles: np.ndarray) -> np.ndarray:
        """All link angles; the end links lie along the grippers, in the turn nearest to their neighbours."""
        ends = pose[:, 2] + 2 * np.pi * np.round((angles[[0, -1]] - pose[:, 2]) / (2 * np.pi))
        return np.concatenate([ends[:1], angles, ends[1:]])

    def vertices(self, pose: np.ndarray, angles: np.ndarray) -> np.ndarray:
        directions = self.full(pose, angles)
        steps = self.links[:, None] * np.column_stack([np.cos(directions), np.sin(directions)])
        return np.vstack([pose[0, :2], pose[0, :2] + np.cumsum(steps, axis=0)])

    def keypoints(self, vertices: np.ndarray, count: int) -> np.ndarray:
        s = np.linspace(0, self.length, count)
        return np.column_stack([np.interp(s, self.arc, column) for column in vertices.T])

    def angles_of(self, keypoints: np.ndarray) -> np.ndarray:
        """Angles of the free links along a smooth curve through keypoints."""
        curve = curve_through(keypoints, CURVE_PIECES)
        arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
        joints = np.column_stack([np.interp(self.arc[1:-1] * arc[-1] / self.length, arc, c) for c in curve.T])
        steps = np.diff(joints, axis=0)
        return np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))

    def solve(self, pose: np.ndarray, angles: np.ndarray) -> np.ndarray | None:
        """The stationary shape near `angles`, or None."""
        solved = angles.copy()
        try:
            return solved if _settle(pose, solved, *self._material) else None
        except np.linalg.LinAlgError:
            return None

    def stability(self, pose: np.ndarray, angles: np.ndarray) -> float:
        """Least eigenvalue of the Hessian on the changes that keep the chain closed, times N^2."""
        return float(_least_eigenvalue(pose, angles, *self._material) * self.hinges**2)

    @property
    def _material(self) -> tuple[np.ndarray, float, np.ndarray, np.ndarray]:
        return self.links / self.length, self.length, self._stiffness, self._rest


@inlined
def _system(pose, angles, links, length, stiffness, rest, gradient, closure, rows):
    """Fill the energy's gradient (free,), the closure error over L (2,) and its derivative (2, free)."""
    free = len(angles)
    ends = np.empty(2)
    for side, neighbour in ((0, 0), (1, free - 1)):  # the end links, in the turn nearest to their neighbours
        turns = np.round((angles[neighbour] - pose[side, 2]) / (2 * np.pi))
        ends[side] = pose[side, 2] + 2 * np.pi * turns
        closure[side] = (pose[0, side] - pose[1, side]) / length
    closure[0] += links[0] * np.cos(ends[0]) + links[-1] * np.cos(ends[1])
    closure[1] += links[0] * np.sin(ends[0]) + links[-1] * np.sin(ends[1])
    for i in range(free):
        before = angles[i - 1] if i > 0 else ends[0]
        after = angles[i + 1] if i < free - 1 else ends[1]
        gradient[i] = stiffness[i] * (angles[i] - before - rest[i])
        gradient[i] -= stiffness[i + 1] * (after - angles[i] - rest[i + 1])
        x, y = links[i + 1] * np.cos(angles[i]), links[i + 1] * np.sin(angles[i])
        closure[0] += x
        closure[1] += y
        rows[0, i], rows[1, i] = -y, x


@kernel
def _directions(rows):
    """Eigenvalues (2,) and eigenvectors, in columns, of rows rows'."""
    products = np.empty((2, 2))
    for j in range(2):
        for k in range(2):
            products[j, k] = np.dot(rows[j], rows[k])
    return np.linalg.eigh(products)


@kernel
def _least_squares_multipliers(gradient, rows):
    """Multipliers that leave the least of gradient + rows' multipliers, by the eigenvectors of rows rows'."""
    values, vectors = _directions(rows)
    along, out = (np.dot(rows[0], gradient), np.dot(rows[1], gradient)), np.zeros(2)
    for k in range(2):
        if values[k] > 1e-18 * values[1]:
            share = (vectors[0, k] * along[0] + vectors[1, k] * along[1]) / values[k]
            out[0] -= vectors[0, k] * share
            out[1] -= vectors[1, k] * share
    return out


@kernel
def _fill_hessian(rows, multipliers, stiffness, hessian):
    """Write the Hessian of the Lagrangian, tridiag(-k_i, k_i + k_{i+1}, -k_{i+1}) less the load along each link, into
    the first rows and columns of a matrix of zeros."""
    for i in range(rows.shape[1]):
        hessian[i, i] = stiffness[i] + stiffness[i + 1] - (rows[1, i] * multipliers[0] - rows[0, i] * multipliers[1])
        if i > 0:
            hessian[i, i - 1] = hessian[i - 1, i] = -stiffness[i]


@kernel
def _largest(x):
    """Largest absolute number of x; NaN or infinite where one of them is."""
    largest = 0.0
    for value in x:
        if not abs(value) <= largest:
            largest = abs(value)
            if not np.isfinite(largest):
                break
    return largest


@kernel
def _settle(pose, angles, links, length, stiffness, rest):
    """Newton's method on stationarity and closure, from and into `angles`; whether it arrives."""
    free = len(angles)
    gradient, closure, rows = np.empty(free), np.empty(2), np.empty((2, free))
    kkt, right = np.empty((free + 2, free + 2)), np.empty(free + 2)
    _system(pose, angles, links, length, stiffness, rest, gradient, closure, rows)
    multipliers = _least_squares_multipliers(gradient, rows)
    for _ in range(ITERATIONS):
        for i in range(free):
            right[i] = -gradient[i] - (rows[0, i] * multipliers[0] + rows[1, i] * multipliers[1])
        right[free], right[free + 1] = -closure[0], -closure[1]
        if _largest(right) < 1e-10:
            return True
        kkt[:] = 0.0
        _fill_hessian(rows, multipliers, stiffness, kkt)
        for k in range(2):
            for i in range(free):
                kkt[free + k, i] = kkt[i, free + k] = rows[k, i]
        step = np.linalg.solve(kkt, right)
        size = _largest(step[:free])
        if not np.isfinite(size):
            return False
        scale = 0.3 / size if size > 0.3 else 1.0
        for i in range(free):
            angles[i] += scale * step[i]
        for k in range(2):
            multipliers[k] += scale * step[free + k]
        _system(pose, angles, links, length, stiffness, rest, gradient, closure, rows)
    return False


@kernel
def _least_eigenvalue(pose, angles, links, length, stiffness, rest):
    """Least eigenvalue of the Hessian on the changes that keep the chain closed."""
    free = len(angles)
    gradient, closure, rows = np.empty(free), np.empty(2), np.empty((2, free))
    _system(pose, angles, links, length, stiffness, rest, gradient, closure, rows)
    hessian = np.zeros((free, free))
    _fill_hessian(rows, _least_squares_multipliers(gradient, rows), stiffness, hessian)
    values, vectors = _directions(rows)
    normal, product = np.empty(free), np.empty(free)
    for k in range(2):
        if values[k] > 1e-18 * values[1]:
            for i in range(free):
                normal[i] = (vectors[0, k] * rows[0, i] + vectors[1, k] * rows[1, i]) / np.sqrt(values[k])
            for i in range(free):
                product[i] = np.dot(hessian[i], normal)
            along = np.dot(normal, product)
            for i in range(free):  # the direction that the closure forbids gets a large eigenvalue of its own
                for j in range(free):
                    hessian[i, j] += (along + FORBIDDEN) * normal[i] * normal[j]
                    hessian[i, j] -= product[i] * normal[j] + normal[i] * product[j]
    return np.linalg.eigvalsh(hessian)[0]
