"""Pictures and depths of RealSense cameras and of what they recorded. librealsense's.

Never tried on a camera: tests play recordings that librealsense's own software device made.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, UInt8

from cableway.core.errors import InputError, MissingExtraError
from cableway.core.extras import require

NAME = "realsense"
"""Source of the first camera that is found; `realsense:SERIAL` is that of one by its serial number."""

RECORDINGS = (".bag", ".db3")
"""Endings of recordings, as librealsense makes them until version 2.56 and from then on."""

SIZE, RATE = (640, 480), 30
"""Width and height [pixels] and pictures per second of a camera, colours and depths alike."""

WARM_UP = 30
"""Pictures of a camera before the first one that counts, in which it finds its exposure."""

PATIENCE, REST = 5000, 1000
"""Time [ms] in which the next picture must come, and that the last ones of a recording take that has been read."""


class Shot(NamedTuple):
    """A picture (red, green, blue), depths [m] in its pixels, 0 where not known, and when that was [s].

    Depths are None where a recording has none.
    """

    time: float
    image: UInt8[np.ndarray, "h w 3"]
    depth: Float[np.ndarray, "h w"] | None


def is_realsense(source: str) -> bool:
    """Whether a source of pictures is such a camera or recording, by its name."""
    return source.split(":")[0] == NAME or source.lower().endswith(RECORDINGS)


def rate_of(source: str) -> float:
    """Pictures per second of a recording, as it says, or of a camera.

    Raises:
        InputError: See `shots`.
        MissingExtraError: See `shots`.
    """
    if source.split(":")[0] == NAME:
        return RATE
    with _streaming(source) as (rs, _, profile):
        return float(profile.get_stream(rs.stream.color).fps())


def shots(source: str) -> Generator[Shot, None, None]:
    """What a camera shows from now on, or showed in a recording, from its first picture on.

    Args:
        source: `realsense`, `realsense:SERIAL`, or the file of a recording.

    Raises:
        InputError: There is no such camera or recording, it gives no colours, or a camera stops giving pictures.
        MissingExtraError: librealsense, or a library that it needs, is not installed.
    """
    live, begun = source.split(":")[0] == NAME, None
    with _streaming(source) as (rs, pipeline, profile):
        aligned, device = rs.align(rs.stream.color), profile.get_device()

        def over() -> bool:
            return not live and device.as_playback().current_status() == rs.playback_status.stopped

        for together in _sets(pipeline, over, WARM_UP if live else 0, source):
            frames = aligned.process(together)
            color, depth = frames.get_color_frame(), frames.get_depth_frame()
            if not color:
                continue
            begun = color.get_timestamp() if begun is None else begun
            known = np.asanyarray(depth.get_data()) * np.float64(depth.get_units()) if depth else None
            yield Shot((color.get_timestamp() - begun) / 1000, _image(rs, color, source), known)
    if begun is None:
        raise InputError(f"{source}: there is no picture in it")


def _sets(pipeline: Any, over: Callable[[], bool], warm_up: int, source: str) -> Iterator[Any]:
    """Sets of frames, until a recording is over.

    Raises:
        InputError: None came any more.
    """
    count, waited = 0, 0
    while waited < PATIENCE:
        came, together = pipeline.try_wait_for_frames(REST)
        if came:
            count, waited = count + 1, 0
            if count > warm_up:
                yield together
        elif over():
            return
        else:
            waited += REST
    raise InputError(f"{source}: no picture came for {PATIENCE / 1000:g} s")


def _image(rs: Any, color: Any, source: str) -> UInt8[np.ndarray, "h w 3"]:
    """Red, green and blue.

    Raises:
        InputError: A recording has colours in another form.
    """
    form = color.get_profile().format()
    if form not in (rs.format.rgb8, rs.format.bgr8):
        raise InputError(f"{source}: colours must be rgb8 or bgr8, got {form.name}")
    image = np.asanyarray(color.get_data())
    return np.ascontiguousarray(image if form == rs.format.rgb8 else image[..., ::-1])


@contextmanager
def _streaming(source: str) -> Iterator[tuple[Any, Any, Any]]:
    """librealsense, its pipeline of a source that streams, and the profile of that.

    Raises:
        InputError: It cannot be.
        MissingExtraError: librealsense, or a library that it needs, is not installed.
    """
    require("realsense", "reading RealSense cameras")
    try:
        import pyrealsense2
    except ImportError as error:  # libusb, which is no Python package
        raise MissingExtraError(f"reading RealSense cameras needs a library of the system: {error}") from None
    rs: Any = pyrealsense2  # its types lack most names
    config, pipeline = rs.config(), rs.pipeline()
    name, _, serial = source.partition(":")
    if name == NAME:
        there = [device.get_info(rs.camera_info.serial_number) for device in rs.context().query_devices()]
        if not there or serial not in ("", *there):
            raise InputError(f"{source}: no such RealSense camera; there are {', '.join(there) or 'none'}")
        config.enable_device(serial or there[0])
        config.enable_stream(rs.stream.color, *SIZE, rs.format.rgb8, RATE)
        config.enable_stream(rs.stream.depth, *SIZE, rs.format.z16, RATE)
    elif not Path(source).is_file():
        raise InputError(f"{source}: no such file")
    try:
        if name != NAME:
            config.enable_device_from_file(source, repeat_playback=False)
            resolved = config.resolve(rs.pipeline_wrapper(pipeline))
            resolved.get_device().as_playback().set_real_time(False)  # before it starts, or first pictures are dropped
        profile = pipeline.start(config)
        profile.get_stream(rs.stream.color)
    except RuntimeError as error:
        what = "the camera does not start" if name == NAME else "not a recording of a RealSense camera with colours"
        raise InputError(f"{source}: {what}: {error}") from None
    try:
        yield rs, pipeline, profile
    finally:
        pipeline.stop()
