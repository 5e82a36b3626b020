"""A plant in space seen by cameras: pictures of its true state are rendered, and the cable is found by its markers.

As `tracking.eyes` on the table: the controller gets what the tracker makes of the pictures, and the gripper poses that
the plant reports; nothing else of the truth. There are no arms, and what stands in the scene is known.
"""

from __future__ import annotations

import time as clock
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8

from cableway.core.errors import InputError
from cableway.core.provenance import describe
from cableway.geometry import polyline
from cableway.geometry.groups import SE3
from cableway.perception.segmentation import view_of
from cableway.perception.spatial_tracker import SpatialSighting, SpatialTrack, SpatialTracker
from cableway.records import Measurement, Observation
from cableway.rendering.markers import bands
from cableway.rendering.mesh import Mesh
from cableway.rendering.picture import labels
from cableway.rendering.space import CABLE, TABLE, body_mesh, cable_mesh, scene_mesh
from cableway.scene.spatial.scene import SpatialScene
from cableway.scene.spatial.task import SpatialTask
from cableway.tracking.eyes import reported_by, shown_as, told_of
from cableway.tracking.lens import Lens
from cableway.tracking.photographer import LOOK, MARKER, EyesConfig, camera_of, lamp, taken
from cableway.tracking.shutter import Shutter
from cableway.tracking.spatial_loop import SpatialPlantLike

SETUP = {"picture": (1280, 960), "frame_rate": 10.0}
"""Of cameras in space: width and height of a picture [pixels] in which markers on a thin cable are large enough, for
they stand back farther than from a table; and pictures a second [Hz], one for each control step."""


class State(NamedTuple):
    """What is to be seen at one time [s]."""

    time: float
    cable: Float[np.ndarray, "m 3"]
    poses: Float[np.ndarray, "2 7"]


class SpatialPhotographer:
    """Makes pictures of a task in space.

    Args:
        task: The task, with what is known to stand there.
        config: The cameras.
        actual: What stands there; None where that is what is known.

    Raises:
        InputError: The cameras are to see what there is on a table alone: unmarked cables, strangers, depths.
    """

    def __init__(self, task: SpatialTask, config: EyesConfig, actual: SpatialScene | None = None) -> None:
        if config.tracker != "markers":
            raise InputError(f"in space cameras find a cable by markers alone, got the tracker {config.tracker!r}")
        if config.depth or config.strangers or config.alike:
            raise InputError("in space cameras give no depths, and see no strangers and nothing of the cable's colour")
        x, y, height = task.scene.size
        self._task, self._config = task, config
        self.cameras = tuple(camera_of(config, place, (x, y), height) for place in config.cameras)
        self._lenses = [Lens(camera) for camera in self.cameras]
        self._light = lamp((x, y), config)
        self._known = scene_mesh(task.scene, LOOK.table, LOOK.obstacle)
        self._still = self._known if actual is None else scene_mesh(actual, LOOK.table, LOOK.obstacle)

    def know(self, scene: SpatialScene) -> None:
        """What is known to stand there from now on."""
        self._known = scene_mesh(scene, LOOK.table, LOOK.obstacle)

    def shot(
        self, state: State, rng: np.random.Generator
    ) -> list[tuple[UInt8[np.ndarray, "h w 3"], Bool[np.ndarray, "h w"]]]:
        """Of each camera the picture, and what may hide the cable by what is known without seeing it."""
        hands = [body_mesh(body, state.poses[body.side], LOOK.grippers[body.side]) for body in self._task.bodies]
        there, bare = Mesh.joined([self._still, *hands, *self._cable(state.cable)]), Mesh.joined([self._known, *hands])
        return [
            (
                taken(there, lens, self._light, self._config, state.time, rng),
                lens.through(labels(bare, lens.pinhole)) > TABLE,
            )
            for lens in self._lenses
        ]

    def _cable(self, line: Float[np.ndarray, "m 3"]) -> list[Mesh]:
        cable, radius = self._task.cable, self._task.cable.radius
        line = polyline.remove_repeated(line)
        marks = [band.painted(MARKER, CABLE) for band in bands(line, radius, cable.keypoints)]
        return [cable_mesh(line, radius, LOOK.cable if self._config.tint is None else self._config.tint), *marks]


class SpatialSeenPlant:
    """A plant like the one behind it, whose cable is known by pictures alone.

    Where the tracker does not know where the cable is, keypoints are NaN and all confidence is 0: the loop then stands
    still.

    Args:
        plant: The one behind it, which measures the truth.
        config: The cameras.
        actual: What stands there; by default, what is known to.

    Raises:
        InputError: See `SpatialPhotographer`.
    """

    def __init__(self, plant: SpatialPlantLike, config: EyesConfig, actual: SpatialScene | None = None) -> None:
        self._plant, self._config, self._known_scene = plant, config, plant.task.scene
        self.control_step = plant.control_step
        self._photographer = SpatialPhotographer(plant.task, config, None if actual == self._known_scene else actual)
        self._colors = shown_as(LOOK.cable), shown_as(MARKER)
        self._tracker = SpatialTracker(plant.task.cable, 1 / config.frame_rate)
        self._shutter = Shutter(config, plant.control_step, _between)
        self._rng, self._now = np.random.default_rng(config.seed), 0.0
        self._track: SpatialTrack | None = None
        self._errors: list[Float[np.ndarray, "n"]] = []
        self._cameras: list[Float[np.ndarray, "n"]] = []
        self._known: list[bool] = []
        self._spent = 0.0

    @property
    def task(self) -> SpatialTask:
        """See `SpatialPlantLike`."""
        return self._plant.task

    def measure(self) -> Measurement:
        """See `SpatialPlantLike`."""
        return self._plant.measure()

    def reset(self) -> Observation:
        """See `SpatialPlantLike`."""
        return self._seen(self._plant.reset())

    def step(self, action: Float[np.ndarray, "2 6"]) -> Observation:
        """Move, and find the cable in the pictures that have come since."""
        reported = self._plant.step(action)
        self._now += self.control_step
        return self._seen(reported)

    def record(self) -> dict[str, Any]:
        """Plain data on the cameras and on how well they saw, as `SeenPlant.record`; `hidden` is the share of the
        markers that no camera sees."""
        errors, inner = np.array(self._errors), np.array(self._cameras)[:, 1:-1]
        return {
            **describe(self._config),
            "frames": len(self._known),
            "known": float(np.mean(self._known)),
            "hidden": float(np.mean(inner == 0)),
            **told_of(errors),
            "seconds_per_frame": self._spent / len(self._known),
        }

    def _seen(self, reported: Observation) -> Observation:
        """What is known now of the newest picture that has been looked at."""
        truth, now = self._plant.measure(), self._now
        self._shutter.note(State(now, truth.centreline, reported.poses))
        newest = None
        for state in self._shutter.taken(now, self._rng):
            newest = self._look(state).observation
        return reported_by(newest, known=self._known[-1], reported=reported, now=now)

    def _look(self, state: State) -> SpatialSighting:
        if (scene := self.task.scene) != self._known_scene:
            self._known_scene = scene
            self._photographer.know(scene)
        shot = self._photographer.shot(state, self._rng)
        begun = clock.process_time()
        views = [
            view_of(camera, picture, hiding, *self._colors)
            for camera, (picture, hiding) in zip(self._photographer.cameras, shot, strict=True)
        ]
        if self._track is None:
            self._track = self._tracker.start(state.poses, self.task.start)
        self._track, seen = self._tracker.update(self._track, views, state.poses, state.time)
        self._spent += clock.process_time() - begun
        self._cameras.append(seen.cameras)
        self._known.append(seen.known)
        if seen.known:
            truth = polyline.resample(state.cable, self.task.cable.keypoints)
            self._errors.append(np.linalg.norm(seen.observation.keypoints - truth, axis=1))
        return seen


def _between(a: State, b: State, share: float, time: float) -> State:
    """The state at a time, a share of the way from one to another."""
    return State(time, (1 - share) * a.cable + share * b.cable, SE3.between(a.poses, b.poses, share))
