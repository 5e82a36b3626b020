"""Trajectory optimisation in space: the cost of `cableway.planning.trajectory_optimization`, for the twelve numbers.

Smoothness is that of the keypoints and of one point beside each gripper, which tells how it is rolled. Besides the
costs of the plane there are those of `cableway.motion.spatial_terms`. Arms push rows back as they do there.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from cableway.geometry import rotations
from cableway.motion.banded_least_squares import (
    BANDS,
    Normal,
    band_form,
    band_product,
    levenberg_marquardt,
    squared_differences,
)
from cableway.motion.spatial import SpatialProblem
from cableway.motion.spatial_terms import Residuals, SpatialTerms
from cableway.motion.terms import TENSION
from cableway.planning.trajectory_optimization import (
    ARMS_SCALE,
    CHANGE_SCALE,
    CLEARANCE_WEIGHTS,
    LOAD_SCALE,
    LOAD_STEP_SCALE,
    STEP_SCALE,
    TrajectoryOptimizationConfig,
)
from cableway.robot.free_arms import WANTED
from cableway.robot.free_spatial_arms import FreeSpatialArms, spatial_room_shortfall

LEVER = 0.15
"""Distance of the point beside each gripper, in lengths of the cable."""


def optimize_in_space(
    q: Float[np.ndarray, "t 12"],
    problem: SpatialProblem,
    config: TrajectoryOptimizationConfig,
    progress: Callable[[float], None] = lambda _: None,
    weights: tuple[float, ...] = CLEARANCE_WEIGHTS,
    arms: FreeSpatialArms | None = None,
) -> Float[np.ndarray, "t 12"]:
    """The sequence moved to a local minimum of the cost; its first and last row stay.

    Args:
        q: (T+1, 12) rod coordinates, T at least 2.
        problem: The problem.
        config: Weights and margins.
        progress: Called with the share that is done; it may raise to stop.
        weights: Stages of the clearance weight; the last one alone does for a sequence that is free.
        arms: What holds the cable; None for grippers alone.
    """
    stages = len(weights)
    for stage, weight in enumerate(weights):

        def report(share: float, stage: int = stage) -> None:
            progress((stage + share) / stages)

        cost = SpatialCost(problem, config, weight, q, arms)
        q = levenberg_marquardt(q, cost, config.iterations, config.tolerance, report)
    return q


class SpatialCost:
    """The cost of the rows of `q`, of which the first and the last stay."""

    def __init__(
        self,
        problem: SpatialProblem,
        config: TrajectoryOptimizationConfig,
        weight: float,
        q: Float[np.ndarray, "t 12"],
        arms: FreeSpatialArms | None = None,
    ) -> None:
        self.rod, self._arms = problem.rod, arms
        self._arms_scale = np.sqrt(weight) / ARMS_SCALE
        first, second = squared_differences(len(q), 1), squared_differences(len(q), 2)
        self._smooth = tuple(a / STEP_SCALE**2 + b / CHANGE_SCALE**2 for a, b in zip(first, second, strict=True))
        self._loads = tuple(band / LOAD_STEP_SCALE**2 for band in first)
        self._units = self.rod.units[self.rod.loads]
        tension = max(TENSION, float(q[[0, -1], self.rod.loads.start].max()))
        self._terms = SpatialTerms(problem, config, weight, tension)

    def cost(self, q: Float[np.ndarray, "t 12"]) -> float:
        """The cost alone, for trial steps."""
        if not np.isfinite(q).all():
            return np.inf
        stations, poses = self.rod.shapes(q)
        loads = q[:, self.rod.loads] / self._units
        total = band_form(self._smooth, self._points(stations, poses).reshape(len(q), -1))
        total += band_form(self._loads, loads) + 0.5 * np.sum(loads**2) / LOAD_SCALE**2
        residuals = self._terms.residuals(q, stations, None, poses, None) + self._of_arms(q, sloped=False)
        total += sum(0.5 * np.sum(value**2) for value, _ in residuals)
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
        residuals = self._terms.residuals(q, stations, dstations, poses, dposes) + self._of_arms(q, sloped=True)
        for value, slopes in residuals:
            cost += 0.5 * np.sum(value**2)
            gradient += np.einsum("tsi,ts->ti", slopes, value)
            blocks[0] += np.matmul(slopes.transpose(0, 2, 1), slopes)
        return Normal(float(cost), gradient, (blocks[0], blocks[1], blocks[2]))

    def _of_arms(self, q: Float[np.ndarray, "t 12"], sloped: bool) -> Residuals:
        """Weighted shortfalls (t, 7) of the room of the arms, with their slopes; none where there are no arms."""
        if self._arms is None:
            return []
        short, slopes = spatial_room_shortfall(self.rod, q, self._arms, WANTED, sloped)
        return [(self._arms_scale * short, self._arms_scale[:, None] * slopes)]

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
