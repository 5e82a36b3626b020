"""The rod filter: estimates a few parameters of the rod in the plane, those of `cableway.rod.material`.

`cableway.estimation.parameter_filter` says how.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cableway.core.checks import NotNegative
from cableway.estimation import rod_kernels
from cableway.estimation.parameter_filter import MET, FilterConfig, ParameterEstimate, ParameterFilter, Prediction
from cableway.rod import material
from cableway.rod.inverse import fit_keypoints
from cableway.rod.material import CURVATURE, GRASPS, LENGTH, PARAMETERS, ROD, STIFFNESS
from cableway.rod.planar import PlanarRod


@dataclass(frozen=True, kw_only=True)
class EstimatorConfig(FilterConfig):
    """Settings of the estimation.

    Attributes:
        stiffness: Prior standard deviation of each mode of the logarithm of the stiffness; 0 where it is known, as for
            all the others.
        curvature: Of each mode of the turn at rest [rad].

    Raises:
        InputError: A value is out of range.
    """

    stiffness: NotNegative[float] = 0.5
    curvature: NotNegative[float] = 1.0

    @classmethod
    def nominal(cls, offset_gain: float = 0.2) -> EstimatorConfig:
        """The parameters are known: only the output offset is estimated."""
        return cls(length=0.0, stiffness=0.0, curvature=0.0, grasp=0.0, grasp_turn=0.0, offset_gain=offset_gain)

    def prior(self, length: float) -> Float[np.ndarray, "p"]:
        """See `FilterConfig.prior`."""
        deviation = np.zeros(PARAMETERS)
        deviation[LENGTH] = self.length * length
        deviation[STIFFNESS], deviation[CURVATURE] = self.stiffness, self.curvature
        deviation[GRASPS] = [self.grasp, self.grasp, self.grasp_turn] * 2
        return deviation


@dataclass(frozen=True)
class RodEstimate(ParameterEstimate):
    """An estimate of a rod in the plane; theta is laid out as in `cableway.rod.material`."""

    @property
    def grasps(self) -> Float[np.ndarray, "2 3"]:
        """See `ParameterEstimate.grasps`."""
        return self.theta[GRASPS].reshape(2, -1)


class RodEstimator(ParameterFilter[RodEstimate]):
    """`ParameterFilter` of a rod in the plane.

    Args:
        rod: The rod; its length is the first guess.
        config: The settings.
        control_step: Time [s] between two updates.
        trust: See `ParameterFilter`.
    """

    _estimate, _grasps = RodEstimate, GRASPS

    def __init__(self, rod: PlanarRod, config: EstimatorConfig, control_step: float, trust: float = 1.0) -> None:
        super().__init__(rod, config, control_step, material.nominal(rod), material.NAMES, trust)
        self.rod, self.modes = rod, material.modes(rod.hinges)

    def predict(
        self, q: Float[np.ndarray, "d"], theta: Float[np.ndarray, "p"], poses: Float[np.ndarray, "2 3"], stride: int = 0
    ) -> Prediction:
        """Of every station that is a multiple of `stride`, by default of the keypoints."""
        stride = stride or self.rod.stride
        q, n = q.copy(), 2 * self.rod.hinges // stride + 1
        space = self.rod.group.space
        keypoints, by_theta = np.empty((n, space)), np.empty((n, space, PARAMETERS))
        ends = self.rod.group.compose(poses, theta[GRASPS].reshape(2, -1))
        by_grasps = self._by_grasps(poses).reshape(ends.size, -1)
        left = rod_kernels.predict(q, ends, by_grasps, theta[ROD], self.modes, stride, keypoints, by_theta)
        finite = bool(np.isfinite(keypoints).all() and np.isfinite(by_theta).all())
        return Prediction(q, keypoints, by_theta, finite and left < MET)

    def fitted(self, keypoints: Float[np.ndarray, "n 2"], poses: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "d"]:
        """See `ParameterFilter.fitted`."""
        return self.rod.continued(fit_keypoints(self.rod, keypoints)[0], poses)
