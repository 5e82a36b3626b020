"""Recordings of a RealSense camera, made by the software device of librealsense: nothing of it is imitated."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

MISSING = "librealsense, or libusb, is not installed: pip install 'cableway[realsense]'"
rs: Any = pytest.importorskip("pyrealsense2", exc_type=ImportError, reason=MISSING)

UNITS, RATE = 0.00025, 30
"""[m] of a number, and pictures per second."""


def record(
    file: Path, images: Sequence[np.ndarray], depths: Sequence[np.ndarray] | None = None, form: str = "rgb8",
    focal: float = 300.0,
) -> None:  # fmt: skip
    """Write pictures, and depths [m] in the same pixels, as a camera would have recorded them."""
    device = rs.software_device()
    streams = [(device.add_sensor("RGB Camera"), rs.stream.color, getattr(rs.format, form), 3, images)]
    if depths is not None:
        counts = [(depth / UNITS).round().astype(np.uint16) for depth in depths]
        streams.append((device.add_sensor("Stereo Module"), rs.stream.depth, rs.format.z16, 2, counts))
        streams[-1][0].add_read_only_option(rs.option.depth_units, UNITS)
    profiles = []
    for number, (sensor, kind, each, size, shown) in enumerate(streams):
        stream = rs.video_stream()
        stream.type, stream.fmt, stream.uid, stream.fps, stream.bpp = kind, each, number, RATE, size
        stream.height, stream.width = shown[0].shape[:2]
        lens = rs.intrinsics()
        lens.width, lens.height, lens.fx, lens.fy = stream.width, stream.height, focal, focal
        lens.ppx, lens.ppy, lens.model, lens.coeffs = stream.width / 2, stream.height / 2, rs.distortion.none, [0.0] * 5
        stream.intrinsics = lens
        profiles.append(sensor.add_video_stream(stream))
    if len(profiles) > 1:
        beside = rs.extrinsics()
        beside.rotation, beside.translation = np.eye(3).ravel().tolist(), [0.0, 0.0, 0.0]
        profiles[1].register_extrinsics_to(profiles[0], beside)
    recorder, together = rs.recorder(str(file), device), rs.syncer()
    sensors = recorder.query_sensors()
    for sensor in sensors:
        sensor.open(sensor.get_stream_profiles()[0])
        sensor.start(together)
    for k in range(len(images)):
        for (sensor, _, _, size, shown), profile in zip(streams, profiles, strict=True):
            frame = rs.software_video_frame()
            frame.pixels, frame.bpp, frame.stride = np.ascontiguousarray(shown[k]), size, size * shown[k].shape[1]
            frame.timestamp, frame.domain = 1000.0 * k / RATE, rs.timestamp_domain.hardware_clock
            frame.frame_number, frame.profile = k, profile.as_video_stream_profile()
            sensor.on_video_frame(frame)
        time.sleep(0.02)  # so that the recorder, which has a thread of its own, drops none
    for sensor in sensors:
        sensor.stop()
        sensor.close()
