"""A plant seen by cameras: pictures of its true state are rendered, and the cable is found in them again.

The controller gets what the tracker makes of the pictures, and the gripper poses that the plant reports; nothing else
of the truth. What may hide the cable is known from where the arms, hands and obstacles are known to be.
"""

from __future__ import annotations

import time as clock
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.core.provenance import describe
from cableway.geometry import polyline
from cableway.geometry.groups import SE2
from cableway.perception.markers import TRACKERS
from cableway.perception.segmentation import CableColor, view_of
from cableway.perception.sighting import Sighting, Track, TrackerConfig
from cableway.records import Measurement, Observation
from cableway.rendering.cell import Color
from cableway.scene.cell import Way
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.tracking.lookout import Lookout
from cableway.tracking.photographer import LOOK, MARKER, EyesConfig, Photographer, State
from cableway.tracking.plant import Plant
from cableway.tracking.shutter import Shutter

LOST = 0.02
"""Mean error of the keypoints of a frame [m] from which on a cable that is taken for known is lost. Trackers that have
the shape err by 1 to 7 mm, in that measure; those that do not, by centimetres."""

SURE = TrackerConfig().most_unsure
"""Standard deviation of a keypoint [m] up to which no room is asked for."""

FREE = 3.0
"""Standard deviations of a keypoint that is less sure within which nothing may stand: a cable that is off by as much
touches nothing."""

LEAST_SURE = 0.02
"""Standard deviation of a keypoint [m] from which on the cable may have another shape, so that room does not help."""


class SeenPlant:
    """A plant like the one behind it, whose cable is known by pictures alone.

    Pictures are taken at a rate of their own, also between control steps, where the state is interpolated. Where the
    tracker does not know where the cable is, keypoints are NaN and all confidence is 0: the loop then stands still.
    Keypoints that arms hide for a while may be less sure than the tracker asks for as long as there is room about them.

    Args:
        plant: The one behind it, which measures the truth.
        config: The cameras.
        way: How the arms of a cell hold the cable, where it measures joints.
        planned: With depths, the task as the planner knew it; by default, the plant's.
        actual: What stands on the table; by default, what is known to.
    """

    def __init__(
        self,
        plant: Plant,
        config: EyesConfig,
        way: Way | None = None,
        planned: Task | None = None,
        actual: Scene | None = None,
    ) -> None:
        self._plant, self._config = plant, config
        self._planned = planned if config.depth and planned is not None else plant.task
        self._known_scene = self._planned.scene
        actual = None if actual == self._known_scene else actual
        self._photographer = Photographer(self._planned, way, config, actual)
        self._cable = shown_as(LOOK.cable)
        self._marker = shown_as(MARKER) if config.tracker == "markers" else None
        self._tracker = TRACKERS[config.tracker](plant.task.cable, 1 / config.frame_rate)
        self._begin()

    def _begin(self) -> None:
        self._rng = np.random.default_rng(self._config.seed)
        self._shutter = Shutter(self._config, self.control_step, _between)
        self._now = 0.0
        self._track: Track | None = None
        self._errors: list[Float[np.ndarray, "n"]] = []
        self._hidden: list[float] = []
        self._known: list[bool] = []
        self._spent = 0.0
        self._lookout = Lookout(self._planned.scene) if self._config.depth else None
        self._seen_task = self._planned
        self._of_depths = np.random.default_rng(self._config.seed)

    @property
    def task(self) -> Task:
        """See `Plant`; with depths, the scene is what was planned with and what was seen to appear."""
        return self._plant.task if self._lookout is None else self._seen_task

    @property
    def control_step(self) -> float:
        """See `Plant`."""
        return self._plant.control_step

    def measure(self) -> Measurement:
        """See `Plant`."""
        return self._plant.measure()

    def reset(self) -> Observation:
        """Go to the start and look."""
        reported = self._plant.reset()
        self._begin()
        self._note(0.0, reported)
        return self._seen(0.0, reported)

    def step(self, action: Float[np.ndarray, "2 3"]) -> Observation:
        """Move, and find the cable in the pictures that have come since."""
        reported = self._plant.step(action)
        self._now += self.control_step
        self._note(self._now, reported)
        return self._seen(self._now, reported)

    def record(self) -> dict[str, Any]:
        """Plain data on the cameras and on how well they saw, against the truth, for the record of a run.

        Errors [m] are of the frames in which the cable was known, for certain or with room for what it was not: the
        mean of a frame's keypoints in `mean_error` and `largest_error`, that of single ones in `p99_error`.
        """
        frames, errors = max(len(self._hidden), 1), np.reshape(self._errors, (-1, self._plant.task.cable.keypoints))
        return {
            **describe(self._config),
            "frames": len(self._hidden),
            "known": sum(self._known) / frames,
            "hidden": sum(self._hidden) / frames,
            **told_of(errors),
            "lost": self._is_lost(errors),
            "seconds_per_frame": self._spent / frames,
            **self._appeared(),
        }

    def _appeared(self) -> dict[str, Any]:
        """What the depths showed at last."""
        lookout = self._lookout
        if lookout is None:
            return {}
        appeared = [{"vertices": each.vertices.tolist(), "height": each.height} for each in lookout.appeared]
        return {"surveys": lookout.surveys, "surveys_failed": lookout.failures, "appeared": appeared}

    def _is_lost(self, errors: Float[np.ndarray, "m n"]) -> bool:
        """Whether the cable was taken to be where it was not, or was not known at the end."""
        wrong = len(errors) > 0 and float(np.mean(errors, axis=1).max()) > LOST
        return wrong or not (self._known and self._known[-1])

    def _note(self, now: float, reported: Observation) -> None:
        truth = self._plant.measure()
        poses, last = reported.poses, self._shutter.last
        if last is not None:
            poses = SE2.continued(poses, last.poses) if np.isfinite(poses).all() else last.poses
        self._shutter.note(State(now, truth.centreline, poses, truth.joints))

    def _seen(self, now: float, reported: Observation) -> Observation:
        """What is known at a time of the newest picture that has been looked at."""
        if self._lookout is not None:
            self._look_out(self._lookout, now)
        newest = None
        for state in self._shutter.taken(now, self._rng):
            newest = self._look(state).observation
        return reported_by(newest, known=self._known[-1], reported=reported, now=now)

    def _look_out(self, lookout: Lookout, now: float) -> None:
        """See what appeared on the table."""
        if lookout.is_due(now):
            lookout.look(now, self._photographer.depths(self._shutter.at(now), self._of_depths))
        if lookout.learn(now):
            self._seen_task = self._planned.in_scene(lookout.scene)

    def _look(self, state: State) -> Sighting:
        if (scene := self.task.scene) != self._known_scene:
            self._known_scene = scene
            self._photographer.know(scene)
        shot = self._photographer.shot(state, self._rng)
        begun = clock.process_time()
        views = [
            view_of(camera, picture, hiding, self._cable, self._marker)
            for camera, (picture, hiding) in zip(self._photographer.cameras, shot, strict=True)
        ]
        if self._track is None:
            self._track = self._tracker.start(state.poses, self.task.start_equilibrium)
        self._track, seen = self._tracker.update(self._track, views, state.poses, state.time)
        self._spent += clock.process_time() - begun
        self._hidden.append(seen.hidden)
        self._known.append(seen.known or self._has_room(seen, state.poses))
        if self._known[-1]:
            truth = polyline.resample(state.cable, self.task.cable.keypoints)
            self._errors.append(np.linalg.norm(seen.observation.keypoints - truth, axis=1))
        return seen

    def _has_room(self, seen: Sighting, poses: Float[np.ndarray, "2 3"]) -> bool:
        """Whether nothing speaks against what was seen, and nothing stands near the keypoints that are not sure."""
        if not seen.possible:
            return False
        keypoints = seen.keypoints
        deviation = np.sqrt(np.linalg.eigvalsh(seen.covariance)[:, -1])
        low = [body for body in self.task.grippers.bodies if body.heights[0] < 2 * self.task.cable.radius]
        reach = max(float(np.linalg.norm(body.outline, axis=1).max()) + body.rounding for body in low)
        apart = np.linalg.norm(keypoints[:, None] - SE2.position(poses), axis=2).min(axis=1) - reach
        room = np.minimum(self.task.scene.signed_distance(keypoints), apart) - self.task.cable.radius
        return bool(deviation.max() < LEAST_SURE and (room >= FREE * deviation)[deviation > SURE].all())


def _between(a: State, b: State, share: float, time: float) -> State:
    """The state at a time, a share of the way from one to another."""
    joints = b.joints if a.joints is None or b.joints is None else (1 - share) * a.joints + share * b.joints
    return State(time, (1 - share) * a.cable + share * b.cable, SE2.between(a.poses, b.poses, share), joints)


def reported_by(newest: Observation | None, *, known: bool, reported: Observation, now: float) -> Observation:
    """What a plant reports with what was found in the newest picture in place of its keypoints.

    Args:
        newest: What that is, None where no picture has come; its time is on the clock of the cameras.
        known: Whether the cable was known in the newest picture, be it of now or before.
        reported: What the plant reports.
        now: The time on the clock of the cameras [s].
    """
    nothing = np.full_like(reported.keypoints, np.nan)
    if not known:
        return replace(reported, keypoints=nothing, confidence=np.zeros(len(nothing)))
    if newest is None:
        return replace(reported, keypoints=nothing)
    taken = newest.time + reported.time - now
    return replace(reported, keypoints=newest.keypoints, confidence=newest.confidence, taken=taken, rod=newest.rod)


def told_of(errors: Float[np.ndarray, "m n"]) -> dict[str, float | None]:
    """Errors of keypoints [m] in m frames, for the record of a run; see `SeenPlant.record`."""
    if not len(errors):
        return {"mean_error": None, "p99_error": None, "largest_error": None}
    return {
        "mean_error": float(np.mean(errors)),
        "p99_error": float(np.percentile(errors, 99)),
        "largest_error": float(np.mean(errors, axis=1).max()),
    }


def shown_as(color: Color) -> CableColor:
    """How something of a colour, of which each part is from 0 to 1, looks in a picture."""
    r, g, b = (255 * part for part in color)
    return CableColor(color=(r, g, b))
