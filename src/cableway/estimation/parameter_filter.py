"""The filter that estimates parameters of a held rod while it moves, and the output offset they leave unexplained.

An observation is predicted as the equilibrium of the adapted rod between the grippers as they were when it was taken,
h(theta) = s(q(theta); theta): between gripper poses y with grasps g its shape q solves e(q; theta) = y o g for the end
poses e, so that ::

    dh/dtheta = ds/dtheta - ds/dq (de/dq)^-1 (de/dtheta - d(y o g)/dtheta).

The parameters drift towards their prior (theta_0, P_0) as an Ornstein-Uhlenbeck process, so that no unobservable one
runs away: with rho = e^(-dt/T), theta <- theta_0 + rho (theta - theta_0) and P <- rho^2 P + (1 - rho^2) P_0. An
extended Kalman filter corrects them by what was measured. Keypoints far from their prediction count less (Huber 1964,
"Robust estimation of a location parameter"), missing ones not at all. What remains of the difference, low-pass
filtered, is the output offset. Where a tracker estimates theta from pictures (`cableway.estimation.curve_filter`), its
estimate takes the place of the correction, so that there is one.

`cableway.estimation.rod_filter` is this of a rod in the plane, `cableway.estimation.spatial_filter` in space.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Generic, TypeVar, cast

import numpy as np
from jaxtyping import Float

from cableway.core.checks import Bounds, Checked, NotNegative, Share
from cableway.estimation.surprise import Surprise
from cableway.records import Estimate, RodParameters
from cableway.rod.held_rod import HeldRod
from cableway.rod.material import LENGTH

MET = 1e-3
"""Residual of the ends, in lengths and radians, up to which the rod is held as it should be."""

HALVINGS = 6
"""Shorter corrections tried where the corrected rod cannot be held by its grippers."""

LONGER = (1.0025, 1.005, 1.01, 1.02, 1.04, 1.06, 1.08, 1.1)
"""Lengths tried, in estimated ones, where the rod is too short for the grippers that hold the cable: no more than it
takes, for what is taken to be longer than it is will be pulled taut."""

LONGEST = 1.1
"""In nominal lengths, what a cable may turn out to be."""

JUMP = 0.015
"""Mean distance [m] of the keypoints from their prediction from which the cable may have jumped to another shape."""

FAR_OFF = 0.03
"""Distance [m] of a keypoint from where the latency tried would have it, beyond which it says no more about it."""


@dataclass(frozen=True)
class ParameterEstimate(ABC):
    """An estimate of the filter.

    Attributes:
        theta: (p,) parameters, the length [m] first.
        covariance: (p, p) of theta, in units of its prior.
        q: (d,) shape last predicted.
        offset: (n, space) [m] what the prediction is short of.
        surprise: What it leaves unexplained.
        updates: Observations that it is made of.
    """

    theta: Float[np.ndarray, "p"]
    covariance: Float[np.ndarray, "p p"]
    q: Float[np.ndarray, "d"]
    offset: Float[np.ndarray, "n space"]
    surprise: Surprise
    updates: int = 0

    @property
    def length(self) -> float:
        """Of the cable [m]."""
        return float(self.theta[LENGTH])

    @property
    @abstractmethod
    def grasps(self) -> Float[np.ndarray, "2 pose"]:
        """Poses of the cable's ends in the frames of the grippers."""


@dataclass(frozen=True)
class Prediction:
    """Shape q (d,), keypoints (n, space) or other stations, their derivative by theta, whether it can be held so."""

    q: Float[np.ndarray, "d"]
    keypoints: Float[np.ndarray, "n space"]
    by_theta: Float[np.ndarray, "n space p"]
    possible: bool

    def distances(self, keypoints: Float[np.ndarray, "n space"]) -> Float[np.ndarray, "k"]:
        """From the visible keypoints [m]; infinite where the rod cannot be held so."""
        if not self.possible:
            return np.array([np.inf])
        distances = np.linalg.norm(keypoints - self.keypoints, axis=1)
        return distances[np.isfinite(distances)]


@dataclass(frozen=True, kw_only=True)
class FilterConfig(Checked, ABC):
    """Settings of a filter.

    Attributes:
        length: Prior standard deviation of the length, in lengths; 0 where it is known, as for all the others.
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
    grasp: NotNegative[float] = 0.004
    grasp_turn: NotNegative[float] = 0.06
    memory: Annotated[float, Bounds(1e-9)] = 30.0
    noise: Annotated[float, Bounds(1e-9)] = 0.004
    lag: NotNegative[float] = 0.1
    outlier: Annotated[float, Bounds(1e-9)] = 3.0
    offset_gain: Share = 0.2

    @abstractmethod
    def prior(self, length: float) -> Float[np.ndarray, "p"]:
        """Standard deviations of theta for a cable of nominal `length` [m]."""


E = TypeVar("E", bound=ParameterEstimate)


class ParameterFilter(ABC, Generic[E]):
    """Estimates theta and the output offset.

    Args:
        rod: The rod; its length is the first guess.
        config: The settings.
        control_step: Time [s] between two updates.
        nominal: (p,) theta_0.
        names: Names and units of theta, in its order.
        trust: Share by which a frame counts: less where the cable swings about its equilibrium. What looks like a
            contact is not known from swinging then.
    """

    _estimate: ClassVar[type[ParameterEstimate]]
    _grasps: ClassVar[slice]
    """Of theta."""

    def __init__(
        self, rod: HeldRod, config: FilterConfig, control_step: float, nominal: Float[np.ndarray, "p"],
        names: Mapping[str, str], trust: float = 1.0,
    ) -> None:  # fmt: skip
        self.rod, self._config, self._nominal, self._names = rod, config, nominal, names
        self._prior, self._trust = config.prior(rod.length), trust
        self._kept = math.exp(-control_step / config.memory)
        self._lag = config.lag / control_step

    @abstractmethod
    def predict(
        self, q: Float[np.ndarray, "d"], theta: Float[np.ndarray, "p"], poses: Float[np.ndarray, "2 pose"]
    ) -> Prediction:
        """Of the keypoints, from a shape near."""

    @abstractmethod
    def fitted(self, keypoints: Float[np.ndarray, "n space"], poses: Float[np.ndarray, "2 pose"]) -> np.ndarray:
        """The nominal rod's shape q (d,) nearest to keypoints, written with gripper poses like these."""

    @property
    def adapts(self) -> bool:
        """Whether parameters are estimated, and not the output offset alone."""
        return bool(self._prior.any())

    def start(self, q: Float[np.ndarray, "d"], known: Mapping[str, Estimate] | None = None) -> E:
        """The first shape q, and what was estimated of the parameters before, each by itself; by default nothing."""
        keypoints = self.rod.at_keypoints(self.rod.shapes(q[None])[0])[0]
        theta, variance = self._nominal.copy(), np.ones(len(self._nominal))
        for k, name in enumerate(self._names):
            if known and name in known and self._prior[k] > 0:
                theta[k], variance[k] = known[name].value, (known[name].deviation / self._prior[k]) ** 2
        surprise = Surprise.none(keypoints, self.rod.length)
        return cast(E, self._estimate(theta, np.diag(variance), np.array(q, float), np.zeros_like(keypoints), surprise))

    def estimates(self, estimate: E) -> dict[str, Estimate]:
        """The parameters by name."""
        deviations = self._prior * np.sqrt(np.diag(estimate.covariance))
        theta, nominal, prior = estimate.theta, self._nominal, self._prior
        return {
            name: Estimate(float(theta[k]), float(deviations[k]), float(nominal[k]), float(prior[k]), unit)
            for k, (name, unit) in enumerate(self._names.items())
        }

    def slack(self, estimate: E, poses: Float[np.ndarray, "2 pose"]) -> tuple[float, float]:
        """How much longer [m] the cable is than the distance between its ends, and the standard deviation of that.

        Args:
            estimate: The present one.
            poses: (2, pose) grippers [m, m, rad].
        """
        ends = self.rod.group.compose(poses, estimate.grasps)[:, : self.rod.group.space]
        apart = ends[1] - ends[0]
        gap = float(np.linalg.norm(apart))
        toward = apart / max(gap, 1e-9)
        by_grasps = self._by_grasps(poses)
        by_theta = np.zeros(len(self._nominal))
        by_theta[LENGTH] = 1.0
        by_theta[self._grasps] = toward @ (by_grasps[0] - by_grasps[1])[: len(toward)]
        scaled = by_theta * self._prior
        return estimate.length - gap, math.sqrt(float(scaled @ estimate.covariance @ scaled))

    def _by_grasps(self, poses: Float[np.ndarray, "2 pose"]) -> Float[np.ndarray, "2 step g"]:
        """Derivative of the ends' poses by the grasps."""
        dof = self.rod.group.dof
        out = np.zeros((2, dof, 2 * dof))
        out[0, :, :dof], out[1, :, dof:] = self.rod.group.to_world(poses)
        return out

    def residuals(
        self,
        estimate: E,
        keypoints: Float[np.ndarray, "n space"],
        poses: Float[np.ndarray, "2 pose"],
        others: Float[np.ndarray, "A 2 pose"],
    ) -> Float[np.ndarray, "A"]:
        """Mean squared distance [m^2] of the visible keypoints from the cable, were the grippers at other poses.

        Distances beyond `FAR_OFF` count as that.

        The cable follows its ends to first order from where it would be at `poses`. The output offset is left out: in
        steady motion it takes up what a wrong latency leaves.

        Args:
            estimate: The present one.
            keypoints: (n, space) [m], NaN where missing.
            poses: (2, pose) grippers [m, m, rad].
            others: (A, 2, pose) such poses.
        """
        group, dof = self.rod.group, self.rod.group.dof
        _, expected = self._held(estimate, keypoints, poses)
        moved = group.minus(group.compose(others, estimate.grasps), group.compose(poses, estimate.grasps))
        by_grasps = self._by_grasps(poses)
        inward = np.stack([np.linalg.inv(by_grasps[end, :, end * dof : (end + 1) * dof]) for end in range(2)])
        in_grippers = np.einsum("eij,aej->aei", inward, moved).reshape(len(others), -1)
        there = expected.keypoints + np.einsum("nkg,ag->ank", expected.by_theta[..., self._grasps], in_grippers)
        return np.nanmean(np.minimum(np.sum((keypoints - there) ** 2, axis=-1), FAR_OFF**2), axis=-1)

    def update(
        self,
        estimate: E,
        keypoints: Float[np.ndarray, "n space"],
        poses: Float[np.ndarray, "2 pose"],
        speed: float,
        confidence: Float[np.ndarray, "n"] | None = None,
        rod: RodParameters | None = None,
        information: Float[np.ndarray, "n space space"] | None = None,
    ) -> E:
        """The estimate after an observation; as it was where the rod cannot explain it.

        Args:
            estimate: Before it.
            keypoints: (n, space) [m], NaN where missing.
            poses: (2, pose) grippers at the time of the frame [m, m, rad].
            speed: Of the faster gripper then [m per control step].
            confidence: (n,) from 0 to 1, by which each keypoint counts; None where all count the same.
            rod: Theta as it is known by now, which takes the place of a correction by the keypoints.
            information: (n, space, space) inverse covariance of each keypoint, over that of one that is seen in all
                directions; None where all are. A camera alone does not see how far away one is.
        """
        visible = np.isfinite(keypoints[:, 0])
        if not visible.any():
            return estimate
        estimate, expected = self._held(estimate, keypoints, poses)
        if not expected.possible:
            return estimate
        if rod is None:
            theta, covariance = self._corrected(estimate, expected, keypoints, speed, confidence, information)
        else:
            theta, covariance = self._given(rod)
        corrected = self._explained(expected.q, theta, keypoints, poses)
        for _ in range(HALVINGS):
            if corrected.possible:
                break
            # a rod that is too short for its grippers: part of the way, and no surer than before
            theta, covariance = (theta + estimate.theta) / 2, estimate.covariance
            corrected = self._explained(expected.q, theta, keypoints, poses)
        if not corrected.possible:
            return estimate
        rest = np.where(visible[:, None], keypoints - corrected.keypoints, estimate.offset)
        gain = max(self._trust * self._config.offset_gain, 1 / (1 + estimate.updates))
        offset = estimate.offset + gain * (rest - estimate.offset)
        surprise = estimate.surprise.updated(keypoints, expected.keypoints, estimate.offset, corrected.keypoints)
        return replace(
            estimate, theta=theta, covariance=covariance, q=corrected.q, offset=offset, surprise=surprise,
            updates=estimate.updates + 1,
        )  # fmt: skip

    def expected(
        self, estimate: E, poses: Float[np.ndarray, "2 pose"]
    ) -> tuple[Prediction, Float[np.ndarray, "n space space"]]:
        """The keypoints between grippers at poses [m, m, rad], and their covariance [m^2] by that of theta."""
        prediction = self._held(estimate, None, poses)[1]
        rows = prediction.by_theta * self._prior
        return prediction, np.einsum("nip,pq,njq->nij", rows, estimate.covariance, rows)

    def held_at(self, estimate: E, share: float = 1.0) -> tuple[int, Float[np.ndarray, "space"], float] | None:
        """See `Surprise.held_at`; None, too, where the cable swings, as that is not known from it."""
        return None if self._trust < 1.0 else estimate.surprise.held_at(share)

    def _held(
        self, estimate: E, keypoints: Float[np.ndarray, "n space"] | None, poses: Float[np.ndarray, "2 pose"]
    ) -> tuple[E, Prediction]:
        """The estimate and its prediction; where the grippers are too far apart for it, with a longer rod."""
        expected = self._explained(estimate.q, estimate.theta, keypoints, poses)
        for share in LONGER:
            if expected.possible:
                break
            theta = estimate.theta.copy()
            theta[LENGTH] *= share
            if theta[LENGTH] > LONGEST * self.rod.length:
                break
            longer = self._explained(estimate.q, theta, keypoints, poses)
            if longer.possible:
                return replace(estimate, theta=theta), longer
        return estimate, expected

    def _explained(
        self,
        q: Float[np.ndarray, "d"],
        theta: Float[np.ndarray, "p"],
        keypoints: Float[np.ndarray, "n space"] | None,
        poses: Float[np.ndarray, "2 pose"],
    ) -> Prediction:
        """The prediction that goes on from q or, after a jump, from the keypoints, whichever is nearer to them."""
        going_on = self.predict(q, theta, poses)
        if keypoints is None:
            return going_on
        missed = float(going_on.distances(keypoints).mean())
        if missed < JUMP:
            return going_on
        filled = np.where(np.isfinite(keypoints), keypoints, self.rod.at_keypoints(self.rod.shapes(q[None])[0])[0])
        anew = self.predict(self.fitted(filled, poses), theta, poses)
        return anew if float(anew.distances(keypoints).mean()) < 0.5 * missed else going_on

    def _corrected(
        self,
        estimate: E,
        expected: Prediction,
        keypoints: Float[np.ndarray, "n space"],
        speed: float,
        confidence: Float[np.ndarray, "n"] | None,
        information: Float[np.ndarray, "n space space"] | None,
    ) -> tuple[Float[np.ndarray, "p"], Float[np.ndarray, "p p"]]:
        """One step of the filter: theta and its covariance in units of the prior."""
        config, prior = self._config, self._prior
        error, by_theta = keypoints - expected.keypoints, expected.by_theta
        if information is not None:
            roots = _roots(information)
            error, by_theta = np.einsum("nij,nj->ni", roots, error), np.einsum("nij,njp->nip", roots, by_theta)
        distance = np.linalg.norm(error, axis=1)
        deviation = math.hypot(config.noise, self._lag * speed)
        certainty = self._trust / np.maximum(1.0, distance / (config.outlier * deviation)) / deviation**2
        certainty = certainty if confidence is None else certainty * confidence
        weights = np.repeat(np.where(np.isfinite(distance), certainty, 0.0), keypoints.shape[1])
        error = np.nan_to_num(error).ravel()
        rows = (by_theta * prior).reshape(-1, len(prior))
        theta, drifted = self._drifted(estimate, self._kept)
        weighted = rows.T * weights
        covariance = np.linalg.inv(np.linalg.inv(drifted) + weighted @ rows)
        return theta + prior * (covariance @ (weighted @ error)), covariance

    def _given(self, rod: RodParameters) -> tuple[Float[np.ndarray, "p"], Float[np.ndarray, "p p"]]:
        """Theta and its covariance in units of the prior; what is taken as known here stays so."""
        free = self._prior > 0
        units = np.where(free, self._prior, 1.0)
        covariance = np.where(np.outer(free, free), rod.covariance / np.outer(units, units), np.eye(len(units)))
        return np.where(free, rod.mean, self._nominal), covariance

    def _drifted(self, estimate: E, kept: float) -> tuple[Float[np.ndarray, "p"], Float[np.ndarray, "p p"]]:
        """Theta and its covariance, in units of the prior, once a share of what was known is kept."""
        nominal = self._nominal
        theta = nominal + kept * (estimate.theta - nominal)
        return theta, kept**2 * estimate.covariance + (1 - kept**2) * np.eye(len(self._nominal))


def _roots(information: Float[np.ndarray, "n k k"]) -> Float[np.ndarray, "n k k"]:
    """Square roots of matrices, which are positive semidefinite."""
    values, vectors = np.linalg.eigh(information)
    return np.einsum("nij,nj,nkj->nik", vectors, np.sqrt(np.maximum(values, 0.0)), vectors)
