"""The filter of `cableway.estimation.parameter_filter` for a cable held in space.

theta = (L, log twist, log weight, b_1..b_K, g_L, g_R): the twisting stiffness C/B and the weight rho A g L^3/B by those
of the nominal rod, the modes of the bending stiffness along it as in the plane, and where the cable is in each gripper,
position [m] and rotation vector [rad]. The mean of the bending stiffness shows in the weight alone: of a cable without
weight nothing tells it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from cableway.core.checks import NotNegative
from cableway.estimation.parameter_filter import FilterConfig, ParameterEstimate, ParameterFilter, Prediction
from cableway.geometry.groups import SE3
from cableway.rod import spatial_kernels
from cableway.rod.inverse import meet_poses
from cableway.rod.material import LENGTH, MODES, modes
from cableway.rod.spatial import SpatialRod
from cableway.rod.spatial_inverse import fit_shape

TWIST, WEIGHT, STIFFNESS, GRASPS = 1, 2, slice(3, 3 + MODES), slice(3 + MODES, 15 + MODES)

NAMES = {
    "length": "m",
    "log twist": "",
    "log weight": "",
    **{f"stiffness mode {k}": "" for k in range(1, MODES + 1)},
    **{f"{side} grasp {axis}": unit for side in ("left", "right")
       for axis, unit in (("x", "m"), ("y", "m"), ("z", "m"), ("turn x", "rad"), ("turn y", "rad"), ("turn z", "rad"))},
}  # fmt: skip
"""Names and units of theta, in its order."""

STEP = 1e-5
"""Of the rod's parameters for central differences [m] and in logarithms."""


@dataclass(frozen=True, kw_only=True)
class SpatialEstimatorConfig(FilterConfig):
    """Settings of the estimation in space.

    Attributes:
        twist: Prior standard deviation of the logarithm of the twisting stiffness; 0 where it is known, as for all the
            others.
        weight: Of the logarithm of the weight.
        stiffness: Of each mode of the logarithm of the bending stiffness.

    Raises:
        InputError: A value is out of range.
    """

    twist: NotNegative[float] = 0.15
    weight: NotNegative[float] = 0.3
    stiffness: NotNegative[float] = 0.5

    def prior(self, length: float) -> Float[np.ndarray, "p"]:
        """See `FilterConfig.prior`."""
        deviation = np.empty(len(NAMES))
        deviation[[LENGTH, TWIST, WEIGHT]] = self.length * length, self.twist, self.weight
        deviation[STIFFNESS] = self.stiffness
        deviation[GRASPS] = [*[self.grasp] * 3, *[self.grasp_turn] * 3] * 2
        return deviation


@dataclass(frozen=True)
class SpatialEstimate(ParameterEstimate):
    """An estimate of a cable in space."""

    @property
    def grasps(self) -> Float[np.ndarray, "2 7"]:
        """See `ParameterEstimate.grasps`."""
        return _grasps(self.theta)


class SpatialEstimator(ParameterFilter[SpatialEstimate]):
    """`ParameterFilter` of a rod in space.

    Args:
        rod: The rod; its length, twist and weight are the first guess.
        config: The settings.
        control_step: Time [s] between two updates.
    """

    _estimate, _grasps = SpatialEstimate, GRASPS

    def __init__(self, rod: SpatialRod, config: SpatialEstimatorConfig, control_step: float) -> None:
        nominal = np.zeros(len(NAMES))
        nominal[LENGTH] = rod.length
        super().__init__(rod, config, control_step, nominal, NAMES)
        self.rod = rod

    def adapted(self, theta: Float[np.ndarray, "p"]) -> SpatialRod:
        """The rod with these parameters."""
        length, twist, weight, *modes = theta[: GRASPS.start].tolist()
        scaled = {"twist": self.rod.twist * math.exp(twist), "weight": self.rod.weight * math.exp(weight)}
        return replace(self.rod, length=length, modes=tuple(modes), **scaled)

    def predict(
        self, q: Float[np.ndarray, "12"], theta: Float[np.ndarray, "p"], poses: Float[np.ndarray, "2 7"]
    ) -> Prediction:
        """See `ParameterFilter.predict`."""
        rod, keypoints = self.adapted(theta), self.rod.keypoints
        found = meet_poses(rod, SE3.compose(poses, _grasps(theta)), q[None])
        if not len(found):
            return Prediction(q, np.full((keypoints, 3), np.nan), np.full((keypoints, 3, len(NAMES)), np.nan), False)
        stations, dstations, _, dends = rod.jacobians(found)
        by_q = rod.at_keypoints(dstations)[0].reshape(-1, rod.dof)
        by_ends = np.linalg.solve(dends[0].reshape(rod.dof, rod.dof).T, by_q.T).T
        by_theta = np.empty((by_q.shape[0], len(NAMES)))
        by_theta[:, GRASPS] = by_ends @ self._by_grasps(poses).reshape(rod.dof, -1)
        steps = STEP * np.eye(len(NAMES))[: GRASPS.start]
        (more, ends_more), (less, ends_less) = (self._shapes(found, theta + sides, rod) for sides in (steps, -steps))
        moved = (more - less).reshape(len(steps), -1) - SE3.minus(ends_more, ends_less).reshape(
            len(steps), -1
        ) @ by_ends.T
        by_theta[:, : GRASPS.start] = moved.T / (2 * STEP)
        finite = bool(np.isfinite(by_theta).all())
        return Prediction(found[0], rod.at_keypoints(stations)[0], by_theta.reshape(keypoints, 3, -1), finite)

    def _shapes(
        self, q: Float[np.ndarray, "1 12"], thetas: Float[np.ndarray, "m p"], near: SpatialRod
    ) -> tuple[Float[np.ndarray, "m n 3"], Float[np.ndarray, "m 2 7"]]:
        """Keypoints [m] and end poses of coordinates of rods with parameters, all with the hinges of one near."""
        stiff = near.hinges * np.exp(thetas[:, STIFFNESS] @ modes(near.hinges))
        nominal = np.array([1.0, self.rod.twist, self.rod.weight])
        rods = nominal * np.column_stack([thetas[:, LENGTH], np.exp(thetas[:, [TWIST, WEIGHT]])])
        found = [spatial_kernels.batch_shapes(q, *each, 0) for each in zip(rods, stiff, strict=True)]
        return np.array([near.at_keypoints(stations)[0] for stations, *_ in found]), np.array(
            [each[2][0] for each in found]
        )

    def fitted(self, keypoints: Float[np.ndarray, "n 3"], poses: Float[np.ndarray, "2 7"]) -> Float[np.ndarray, "12"]:
        """See `ParameterFilter.fitted`."""
        return fit_shape(self.rod, keypoints, poses[:, 3:])[0]


def _grasps(theta: Float[np.ndarray, "p"]) -> Float[np.ndarray, "2 7"]:
    return SE3.plus(np.tile(SE3.identity, (2, 1)), theta[GRASPS].reshape(2, SE3.dof))
