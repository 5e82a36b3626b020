"""What a shape in space costs: the shortfalls of `cableway.motion.terms` of a cable held in space, weighed.

Besides those of the plane there are too much twist, the cable near itself, and hands near the cable that they do not
hold. Trajectory optimisation and control in space add up their squares.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.geometry.groups import SE3
from cableway.geometry.spatial_convex import signed_distance
from cableway.motion import terms
from cableway.motion.limits import Margins, SoftLimits
from cableway.motion.spatial import OFF_CABLE, SpatialProblem
from cableway.motion.spatial_kernels import OFF, OTHER, WORLD, closest_parts, nearest_to_cable
from cableway.motion.terms import (
    BEND_SCALE,
    CLEARANCE_SCALE,
    ROOM_SCALE,
    SPAN_SCALE,
    STABILITY_SCALE,
    TENSION_SCALE,
)

TWIST_SHARE, TWIST_SCALE = 0.95, 0.1
"""Of the greatest twist, what costs nothing; scale of the excess [rad]."""

SPARE = 0.002
"""Beyond what must be kept of the distances of the cable from itself and of grippers from the cable [m]."""

SELF_DISTANCE = Margins().self_distance

Residuals = list[tuple[np.ndarray, np.ndarray]]
"""Values (t, k) and their slopes (t, k, 12)."""


class SpatialTerms:
    """The residuals of shapes of a problem's rod.

    Args:
        problem: The problem.
        soft: What costs nothing.
        weight: Of the clearance.
        tension: Force along the rod at its centre, in B/L^2, that costs nothing.
    """

    def __init__(self, problem: SpatialProblem, soft: SoftLimits, weight: float, tension: float) -> None:
        self.problem, self.soft, self.rod = problem, soft, problem.rod
        self._along, self._tension = self.rod.loads.start, tension
        self._clearance_scale = np.sqrt(weight) / CLEARANCE_SCALE
        self._room = max(soft.margin, soft.room)
        self._apart = problem.stations_apart
        self._spared = problem.bodies.arrays(self.rod.length, 2 * self.rod.hinges + 1)[3]
        self._sharpest = soft.bend_share * problem.sharpest_turn

    def residuals(
        self, q: Float[np.ndarray, "t 12"], stations: Float[np.ndarray, "t s 3"], dstations: np.ndarray | None,
        poses: Float[np.ndarray, "t 2 7"], dposes: np.ndarray | None,
    ) -> Residuals:  # fmt: skip
        """All residuals, with slopes by steps of q; slopes are empty where no derivatives are given.

        Args:
            q: (t, 12) rod coordinates.
            stations: (t, s, 3) where the cable is taken to lie [m].
            dstations: (t, s, 3, 12) their derivative by steps of q; None for values alone.
            poses: (t, 2, 7) of the grippers.
            dposes: (t, 2, 6, 12) their derivative; None for values alone.
        """
        return [
            self._clearance(stations, dstations),
            self._bodies(poses, dposes),
            self._off_cable(stations, dstations, poses, dposes),
            *self._hulls(stations, dstations, poses, dposes),
            self._off_itself(stations, dstations),
            self._stability(q),
            self._span(poses, dposes),
            *self._by_loads(q),
            *self._bends(stations, dstations),
        ]

    def _clearance(self, stations: np.ndarray, dstations: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """Weighted shortfalls of the clearance at each station but the ends, the grippers."""
        wanted = self._room + self.problem.radius
        distance, slope, _ = signed_distance(stations[:, 1:-1], self.problem.world, wanted)
        slopes = None if dstations is None else -np.einsum("tsk,tski->tsi", slope, dstations[:, 1:-1])
        return self._weighted(np.maximum(0.0, wanted - distance), slopes)

    def _bodies(self, poses: np.ndarray, dposes: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """The same of the bodies of the grippers."""
        bodies = self.problem.bodies
        points, wanted = bodies.points(poses), self._room + bodies.radius
        distance, slope, _ = signed_distance(points, self.problem.world, float(wanted.max()))
        short = np.maximum(0.0, wanted - distance)
        if dposes is None:
            return self._weighted(short, None)
        slope *= (short > 0)[..., None]
        return self._weighted(short, -self._by_poses(slope, points, bodies.side, poses, dposes))

    @staticmethod
    def _by_poses(
        slope: np.ndarray, points: np.ndarray, side: np.ndarray, poses: np.ndarray, dposes: np.ndarray
    ) -> Float[np.ndarray, "t k 12"]:
        """Slopes by q of what has slopes (t, k, 3) by points that move with the grippers `side` (k,)."""
        return np.einsum("tkj,tkji->tki", SE3.pulled_back(slope, points, poses[:, side]), dposes[:, side])

    def _off_cable(
        self, stations: np.ndarray, dstations: np.ndarray | None, poses: np.ndarray, dposes: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Shortfalls of the distance of bodies from the cable that they do not hold."""
        bodies = self.problem.bodies
        points = bodies.points(poses)
        away, which = nearest_to_cable(points, stations, bodies.side, self._spared)
        short = np.maximum(0.0, bodies.radius + self.problem.radius + OFF_CABLE + SPARE - away)
        if dstations is None or dposes is None or not short.any():
            return short / CLEARANCE_SCALE, np.zeros((*short.shape, self.rod.dof))
        rows = np.arange(len(stations))[:, None]
        unit = (points - stations[rows, which]) / np.maximum(away, 1e-9)[..., None] * (short > 0)[..., None]
        slopes = np.einsum("tkj,tkji->tki", unit, dstations[rows, which])
        return short / CLEARANCE_SCALE, (
            slopes - self._by_poses(unit, points, bodies.side, poses, dposes)
        ) / CLEARANCE_SCALE

    def _hulls(
        self, stations: np.ndarray, dstations: np.ndarray | None, poses: np.ndarray, dposes: np.ndarray | None
    ) -> Residuals:
        """Shortfalls of the distances of hulls from obstacles and walls, from the other gripper and from the cable."""
        bodies = self.problem.bodies
        side = bodies.hulls.side
        if not len(side):
            return []
        wanted = np.array([self._room, self._room, self.problem.radius + OFF_CABLE + SPARE])
        away, normal, at, near, share = bodies.hull_gaps(poses, stations, self.problem.world, self.rod.length, wanted)
        short = np.maximum(0.0, wanted - away)
        off = short[..., OFF] / CLEARANCE_SCALE
        if dstations is None or dposes is None:
            values = [self._weighted(short[..., what], None)[0] for what in (WORLD, OTHER)]
            return [(value, np.zeros(0)) for value in (*values, off)]
        unit = normal * (short > 0)[..., None]
        by_own, by_other = (
            np.stack([self._by_poses(unit[..., k, :], at[..., k, :], of, poses, dposes) for k in range(3)], axis=2)
            for of in (side, 1 - side)
        )
        rows = np.arange(len(stations))[:, None]
        line = dstations[rows, near] * (1 - share)[..., None, None] + dstations[rows, near + 1] * share[..., None, None]
        by_line = np.einsum("tpj,tpji->tpi", unit[..., OFF, :], line)
        return [
            self._weighted(short[..., WORLD], -by_own[..., WORLD, :]),
            self._weighted(short[..., OTHER], by_other[..., OTHER, :] - by_own[..., OTHER, :]),
            (off, (by_line - by_own[..., OFF, :]) / CLEARANCE_SCALE),
        ]

    def _off_itself(self, stations: np.ndarray, dstations: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """Shortfall (t, 1) of the distance of the two nearest parts of the cable."""
        away, which = closest_parts(stations, self._apart)
        short = np.maximum(0.0, 2 * self.problem.radius + SELF_DISTANCE + SPARE - away)[:, None]
        if dstations is None or not short.any():
            return short / CLEARANCE_SCALE, np.zeros((*short.shape, self.rod.dof))
        rows = np.arange(len(stations))
        one, other = which.T
        unit = (stations[rows, one] - stations[rows, other]) / np.maximum(away, 1e-9)[:, None] * (short > 0)
        slopes = np.einsum("tj,tji->ti", unit, dstations[rows, other] - dstations[rows, one])
        return short / CLEARANCE_SCALE, slopes[:, None] / CLEARANCE_SCALE

    def _weighted(self, short: np.ndarray, slopes: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """Shortfalls (t, 2 k) against margin and room, from those against room, with their slopes."""
        much, scale = short - (self._room - self.soft.margin), self._clearance_scale
        value = np.concatenate([scale * np.maximum(0.0, much), short / ROOM_SCALE], axis=1)
        if slopes is None:
            return value, np.zeros(0)
        return value, np.concatenate([scale * slopes * (much > 0)[..., None], slopes / ROOM_SCALE], axis=1)

    def _stability(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        lack, slope = terms.stability_shortfall(self.rod, q, self.soft.stability_wanted)
        return lack[:, None] / STABILITY_SCALE, slope[:, None] / STABILITY_SCALE

    def _span(self, poses: np.ndarray, dposes: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """Excess and shortfall (t, 2) of the distance between the grippers."""
        length, least = self.rod.length, self.problem.grippers.least_span + self.soft.separation_margin
        over, slope = terms.span_excess(poses, self.soft.span_wanted * length, least, SE3)
        scale = length * SPAN_SCALE
        return over / scale, np.zeros(0) if dposes is None else np.einsum("tckj,tkji->tci", slope, dposes) / scale

    def _by_loads(self, q: np.ndarray) -> Residuals:
        """Excess (t, 1) of the force along the rod and of its twist."""
        taut = np.maximum(0.0, q[:, [self._along]] - self._tension)
        most = TWIST_SHARE * self.problem.most_twist
        twist = np.maximum(0.0, np.abs(q[:, [9]]) / self.rod.twist - most)
        slopes = np.zeros((2, len(q), 1, self.rod.dof))
        slopes[0, :, :, self._along] = taut > 0
        slopes[1, :, :, 9] = np.sign(q[:, [9]]) * (twist > 0) / self.rod.twist
        return [(taut / TENSION_SCALE, slopes[0] / TENSION_SCALE), (twist / TWIST_SCALE, slopes[1] / TWIST_SCALE)]

    def _bends(self, stations: np.ndarray, dstations: np.ndarray | None) -> Residuals:
        """Excess (t, hinges) of the sine of the turn at each hinge; none where the cable bends as it likes."""
        if not np.isfinite(self._sharpest):
            return []
        scale = (self.rod.length / (2 * self.rod.hinges)) ** 2
        halves = np.diff(stations, axis=1)
        before, after = halves[:, ::2], halves[:, 1::2]
        normal = np.cross(before, after)
        size = np.linalg.norm(normal, axis=2)
        over = np.maximum(0.0, size / scale - self._sharpest)
        if dstations is None:
            return [(over / BEND_SCALE, np.zeros(0))]
        unit = normal / np.maximum(size, 1e-12)[..., None] * (over > 0)[..., None]
        dhalves = np.diff(dstations, axis=1)
        slopes = np.einsum("thk,thki->thi", np.cross(after, unit), dhalves[:, ::2])
        slopes += np.einsum("thk,thki->thi", np.cross(unit, before), dhalves[:, 1::2])
        return [(over / BEND_SCALE, slopes / scale / BEND_SCALE)]
