"""What a RealSense camera recorded is read as it was: colours, depths in metres in their pixels, and times."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recorded_realsense import RATE, record

from cableway.core.errors import InputError
from cableway.perception import realsense
from cableway.perception.capture import depth_picture, frames, picture, rate_of
from cableway.perception.realsense import shots

COUNT = 4


def colors(form: str = "rgb8") -> list[np.ndarray]:
    images = [np.full((60, 80, 3), (10 * k, 100, 200), np.uint8) for k in range(COUNT)]
    return [image[..., ::-1] for image in images] if form == "bgr8" else images


@pytest.mark.parametrize("form", ["rgb8", "bgr8"])
def test_pictures_are_those_recorded(tmp_path: Path, form: str):
    file = tmp_path / "made.db3"
    record(file, colors(form), form=form)
    found = list(frames(str(file)))
    assert [frame.image[0, 0].tolist() for frame in found] == [[10 * k, 100, 200] for k in range(COUNT)]
    np.testing.assert_allclose([frame.time for frame in found], np.arange(COUNT) / RATE, atol=1e-6)
    assert rate_of(str(file), 10.0) == RATE
    assert picture(file).shape == (60, 80, 3)
    with pytest.raises(InputError, match="there are no depths in it"):
        depth_picture(file)


def test_a_recording_that_is_left_has_stopped_and_its_pictures_are_copies(tmp_path: Path):
    """Else librealsense plays on for what has gone, and now and then ends the process."""
    file = tmp_path / "made.db3"
    record(file, colors())
    for _ in range(10):
        with realsense._streaming(str(file)) as (rs, pipeline, profile):
            pipeline.wait_for_frames()
        assert profile.get_device().as_playback().current_status() == rs.playback_status.stopped
    assert all(shot.image.flags.owndata for shot in shots(str(file)))


def test_depths_are_in_metres(tmp_path: Path):
    file = tmp_path / "made.db3"
    record(file, colors(), [np.full((60, 80), 0.5 + 0.01 * k) for k in range(COUNT)])
    found = [shot.depth for shot in shots(str(file))]
    assert all(depth is not None for depth in found)
    middles = [float(depth[30, 40]) for depth in found if depth is not None]
    np.testing.assert_allclose(middles, 0.5 + 0.01 * np.arange(COUNT), atol=2e-4)
    assert depth_picture(file)[30, 40] == pytest.approx(np.median(middles), abs=2e-4)


@pytest.mark.parametrize(
    ("source", "said"),
    [("none.db3", "none.db3: no such file"), ("empty.bag", "not a recording of a RealSense camera"),
     ("realsense", "no such RealSense camera"), ("realsense:123", "no such RealSense camera")],
)  # fmt: skip
def test_what_is_no_camera_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, source: str, said: str):
    monkeypatch.chdir(tmp_path)
    Path("empty.bag").write_bytes(b"")
    with pytest.raises(InputError, match=said):
        next(iter(frames(source)))
