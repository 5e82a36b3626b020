"""How far bodies of grippers in space stay from obstacles, walls, each other and the cable, swept, by Coal.

Distances are measured in order of what they could be at least, which the boxes about bodies and distances in rows
nearby tell, until none could be the least.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from cableway.core.time_limit import checkpoint
from cableway.records import Check
from cableway.scene.spatial.grippers import SpatialBody
from cableway.scene.spatial.task import SpatialTask
from cableway.verification.plan import at_least, with_halves
from cableway.verification.spatial_distance import ToScene, between, boxes_apart, capsule, hull, library, placed

STEP = 0.002
"""Largest move [m] of a corner of a body between two looks at it."""

CLOSE = 1e-6
"""Within which [m] the least distance is found."""

POINT = 1e-6
"""Radius [m] of what stands for a point."""


def bodies_off_scene(poses: Float[np.ndarray, "t 2 7"], task: SpatialTask, limit: float) -> list[Check]:
    """Clearance of what grippers have beyond their balls: from obstacles, walls and the other gripper."""
    if not task.bodies[2:]:
        return []
    fine, at = _fine_poses(poses, task.bodies)
    bodies = [_Moving(body, fine) for body in task.bodies]
    scene = ToScene(task.scene, task.grippers.radius)
    least = [
        _least([body.to_scene(scene, limit) for body in bodies[2:]], STEP, limit),
        _least([a.to_other(b) for a, b in _facing(bodies)], 2 * STEP, limit),
    ]
    words = (
        ("gripper body clearance", "a gripper and an obstacle"),
        ("gripper bodies apart", "the grippers"),
    )
    checks = []
    for (name, where), (value, row, kept) in zip(words, least, strict=True):
        wanted = min(limit, kept - STEP / 2) - 1e-9
        check = at_least(name, np.array([value - STEP / 2]), "m", wanted)
        checks.append(replace(check, where=where, row=float(at[row])))
    return checks


def bodies_off_cable(lines: Float[np.ndarray, "t m 3"], poses: Float[np.ndarray, "t 2 7"], task: SpatialTask) -> Check:
    """Clearance of the bodies of grippers from the cable that they do not hold."""
    lines, poses = with_halves(lines), with_half_poses(poses)
    least, at = np.inf, 0
    for body in task.bodies:
        line = lines if body.side == 0 else lines[:, ::-1]
        first = int(np.ceil(body.held_arc(task.cable.radius) / task.cable.length * (lines.shape[1] - 1))) + 1
        if first + 1 < lines.shape[1]:
            found, row = _Moving(body, poses).to_lines(line[:, first:], least)
            least, at = (found, row) if found < least else (least, at)
    found = at_least("gripper body from the cable", np.array([least - task.cable.radius]), "m", 0.0)
    return replace(found, where="a gripper and the cable", row=at / 2)


def with_half_poses(poses: Float[np.ndarray, "t 2 7"]) -> Float[np.ndarray, "2*t-1 2 7"]:
    """The poses of all rows and half-way from each row to the next, turned the short way."""
    out = np.empty((2 * len(poses) - 1, 2, 7))
    out[::2], out[1::2] = poses, _between(poses[:-1], poses[1:], 0.5)
    return out


def _between(a: np.ndarray, b: np.ndarray, share: np.ndarray | float) -> np.ndarray:
    """Poses at a share of the way; orientations by their normalised mean, exact half-way."""
    sign = np.where(np.sum(a[..., 3:] * b[..., 3:], axis=-1, keepdims=True) < 0, -1.0, 1.0)
    turn = (1 - share) * a[..., 3:] + share * sign * b[..., 3:]
    turn = turn / np.linalg.norm(turn, axis=-1, keepdims=True)
    return np.concatenate([(1 - share) * a[..., :3] + share * b[..., :3], turn], axis=-1)


def _fine_poses(
    poses: np.ndarray, bodies: tuple[SpatialBody, ...]
) -> tuple[Float[np.ndarray, "s 2 7"], Float[np.ndarray, "s"]]:
    """Poses between which no corner moves more than `STEP`, and their fractional rows."""
    moved = np.zeros(len(poses) - 1)
    for body in bodies:
        steps = np.linalg.norm(np.diff(body.placed(poses[:, body.side]), axis=0), axis=2).max(1)
        moved = np.maximum(moved, steps)
    counts = np.maximum(1, np.ceil(moved / STEP)).astype(int)
    at = np.concatenate([row + np.arange(n) / n for row, n in enumerate(counts)] + [[len(poses) - 1.0]])
    first = np.minimum(at.astype(int), len(poses) - 2)
    return _between(poses[first], poses[first + 1], (at - first)[:, None, None]), at


class _Gap:
    """A distance in each of many rows, of which a lower bound is known.

    Args:
        bound: (s,) [m].
        measure: The distance [m] in a row.
    """

    def __init__(self, bound: Float[np.ndarray, "s"], measure: Callable[[int], float]) -> None:
        self.bound, self._measure, self._known = bound, measure, dict[int, float]()

    def __call__(self, row: int) -> float:
        if row not in self._known:
            checkpoint()
            self._known[row] = self._measure(row)
        return self._known[row]


def _least(gaps: list[_Gap], rate: float, limit: float) -> tuple[float, int, float]:
    """The least distance [m] in any row, the row, and the least in the first and last row up to a limit [m].

    Args:
        gaps: Of pairs of things.
        rate: What a distance changes from row to row at most [m].
        limit: As above.
    """
    kept = limit + STEP
    for gap in gaps:
        for row in (0, len(gap.bound) - 1):
            if gap.bound[row] < kept:
                kept = min(kept, gap(row))
    least, at = np.inf, 0
    for gap in sorted(gaps, key=lambda gap: float(gap.bound.min())):
        bound, rows = gap.bound.copy(), np.arange(len(gap.bound))
        while bound[row := int(bound.argmin())] < least - CLOSE:
            found = gap(row)
            if found < least:
                least, at = found, row
            bound = np.maximum(bound, found - rate * np.abs(rows - row))
            bound[row] = np.inf
    return least, at, kept


class _Moving:
    """A body on a gripper in many rows, as Coal has it: a hull or a point, without the radius by which it is grown."""

    def __init__(self, body: SpatialBody, poses: Float[np.ndarray, "s 2 7"]) -> None:
        self.body, self.radius = body, body.radius
        self._at = poses[:, body.side, :3]
        self._turns = Rotation.from_quat(poses[:, body.side, 3:], scalar_first=True).as_matrix()
        self._point = len(body.points) == 1
        self._solid = library().Sphere(POINT) if self._point else hull(body.points)
        self.corners = self._at[:, None] + np.einsum("sij,kj->ski", self._turns, body.points)
        self.low, self.high = self.corners.min(1), self.corners.max(1)

    def place(self, row: int) -> tuple[object, object]:
        """Coal's shape and where it is."""
        at = self.corners[row, 0] if self._point else self._at[row]
        return self._solid, library().Transform3s(self._turns[row], at)

    def to_scene(self, scene: ToScene, limit: float) -> _Gap:
        """Its clearance [m]; beyond some distance it is given as that."""
        enough = limit + self.radius

        def measure(row: int) -> float:
            return scene.hull_distance(*self.place(row), self.corners[row], enough) - self.radius

        return _Gap(scene.box_bound(self.low, self.high, enough) - self.radius, measure)

    def to_other(self, other: _Moving) -> _Gap:
        """Its distance [m] from a body of the other gripper."""
        grown = self.radius + other.radius
        bound = boxes_apart(self.low, self.high, other.low, other.high)
        return _Gap(bound - grown, lambda row: between(*self.place(row), *other.place(row)) - grown)

    def to_lines(self, lines: Float[np.ndarray, "s m 3"], enough: float) -> tuple[float, int]:
        """Its least distance [m] from the line of a row, `enough` where none is nearer, and the row."""
        local = np.einsum("sij,smi->smj", self._turns, lines - self._at[:, None])
        low, high = self.body.points.min(0), self.body.points.max(0)
        away = np.linalg.norm(np.maximum(0.0, np.maximum(low - local, local - high)), axis=2)
        bound = (away[:, 1:] + away[:, :-1] - np.linalg.norm(np.diff(lines, axis=1), axis=2)) / 2 - self.radius
        least, at = enough, 0
        for row in np.argsort(bound.min(1)).tolist():
            for piece in np.argsort(bound[row]).tolist():
                if bound[row, piece] >= least - CLOSE:
                    break
                checkpoint()
                ends = lines[row, piece : piece + 2]
                gap = between(*self.place(row), capsule(ends, POINT), placed(ends)) + POINT - self.radius
                if gap < least:
                    least, at = gap, row
        return least, at


def _facing(bodies: list[_Moving]) -> list[tuple[_Moving, _Moving]]:
    """Pairs of bodies of both grippers but for both balls, whose distance is another check."""
    left, right = ([each for each in bodies if each.body.side == side] for side in (0, 1))
    return [pair for pair in product(left, right) if pair != (bodies[0], bodies[1])]
