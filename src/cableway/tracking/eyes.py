"""A plant seen by cameras: pictures of its true state are rendered, and the cable is found in them again.

The controller gets what the tracker makes of the pictures, and the gripper poses that the plant reports; nothing else
of the truth. What may hide the cable is known from where the arms, hands and obstacles are known to be.
"""

from __future__ import annotations

import math
import time as clock
from collections import deque
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy.ndimage import gaussian_filter

from cableway.core.checks import Bounds, Checked, Choice, NotNegative, Share
from cableway.core.errors import InputError
from cableway.core.provenance import describe
from cableway.geometry import polyline
from cableway.geometry.groups import SE2
from cableway.perception.calibration import CalibratedCamera
from cableway.perception.placement import camera_at
from cableway.perception.rod_tracker import RodTracker, Sighting, Track
from cableway.perception.segmentation import CableColor, cable_mask
from cableway.perception.views import View
from cableway.records import Measurement, Observation
from cableway.rendering.cell import CellScene, Label, Look
from cableway.rendering.mesh import Mesh
from cableway.rendering.picture import Light, render
from cableway.scene.cell import Way
from cableway.scene.task import Task
from cableway.tracking.plant import Plant

LOOK = Look(
    table=(0.88, 0.88, 0.88),
    wall=(0.25, 0.25, 0.25),
    obstacle=(0.45, 0.48, 0.52),
    cable=(0.85, 0.35, 0.05),
    grippers=((0.35, 0.35, 0.35), (0.35, 0.35, 0.35)),
    joints=((0.35, 0.55, 0.75), (0.75, 0.72, 0.45)),
    links=(0.7, 0.72, 0.75),
)
"""An orange cable on a light table."""

LAMP, AMBIENT = (0.0, -0.5, 3.2), 0.62
"""Where the lamp is from the middle of the workspace [m], and the share of light from everywhere."""

SHADOWS = 256
"""Pixels of the lamp's picture each way."""

PICTURE = (640, 480)
"""Width and height [pixels]."""

ROUNDING = 1e-9
"""[s]."""


@dataclass(frozen=True, kw_only=True)
class EyesConfig(Checked):
    """Cameras, and what is done with their pictures.

    Attributes:
        cameras: Where they stand, of `cableway.perception.placement.PLACES`.
        tracker: What finds the cable in their pictures.
        frame_rate: Pictures per second [Hz].
        latency: Time [s] from when a picture is taken until the cable is found in it.
        drop_rate: Share of the pictures that are lost.
        blur: Standard deviation [pixels].
        noise: Standard deviation of each number of a pixel, from 0 to 255.
        dark: When all cameras see nothing: (begin, end) [s]; never where None.
        shadows: Whether things throw shadows; pictures take twice as long to make.
        seed: Of noise and lost pictures.

    Raises:
        InputError: There is no camera, no such place, or a value is out of range.
    """

    cameras: tuple[str, ...] = ("front", "back")
    tracker: Annotated[Literal["rod"], Choice("tracker")] = "rod"
    frame_rate: Annotated[float, Bounds(1, 1000)] = 30.0
    latency: Annotated[float, Bounds(0, 1)] = 0.05
    drop_rate: Share = 0.0
    blur: NotNegative[float] = 0.7
    noise: NotNegative[float] = 5.0
    dark: tuple[float, float] | None = None
    shadows: bool = False
    seed: Annotated[int, Bounds(0)] = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.cameras or len(set(self.cameras)) < len(self.cameras):
            raise InputError(f"cameras must be one or more places, each once, got {list(self.cameras)}")
        for place in self.cameras:
            camera_at(place, (1.0, 1.0))
        if self.dark is not None and not 0 <= self.dark[0] <= self.dark[1] < math.inf:
            raise InputError(f"dark must be a begin and an end in seconds, got {list(self.dark)}")


class _State(NamedTuple):
    """What is to be seen at one time [s]."""

    time: float
    cable: Float[np.ndarray, "m 2"]
    poses: Float[np.ndarray, "2 3"]
    joints: Float[np.ndarray, "2 6"] | None


class Photographer:
    """Makes pictures of a task's table.

    Args:
        task: The task, with what stands on the table.
        way: How the arms of its cell hold the cable; None where grippers float.
        config: The cameras.
    """

    def __init__(self, task: Task, way: Way | None, config: EyesConfig) -> None:
        width, height = task.scene.size
        self._scene, self._config = CellScene(task, way, LOOK), config
        self.cameras = tuple(camera_at(place, (width, height), PICTURE) for place in config.cameras)
        place = (width / 2 + LAMP[0], height / 2 + LAMP[1], LAMP[2])
        self._light = Light(position=place, ambient=AMBIENT, shadows=SHADOWS if config.shadows else 0)

    def pictures(self, state: _State, rng: np.random.Generator) -> list[UInt8[np.ndarray, "h w 3"]]:
        """Of each camera."""
        mesh, dark = self._mesh(state), self._config.dark
        if dark is not None and dark[0] <= state.time < dark[1]:
            return [np.zeros((*PICTURE[::-1], 3), np.uint8) for _ in self.cameras]
        return [self._exposed(mesh, camera, rng) for camera in self.cameras]

    def hiding(self, state: _State) -> list[Bool[np.ndarray, "h w"]]:
        """What may hide the cable from each camera, by what is known without seeing it: joints, or poses of hands."""
        mesh = self._mesh(state)
        kept = mesh.labels != Label.CABLE
        bare = Mesh(mesh.corners[kept], mesh.normals[kept], mesh.colors[kept], mesh.labels[kept])
        light = replace(self._light, shadows=0)
        return [render(bare, camera.pinhole, light).label > Label.TABLE for camera in self.cameras]

    def _mesh(self, state: _State) -> Mesh:
        if state.joints is None:
            return self._scene.mesh(state.cable, poses=state.poses)
        return self._scene.mesh(state.cable, joints=state.joints)

    def _exposed(self, mesh: Mesh, camera: CalibratedCamera, rng: np.random.Generator) -> UInt8[np.ndarray, "h w 3"]:
        config = self._config
        color = render(mesh, camera.pinhole, self._light).color.astype(np.float32)
        if config.blur:
            color = gaussian_filter(color, (config.blur, config.blur, 0))
        if config.noise:
            color += np.float32(config.noise) * rng.standard_normal(color.shape, dtype=np.float32)
        return np.clip(color, 0, 255).round().astype(np.uint8)


class SeenPlant:
    """A plant like the one behind it, whose cable is known by pictures alone.

    Pictures are taken at a rate of their own, also between control steps, where the state is interpolated. Where the
    tracker does not know where the cable is, keypoints are NaN and all confidence is 0: the loop then stands still.

    Args:
        plant: The one behind it, which measures the truth.
        config: The cameras.
        way: How the arms of a cell hold the cable, where it measures joints.
    """

    def __init__(self, plant: Plant, config: EyesConfig, way: Way | None = None) -> None:
        self._plant, self._config = plant, config
        self._photographer = Photographer(plant.task, way, config)
        r, g, b = (255 * part for part in LOOK.cable)
        self._color = CableColor(color=(r, g, b))
        self._tracker = RodTracker(plant.task.cable, 1 / config.frame_rate)
        self._begin()

    def _begin(self) -> None:
        self._rng = np.random.default_rng(self._config.seed)
        self._states: deque[_State] = deque()
        self._track: Track | None = None
        self._frame = 0
        self._errors: list[float] = []
        self._hidden: list[float] = []
        self._spent = 0.0

    @property
    def task(self) -> Task:
        """See `Plant`."""
        return self._plant.task

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
        now = self._states[-1].time + self.control_step
        self._note(now, reported)
        return self._seen(now, reported)

    def record(self) -> dict[str, Any]:
        """Plain data on the cameras and on how well they saw, against the truth, for the record of a run."""
        frames, errors = max(len(self._hidden), 1), self._errors
        return {
            **describe(self._config),
            "frames": len(self._hidden),
            "known": len(errors) / frames,
            "hidden": sum(self._hidden) / frames,
            "mean_error": sum(errors) / len(errors) if errors else None,
            "largest_error": max(errors, default=None),
            "seconds_per_frame": self._spent / frames,
        }

    def _note(self, now: float, reported: Observation) -> None:
        truth = self._plant.measure()
        poses = reported.poses if np.isfinite(reported.poses).all() else self._states[-1].poses
        if self._states:
            poses = SE2.continued(poses, self._states[-1].poses)
        self._states.append(_State(now, truth.centreline, poses, truth.joints))
        while len(self._states) > 2 and self._states[1].time < now - self._config.latency - self.control_step:
            self._states.popleft()

    def _at(self, time: float) -> _State:
        """The state at a time, between two that are known."""
        states = list(self._states)
        after = next((k for k, state in enumerate(states) if state.time >= time - ROUNDING), len(states) - 1)
        b = states[after]
        a = states[max(after - 1, 0)]
        share = 1.0 if b.time <= a.time else min(max((time - a.time) / (b.time - a.time), 0.0), 1.0)
        joints = b.joints if a.joints is None or b.joints is None else (1 - share) * a.joints + share * b.joints
        return _State(time, (1 - share) * a.cable + share * b.cable, SE2.between(a.poses, b.poses, share), joints)

    def _seen(self, now: float, reported: Observation) -> Observation:
        """What is known at a time of the newest picture that has been looked at."""
        config, newest = self._config, None
        while (taken := self._frame / config.frame_rate) <= now - (config.latency if now else 0.0) + ROUNDING:
            self._frame += 1
            lost = self._rng.random() < config.drop_rate
            if not lost or self._track is None:
                newest = self._look(self._at(taken))
        if newest is None:
            return replace(reported, keypoints=np.full_like(reported.keypoints, np.nan))
        if not newest.known:
            n = len(reported.keypoints)
            return replace(reported, keypoints=np.full((n, 2), np.nan), confidence=np.zeros(n))
        seen, offset = newest.observation, reported.time - now
        return replace(
            reported, keypoints=seen.keypoints, confidence=seen.confidence, taken=seen.time + offset
        )  # fmt: skip

    def _look(self, state: _State) -> Sighting:
        pictures, hiding = self._photographer.pictures(state, self._rng), self._photographer.hiding(state)
        begun = clock.process_time()
        views = [
            View(camera, cable_mask(picture, self._color), hidden)
            for camera, picture, hidden in zip(self._photographer.cameras, pictures, hiding, strict=True)
        ]
        if self._track is None:
            self._track = self._tracker.start(state.poses, self.task.start_equilibrium)
        self._track, seen = self._tracker.update(self._track, views, state.poses, state.time)
        self._spent += clock.process_time() - begun
        self._hidden.append(seen.hidden)
        if seen.known:
            truth = polyline.resample(state.cable, self.task.cable.keypoints)
            self._errors.append(float(np.linalg.norm(seen.observation.keypoints - truth, axis=1).mean()))
        return seen
