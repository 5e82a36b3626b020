"""Pictures and depths of RealSense cameras and of what they recorded. librealsense's.

Never tried on a camera: tests play recordings that librealsense's own software device made.
"""

from __future__ import annotations

import time
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

STOPPING = 0.002
"""Time [s] between two looks whether a recording that was stopped still plays."""


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

        def shot(together: Any) -> Shot | None:
            """A copy of what came; nothing of librealsense is left, since it must not outlive the pipeline."""
            frames = aligned.process(together)
            color, depth = frames.get_color_frame(), frames.get_depth_frame()
            if not color:
                return None
            known = np.asanyarray(depth.get_data()) * np.float64(depth.get_units()) if depth else None
            return Shot(color.get_timestamp() / 1000, _image(rs, color, source), known)

        for made in _shots(pipeline, shot, over, WARM_UP if live else 0, source):
            begun = made.time if begun is None else begun
            yield made._replace(time=made.time - begun)
    if begun is None:
        raise InputError(f"{source}: there is no picture in it")


def _shots(
    pipeline: Any, shot: Callable[[Any], Shot | None], over: Callable[[], bool], warm_up: int, source: str
) -> Iterator[Shot]:
    """What is made of sets of frames, until a recording is over.

    Raises:
        InputError: None came any more.
    """
    count, waited = 0, 0
    while waited < PATIENCE:
        came, together = pipeline.try_wait_for_frames(REST)
        made = shot(together) if came and count >= warm_up else None
        del together
        if came:
            count, waited = count + 1, 0
            if made is not None:
                yield made
        elif over():
            return
        else:
            waited += REST
    raise InputError(f"{source}: no picture came for {PATIENCE / 1000:g} s")


def _image(rs: Any, color: Any, source: str) -> UInt8[np.ndarray, "h w 3"]:
    """A copy of red, green and blue.

    Raises:
        InputError: A recording has colours in another form.
    """
    form = color.get_profile().format()
    if form not in (rs.format.rgb8, rs.format.bgr8):
        raise InputError(f"{source}: colours must be rgb8 or bgr8, got {form.name}")
    image = np.asanyarray(color.get_data())
    return np.array(image if form == rs.format.rgb8 else image[..., ::-1], order="C")


@contextmanager
def _streaming(source: str) -> Iterator[tuple[Any, Any, Any]]:
    """librealsense, its pipeline of a source that streams, and the profile of that.

    A recording that is stopped before its end plays on for some milliseconds, in a thread of librealsense. That is
    waited for: where what it plays for has gone, it ends the process.

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
        playback = None if name == NAME else profile.get_device().as_playback()
        until = time.monotonic() + PATIENCE / 1000
        while playback and playback.current_status() != rs.playback_status.stopped and time.monotonic() < until:
            time.sleep(STOPPING)
