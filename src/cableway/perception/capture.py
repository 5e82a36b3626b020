"""Pictures from a camera, a video file or a folder, and what was found drawn on them. OpenCV's, or librealsense's."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, UInt8

from cableway.core.errors import InputError
from cableway.core.extras import require
from cableway.perception import realsense
from cableway.perception.depth import middle

IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
"""Endings of the pictures of a folder, which are taken in the order of their names."""

MILLIMETRE = 0.001
"""[m] of a number in a depth picture."""

DEPTHS = 10
"""Pictures of depths of a RealSense camera of which the median counts."""

DOT, MARK = 4, (0, 120, 255)
"""Radius [pixels] and colour of a keypoint in a picture."""


class Frame(NamedTuple):
    """A picture (red, green, blue) and when it was taken [s], from the first one on."""

    time: float
    image: UInt8[np.ndarray, "h w 3"]


def rate_of(source: str, otherwise: float) -> float:
    """Pictures per second of a video file or a RealSense camera, as it says; `otherwise` for all else.

    Raises:
        InputError: There is no such camera or recording.
        MissingExtraError: OpenCV or librealsense is not installed.
    """
    if realsense.is_realsense(source):
        return realsense.rate_of(source)
    require("vision", "reading pictures")
    import cv2

    if not Path(source).is_file():
        return otherwise
    capture = cv2.VideoCapture(source)
    stated = capture.get(cv2.CAP_PROP_FPS)
    capture.release()
    return stated if 0 < stated < math.inf else otherwise


def frames(source: str, rate: float = 30.0) -> Iterator[Frame]:
    """The pictures of a source.

    Args:
        source: The number of a camera, a video file, a folder of pictures, or one of `realsense.shots`.
        rate: Pictures per second of a folder or a video file.

    Raises:
        InputError: There is no such source, or nothing in it can be read.
        MissingExtraError: OpenCV or librealsense is not installed.
    """
    if realsense.is_realsense(source):
        yield from (Frame(shot.time, shot.image) for shot in realsense.shots(source))
        return
    require("vision", "reading pictures")
    import cv2

    if Path(source).is_dir():
        yield from _of_folder(Path(source), rate)
        return
    live = source.isdigit()
    if not live and not Path(source).is_file():
        raise InputError(f"{source}: no such file, folder or number of a camera")
    capture = cv2.VideoCapture(int(source) if live else source)
    try:
        begun, count = time.monotonic(), 0
        while True:
            read, image = capture.read()
            if not read:
                break
            yield Frame(time.monotonic() - begun if live else count / rate, cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
            count += 1
    finally:
        capture.release()
    if not count:
        raise InputError(f"{source}: " + ("there is no such camera" if live else "not a video that OpenCV can read"))


def sharpest(source: str, most: int) -> list[UInt8[np.ndarray, "h w 3"]]:
    """The pictures of a folder; of a film or a recording the sharpest one of each of `most` equal parts.

    Raises:
        InputError: There is no such source, or nothing in it can be read.
        MissingExtraError: OpenCV or librealsense is not installed.
    """
    if Path(source).is_dir():
        return [frame.image for frame in frames(source)]
    if not Path(source).is_file():
        raise InputError(f"{source}: no such folder of pictures, film or recording")
    sharpness = np.array([_sharpness(frame.image) for frame in frames(source)])
    parts = np.array_split(np.arange(len(sharpness)), most)
    chosen = {int(part[np.argmax(sharpness[part])]) for part in parts if len(part)}
    return [frame.image for k, frame in enumerate(frames(source)) if k in chosen]


def _sharpness(image: UInt8[np.ndarray, "h w 3"]) -> float:
    """Variance of the Laplacian: of pictures of one thing the larger, the less they are blurred."""
    import cv2

    return float(cv2.Laplacian(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), cv2.CV_64F).var())


def _of_folder(folder: Path, rate: float) -> Iterator[Frame]:
    for count, file in enumerate(_files(folder)):
        yield Frame(count / rate, picture(file))


def _files(folder: Path) -> list[Path]:
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() in IMAGES)
    if not files:
        raise InputError(f"{folder}: there is no picture in it that ends in {', '.join(IMAGES)}")
    return files


def picture(file: Path) -> UInt8[np.ndarray, "h w 3"]:
    """A picture (red, green, blue): a file, or the first one of a RealSense camera or recording.

    Raises:
        InputError: It cannot be read.
        MissingExtraError: OpenCV or librealsense is not installed.
    """
    if realsense.is_realsense(str(file)):
        with closing(realsense.shots(str(file))) as shots:
            return next(shots).image
    require("vision", "reading pictures")
    import cv2

    image = cv2.imread(str(file), cv2.IMREAD_COLOR) if file.is_file() else None
    if image is None:
        raise InputError(f"{file}: not a picture that OpenCV can read")
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


def depth_picture(source: Path) -> Float[np.ndarray, "h w"]:
    """Depths [m], 0 where they are not known: whole millimetres in a picture of 16 bits.

    Args:
        source: A picture; or a folder of pictures of what stands still, or a RealSense camera or recording of it, of
            each pixel's depths the median.

    Raises:
        InputError: There is no picture, or one cannot be read, has not 16 bits or is not as large as the others.
        MissingExtraError: OpenCV or librealsense is not installed.
    """
    if realsense.is_realsense(str(source)):
        return _of_realsense(str(source))
    require("vision", "reading pictures")
    import cv2

    taken: list[np.ndarray] = []
    for file in _files(source) if source.is_dir() else [source]:
        image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED) if file.is_file() else None
        if image is None or image.dtype != np.uint16 or image.ndim != 2:
            raise InputError(f"{file}: not a depth picture: one channel of 16 bits, in millimetres")
        if taken and image.shape != taken[0].shape:
            raise InputError(f"{file}: depth pictures of one camera must be of one size")
        taken.append(image)
    return middle(np.stack(taken) * MILLIMETRE)


def _of_realsense(source: str) -> Float[np.ndarray, "h w"]:
    """The median of the first pictures of depths [m].

    Raises:
        InputError: A recording has none.
    """
    with closing(realsense.shots(source)) as shots:
        taken = [shot.depth for shot in islice(shots, DEPTHS) if shot.depth is not None]
    if not taken:
        raise InputError(f"{source}: there are no depths in it")
    return middle(np.stack(taken))


def marked(image: UInt8[np.ndarray, "h w 3"], pixels: Float[np.ndarray, "n 2"]) -> UInt8[np.ndarray, "h w 3"]:
    """A picture with keypoints (u, v) on it, NaN where there is none.

    Raises:
        MissingExtraError: OpenCV is not installed.
    """
    require("vision", "drawing on pictures")
    import cv2

    drawn = image.copy()
    there = pixels[np.isfinite(pixels).all(axis=1)].round().astype(np.int32)
    if len(there) == len(pixels):
        cv2.polylines(drawn, [there.reshape(-1, 1, 2)], False, MARK, 1, cv2.LINE_AA)
    for u, v in there.tolist():
        cv2.circle(drawn, (u, v), DOT, MARK, -1, cv2.LINE_AA)
    return drawn
