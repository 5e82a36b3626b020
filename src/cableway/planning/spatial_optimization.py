"""Trajectory optimisation in space: the cost of `cableway.planning.trajectory_optimization`, for the twelve numbers.

Smoothness is that of the keypoints and of one point beside each gripper, which tells how it is rolled. Besides the
costs of the plane there are those of too much twist, of the cable near itself, and of grippers near the cable.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from cableway.geometry import rotations
from cableway.geometry.groups import SE3
from cableway.geometry.spatial_convex import signed_distance
from cableway.motion import terms
from cableway.motion.limits import Margins
from cableway.motion.spatial import OFF_CABLE, SpatialProblem
from cableway.motion.spatial_kernels import OFF, OTHER, WORLD, closest_parts, nearest_to_cable
from cableway.planning.banded_least_squares import (
    BANDS,
    Normal,
    band_form,
    band_product,
    levenberg_marquardt,
    squared_differences,
)
from cableway.planning.trajectory_optimization import (
    BEND_SCALE,
    CHANGE_SCALE,
    CLEARANCE_SCALE,
    CLEARANCE_WEIGHTS,
    LOAD_SCALE,
    LOAD_STEP_SCALE,
    ROOM_SCALE,
    SPAN_SCALE,
    STABILITY_SCALE,
    STEP_SCALE,
    TENSION,
    TENSION_SCALE,
    TrajectoryOptimizationConfig,
)

LEVER = 0.15
"""Distance of the point beside each gripper, in lengths of the cable."""

TWIST_SHARE, TWIST_SCALE = 0.95, 0.1
"""Of the greatest twist, what costs nothing; scale of the excess [rad]."""

SPARE = 0.002
"""Beyond what must be kept of the distances of the cable from itself and of grippers from the cable [m]."""

SELF_DISTANCE = Margins().self_distance


def optimize_in_space(
    q: Float[np.ndarray, "t 12"],
    problem: SpatialProblem,
    config: TrajectoryOptimizationConfig,
    progress: Callable[[float], None] = lambda _: None,
    weights: tuple[float, ...] = CLEARANCE_WEIGHTS,
) -> Float[np.ndarray, "t 12"]:
    """The sequence moved to a local minimum of the cost; its first and last row stay.

    Args:
        q: (T+1, 12) rod coordinates, T at least 2.
        problem: The problem.
        config: Weights and margins.
        progress: Called with the share that is done; it may raise to stop.
        weights: Stages of the clearance weight; the last one alone does for a sequence that is free.
    """
    stages = len(weights)
    for stage, weight in enumerate(weights):

        def report(share: float, stage: int = stage) -> None:
            progress((stage + share) / stages)

        cost = SpatialCost(problem, config, weight, q)
        q = levenberg_marquardt(q, cost, config.iterations, config.tolerance, report)
    return q


Residuals = list[tuple[np.ndarray, np.ndarray]]
"""Values (t, k) and their slopes (t, k, 12)."""


class SpatialCost:
    """The cost of the rows of `q`, of which the first and the last stay."""

    def __init__(
        self, problem: SpatialProblem, config: TrajectoryOptimizationConfig, weight: float, q: Float[np.ndarray, "t 12"]
    ) -> None:
        self.problem, self.config, self.rod = problem, config, problem.rod
        first, second = squared_differences(len(q), 1), squared_differences(len(q), 2)
        self._smooth = tuple(a / STEP_SCALE**2 + b / CHANGE_SCALE**2 for a, b in zip(first, second, strict=True))
        self._loads = tuple(band / LOAD_STEP_SCALE**2 for band in first)
        self._units, self._along = self.rod.units[self.rod.loads], self.rod.loads.start
        self._tension = max(TENSION, float(q[[0, -1], self._along].max()))
        self._clearance_scale = np.sqrt(weight) / CLEARANCE_SCALE
        self._room = max(config.margin, config.room)
        self._apart = problem.stations_apart
        self._spared = problem.bodies.arrays(self.rod.length, 2 * self.rod.hinges + 1)[3]
        self._sharpest = config.bend_share * problem.sharpest_turn

    def cost(self, q: Float[np.ndarray, "t 12"]) -> float:
        """The cost alone, for trial steps."""
        if not np.isfinite(q).all():
            return np.inf
        stations, poses = self.rod.shapes(q)
        loads = q[:, self.rod.loads] / self._units
        total = band_form(self._smooth, self._points(stations, poses).reshape(len(q), -1))
        total += band_form(self._loads, loads) + 0.5 * np.sum(loads**2) / LOAD_SCALE**2
        total += sum(0.5 * np.sum(value**2) for value, _ in self._residuals(q, stations, None, poses, None))
        return float(total)

    def linearise(self, q: Float[np.ndarray, "t 12"]) -> Normal:
        """Cost, gradient and Gauss-Newton blocks at q, by steps of q."""
        rows = len(q)
        stations, dstations, poses, dposes = self.rod.jacobians(q)
        points = self._points(stations, poses).reshape(rows, -1)
        jacobian = np.ascontiguousarray(self._point_slopes(dstations, poses, dposes).reshape(rows, -1, self.rod.dof))
        gradient = np.einsum("tki,tk->ti", jacobian, band_product(self._smooth, points))
        blocks = [
            self._smooth[k][:, None, None] * np.matmul(jacobian[: rows - k].transpose(0, 2, 1), jacobian[k:])
            for k in range(BANDS)
        ]
        loads = q[:, self.rod.loads] / self._units
        pull = band_product(self._loads, loads) + loads / LOAD_SCALE**2
        gradient[:, self.rod.loads] += pull / self._units
        places = np.arange(self.rod.dof)[self.rod.loads]
        for k in range(BANDS):
            diagonal = self._loads[k] + (1 / LOAD_SCALE**2 if k == 0 else 0.0)
            blocks[k][:, places, places] += diagonal[:, None] / self._units**2
        cost = band_form(self._smooth, points) + band_form(self._loads, loads)
        cost += 0.5 * np.sum(loads**2) / LOAD_SCALE**2
        for value, slopes in self._residuals(q, stations, dstations, poses, dposes):
            cost += 0.5 * np.sum(value**2)
            gradient += np.einsum("tsi,ts->ti", slopes, value)
            blocks[0] += np.matmul(slopes.transpose(0, 2, 1), slopes)
        return Normal(float(cost), gradient, (blocks[0], blocks[1], blocks[2]))

    def _residuals(
        self, q: np.ndarray, stations: np.ndarray, dstations: np.ndarray | None, poses: np.ndarray,
        dposes: np.ndarray | None,
    ) -> Residuals:  # fmt: skip
        """All residuals; slopes are empty where no derivatives are given."""
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

    def _points(self, stations: np.ndarray, poses: np.ndarray) -> Float[np.ndarray, "t k 3"]:
        """Keypoints and a point beside each gripper [m]."""
        beside = poses[..., :3] + rotations.rotate(poses[..., 3:], self._lever)
        return np.concatenate([self.rod.at_keypoints(stations), beside], axis=1)

    @property
    def _lever(self) -> np.ndarray:
        return np.array([0.0, LEVER * self.rod.length, 0.0])

    def _point_slopes(
        self, dstations: np.ndarray, poses: np.ndarray, dposes: np.ndarray
    ) -> Float[np.ndarray, "t k 3 12"]:
        arms = rotations.rotate(poses[..., 3:], self._lever)
        turned = np.cross(dposes[:, :, 3:].swapaxes(2, 3), arms[:, :, None]).swapaxes(2, 3)
        return np.concatenate([self.rod.at_keypoints(dstations), dposes[:, :, :3] + turned], axis=1)

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
        much, scale = short - (self._room - self.config.margin), self._clearance_scale
        value = np.concatenate([scale * np.maximum(0.0, much), short / ROOM_SCALE], axis=1)
        if slopes is None:
            return value, np.zeros(0)
        return value, np.concatenate([scale * slopes * (much > 0)[..., None], slopes / ROOM_SCALE], axis=1)

    def _stability(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        lack, slope = terms.stability_shortfall(self.rod, q, self.config.stability_wanted)
        return lack[:, None] / STABILITY_SCALE, slope[:, None] / STABILITY_SCALE

    def _span(self, poses: np.ndarray, dposes: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """Excess and shortfall (t, 2) of the distance between the grippers."""
        length, least = self.rod.length, self.problem.grippers.least_span + self.config.separation_margin
        over, slope = terms.span_excess(poses, self.config.span_wanted * length, least, SE3)
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
