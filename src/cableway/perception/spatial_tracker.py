"""Follows a cable in space by the markers on it, in pictures of one or several cameras.

As on the table (`perception.markers`) marks are named anew in every picture, by where the rod is expected; here each
picture by itself. A mark says on which ray from its camera its marker lies: two cameras say where, one leaves open how
far away, and the rod (`estimation.spatial_filter`) counts it for just that. Hidden markers are the rod's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from cableway.core.errors import InputError
from cableway.estimation.naming import named
from cableway.estimation.spatial_filter import SpatialEstimate, SpatialEstimator, SpatialEstimatorConfig
from cableway.geometry.groups import SE3
from cableway.perception import kernels
from cableway.perception.markers import marks_in, visible_side
from cableway.perception.sighting import TrackerConfig
from cableway.perception.views import View, widths
from cableway.records import Observation
from cableway.scene.spatial.cable import SpatialCable

PASSES = 2
"""Times that marks are named: by what was expected, and by what those tell."""

GATE = 3.0
"""Distance of a mark from where its marker is expected, in standard deviations, up to which it may be that."""

LEAST, MOST = 0.008, 0.05
"""Least and largest such distance [m], the latter no more than half of the way to the next marker."""

AROUND = 2.0
"""Pixels about a marker, and the width of the cable there, within which it is looked for and may be hidden."""

APART = 0.004
"""Distance [m] between a marker and the rays of its marks from which on one of these is another's."""

JUMP = 0.02
"""Distance [m] that a keypoint of the rod may move against the grippers from one frame to the next. Where an estimate's
branch of equilibria ends, it jumps to another one, though the cable need not."""

NEAR = 1e-6
"""Weight of where a marker is expected, by which one that a single camera sees is at a place on its ray."""

PARAMETERS = SpatialEstimatorConfig(noise=0.001, lag=0.02, offset_gain=0.5)
"""Of the rod: the noise is that of marks."""


@dataclass(frozen=True, eq=False)
class SpatialTrack:
    """What the tracker knows between two frames.

    Attributes:
        estimate: Of the rod.
        poses: (2, 7) of the grippers at the last frame.
        residual: How far keypoints of the rod were off their markers then [m], root mean square.
        keypoints: (n, 3) there [m].
        found: Whether any frame was explained since the estimate last began.
    """

    estimate: SpatialEstimate
    poses: Float[np.ndarray, "2 7"]
    keypoints: Float[np.ndarray, "n 3"]
    residual: float = 0.0
    found: bool = False


@dataclass(frozen=True, eq=False)
class SpatialSighting:
    """What the tracker makes of one frame.

    Attributes:
        observation: Keypoints, hidden ones included, with confidence; the grippers as measured.
        covariance: (n, 3, 3) of the keypoints [m^2].
        cameras: (n,) how many cameras see the marker of each keypoint.
        unexplained: Share of the marks that are no marker of the cable.
        missing: Share of the markers in view, and hidden by nothing known, that no camera sees.
        residual: Root mean square distance [m] of the keypoints of the rod from the rays of their marks; 0 without any.
        explained: Whether some markers are seen, most marks are markers, and few markers are missing.
        known: Whether the keypoints can be relied on. Where not, a controller had better stop.
    """

    observation: Observation
    covariance: Float[np.ndarray, "n 3 3"]
    cameras: Int[np.ndarray, "n"]
    unexplained: float
    missing: float
    residual: float
    explained: bool
    known: bool


class _Rays(NamedTuple):
    """Rays of a camera on which markers of a cable lie, NaN where none is seen.

    Attributes:
        origins: (n, 3) [m].
        ways: (n, 3) their directions.
    """

    origins: Float[np.ndarray, "n 3"]
    ways: Float[np.ndarray, "n 3"]

    @property
    def across(self) -> Float[np.ndarray, "n 3 3"]:
        """Projections onto the planes across the rays."""
        return np.eye(3) - np.einsum("ni,nj->nij", self.ways, self.ways)

    def off(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """Distances of points from the rays [m]."""
        return np.linalg.norm(np.einsum("nij,nj->ni", self.across, points - self.origins), axis=1)


class _Guess(NamedTuple):
    """Where the cable is taken to be.

    Attributes:
        q: (12,) of the rod.
        keypoints: (n, 3) [m].
        offset: (n, 3) of these from the rod's [m].
        covariance: (n, 3, 3) of the keypoints [m^2].
    """

    q: Float[np.ndarray, "12"]
    keypoints: Float[np.ndarray, "n 3"]
    offset: Float[np.ndarray, "n 3"]
    covariance: Float[np.ndarray, "n 3 3"]


class SpatialTracker:
    """Follows a cable in space by its markers.

    Each camera's views have the markers as `View.marks`, or as their one mask.

    Args:
        cable: The nominal cable.
        frame_step: Time [s] between two frames.
        config: Settings; those of pixels of the cable have no say.
        parameters: Prior of the parameters of the rod.
    """

    def __init__(
        self,
        cable: SpatialCable,
        frame_step: float,
        config: TrackerConfig | None = None,
        parameters: SpatialEstimatorConfig = PARAMETERS,
    ) -> None:
        self._cable, self._config, self._noise = cable, config or TrackerConfig(), parameters.noise
        self._estimator = SpatialEstimator(cable.rod, parameters, frame_step)

    def start(self, poses: Float[np.ndarray, "2 7"], q: Float[np.ndarray, "12"]) -> SpatialTrack:
        """Before the first frame, with grippers at `poses` and rod coordinates near the shape.

        Raises:
            InputError: The nominal cable has no shape near that one between these grippers.
        """
        estimate = self._estimator.start(q)
        guess = self._guess(estimate, poses)
        if guess is None:
            raise InputError("no rod is held so by these gripper poses")
        return SpatialTrack(estimate, poses, guess.keypoints)

    def update(
        self, track: SpatialTrack, views: Sequence[View], poses: Float[np.ndarray, "2 7"], time: float
    ) -> tuple[SpatialTrack, SpatialSighting]:
        """After a frame.

        Args:
            track: Before it.
            views: Of one or several cameras, taken at the same time.
            poses: (2, 7) grippers then [m, quaternion].
            time: When that was [s].

        Raises:
            InputError: The poses are not finite.
        """
        if not np.isfinite(poses).all():
            raise InputError(f"poses must be finite numbers, got {np.asarray(poses).tolist()}")
        poses = SE3.continued(poses, track.poses)
        speed = float(np.linalg.norm(SE3.position(poses) - SE3.position(track.poses), axis=1).max())
        before = _led(track, poses)
        estimate, guess = self._begun(track.estimate, poses, before)
        if guess is None:
            return self._lost(track, poses, before, time)
        known, rays, begun_anew = estimate, list[_Rays](), estimate is not track.estimate
        marks = [self._marks(view, guess.keypoints) for view in views]
        for _ in range(PASSES):
            rays = [self._rays(view, pixels, guess, track.residual) for view, pixels in zip(views, marks, strict=True)]
            points, information = _fused(rays, guess.keypoints)
            updated = self._estimator.update(known, points, poses, speed, information=information)
            if (found := self._guess(updated, poses, before)) is None:
                break
            estimate, guess = updated, found
        seen = self._sighting(guess, rays, sum(map(len, marks)), self._missing(views, guess), poses, time)
        found = seen.explained or (track.found and not begun_anew)
        track = SpatialTrack(replace(estimate, q=guess.q), poses, seen.observation.keypoints, seen.residual, found)
        return track, seen if found else replace(seen, known=False)

    def _begun(
        self, estimate: SpatialEstimate, poses: Float[np.ndarray, "2 7"], before: Float[np.ndarray, "n 3"]
    ) -> tuple[SpatialEstimate, _Guess | None]:
        """An estimate before a frame, and its guess; one that knows nothing of the rod where that would have jumped."""
        guess = self._guess(estimate, poses, before)
        if guess is not None:
            return estimate, guess
        anew = self._estimator.start(self._estimator.fitted(before, poses))
        return anew, self._guess(anew, poses, before)

    def _guess(
        self, estimate: SpatialEstimate, poses: Float[np.ndarray, "2 7"], before: Float[np.ndarray, "n 3"] | None = None
    ) -> _Guess | None:
        """Where keypoints are by an estimate; None where no rod of this length can be held by the grippers, or where it
        is too far from where the grippers led it to [m]."""
        expected, covariance = self._estimator.expected(estimate, poses)
        if not expected.possible:
            return None
        keypoints = expected.keypoints + estimate.offset
        if before is not None and np.linalg.norm(keypoints - before, axis=1).max() > JUMP:
            return None
        covariance = covariance + self._config.beside**2 * np.eye(3)
        return _Guess(expected.q, keypoints, estimate.offset, covariance)

    def _marks(self, view: View, expected: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "b 2"]:
        """Where marks are in a view [pixels] that are as large as markers where the cable is expected."""
        found, wide = marks_in(view), widths(view, expected, self._cable.radius).mean()
        return found.pixels[found.of_size(np.full(len(found.areas), wide))]

    def _rays(self, view: View, marks: Float[np.ndarray, "b 2"], guess: _Guess, residual: float) -> _Rays:
        """Of each keypoint the ray of its mark in a view, of marks at pixels that were so far off before [m]."""
        camera, radius, expected = view.camera, self._cable.radius, guess.keypoints
        along = np.gradient(expected, axis=0)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        lift = visible_side(view, expected, along, radius)
        pixels, _ = camera.project(expected + lift)
        scale = widths(view, expected + lift, radius) / (2 * radius)  # pixels for each metre there
        half = self._cable.length / (len(expected) - 1) / 2
        deviation = np.sqrt(np.linalg.eigvalsh(guess.covariance)[:, -1] + self._noise**2 + residual**2)
        reach = scale * np.clip(GATE * deviation, min(LEAST, half), min(MOST, half))
        reach[[0, -1]] = 0.0  # the ends, in the grippers, have none
        reach[~np.isfinite(pixels).all(axis=1)] = 0.0
        found = named(marks, np.nan_to_num(pixels), reach)
        pose = camera.pinhole.pose
        ways = np.column_stack([camera.rays(found), np.ones(len(found))]) @ pose[:3, :3].T
        return _Rays(pose[:3, 3] - lift, ways / np.linalg.norm(ways, axis=1, keepdims=True))

    def _missing(self, views: Sequence[View], guess: _Guess) -> float:
        """See `SpatialSighting.missing`."""
        inner = guess.keypoints[1:-1]
        codes = np.full((len(views), len(inner)), kernels.HIDDEN)
        for view, out in zip(views, codes, strict=True):
            pixels, _ = view.camera.project(inner)
            hiding = np.ones(view.mask.shape, bool) if view.hiding is None else np.ascontiguousarray(view.hiding)
            kernels.claims(pixels, widths(view, inner, self._cable.radius) + AROUND, view.markers, hiding, out)
        seen, missing = (codes == kernels.SEEN).any(axis=0), (codes == kernels.MISSING).any(axis=0)
        return float((missing & ~seen).sum() / max((seen | missing).sum(), 1))

    def _sighting(
        self,
        guess: _Guess,
        rays: Sequence[_Rays],
        marks: int,
        missing: float,
        poses: Float[np.ndarray, "2 7"],
        time: float,
    ) -> SpatialSighting:
        config = self._config
        points, _ = _fused(rays, guess.keypoints)
        rod = np.where(np.isfinite(points), guess.keypoints - guess.offset, np.nan)
        off = np.array([each.off(rod) for each in rays]).reshape(len(rays), len(rod))
        cameras, on = np.isfinite(off).sum(axis=0), off[np.isfinite(off)]
        residual = float(np.sqrt(np.mean(on**2))) if len(on) else 0.0
        unexplained = 1 - len(on) / marks if marks else 0.0
        placed = cameras > 1
        observed = np.where(placed[:, None], points, guess.keypoints)
        covariance = guess.covariance + residual**2 * np.eye(3)
        covariance = np.where(placed[:, None, None], self._noise**2 * np.eye(3), covariance)
        variance = np.linalg.eigvalsh(covariance)[:, -1]
        possible = unexplained <= config.most_unexplained and missing <= config.most_missing
        confidence = config.sure**2 / (config.sure**2 + variance)
        return SpatialSighting(
            Observation(time, observed, poses, taken=time, confidence=confidence),
            covariance,
            cameras,
            unexplained,
            missing,
            residual,
            explained=len(on) > 0 and possible,
            known=possible and math.sqrt(variance.max()) <= config.most_unsure,
        )

    def _lost(
        self, track: SpatialTrack, poses: Float[np.ndarray, "2 7"], before: Float[np.ndarray, "n 3"], time: float
    ) -> tuple[SpatialTrack, SpatialSighting]:
        """Where no rod of this length can be held by these grippers."""
        n = self._cable.keypoints
        observation = Observation(time, np.full((n, 3), np.nan), poses, taken=time, confidence=np.zeros(n))
        nothing = (np.full((n, 3, 3), np.inf), np.zeros(n, int), 1.0, 1.0, 0.0)
        return replace(track, poses=poses, keypoints=before, found=False), SpatialSighting(
            observation, *nothing, explained=False, known=False
        )


def _led(track: SpatialTrack, poses: Float[np.ndarray, "2 7"]) -> Float[np.ndarray, "n 3"]:
    """The keypoints of a track [m] as grippers that are at `poses` now have led them, the nearer one more."""
    share = np.linspace(0.0, 1.0, len(track.keypoints))[:, None]
    ways = SE3.position(poses) - SE3.position(track.poses)
    return track.keypoints + (1 - share) * ways[0] + share * ways[1]


def _fused(
    rays: Sequence[_Rays], expected: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
    """Where markers are by the rays of their marks [m], NaN where there is none or they are apart, and their inverse
    covariance, over the variance of a mark."""
    information, moved = np.zeros((len(expected), 3, 3)), np.zeros((len(expected), 3))
    for each in rays:
        across = np.nan_to_num(each.across)
        information += across
        moved += np.einsum("nij,nj->ni", across, each.origins - expected)
    points = expected + np.linalg.solve(information + NEAR * np.eye(3), moved[..., None])[..., 0]
    seen = information.any(axis=(1, 2))
    off = np.array([np.nan_to_num(each.off(points)) for each in rays]).reshape(len(rays), len(expected))
    points[~seen | (off > APART).any(axis=0)] = np.nan
    return points, information
