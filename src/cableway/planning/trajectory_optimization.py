"""Trajectory optimisation: move a sequence of rod equilibria until it is smooth, clear of obstacles and stable.

Levenberg-Marquardt over q_1..q_{T-1} with both ends fixed, minimising

    1/2 sum_t |x_{t+1} - x_t|^2 / v^2 + 1/2 sum_t |x_{t-1} - 2 x_t + x_{t+1}|^2 / u^2      keypoints x, smoothness
    + 1/2 w sum_t sum_i max(0, margin - clearance_{t,i})^2 / e^2                           stations, gripper discs, plug
    + 1/2 sum_t sum_i max(0, room - clearance_{t,i})^2 / f^2                               more, where there is room
    + 1/2 sum_t max(0, mu_0 - mu_t)^2 / d^2                                                stability
    + 1/2 sum_t max(0, tension_t - tension_0)^2 / h^2                                      the cable not taut
    + 1/2 sum_t max(0, span_t/L - span_0)^2 / g^2                                          slack, gripper separation
    + 1/2 sum_t sum_j max(0, |sin turn_{t,j}| - turn_0)^2 / b^2                            sharpest bend
    + 1/2 w sum_t sum_i max(0, room_0i - room_{t,i})^2 / a_i^2                             arms, where it is known how
                                                                                           they hold the cable
    + small pulls on the loads and on their differences,

with the clearance weight w rising in stages; `cableway.motion.banded_least_squares` solves it.

Note:
    Not in the paper (Tang et al.), whose planned shapes are never made equilibria.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from cableway.core.deprecation import renamed
from cableway.motion import terms
from cableway.motion.banded_least_squares import (
    BANDS,
    Normal,
    band_form,
    band_product,
    levenberg_marquardt,
    squared_differences,
)
from cableway.motion.limits import BodyPoints, Margins, SoftLimits, sharpest_turn_of
from cableway.motion.terms import (
    BEND_SCALE,
    CLEARANCE_SCALE,
    ROOM_SCALE,
    SPAN_SCALE,
    STABILITY_SCALE,
    TENSION,
    TENSION_SCALE,
)
from cableway.motion.validity import is_pulled_straight
from cableway.robot.free_arms import WANTED, free_arms, room_shortfall
from cableway.scene.task import Task

CLEARANCE_WEIGHTS = (0.3, 1.0, 3.0)
"""The rising stages of the clearance weight."""

STEP_SCALE = 0.05
"""Of a keypoint's move from row to row [m]."""

CHANGE_SCALE = 0.005
"""Of the change of that move [m]."""

LOAD_STEP_SCALE = 1.0
"""Of the change of a load from row to row, in its units."""

TAUT = Margins().gripper_span
"""Distance between the grippers over L from which the cable is nearly straight; lengths are known to 2%."""

LOAD_SCALE = 10.0
"""Of a load, in its unit (`HeldRod.units`)."""

ARMS_SCALE = np.array([0.01, 0.001, 0.01, 0.01, 0.001, 0.01, 0.001])
"""Of the shortfall of arms' room against `free_arms.WANTED`."""


@dataclass(frozen=True, kw_only=True)
class TrajectoryOptimizationConfig(SoftLimits):
    """What shapes are to keep, and how long that is tried.

    Attributes:
        iterations: Cap for each stage.
        tolerance: Relative fall of the cost that ends a stage.
    """

    iterations: int = 60
    tolerance: float = 1e-4


def optimize_trajectory(
    q: Float[np.ndarray, "t d"],
    task: Task,
    config: TrajectoryOptimizationConfig,
    progress: Callable[[float], None] = lambda _: None,
) -> Float[np.ndarray, "t d"]:
    """The sequence moved to a local minimum of the cost above; its first and last row stay.

    Where the way is so narrow that the room asked for pulls the cable straight, less is asked for, down to the margin:
    a straight cable is farthest from both sides, takes the grippers a long way, and is torn by a small error of its
    length.

    Args:
        q: (T+1, d) rod coordinates with angles that run on, T at least 2.
        task: The task; its cable, grippers and scene.
        config: Weights and margins.
        progress: Called with the share that is done; it may raise to stop.
    """
    room, margin = max(config.room, config.margin), config.margin
    rooms = sorted({room, float(np.sqrt(room * margin)), margin}, reverse=True)
    optimized = q
    for k, room in enumerate(rooms):
        optimized = _optimized(
            q, task, replace(config, room=room), lambda share, k=k: progress((k + share) / len(rooms))
        )
        if not is_pulled_straight(task.cable.rod.shapes(optimized)[1], task.cable.length, TAUT):
            break
    progress(1.0)
    return optimized


def _optimized(
    q: Float[np.ndarray, "t d"],
    task: Task,
    config: TrajectoryOptimizationConfig,
    progress: Callable[[float], None],
) -> Float[np.ndarray, "t d"]:
    """The same with the room of `config` and no less."""
    stages = len(CLEARANCE_WEIGHTS)
    for stage, weight in enumerate(CLEARANCE_WEIGHTS):

        def report(share: float, stage: int = stage) -> None:
            progress((stage + share) / stages)

        q = levenberg_marquardt(q, _Problem(task, config, weight, q), config.iterations, config.tolerance, report)
    return q


class _Problem:
    """The cost of the rows of `q`, of which the first and the last stay."""

    def __init__(
        self, task: Task, config: TrajectoryOptimizationConfig, weight: float, q: Float[np.ndarray, "t d"]
    ) -> None:
        self.task, self.config, self.weight, self.rod = task, config, weight, task.cable.rod
        first, second = squared_differences(len(q), 1), squared_differences(len(q), 2)
        self.smooth = tuple(a / STEP_SCALE**2 + b / CHANGE_SCALE**2 for a, b in zip(first, second, strict=True))
        self.loads = tuple(band / LOAD_STEP_SCALE**2 for band in first)
        self.load_units = self.rod.units[self.rod.loads]
        self.sharpest = config.bend_share * sharpest_turn_of(task)
        self.along = self.rod.loads.start
        self.tension = max(TENSION, float(q[[0, -1], self.along].max()))
        self.clearance_scale = np.sqrt(weight) / CLEARANCE_SCALE
        self.room, self.bodies = max(config.margin, config.room), BodyPoints.of(task)
        over_cable = any(body.meets_cable(task.cable.radius) for body in task.bodies)
        self.bodies_meet = over_cable or bool(task.body_pairs)
        self.arms = free_arms(task, np.empty((0, 2, 3)))

    def cost(self, q: Float[np.ndarray, "t d"]) -> float:
        """The cost alone, for trial steps."""
        stations, poses = self.rod.shapes(q)
        keypoints = self.rod.at_keypoints(stations).reshape(len(q), -1)
        loads = q[:, self.rod.loads] / self.load_units
        total = band_form(self.smooth, keypoints) + band_form(self.loads, loads)
        total += 0.5 * np.sum(loads**2) / LOAD_SCALE**2
        by_load = (self._stability(q), self._tension(q))
        residuals = (self._clearance(stations), self._bodies(poses), self._span(poses), *by_load)
        total += sum(0.5 * np.sum(value**2) for value, _ in residuals) + 0.5 * np.sum(self._bends(stations) ** 2)
        if self.arms is not None:
            total += 0.5 * np.sum(self._arms(poses)[0] ** 2)
        if self.bodies_meet:
            total += 0.5 * np.sum(self._apart(poses)[0] ** 2) + 0.5 * np.sum(self._off_cable(stations, poses)[0] ** 2)
        return float(total)

    def linearise(self, q: Float[np.ndarray, "t d"]) -> Normal:
        """Cost, gradient and Gauss-Newton blocks at q."""
        rows = len(q)
        stations, dstations, poses, dposes = self.rod.jacobians(q)
        keypoints = self.rod.at_keypoints(stations).reshape(rows, -1)
        jacobian = np.ascontiguousarray(self.rod.at_keypoints(dstations).reshape(rows, -1, self.rod.dof))
        gradient = np.einsum("tki,tk->ti", jacobian, band_product(self.smooth, keypoints))
        blocks = [
            self.smooth[k][:, None, None] * np.matmul(jacobian[: rows - k].transpose(0, 2, 1), jacobian[k:])
            for k in range(BANDS)
        ]
        cost = band_form(self.smooth, keypoints)

        loads = q[:, self.rod.loads] / self.load_units
        pull = band_product(self.loads, loads) + loads / LOAD_SCALE**2
        gradient[:, self.rod.loads] += pull / self.load_units
        places = np.arange(self.rod.dof)[self.rod.loads]
        for k in range(BANDS):
            diagonal = self.loads[k] + (1 / LOAD_SCALE**2 if k == 0 else 0.0)
            blocks[k][:, places, places] += diagonal[:, None] / self.load_units**2
        cost += band_form(self.loads, loads) + 0.5 * np.sum(loads**2) / LOAD_SCALE**2

        short, slope = self._clearance(stations)
        lack, dlack = self._stability(q)
        inner = np.concatenate([dstations[:, 1:-1]] * 2, axis=1)
        residuals = [
            (short, np.einsum("tsk,tski->tsi", slope, inner)),
            (lack[:, None], dlack[:, None]),
            self._tension(q),
        ]
        of_poses = [self._span(poses), self._bodies(poses), *([self._apart(poses)] if self.bodies_meet else [])]
        of_poses += [] if self.arms is None else [self._arms(poses)]
        for value, by_poses in of_poses:
            residuals.append((value, np.einsum("tckj,tkji->tci", by_poses, dposes)))
        if self.bodies_meet:
            value, which, by_stations, by_poses = self._off_cable(stations, poses)
            slopes = np.einsum("tsk,tski->tsi", by_stations, dstations[:, which])
            residuals.append((value, slopes + np.einsum("tckj,tkji->tci", by_poses, dposes)))
        if np.isfinite(self.sharpest):
            slopes = terms.turn_excess_slope(stations, dstations, self.rod, self.sharpest)
            residuals.append((self._bends(stations), slopes / BEND_SCALE))
        for value, slopes in residuals:
            cost += 0.5 * np.sum(value**2)
            gradient += np.einsum("tsi,ts->ti", slopes, value)
            blocks[0] += np.matmul(slopes.transpose(0, 2, 1), slopes)
        return Normal(float(cost), gradient, (blocks[0], blocks[1], blocks[2]))

    def _clearance(self, stations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weighted shortfalls of the clearance at each station but the ends, the grippers, and their slopes."""
        wanted = self.room + self.task.cable.radius
        return self._weighted(*terms.clearance_shortfall(stations[:, 1:-1], self.task.scene.world, wanted))

    def _bodies(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same for points round the bodies, and their slopes by the gripper poses."""
        return self._weighted(*terms.body_shortfall(self.bodies, self.task.scene.world, poses, self.room))

    def _apart(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same between the bodies of the two grippers."""
        return self._weighted(*terms.bodies_shortfall(self.task.body_pairs, poses, self.room))

    def _arms(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weighted shortfalls (t, 7) of the room of the arms, and their slopes by the gripper poses."""
        assert self.arms is not None
        short, slope = room_shortfall(poses, self.arms, WANTED)
        scale = np.sqrt(self.weight) / ARMS_SCALE
        return scale * short, scale[:, None, None] * slope

    def _off_cable(
        self, stations: np.ndarray, poses: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The same of stations that bodies could meet, which those are, and the slopes by them and by the poses."""
        short, which, by_stations, by_poses = terms.cable_shortfall(stations, poses, self.task, self.room)
        value, by_poses = self._weighted(short, by_poses)
        return value, np.tile(which, 2), self._weighted(short, by_stations)[1], by_poses

    def _weighted(self, short: np.ndarray, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Shortfalls (t, 2 k) against margin and room, from those against room, with their slopes."""
        much = short - (self.room - self.config.margin)
        much_slope = slope * (much > 0).reshape(*much.shape, *[1] * (slope.ndim - 2))
        return (
            np.concatenate([self.clearance_scale * np.maximum(0.0, much), short / ROOM_SCALE], axis=1),
            np.concatenate([self.clearance_scale * much_slope, slope / ROOM_SCALE], axis=1),
        )

    def _stability(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        lack, slope = terms.stability_shortfall(self.rod, q, self.config.stability_wanted)
        return lack / STABILITY_SCALE, slope / STABILITY_SCALE

    def _tension(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Excess (t, 1) of the force along the rod, and its slopes (t, 1, d)."""
        over, slope = np.maximum(0.0, q[:, None, self.along] - self.tension), np.zeros((len(q), 1, q.shape[1]))
        slope[:, 0, self.along] = over[:, 0] > 0
        return over / TENSION_SCALE, slope / TENSION_SCALE

    def _span(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Excess and shortfall (t, 2) of the gripper span, and their slopes by the poses."""
        length, least = self.rod.length, self.task.grippers.least_span + self.config.separation_margin
        over, slope = terms.span_excess(poses, self.config.span_wanted * length, least)
        return over / (length * SPAN_SCALE), slope / (length * SPAN_SCALE)

    def _bends(self, stations: np.ndarray) -> np.ndarray:
        """Excess (t, hinges) of the sine of the turn at each hinge over the greatest wanted."""
        return terms.turn_excess(stations, self.rod, self.sharpest) / BEND_SCALE


__getattr__ = renamed(__name__, {"RefinementConfig": "TrajectoryOptimizationConfig", "refine": "optimize_trajectory"})
