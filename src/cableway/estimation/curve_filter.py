"""The rod filter for points of unknown arc length: what a picture shows of a cable without marks.

A point says how far the cable is from its prediction across the cable, and nothing along it. The rest is that of
`rod_filter`: the same parameters, prior and drift, and so the same estimate. As the place on the rod to which a point
belongs depends on the parameters, each update looks for it anew a few times (an iterated extended Kalman filter).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from jaxtyping import Float

from cableway.core.checks import Bounds, Checked, NotNegative, Positive
from cableway.estimation import curve_kernels
from cableway.estimation.rod_filter import HALVINGS, EstimatorConfig, Prediction, RodEstimate, RodEstimator
from cableway.rod.material import PARAMETERS
from cableway.rod.planar import PlanarRod


@dataclass(frozen=True, kw_only=True)
class CurveConfig(Checked):
    """Settings of the estimation from points.

    Attributes:
        noise: Standard deviation [m] of the points over one hinge of the rod, at rest, with what it cannot explain.
        lag: Time [s] by which a moving cable may be behind; that share of its motion adds to the noise.
        gate: Distance, in standard deviations, from which on a point is of something else.
        least: Least such distance [m].
        most: Largest such distance [m].
        outlier: Distance, in standard deviations of the noise, from which on a point counts less.
        passes: Times that an update looks for the places of the points.

    Raises:
        InputError: A value is out of range.
    """

    noise: Positive[float] = 0.001
    lag: NotNegative[float] = 0.01
    gate: Positive[float] = 3.0
    least: Positive[float] = 0.006
    most: Positive[float] = 0.04
    outlier: Positive[float] = 2.0
    passes: Annotated[int, Bounds(1, 100)] = 3


@dataclass(frozen=True, eq=False)
class CurveFit:
    """The rod after an update, and how points lie beside it.

    Attributes:
        stations: (2N + 1, 2) of the rod [m].
        deviations: (2N + 1, 2, p) of the stations [m] by one standard deviation of the prior of each parameter.
        at: (k,) places of the points on the rod, in hinges from 0 to N.
        residuals: (k,) distances of the points from it, to its left [m]; NaN for those of something else.
    """

    stations: Float[np.ndarray, "s 2"]
    deviations: Float[np.ndarray, "s 2 p"]
    at: Float[np.ndarray, "k"]
    residuals: Float[np.ndarray, "k"]

    def places(self, at: Float[np.ndarray, "m"]) -> tuple[Float[np.ndarray, "m 2"], Float[np.ndarray, "m 2"]]:
        """Points [m] of the centre line at places in hinges from 0 to N, and its normals there, to the left."""
        points, normals = np.empty((len(at), 2)), np.empty((len(at), 2))
        curve_kernels.place(self.stations, np.asarray(at, float), points, normals)
        return points, normals


class CurveEstimator(RodEstimator):
    """Estimates theta from points of the centre line, and from keypoints as `RodEstimator` does.

    Args:
        rod: The rod; its length is the first guess.
        config: The settings of both.
        curve: The settings for points.
        control_step: Time [s] between two updates.
    """

    def __init__(self, rod: PlanarRod, config: EstimatorConfig, curve: CurveConfig, control_step: float) -> None:
        super().__init__(rod, config, control_step)
        self.curve, self._delay = curve, curve.lag / control_step

    def update_points(
        self, estimate: RodEstimate, points: Float[np.ndarray, "k 2"], poses: Float[np.ndarray, "2 3"], speed: float
    ) -> tuple[RodEstimate, CurveFit | None]:
        """The estimate after a picture, and how its points lie beside the rod.

        Where the rod cannot be held by these grippers, the estimate as it was, and None.

        Args:
            estimate: Before it.
            points: (k, 2) of the centre line [m], in any order; some may be of something else.
            poses: (2, 3) grippers at the time of the picture [m, m, rad].
            speed: Of the faster gripper then [m per control step].
        """
        estimate, held = self._held(estimate, None, poses)
        if not held.possible:
            return estimate, None
        points = np.ascontiguousarray(points, dtype=float)
        begin, covariance = self._drifted(estimate)
        inverse, prior = np.linalg.inv(covariance), self._prior
        theta, expected = begin, self._predict(held.q, begin, poses, 1)
        if not expected.possible:  # drifted to a rod that is too short
            theta = begin = estimate.theta
            expected = self._predict(held.q, theta, poses, 1)
        for _ in range(self.curve.passes):
            information, gradient, _ = self._said(points, expected, covariance, speed)
            narrowed = np.linalg.inv(inverse + information)
            moved = (theta - begin) / np.where(prior > 0, prior, 1.0)
            wanted = begin + prior * (narrowed @ (gradient + information @ moved))
            found = self._predict(expected.q, wanted, poses, 1)
            for _ in range(HALVINGS):
                if found.possible:
                    break
                wanted = (wanted + theta) / 2
                found = self._predict(expected.q, wanted, poses, 1)
            if not found.possible:
                break
            theta, expected, covariance = wanted, found, narrowed
        _, _, fit = self._said(points, expected, covariance, speed)
        return replace(estimate, theta=theta, covariance=covariance, q=expected.q, updates=estimate.updates + 1), fit

    def _said(
        self, points: Float[np.ndarray, "k 2"], expected: Prediction, covariance: Float[np.ndarray, "p p"], speed: float
    ) -> tuple[Float[np.ndarray, "p p"], Float[np.ndarray, "p"], CurveFit]:
        """See `curve_kernels.gather`."""
        curve = self.curve
        gate = (math.hypot(curve.noise, self._delay * speed), curve.gate, curve.least, curve.most, curve.outlier)
        information, gradient = np.zeros((PARAMETERS, PARAMETERS)), np.zeros(PARAMETERS)
        at, residuals = np.empty(len(points)), np.empty(len(points))
        stations, by_theta = expected.keypoints, expected.by_theta
        curve_kernels.gather(
            points, stations, by_theta, self._prior, covariance, gate, information, gradient, at, residuals
        )
        return information, gradient, CurveFit(stations, by_theta * self._prior, at, residuals)
