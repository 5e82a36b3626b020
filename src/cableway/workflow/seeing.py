"""A cable in pictures from outside: keypoints by time, as a recording."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import repeat
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, UInt8

from cableway.core.errors import FileFormatError, InputError, UnknownNameError
from cableway.core.files import write_text
from cableway.core.reading import read_table
from cableway.datasets.rows import POSES, TIME
from cableway.geometry.groups import SE2
from cableway.perception.calibration import CalibratedCamera
from cableway.perception.capture import IMAGES, Frame, frames, picture
from cableway.perception.chain import chained
from cableway.perception.markers import TRACKERS
from cableway.perception.rod_tracker import RodTracker
from cableway.perception.segmentation import CableColor, view_of
from cableway.perception.sighting import Track
from cableway.perception.views import View, axis_points
from cableway.scene.cable import Cable


@dataclass(frozen=True, eq=False)
class Eye:
    """A camera with its pictures.

    Attributes:
        camera: The camera.
        frames: Its pictures.
        hides: With each picture, which pixels may show something that hides the cable; None where that is not known.
            Where it is, a table seen where the rod claims to be counts against the rod.
        background: A picture without the cable, whatever of its colour is in that is not the cable; None where there is
            none.
    """

    camera: CalibratedCamera
    frames: Iterable[Frame]
    hides: Iterable[Bool[np.ndarray, "h w"]] | None = None
    background: UInt8[np.ndarray, "h w 3"] | None = None

    def shots(self) -> Iterator[tuple[Frame, Bool[np.ndarray, "h w"] | None]]:
        """Pictures with what hides the cable in them, until either ends.

        Raises:
            InputError: A picture, or what hides the cable, is not as large as the camera's.
        """
        width, height = self.camera.pinhole.size
        for frame, hides in zip(self.frames, repeat(None) if self.hides is None else self.hides, strict=False):
            arrays = {
                "a picture": frame.image, "a mask of what hides the cable": hides, "a background": self.background
            }  # fmt: skip
            for what, array in arrays.items():
                if array is not None and array.shape[:2] != (height, width):
                    got = " x ".join(map(str, array.shape[1::-1]))
                    raise InputError(f"{what} is {got} pixels, and those of the calibration are {width} x {height}")
            yield frame, hides


@dataclass(frozen=True, eq=False)
class Seen:
    """What was found in the pictures of one time.

    Attributes:
        time: Of the first camera's picture [s].
        images: Of each camera.
        keypoints: (n, 2) [m], NaN where nothing is known.
        poses: (2, 3) of the grippers then [m, m, rad]; None where they are not known.
    """

    time: float
    images: tuple[UInt8[np.ndarray, "h w 3"], ...]
    keypoints: Float[np.ndarray, "n 2"]
    poses: Float[np.ndarray, "2 3"] | None

    @property
    def known(self) -> bool:
        """Whether the cable was found."""
        return bool(np.isfinite(self.keypoints).any())

    def without_picture(self) -> Seen:
        """The same without pictures, so that a long film needs no memory."""
        return replace(self, images=())


@dataclass(frozen=True, eq=False)
class GripperLog:
    """Gripper poses by time.

    Attributes:
        times: (m,) [s], increasing, on the clock of the pictures.
        poses: (m, 2, 3) [m, m, rad].
    """

    times: Float[np.ndarray, "m"]
    poses: Float[np.ndarray, "m 2 3"]

    @classmethod
    def load(cls, path: Path) -> GripperLog:
        """From a CSV file with the columns `time` and those of the poses of a recording.

        Raises:
            FileFormatError: It cannot be read, lacks a column, or holds what is no number.
        """
        try:
            rows = np.array(read_table(path, (TIME, *POSES)), float).reshape(-1, 7)
        except ValueError as error:
            raise FileFormatError(f"{path}: {error}") from None
        if not len(rows) or not np.isfinite(rows).all() or (np.diff(rows[:, 0]) <= 0).any():
            raise FileFormatError(f"{path}: needs rows of finite numbers, their times increasing")
        return cls(rows[:, 0], rows[:, 1:].reshape(-1, 2, 3))

    def at(self, time: float) -> Float[np.ndarray, "2 3"]:
        """The poses at a time, those of the first or last row beyond them."""
        after = int(np.clip(np.searchsorted(self.times, time), 1, max(len(self.times) - 1, 1)))
        if len(self.times) == 1:
            return self.poses[0]
        first, last = self.times[after - 1 : after + 1]
        begin, end = self.poses[after - 1 : after + 1]
        return SE2.between(begin, SE2.continued(end, begin), float(np.clip((time - first) / (last - first), 0, 1)))


def see(
    eyes: Sequence[Eye],
    color: CableColor,
    cable: Cable,
    grippers: GripperLog | None = None,
    frame_step: float = 1 / 30,
    tracker: str = "rod",
    cable_color: CableColor | None = None,
) -> Iterator[Seen]:
    """Find a cable in pictures, one after the other.

    With gripper poses by a tracker; without them by the pixels alone, so that only what is seen is found.

    Args:
        eyes: The cameras, whose first, second ... pictures were taken at the same time each.
        color: Of the cable, or of its markers.
        cable: Its radius and number of keypoints, and with gripper poses its length.
        grippers: Their poses by time.
        frame_step: Time [s] between two pictures.
        tracker: What finds the cable with gripper poses, one of `markers.TRACKERS`.
        cable_color: Of the cable between its markers, so that its own pixels count, too; None where they do not.

    Raises:
        UnknownNameError: There is no such tracker; the message lists them.
        InputError: A picture is not as large as its camera's, markers are to be found without gripper poses, a colour
            of the cable between markers is given without these, or the cable is too short for the grippers.
    """
    if tracker not in TRACKERS:
        raise UnknownNameError("tracker", tracker, TRACKERS)
    if tracker == "markers" and grippers is None:
        raise InputError("markers are named by the rod between the grippers, and no gripper poses are given")
    if cable_color is not None and tracker != "markers":
        raise InputError(f"cable_color is that of a cable between its markers, and the tracker is {tracker!r}")
    colors = (color, None) if cable_color is None else (cable_color, color)
    follower, track = TRACKERS[tracker](cable, frame_step), None
    before: np.ndarray | None = None
    for shots in zip(*(eye.shots() for eye in eyes), strict=False):
        views = [
            view_of(eye.camera, frame.image, hides, *colors, background=eye.background)
            for eye, (frame, hides) in zip(eyes, shots, strict=True)
        ]
        time, images = shots[0][0].time, tuple(frame.image for frame, _ in shots)
        if grippers is None:
            points = np.concatenate([axis_points(view, cable.radius) for view in views])
            found = chained(points, cable.keypoints, before)
            before = before if found is None else found
            yield Seen(time, images, np.full((cable.keypoints, 2), np.nan) if found is None else found, None)
            continue
        poses = grippers.at(time)
        track, keypoints = _followed(follower, track, views, poses, time)
        yield Seen(time, images, keypoints, poses)


def masks(source: str, rate: float) -> Iterator[Bool[np.ndarray, "h w"]]:
    """Which pixels are not black: of one picture again and again, or of each of a video file or a folder.

    Raises:
        InputError: There is no such source, or nothing in it can be read.
        MissingExtraError: OpenCV is not installed.
    """
    if Path(source).suffix.lower() in IMAGES:
        return repeat(picture(Path(source)).max(axis=2) > 0)
    return (frame.image.max(axis=2) > 0 for frame in frames(source, rate))


def _followed(
    tracker: RodTracker, track: Track | None, views: Sequence[View], poses: Float[np.ndarray, "2 3"], time: float
) -> tuple[Track, Float[np.ndarray, "n 2"]]:
    """The track after pictures, and the keypoints, NaN where they are not known."""
    track = tracker.found(views, poses) if track is None else track
    track, seen = tracker.update(track, views, poses, time)
    keypoints = seen.observation.keypoints
    return track, keypoints if seen.known else np.full_like(keypoints, np.nan)


def write_recording(path: Path, seen: list[Seen]) -> None:
    """Write what was found as a CSV recording: see the page on data sets."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    n = len(seen[0].keypoints)
    posed = seen[0].poses is not None
    writer.writerow([TIME, *(f"{axis}{k}" for k in range(n) for axis in "xy"), *(POSES if posed else ())])
    for each in seen:
        numbers = [*each.keypoints.ravel(), *(each.poses.ravel() if each.poses is not None else ())]
        shown = ["" if np.isnan(number) else f"{number:.6f}" for number in numbers]
        writer.writerow([f"{each.time:.6f}", *shown])
    write_text(path, text.getvalue())
