"""The filter of `cableway.estimation.parameter_filter` for a cable held in space.

theta = (L, log twist, log weight, g_L, g_R): the twisting stiffness C/B and the weight rho A g L^3/B by those of the
nominal rod, and where the cable is in each gripper, position [m] and rotation vector [rad]. The bending stiffness shows
in the weight alone: of a cable without weight nothing tells it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from jaxtyping import Float

from cableway.core.checks import Bounds, Checked, NotNegative, Share
from cableway.estimation.parameter_filter import LENGTH, ParameterEstimate, ParameterFilter, Prediction
from cableway.geometry.groups import SE3
from cableway.rod import spatial_kernels
from cableway.rod.inverse import meet_poses
from cableway.rod.spatial import SpatialRod
from cableway.rod.spatial_inverse import fit_shape

TWIST, WEIGHT, GRASPS = 1, 2, slice(3, 15)

NAMES = {
    "length": "m",
    "log twist": "",
    "log weight": "",
    **{f"{side} grasp {axis}": unit for side in ("left", "right")
       for axis, unit in (("x", "m"), ("y", "m"), ("z", "m"), ("turn x", "rad"), ("turn y", "rad"), ("turn z", "rad"))},
}  # fmt: skip
"""Names and units of theta, in its order."""

UNMOVED = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
"""The pose of a frame in itself."""

STEP = 1e-4
"""Of the rod's parameters, by their own size, for central differences."""


@dataclass(frozen=True, kw_only=True)
class SpatialEstimatorConfig(Checked):
    """Settings of the estimation in space; those from `memory` on are of `EstimatorConfig`.

    Attributes:
        length: Prior standard deviation of the length, in lengths; 0 where it is known, as for all the others.
        twist: Of the logarithm of the twisting stiffness.
        weight: Of the logarithm of the weight.
        grasp: Of where the cable is in a gripper [m].
        grasp_turn: Of its turn there [rad].
        memory: Time [s] in which the parameters forget.
        noise: Standard deviation [m] of what an equilibrium cannot explain, at rest.
        lag: Time [s] by which a moving cable may be behind; that share of its motion adds to the noise.
        outlier: Distance from the prediction, in standard deviations, from which a keypoint counts less.
        offset_gain: Share of the newest difference that enters the output offset; of the first ones it is the mean.

    Raises:
        InputError: A value is out of range.
    """

    length: NotNegative[float] = 0.02
    twist: NotNegative[float] = 0.15
    weight: NotNegative[float] = 0.3
    grasp: NotNegative[float] = 0.004
    grasp_turn: NotNegative[float] = 0.06
    memory: Annotated[float, Bounds(1e-9)] = 30.0
    noise: Annotated[float, Bounds(1e-9)] = 0.004
    lag: NotNegative[float] = 0.1
    outlier: Annotated[float, Bounds(1e-9)] = 3.0
    offset_gain: Share = 0.2

    def prior(self, length: float) -> Float[np.ndarray, "15"]:
        """Standard deviations of theta for a cable of nominal `length` [m]."""
        deviation = np.empty(len(NAMES))
        deviation[[LENGTH, TWIST, WEIGHT]] = self.length * length, self.twist, self.weight
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

    def adapted(self, theta: Float[np.ndarray, "15"]) -> SpatialRod:
        """The rod with these parameters."""
        length, twist, weight = theta[: GRASPS.start].tolist()
        return replace(
            self.rod, length=length, twist=self.rod.twist * np.exp(twist), weight=self.rod.weight * np.exp(weight)
        )

    def predict(
        self, q: Float[np.ndarray, "12"], theta: Float[np.ndarray, "15"], poses: Float[np.ndarray, "2 7"]
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
        for k, per_unit in ((LENGTH, 1.0), (TWIST, rod.twist), (WEIGHT, rod.weight)):
            moved, ends = _by_parameter(rod, found, k)
            by_theta[:, k] = per_unit * (moved - by_ends @ ends)
        return Prediction(
            found[0],
            rod.at_keypoints(stations)[0],
            by_theta.reshape(keypoints, 3, -1),
            bool(np.isfinite(by_theta).all()),
        )

    def _fitted(self, keypoints: Float[np.ndarray, "n 3"], poses: Float[np.ndarray, "2 7"]) -> Float[np.ndarray, "12"]:
        return fit_shape(self.rod, keypoints, poses[:, 3:])[0]


def _grasps(theta: Float[np.ndarray, "15"]) -> Float[np.ndarray, "2 7"]:
    return SE3.plus(np.tile(UNMOVED, (2, 1)), theta[GRASPS].reshape(2, SE3.dof))


def _by_parameter(
    rod: SpatialRod, q: Float[np.ndarray, "1 12"], k: int
) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "12"]]:
    """Derivatives of the keypoints [m] and of the end poses by a parameter of the rod, its coordinates held."""
    parameters, hinges = rod.arrays
    step = STEP * max(float(parameters[k]), STEP)
    sides = []
    for sign in (1, -1):
        moved = parameters.copy()
        moved[k] += sign * step
        stations, _, poses, _ = spatial_kernels.batch_shapes(q, moved, hinges, 0)
        sides.append((rod.at_keypoints(stations)[0], poses[0]))
    (more, ends_more), (less, ends_less) = sides
    return (more - less).ravel() / (2 * step), SE3.minus(ends_more, ends_less).ravel() / (2 * step)
