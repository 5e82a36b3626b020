"""The rod filter for points of unknown arc length: what a picture shows of a cable without marks.

A point says how far the cable is from its prediction across the cable, and nothing along it. Marks at the keypoints
say that, too; which keypoint a mark is at follows from where the rod is expected, anew in every frame. The rest is that
of `rod_filter`: the same parameters and prior, and so the same estimate. As the place on the rod to which a point
belongs depends on the parameters, each update looks for it anew a few times (an iterated extended Kalman filter).

What was known is forgotten as the grippers move, not as time goes by: a hidden cable between grippers that stand lies
where it lay. What no rod explains, friction above all, is much the same from one picture to the next, so that pictures
close in time say little more than one.

It searches in coordinates and parameters (q, p) of the rod, of which the grasps are a function, instead of for the rod
between given ends: a branch of equilibria that ends at a fold as the grippers move on is no end of the search, which
bends or holds the rod a little otherwise, and slides to another branch where the points say so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from cableway.core.checks import Checked, NotNegative, Positive
from cableway.estimation import curve_kernels
from cableway.estimation.naming import named
from cableway.estimation.rod_filter import EstimatorConfig, RodEstimate, RodEstimator
from cableway.records import RodParameters
from cableway.rod.least_squares import Rule
from cableway.rod.material import GRASPS, ROD
from cableway.rod.planar import PlanarRod

KNOWN = 1e-3
"""Standard deviation of what is taken as known, in the usual ones of what is not: it keeps matrices regular."""

SURPRISING = 0.8
"""Strain from which on a cable is not what it was, for it slipped, sticks or is touched: what was known of it is
forgotten. That of a cable that is followed stays below 0.5, but for the first picture."""

PASSES = 2
"""Times that an update asks which points are of the cable: by what was expected, and by what those tell. The first time
marks that are too far from where one is expected are points of the cable, by which the others find their names."""

SINGULAR = 1e-12
"""Least eigenvalue of a normal matrix, in its largest one."""

FITTING = Rule(first=1e-6, restart=1e-6, fall=1e-6, small=1e-4, steps=30.0, trials=40.0, max_step=0.5)
"""For a fit that goes on from the frame before."""


@dataclass(frozen=True, kw_only=True)
class CurveConfig(Checked):
    """Settings of the estimation from points.

    Attributes:
        travel: Way [m] of the faster gripper in which the parameters forget.
        noise: Standard deviation [m] of the points over one hinge of the rod, at rest, with what it cannot explain.
        lag: Time [s] by which a moving cable may be behind; that share of its motion adds to the noise.
        gate: Distance, in standard deviations, from which on a point is of something else.
        least: Least such distance [m].
        most: Largest such distance [m].
        mark: Standard deviation [m] of a mark, the same.
        lasting: Time [s] for which the cable lies beside the rod in the same way: pictures within it count as one; each
            counts where it is 0.
        outlier: Distance, in standard deviations of the noise, from which on a point or a mark counts less.

    Raises:
        InputError: A value is out of range.
    """

    travel: Positive[float] = 4.0
    noise: Positive[float] = 0.0015
    lag: NotNegative[float] = 0.01
    gate: Positive[float] = 3.0
    least: Positive[float] = 0.006
    most: Positive[float] = 0.04
    mark: Positive[float] = 0.0005
    lasting: NotNegative[float] = 0.2
    outlier: Positive[float] = 2.0


@dataclass(frozen=True, eq=False)
class CurveFit:
    """The rod after an update, and how points lie beside it.

    Attributes:
        stations: (2N + 1, 2) of the rod [m].
        deviations: (2N + 1, 2, m) of the stations [m] by m errors of the estimate, independent and of variance 1 each.
        at: (k,) places of the points on the rod, in hinges from 0 to N.
        residuals: (k,) distances of the points from it, to its left [m]; NaN for those of something else.
        marks: (n, 2) where the marks at the keypoints are seen [m], mean of all that show one; NaN where none does.
        off: (b,) distances of all marks from their keypoints [m]; NaN for those of something else.
        strain: How improbable the rod is by what was known before: the distance of theta from that, in standard
            deviations, over the root of how many numbers it has.
        astray: Largest number by which an end is off where its gripper would hold it, in standard deviations of the
            prior of that.
        askew: The same of its turn.
    """

    stations: Float[np.ndarray, "s 2"]
    deviations: Float[np.ndarray, "s 2 m"]
    at: Float[np.ndarray, "k"]
    residuals: Float[np.ndarray, "k"]
    marks: Float[np.ndarray, "n 2"]
    off: Float[np.ndarray, "b"]
    strain: float
    astray: float
    askew: float

    def places(self, at: Float[np.ndarray, "m"]) -> tuple[Float[np.ndarray, "m 2"], Float[np.ndarray, "m 2"]]:
        """Points [m] of the centre line at places in hinges from 0 to N, and its normals there, to the left."""
        points, normals = np.empty((len(at), 2)), np.empty((len(at), 2))
        curve_kernels.place(self.stations, np.asarray(at, float), points, normals)
        return points, normals


class _Held(NamedTuple):
    """See `curve_kernels.held`."""

    stations: Float[np.ndarray, "s 2"]
    by_x: Float[np.ndarray, "s 2 m"]
    theta: Float[np.ndarray, "p"]
    rates: Float[np.ndarray, "p m"]


class CurveEstimator(RodEstimator):
    """Estimates theta from points of the centre line, and from keypoints as `RodEstimator` does.

    Args:
        rod: The rod; its length is the first guess.
        config: The settings of both; its memory is for keypoints alone.
        curve: The settings for points.
        control_step: Time [s] between two updates.
    """

    def __init__(self, rod: PlanarRod, config: EstimatorConfig, curve: CurveConfig, control_step: float) -> None:
        super().__init__(rod, config, control_step)
        self.curve, self._delay = curve, curve.lag / control_step
        self._new = 1 - math.exp(-control_step / curve.lasting) if curve.lasting else 1.0
        # what is taken as known is so to a thousandth of what is usually not known of it
        self._spread = np.maximum(self._prior, KNOWN * EstimatorConfig().prior(rod.length))
        self._units = np.concatenate([rod.units, self._spread[ROD]])

    def update_points(
        self,
        estimate: RodEstimate,
        points: Float[np.ndarray, "k 2"],
        poses: Float[np.ndarray, "2 3"],
        speed: float,
        blobs: Sequence[Float[np.ndarray, "b 2"]] = (),
    ) -> tuple[RodEstimate, CurveFit | None]:
        """The estimate after a picture, and how its points lie beside the rod.

        Where there is no such rod, the estimate as it was, and None.

        Args:
            estimate: Before it.
            points: (k, 2) of the centre line [m], in any order; some may be of something else.
            poses: (2, 3) grippers at the time of the picture [m, m, rad].
            speed: Of the faster gripper then [m per control step].
            blobs: (b, 2) of each camera, what may be marks [m], in any order.
        """
        points, poses = np.ascontiguousarray(points, dtype=float), np.ascontiguousarray(poses, dtype=float)
        if estimate.updates:
            # by the picture in full, as a change must not wait for pictures to come, and by marks as by points: what no
            # rod explains of them is no change
            judged = self._updated(estimate, points, poses, speed, blobs, mark=self.curve.noise)[1]
            if judged is None or judged.strain <= SURPRISING:
                return self._updated(estimate, points, poses, speed, blobs, self._new)
            estimate = replace(estimate, theta=self._nominal, covariance=np.eye(len(self._nominal)), updates=0)
        return self._updated(estimate, points, poses, speed, blobs)

    def _updated(
        self,
        estimate: RodEstimate,
        points: Float[np.ndarray, "k 2"],
        poses: Float[np.ndarray, "2 3"],
        speed: float,
        blobs: Sequence[Float[np.ndarray, "b 2"]],
        new: float = 1.0,
        mark: float | None = None,
    ) -> tuple[RodEstimate, CurveFit | None]:
        """See `update_points`; `new` is the share of a picture that counts, `mark` replaces `CurveConfig.mark` [m]."""
        mark = self.curve.mark if mark is None else mark
        expected, before = self._drifted(estimate, math.exp(-speed / self.curve.travel))
        root = np.linalg.inv(np.linalg.cholesky(before)) / self._spread
        noise = math.hypot(self.curve.noise, self._delay * speed)
        x = np.concatenate([estimate.q, expected[ROD]])

        def fitted(
            points: Float[np.ndarray, "k 2"],
            weights: Float[np.ndarray, "k"],
            marks: Float[np.ndarray, "v n 2"],
            mark: float,
        ) -> Float[np.ndarray, "m m"]:
            """Moves x; see `curve_kernels.fit`."""
            far, units, modes = self.curve.outlier * noise, self._units, self.modes
            of = np.nonzero(np.isfinite(marks[..., 0]))
            known = (marks[of], of[1] * self.rod.stride, new / math.hypot(mark, self._delay * speed) ** 2)
            return curve_kernels.fit(x, modes, poses, units, expected, root, points, weights, *known, far, FITTING)

        marks = np.empty((0, 1, 2))
        normal = fitted(np.empty((0, 2)), np.empty(0), marks, self.curve.noise)
        for turn in range(PASSES):
            held = self._held_by(x, poses)
            marks = self._named(blobs, held, normal, noise)
            shown = points if turn else np.concatenate([points, _nameless(blobs, marks)])
            at, residuals = self._beside(shown, held, normal, noise)
            used = np.isfinite(residuals) & (at > 0) & (at < self.rod.hinges)
            over = at[used].astype(int)  # all points over one hinge together count as one
            weights = new / (np.bincount(over, minlength=self.rod.hinges)[over] * noise**2)
            # names are doubtful at first
            normal = fitted(shown[used], weights, marks, mark if turn else self.curve.noise)
        held = self._held_by(x, poses)
        if not np.isfinite(held.stations).all():
            return estimate, None
        at, residuals = self._beside(points, held, normal, noise)
        spread = _inverse_root(normal)
        deviations = (held.rates / self._spread[:, None]) @ spread
        strain = float(np.linalg.norm(root @ (held.theta - expected))) / math.sqrt(len(expected))
        off = np.abs(held.theta[GRASPS] / self._spread[GRASPS]).reshape(2, -1)
        astray, askew = float(off[:, :-1].max()), float(off[:, -1].max())
        estimate = replace(
            estimate, theta=held.theta, covariance=deviations @ deviations.T, q=x[: self.rod.dof],
            updates=estimate.updates + 1,
        )  # fmt: skip
        seen, beside = self._marked(marks, blobs, held)
        return estimate, CurveFit(held.stations, held.by_x @ spread, at, residuals, seen, beside, strain, astray, askew)

    def known(self, estimate: RodEstimate) -> RodParameters:
        """Theta and its covariance, in their units."""
        return RodParameters(estimate.theta, estimate.covariance * np.outer(self._spread, self._spread))

    def _held_by(self, x: Float[np.ndarray, "m"], poses: Float[np.ndarray, "2 3"]) -> _Held:
        """See `curve_kernels.held`."""
        size, count, stations = len(x), len(self._spread), 2 * self.rod.hinges + 1
        held = _Held(
            np.empty((stations, 2)), np.empty((stations, 2, size)), np.empty(count), np.empty((count, size))
        )  # fmt: skip
        curve_kernels.held(x, self.modes, poses, self._units, *held)
        return held

    def _named(
        self, blobs: Sequence[Float[np.ndarray, "b 2"]], held: _Held, normal: Float[np.ndarray, "m m"], noise: float
    ) -> Float[np.ndarray, "v n 2"]:
        """Of each camera the marks at the keypoints [m], NaN where there is none, by where they are expected."""
        curve, stride = self.curve, self.rod.stride
        keypoints, rows = held.stations[::stride], held.by_x[::stride] @ _inverse_root(normal)
        reach = curve.gate * np.sqrt(np.sum(rows**2, axis=(1, 2)) + noise**2)
        half = self.rod.length / (len(keypoints) - 1) / 2
        reach = np.clip(reach, min(curve.least, half), min(curve.most, half))
        reach[[0, -1]] = 0.0  # the ends, in the grippers, have none
        return np.array([named(each, keypoints, reach) for each in blobs]).reshape(len(blobs), *keypoints.shape)

    def _marked(
        self, marks: Float[np.ndarray, "v n 2"], blobs: Sequence[Float[np.ndarray, "b 2"]], held: _Held
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "b"]]:
        """`CurveFit.marks` and `CurveFit.off`."""
        keypoints = held.stations[:: self.rod.stride]
        if not len(marks):
            return np.full_like(keypoints, np.nan), np.empty(0)
        count = np.isfinite(marks[..., :1]).sum(axis=0)
        away = np.linalg.norm(marks - keypoints, axis=2)
        off = np.full(sum(map(len, blobs)), np.nan)
        off[: np.isfinite(away).sum()] = away[np.isfinite(away)]
        return np.nansum(marks, axis=0) / np.where(count, count, np.nan), off

    def _beside(
        self, points: Float[np.ndarray, "k 2"], held: _Held, normal: Float[np.ndarray, "m m"], noise: float
    ) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k"]]:
        """See `curve_kernels.gate`."""
        curve, spread, at, residuals = self.curve, _inverse_root(normal), np.empty(len(points)), np.empty(len(points))
        bounds = (noise, curve.gate, curve.least, curve.most)
        curve_kernels.gate(points, held.stations, held.by_x, spread @ spread.T, bounds, at, residuals)
        return at, residuals


def _nameless(blobs: Sequence[Float[np.ndarray, "b 2"]], marks: Float[np.ndarray, "v n 2"]) -> Float[np.ndarray, "k 2"]:
    """Of each camera what may be marks [m], and is none of those at the keypoints."""
    named = [(each[:, None] == seen).all(axis=2).any(axis=1) for each, seen in zip(blobs, marks, strict=True)]
    return np.concatenate([np.empty((0, 2)), *(each[~known] for each, known in zip(blobs, named, strict=True))])


def _inverse_root(normal: Float[np.ndarray, "m m"]) -> Float[np.ndarray, "m m"]:
    """A square root of the inverse of a matrix of which the lower triangle is given."""
    values, vectors = np.linalg.eigh(normal)
    return vectors / np.sqrt(np.maximum(values, SINGULAR * values[-1]))
