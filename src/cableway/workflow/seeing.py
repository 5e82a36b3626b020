"""A cable in pictures from outside: keypoints by time, as a recording."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from cableway.core.errors import FileFormatError, InputError
from cableway.core.files import write_text
from cableway.core.reading import LARGEST_TEXT, read_bytes
from cableway.datasets.rows import POSES, TIME
from cableway.geometry.groups import SE2
from cableway.perception.calibration import CalibratedCamera
from cableway.perception.capture import Frame
from cableway.perception.chain import chained
from cableway.perception.rod_tracker import RodTracker, Track
from cableway.perception.segmentation import CableColor, cable_mask
from cableway.perception.views import View, axis_points
from cableway.scene.cable import Cable


@dataclass(frozen=True, eq=False)
class Seen:
    """What was found in one picture.

    Attributes:
        frame: The picture.
        keypoints: (n, 2) [m], NaN where nothing is known.
        poses: (2, 3) of the grippers then [m, m, rad]; None where they are not known.
    """

    frame: Frame
    keypoints: Float[np.ndarray, "n 2"]
    poses: Float[np.ndarray, "2 3"] | None

    @property
    def known(self) -> bool:
        """Whether the cable was found."""
        return bool(np.isfinite(self.keypoints).all())

    def without_picture(self) -> Seen:
        """The same with an empty picture, so that a long film needs no memory."""
        return replace(self, frame=Frame(self.frame.time, np.empty((0, 0, 3), np.uint8)))


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
        reader = csv.DictReader(io.StringIO(read_bytes(path, LARGEST_TEXT).decode(errors="replace")))
        missing = [name for name in (TIME, *POSES) if name not in (reader.fieldnames or [])]
        if missing:
            raise FileFormatError(f"{path}: there is no column {missing[0]!r}")
        try:
            rows = np.array([[float(row[name]) for name in (TIME, *POSES)] for row in reader]).reshape(-1, 7)
        except (TypeError, ValueError) as error:
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
    frames: Iterable[Frame],
    camera: CalibratedCamera,
    color: CableColor,
    cable: Cable,
    grippers: GripperLog | None = None,
    frame_step: float = 1 / 30,
) -> Iterator[Seen]:
    """Find a cable in pictures, one after the other.

    With gripper poses by the rod tracker; without them by the pixels alone, so that only what is seen is found.

    Args:
        frames: The pictures.
        camera: That took them.
        color: Of the cable.
        cable: Its radius and number of keypoints, and with gripper poses its length.
        grippers: Their poses by time.
        frame_step: Time [s] between two pictures.

    Raises:
        InputError: A picture is not as large as the camera's, or the cable is too short for the grippers.
    """
    width, height = camera.pinhole.size
    tracker, track = RodTracker(cable, frame_step), None
    before: np.ndarray | None = None
    for frame in frames:
        if frame.image.shape != (height, width, 3):
            got = " x ".join(map(str, frame.image.shape[1::-1]))
            raise InputError(f"a picture is {got} pixels, and those of the calibration are {width} x {height}")
        view = View(camera, cable_mask(frame.image, color))
        if grippers is None:
            found = chained(axis_points(view, cable.radius), cable.keypoints, before)
            before = before if found is None else found
            yield Seen(frame, np.full((cable.keypoints, 2), np.nan) if found is None else found, None)
            continue
        poses = grippers.at(frame.time)
        track, keypoints = _followed(tracker, track, view, poses, frame.time)
        yield Seen(frame, keypoints, poses)


def _followed(
    tracker: RodTracker, track: Track | None, view: View, poses: Float[np.ndarray, "2 3"], time: float
) -> tuple[Track, Float[np.ndarray, "n 2"]]:
    """The track after a picture, and the keypoints, NaN where they are not known."""
    track = tracker.found([view], poses) if track is None else track
    track, seen = tracker.update(track, [view], poses, time)
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
        writer.writerow([f"{each.frame.time:.6f}", *shown])
    write_text(path, text.getvalue())
