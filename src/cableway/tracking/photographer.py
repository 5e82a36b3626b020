"""Pictures of a simulated table by cameras about it: what they are like, and how they are made."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy.ndimage import gaussian_filter

from cableway.core.checks import Bounds, Checked, Choice, NotNegative, Positive, Share, shown
from cableway.core.errors import InputError, UnknownNameError
from cableway.perception.calibration import NONE, CalibratedCamera
from cableway.perception.depth import DepthView
from cableway.perception.markers import Tracker
from cableway.perception.placement import camera_at
from cableway.perception.segmentation import CableColor, cable_mask
from cableway.perception.survey import depth_view
from cableway.rendering.cell import ARMS, GRIPPERS, CellScene, Color, Label, Look
from cableway.rendering.depth_sensor import DepthSensor, measured
from cableway.rendering.mesh import Mesh
from cableway.rendering.picture import Light, labels, render
from cableway.rendering.strangers import lying_cable, reaching_arm
from cableway.scene.cell import Way
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.tracking.lens import Lens

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

ORANGE = CableColor(color=(255 * LOOK.cable[0], 255 * LOOK.cable[1], 255 * LOOK.cable[2]))
"""That cable in pictures."""

MARKER = (0.05, 0.55, 0.2)
"""Of the markers, green: like nothing else there."""

LAMP, AMBIENT = (0.0, -0.5, 3.2), 0.62
"""Where the lamp is from the middle of the workspace [m], and the share of light from everywhere."""

SHADOWS = 256
"""Pixels of the lamp's picture each way."""

PICTURE = (640, 480)
"""Width and height [pixels]."""

STRANGERS = ("cable", "arm")
"""What may be in pictures beside what belongs to a task."""


@dataclass(frozen=True, kw_only=True)
class EyesConfig(Checked):
    """Cameras, and what is done with their pictures.

    Attributes:
        cameras: Where they stand, of `cableway.perception.placement.PLACES`.
        tracker: What finds the cable in their pictures: the rod by the cable's own pixels, or by markers on it.
        frame_rate: Pictures per second [Hz].
        latency: Time [s] from when a picture is taken until the cable is found in it.
        drop_rate: Share of the pictures that are lost.
        blur: Standard deviation [pixels].
        noise: Standard deviation of each number of a pixel, from 0 to 255.
        dark: When all cameras see nothing: (begin, end) [s]; never where None.
        shadows: Whether things throw shadows; pictures take twice as long to make.
        ambient: Share of the light that comes from everywhere, not from the lamp.
        exposure: Factor of all that is seen; what is brighter than white is cut off.
        tint: Colour of the cable (sRGB from 0 to 1); None for the one that is looked for.
        alike: Whether posts, boxes and grippers have the colour of the cable.
        strangers: What else is in the pictures, of `STRANGERS`, and nobody told: a second cable on the table, a
            person's arm over it.
        depth: Whether they give depths, too, by which the controller knows what stands on the table: what the task has,
            and what appears there, and nothing else of the scene.
        distortion: k1, k2, p1, p2, k3 of their lenses, see `CalibratedCamera`; the tracker knows them.
        picture: Width and height of a picture [pixels].
        seed: Of noise, lost pictures and strangers.

    Raises:
        InputError: There is no camera, no such place, or a value is out of range.
    """

    cameras: tuple[str, ...] = ("front", "back")
    tracker: Annotated[Tracker, Choice("tracker")] = "rod"
    frame_rate: Annotated[float, Bounds(1, 1000)] = 30.0
    latency: Annotated[float, Bounds(0, 1)] = 0.05
    drop_rate: Share = 0.0
    blur: NotNegative[float] = 0.7
    noise: NotNegative[float] = 5.0
    dark: tuple[float, float] | None = None
    shadows: bool = False
    ambient: Share = AMBIENT
    exposure: Positive[float] = 1.0
    tint: Color | None = None
    alike: bool = False
    strangers: tuple[str, ...] = ()
    depth: bool = False
    distortion: tuple[float, float, float, float, float] = NONE
    picture: tuple[int, int] = PICTURE
    seed: Annotated[int, Bounds(0)] = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.cameras or len(set(self.cameras)) < len(self.cameras):
            raise InputError(f"cameras must be one or more places, each once, got {list(self.cameras)}")
        if len(self.picture) != 2 or not all(isinstance(side, int) and 8 <= side <= 4096 for side in self.picture):
            raise InputError(f"picture must be width and height, from 8 to 4096 pixels, got {shown(self.picture)}")
        for place in self.cameras:
            camera_of(self, place, (1.0, 1.0))
        if self.dark is not None and not 0 <= self.dark[0] <= self.dark[1] < math.inf:
            raise InputError(f"dark must be a begin and an end in seconds, got {list(self.dark)}")
        if self.tint is not None and (len(self.tint) != 3 or not all(0 <= part <= 1 for part in self.tint)):
            raise InputError(f"tint must be three numbers from 0 to 1, got {shown(self.tint)}")
        for stranger in self.strangers:
            if stranger not in STRANGERS:
                raise UnknownNameError("stranger", stranger, STRANGERS)

    def is_dark(self, time: float) -> bool:
        """Whether all cameras see nothing at a time [s]."""
        return self.dark is not None and self.dark[0] <= time < self.dark[1]


class State(NamedTuple):
    """What is to be seen at one time [s]."""

    time: float
    cable: Float[np.ndarray, "m 2"]
    poses: Float[np.ndarray, "2 3"]
    joints: Float[np.ndarray, "2 6"] | None


DepthViews = list[DepthView]
"""Of each camera."""


class Photographer:
    """Makes pictures of a task's table.

    Args:
        task: The task, with what is known to stand on the table.
        way: How the arms of its cell hold the cable; None where grippers float.
        config: The cameras.
        actual: What stands on the table; None where that is what is known.
    """

    def __init__(self, task: Task, way: Way | None, config: EyesConfig, actual: Scene | None = None) -> None:
        self._size, self._config = task.scene.size, config
        look = LOOK if config.tint is None else LOOK._replace(cable=config.tint)
        if config.alike:
            look = look._replace(obstacle=look.cable, grippers=(look.cable, look.cable))
        if config.tracker == "markers":
            look = look._replace(marker=MARKER)
        self._task, self._way, self._look = task, way, look
        self._known = CellScene(task, way, look)
        self._scene = self._known if actual is None else CellScene(task.in_scene(actual), way, look)
        sensors = np.random.default_rng(config.seed)
        self._sensors = [DepthSensor().drawn(sensors) for _ in config.cameras]
        second = "cable" in config.strangers
        self._lying = [lying_cable(self._size, task.cable.radius, look.cable, config.seed)] if second else []
        self.cameras = tuple(camera_of(config, place, self._size) for place in config.cameras)
        self._lenses = [Lens(camera) for camera in self.cameras]
        self._light = lamp(self._size, config)

    def shot(
        self, state: State, rng: np.random.Generator
    ) -> list[tuple[UInt8[np.ndarray, "h w 3"], Bool[np.ndarray, "h w"]]]:
        """Of each camera the picture, and what may hide the cable by what is known without seeing it: joints, or poses
        of hands.
        """
        there = self._mesh(state, self._scene)
        known = there if self._known is self._scene else self._mesh(state, self._known)
        bare = known.where(known.labels != Label.CABLE)
        return [
            (picture, lens.through(labels(bare, lens.pinhole)) > Label.TABLE)
            for picture, lens in zip(self._taken(there, state.time, rng), self._lenses, strict=True)
        ]

    def pictures(self, state: State, rng: np.random.Generator) -> list[UInt8[np.ndarray, "h w 3"]]:
        """Of each camera the picture."""
        return self._taken(self._mesh(state, self._scene), state.time, rng)

    def _taken(self, there: Mesh, time: float, rng: np.random.Generator) -> list[UInt8[np.ndarray, "h w 3"]]:
        """Of each camera the picture of what is there."""
        seen = Mesh.joined([there, *self._strangers(time)])
        return [taken(seen, lens, self._light, self._config, time, rng) for lens in self._lenses]

    def depths(self, state: State, rng: np.random.Generator) -> DepthViews:
        """What the cameras show of depths, with the errors of `DepthSensor`, where cable, hands and arms are known."""
        there = self._mesh(state, self._scene)
        seen, views = Mesh.joined([there, *self._strangers(state.time)]), DepthViews()
        for lens, sensor in zip(self._lenses, self._sensors, strict=True):
            camera, shown = lens.camera, render(seen, lens.pinhole, self._light)
            depth = np.zeros(shown.depth.shape)
            if not self._config.is_dark(state.time):
                depth = measured(shown.depth, camera.pinhole.focal[0], sensor, rng)
            hands, cable = np.isin(labels(there, lens.pinhole), (*GRIPPERS, *ARMS)), cable_mask(shown.color, ORANGE)
            views.append(depth_view(camera, lens.nearest(depth), lens.through(cable), lens.through(hands)))
        return views

    def know(self, scene: Scene) -> None:
        """What is known to stand on the table from now on."""
        self._known = CellScene(self._task.in_scene(scene), self._way, self._look)

    @staticmethod
    def _mesh(state: State, scene: CellScene) -> Mesh:
        if state.joints is None:
            return scene.mesh(state.cable, poses=state.poses)
        return scene.mesh(state.cable, joints=state.joints)

    def _strangers(self, time: float) -> list[Mesh]:
        arm = reaching_arm(self._size, time, self._config.seed) if "arm" in self._config.strangers else None
        return self._lying + ([] if arm is None else [arm])


def camera_of(config: EyesConfig, place: str, workspace: tuple[float, float], height: float = 0.0) -> CalibratedCamera:
    """The camera at a place, see `camera_at`, with the lens that it has."""
    return replace(camera_at(place, workspace, config.picture, height), distortion=config.distortion)


def lamp(size: tuple[float, float], config: EyesConfig) -> Light:
    """The light on a table of this size [m]."""
    place = (size[0] / 2 + LAMP[0], size[1] / 2 + LAMP[1], LAMP[2])
    return Light(position=place, ambient=config.ambient, shadows=SHADOWS if config.shadows else 0)


def taken(
    mesh: Mesh, lens: Lens, light: Light, config: EyesConfig, time: float, rng: np.random.Generator
) -> UInt8[np.ndarray, "h w 3"]:
    """The picture that a camera takes of what is there at a time [s]."""
    if config.is_dark(time):
        return np.zeros((*config.picture[::-1], 3), np.uint8)
    color = lens.through(render(mesh, lens.pinhole, light).color.astype(np.float32))
    if config.blur:
        color = gaussian_filter(color, (config.blur, config.blur, 0))
    color *= np.float32(config.exposure)
    if config.noise:
        color += np.float32(config.noise) * rng.standard_normal(color.shape, dtype=np.float32)
    return np.clip(color, 0, 255).round().astype(np.uint8)
