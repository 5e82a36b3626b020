"""The cost of a motion over the horizon, and the box its actions lie in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cableway.control.limits import span_limit
from cableway.geometry import polyline
from cableway.scene.task import Grippers, Task
from cableway.tang2025.control import terms
from cableway.tang2025.control.mpc_config import MPCConfig

HEADROOM = 0.2
"""Share of the step limit that the box leaves beyond the plan's own step, for catching up."""

LONGEST_SIDE = 0.95
"""Longest half side of the box over the step limit; the other is then 0.31 of it."""


@dataclass(frozen=True)
class Target:
    """What the motion over the horizon should be.

    Attributes:
        shapes: (H, n, 2) keypoints [m] after each action.
        poses: (H, 2, 3) gripper poses [m, m, rad] after each action.
        actions: (H, 2, 3) gripper motions [m, m, rad].
    """

    shapes: Float[np.ndarray, "H n 2"]
    poses: Float[np.ndarray, "H 2 3"]
    actions: Float[np.ndarray, "H 2 3"]


class HorizonCost:
    """Gathers the terms of the cost for one task.

    Args:
        task: Scene, cable and grippers.
        config: Weights and thresholds.
    """

    def __init__(self, task: Task, config: MPCConfig) -> None:
        self._task, self._config = task, config
        unit = np.repeat(np.eye(task.cable.keypoints)[..., None], 2, axis=-1)
        self._points = polyline.spline(unit, config.pieces)[..., 0].T
        later = np.tril(np.ones((config.horizon, config.horizon)))
        self._poses_by_actions = np.einsum("kj,gh,xy->kgxjhy", later, np.eye(2), np.eye(3)).reshape(
            config.horizon, 2, 3, -1
        )
        self._units = np.array([1.0, 1.0, config.turn_lever**2])

    def terms(
        self,
        shapes: Float[np.ndarray, "H n 2"],
        poses: Float[np.ndarray, "2 3"],
        actions: Float[np.ndarray, "H 2 3"],
        target: Target,
    ) -> list[terms.Term]:
        """All terms for predicted `shapes` [m] and `actions` from gripper `poses`."""
        config, cable, derivative = self._config, self._task.cable, self._poses_by_actions
        reached = poses + np.cumsum(actions, axis=0)
        return [
            terms.tracking(shapes, target.shapes, config.tracking_weight),
            terms.deviation(actions, target.actions, config.control_weight * self._units, np.eye(actions.size)),
            terms.deviation(reached, target.poses, config.pose_weight * self._units, derivative),
            self._cable_clearance(shapes),
            self._gripper_clearance(reached),
            terms.separation(
                reached,
                derivative,
                self._task.grippers.least_span,
                span_limit(target.poses, cable.length, config.soft_span),
                config.span_weight,
            ),
        ]

    def _cable_clearance(self, shapes: np.ndarray) -> terms.Term:
        count, n = self._points.shape
        residual, by_points, near = self._clearance(self._points @ shapes, self._task.cable.radius)
        row, point = near // count, near % count
        # (k, 2n): from all keypoints of the row to the residual
        by_shapes = (self._points[point][:, :, None] * by_points[:, None, :]).reshape(len(near), 2 * n)

        def by_actions(derivative: np.ndarray) -> np.ndarray:
            flat = derivative.reshape(len(derivative), 2 * n, -1)
            return np.einsum("ki,kia->ka", by_shapes, flat[row])

        return residual, by_actions

    def _gripper_clearance(self, poses: np.ndarray) -> terms.Term:
        residual, by_points, near = self._clearance(poses[..., :2], self._task.grippers.radius)
        rows = self._poses_by_actions[:, :, :2].reshape(-1, 2, self._poses_by_actions.shape[-1])[near]
        return residual, lambda _: np.einsum("kx,kxa->ka", by_points, rows)

    def _clearance(self, points: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        config = self._config
        return terms.clearance(
            points.reshape(-1, 2),
            self._task.scene.world,
            radius,
            config.threshold,
            config.obstacle_weight,
            config.profile,
        )


@dataclass(frozen=True)
class ActionBox:
    """Unknowns in which the allowed actions contain a box, |x| <= bound.

    For each gripper and action one side of the box lies along the wanted step and reaches `HEADROOM` beyond it, the
    other reaches as far as the disc of allowed steps lets it; without a wanted step the box is a square. The third
    unknown is the turn.

    Attributes:
        basis: (2 H, 3, 3) from three unknowns to one gripper's action [m or rad per unit].
        bound: (a,) half the width of the box.
    """

    basis: Float[np.ndarray, "g 3 3"]
    bound: Float[np.ndarray, "a"]

    @classmethod
    def around(cls, wanted: Float[np.ndarray, "H 2 3"], grippers: Grippers) -> ActionBox:
        """The box for wanted actions (H, 2, 3)."""
        moves = wanted[..., :2].reshape(-1, 2)
        size = np.linalg.norm(moves, axis=1)
        long = np.clip(size / grippers.max_step + HEADROOM, np.sqrt(0.5), LONGEST_SIDE)
        along = np.where(size[:, None] > 1e-9, moves / np.maximum(size, 1e-9)[:, None], [1.0, 0.0])
        basis = np.zeros((len(moves), 3, 3))
        basis[:, :2, 0] = grippers.max_step * along
        basis[:, :2, 1] = grippers.max_step * np.stack([-along[:, 1], along[:, 0]], axis=1)
        basis[:, 2, 2] = grippers.max_turn
        return cls(basis, np.column_stack([long, np.sqrt(1 - long**2), np.ones(len(moves))]).ravel())

    def actions(self, x: Float[np.ndarray, "a"]) -> Float[np.ndarray, "H 2 3"]:
        """The actions that unknowns stand for."""
        return np.einsum("gxu,gu->gx", self.basis, x.reshape(-1, 3)).reshape(-1, 2, 3)

    def by_unknowns(self, by_actions: Float[np.ndarray, "m a"]) -> Float[np.ndarray, "m a"]:
        """A derivative by the unknowns from that by the actions."""
        split = by_actions.reshape(len(by_actions), -1, 3)
        return np.einsum("mgx,gxu->mgu", split, self.basis).reshape(by_actions.shape)

    def unknowns(self, actions: Float[np.ndarray, "H 2 3"]) -> Float[np.ndarray, "a"]:
        """The unknowns of actions; the columns of each basis are orthogonal."""
        x = np.einsum("gxu,gx->gu", self.basis, actions.reshape(-1, 3)) / np.sum(self.basis**2, axis=1)
        return x.ravel()
