"""The rod tracker: where the cable is, from pictures of it without markers and from the grippers that hold it.

The rod filter (`estimation.curve_filter`) fits the parameters of the rod to the points of the cable's axis that one or
several cameras show, between the measured grippers; what is hidden follows from the rod. The little that no rod
explains is a field across the cable (`estimation.deviation`). Points of something else are left out, and counted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from cableway.core.errors import InputError
from cableway.estimation.curve_filter import CurveConfig, CurveEstimator, CurveFit
from cableway.estimation.deviation import DeviationField
from cableway.estimation.parameter_filter import LONGEST
from cableway.estimation.rod_filter import EstimatorConfig, RodEstimate
from cableway.geometry.groups import SE2
from cableway.perception import kernels
from cableway.perception.sighting import Sighting, Track, TrackerConfig
from cableway.perception.views import View, axis_points, seen_of
from cableway.records import Observation, RodParameters
from cableway.rod.inverse import equilibria_at
from cableway.rod.material import ROD
from cableway.scene.cable import Cable

PLACES = 4
"""Places over each hinge at which the rod is looked for in the pictures."""

LOOKS = 33
"""First guesses among which shapes are looked for anew: fewer than for a start, to take no longer than a frame."""

STRAINED = 1.2
"""Strain of a rod (`CurveFit.strain`) from which on another shape of it may be likelier, though it explains all that is
seen: it hooks at a gripper to do so. That of cables in the first picture is below 1.1."""

LESS = 0.7
"""Share of how badly the rod explains a frame that another shape of it must stay below to take its place."""

CELL = 0.004
"""Side of the squares [m] in which it is remembered that something else was seen there."""

CLEAR = 0.05
"""Share of the rod that may be missing for what is seen beside it to be something else for certain: a rod that is
elsewhere than the cable is not seen."""

ASKEW_HIDDEN = 0.1
"""Share of the rod that may be hidden, and of the points that may be something else's, for a rod that leaves its
gripper askew to be where the cable is: it is seen from end to end, and is curved more there than a rod can be."""

PARAMETERS = EstimatorConfig(grasp=0.003)
"""The prior of the rod."""


class Evidence(NamedTuple):
    """What pictures show of a cable.

    Attributes:
        points: Of its axis [m], in no order.
        blobs: Of each camera what may be its marks [m].
    """

    points: Float[np.ndarray, "k 2"]
    blobs: Sequence[Float[np.ndarray, "b 2"]] = ()

    def __bool__(self) -> bool:
        """Whether it is anything."""
        return len(self.points) > 0 or any(map(len, self.blobs))


class RodTracker:
    """Follows a cable through pictures.

    Args:
        cable: The nominal cable.
        frame_step: Time [s] between two frames.
        config: Settings.
        parameters: Prior of the parameters of the rod.
        curve: How points and marks count.
    """

    def __init__(
        self,
        cable: Cable,
        frame_step: float,
        config: TrackerConfig | None = None,
        parameters: EstimatorConfig = PARAMETERS,
        curve: CurveConfig | None = None,
    ) -> None:
        self._cable, self._config = cable, config or TrackerConfig()
        self._estimator = CurveEstimator(cable.rod, parameters, curve or CurveConfig(), frame_step)
        self._kept = math.exp(-frame_step / self._config.fading)
        hinges = cable.rod.hinges
        self._places = np.arange(hinges * PLACES + 1) / PLACES
        self._keypoints = np.arange(cable.keypoints) * (cable.rod.stride / 2)

    def start(self, poses: Float[np.ndarray, "2 3"], q: Float[np.ndarray, "6"]) -> Track:
        """Before the first frame, with grippers at `poses` [m, m, rad] and rod coordinates near the shape."""
        field = DeviationField.unknown(self._cable.keypoints, self._config.beside, self._config.reach)
        rod = self._cable.rod
        q = rod.continued(q, poses)
        return Track(self._estimator.start(q), field, SE2.continued(poses, rod.end_poses(q[None])[0]), np.empty((0, 2)))

    def found(self, views: Sequence[View], poses: Float[np.ndarray, "2 3"]) -> Track:
        """Before the first frame, with the shape of the nominal cable that fits the pictures best.

        Raises:
            InputError: The nominal cable has no stable shape between these grippers.
        """
        shapes = equilibria_at(self._cable.rod, poses)
        if not len(shapes):
            raise InputError("the cable has no stable shape between these gripper poses")
        return self._best([self.start(poses, q) for q in shapes], self._seen_in(views), views)[0]

    def _best(self, tracks: Sequence[Track], shown: Evidence, views: Sequence[View]) -> tuple[Track, float]:
        """Of tracks before a frame that one which explains it best, and how badly it does, as a distance [m]."""
        costs = []
        for track in tracks:
            _, fit = self._estimator.update_points(track.estimate, shown.points, track.poses, 0.0, shown.blobs)
            costs.append(math.inf if fit is None else self._cost(fit, views))
        best = int(np.argmin(costs))
        return tracks[best], costs[best]

    def _cost(self, fit: CurveFit, views: Sequence[View]) -> float:
        """How badly a rod explains what is seen: a distance [m]."""
        curve = self._estimator.curve
        off = np.nan_to_num(np.abs(np.concatenate([fit.residuals, fit.off])), nan=curve.most)
        return (
            float(off.sum()) / max(len(off), 1) + curve.most * self._claimed(views, fit)[1] + curve.noise * fit.strain
        )

    def update(
        self, track: Track, views: Sequence[View], poses: Float[np.ndarray, "2 3"], time: float
    ) -> tuple[Track, Sighting]:
        """After a frame.

        Args:
            track: Before it.
            views: Of one or several cameras, taken at the same time.
            poses: (2, 3) grippers then [m, m, rad].
            time: When that was [s].

        Raises:
            InputError: The poses are not finite.
        """
        if not np.isfinite(poses).all():
            raise InputError(f"poses must be finite numbers, got {np.asarray(poses).tolist()}")
        poses = SE2.continued(poses, track.poses)
        speed = float(np.linalg.norm(SE2.position(poses) - SE2.position(track.poses), axis=1).max())
        others, found = self._still_there(track.others, views), track.found
        shown = self._seen_in(views, track)
        shown = shown._replace(points=self._without(shown.points, others))
        estimate, fit = self._estimator.update_points(track.estimate, shown.points, poses, speed, shown.blobs)
        if fit is None:
            return self._lost(track, poses, time)
        field = track.field.later(self._kept).updated(*self._means(fit), self._config.pixel)
        seen = self._sighting(estimate, field, fit, shown.points, views, poses, time)
        found = found or seen.explained
        seen = seen if found else replace(seen, possible=False, known=False)
        waited = time - track.looked
        likely = seen.explained and fit.strain <= STRAINED
        if likely and seen.missing <= CLEAR:
            beside = shown.points[np.isnan(fit.residuals)]
            if seen.hidden > self._config.most_unexplained:
                beside = beside[~self._reached(beside, fit, views)]
            others = np.unique(np.round(np.concatenate([others, beside]) / CELL), axis=0) * CELL
        if likely or not shown or 0 <= waited < self._config.patience:
            return Track(estimate, field, poses, others, track.looked, found), seen
        other, cost = self._anew(replace(track, poses=poses, looked=time), shown, views)
        if cost >= LESS * self._cost(fit, views):
            return Track(estimate, field, poses, others, time, found), seen
        return self.update(other, views, poses, time)

    def _anew(self, track: Track, shown: Evidence, views: Sequence[View]) -> tuple[Track, float]:
        """The shape of the cable as it is known that explains a frame best, whatever it was before; and see `_best`."""
        known, rod = track.estimate, self._cable.rod
        rod = replace(rod, length=known.length, modes=tuple(known.theta[ROD][1:]))
        ends = SE2.compose(track.poses, known.grasps)
        try:
            shapes = equilibria_at(rod, ends, LOOKS)
        except InputError:  # the ends are too far apart for it
            return track, math.inf
        if not len(shapes):
            return track, math.inf
        fresh = self.start(track.poses, shapes[0])
        estimates = [replace(known, q=rod.continued(q, ends), covariance=fresh.estimate.covariance) for q in shapes]
        tracks = [replace(track, estimate=estimate, field=fresh.field) for estimate in estimates]
        return self._best(tracks, shown, views)

    def _seen_in(self, views: Sequence[View], track: Track | None = None) -> Evidence:
        """What views show of the cable, after a track if there is one."""
        radius = self._cable.radius
        return Evidence(np.concatenate([np.empty((0, 2)), *(axis_points(view, radius) for view in views)]))

    @staticmethod
    def _without(points: Float[np.ndarray, "k 2"], others: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "l 2"]:
        """The points [m] that are not where something else is known to lie."""
        if not (len(points) and len(others)):
            return points
        return points[np.isinf(KDTree(others).query(points, distance_upper_bound=1.5 * CELL)[0])]

    def _still_there(self, others: Float[np.ndarray, "k 2"], views: Sequence[View]) -> Float[np.ndarray, "m 2"]:
        """Those places [m] of something else where it is still seen, or hidden."""
        codes = np.array([seen_of(view, others, self._cable.radius) for view in views]).reshape(len(views), len(others))
        gone = (codes == kernels.MISSING).any(axis=0) & ~(codes == kernels.SEEN).any(axis=0)
        return others[~gone]

    def _shared(self, estimate: RodEstimate) -> RodParameters | None:
        """What controllers are told of the rod."""
        return self._estimator.known(estimate)

    def _looked_for(self, views: Sequence[View]) -> Float[np.ndarray, "m"]:
        """Places on the rod, in hinges, that should be seen in views."""
        return self._places

    def _observed(
        self, keypoints: Float[np.ndarray, "n 2"], variance: Float[np.ndarray, "n"], fit: CurveFit
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n"]]:
        """What is observed of the keypoints [m], and its variance [m^2], given those of the rod."""
        return keypoints, variance

    def _means(self, fit: CurveFit) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m"]]:
        """Shares of the length of the hinges that are seen, and mean distances [m] of their points."""
        hinges, used = self._cable.rod.hinges, np.isfinite(fit.residuals)
        over = np.minimum(fit.at[used].astype(int), hinges - 1)
        counts = np.bincount(over, minlength=hinges)
        seen, divided = counts > 0, np.maximum(counts, 1)
        along = np.bincount(over, fit.at[used], hinges) / divided / hinges
        return along[seen], (np.bincount(over, fit.residuals[used], hinges) / divided)[seen]

    def _sighting(
        self,
        estimate: RodEstimate,
        field: DeviationField,
        fit: CurveFit,
        points: Float[np.ndarray, "k 2"],
        views: Sequence[View],
        poses: Float[np.ndarray, "2 3"],
        time: float,
    ) -> Sighting:
        config, stride = self._config, self._cable.rod.stride
        at, normals = fit.places(self._keypoints)
        rows = fit.deviations[::stride]
        covariance = np.einsum("nia,nja->nij", rows, rows)
        covariance += np.einsum("n,ni,nj->nij", np.diag(field.covariance) + config.pixel**2, normals, normals)
        variance = np.linalg.eigvalsh(covariance)[:, -1]
        keypoints = at + field.mean[:, None] * normals
        hidden, missing = self._claimed(views, fit)
        residuals = fit.residuals
        if missing <= CLEAR:
            residuals = residuals[np.isfinite(residuals) | self._reached(points, fit, views)]
        distances = np.concatenate([residuals, fit.off])
        on = distances[np.isfinite(distances)]
        unexplained = 1 - len(on) / len(distances) if len(distances) else 0.0
        residual = float(np.sqrt(np.mean(on**2))) if len(on) else 0.0
        possible = (
            min(unexplained, hidden) <= config.most_unexplained  # what is seen here is nowhere else
            and missing <= config.most_missing
            and residual <= config.most_residual
            and fit.astray <= config.most_askew
            and (fit.askew <= config.most_askew or max(hidden, unexplained) <= ASKEW_HIDDEN)
        )
        explained = len(on) > 0 and possible
        known = possible and math.sqrt(variance.max()) <= config.most_unsure
        observed, variance = self._observed(keypoints, variance, fit)
        confidence = config.sure**2 / (config.sure**2 + variance)
        rod = self._shared(estimate)
        observation = Observation(time, observed, poses, taken=time, confidence=confidence, rod=rod)
        shares = (unexplained, missing, hidden, residual)
        marked = np.isfinite(fit.marks[:, 0])
        return Sighting(
            observation, keypoints, covariance, marked, *shares, explained=explained, possible=possible, known=known
        )

    def _claimed(self, views: Sequence[View], fit: CurveFit) -> tuple[float, float]:
        """Share of the rod that no camera shows, and of what is in view that is missing."""
        seen, missing = self._shown(views, fit.places(self._looked_for(views))[0])
        return 1 - float(np.mean(seen)), float(missing.sum() / max((seen | missing).sum(), 1))

    def _shown(
        self, views: Sequence[View], places: Float[np.ndarray, "m 2"]
    ) -> tuple[Bool[np.ndarray, "m"], Bool[np.ndarray, "m"]]:
        """Of each place of the rod [m] whether a camera sees it, and whether one misses it."""
        codes = np.array([seen_of(view, places, self._cable.radius) for view in views]).reshape(-1, len(places))
        return (codes == kernels.SEEN).any(axis=0), (codes == kernels.MISSING).any(axis=0)

    def _reached(self, points: Float[np.ndarray, "k 2"], fit: CurveFit, views: Sequence[View]) -> Bool[np.ndarray, "k"]:
        """Whether a part of the cable that is not seen could be at points [m].

        Such a part lies in the ellipse about the places where it begins and ends in which the ways to both are together
        no longer than it is. The grippers hold the ends.
        """
        places = fit.places(self._places)[0]
        seen = self._shown(views, places)[0]
        seen[[0, -1]] = True
        at = np.flatnonzero(seen)
        first, last = at[:-1][np.diff(at) > 1], at[1:][np.diff(at) > 1]
        longest = LONGEST * self._cable.length * (last - first) / (len(places) - 1) + 2 * self._estimator.curve.least
        return np.any(cdist(points, places[first]) + cdist(points, places[last]) <= longest, axis=1)

    def _lost(self, track: Track, poses: Float[np.ndarray, "2 3"], time: float) -> tuple[Track, Sighting]:
        """Where no rod of this length can be held by these grippers."""
        n = self._cable.keypoints
        observation = Observation(time, np.full((n, 2), np.nan), poses, taken=time, confidence=np.zeros(n))
        nothing = (observation.keypoints, np.full((n, 2, 2), np.inf), np.zeros(n, bool))
        track = replace(track, poses=poses)
        return track, Sighting(observation, *nothing, 1.0, 1.0, 1.0, 0.0, explained=False, possible=False, known=False)
