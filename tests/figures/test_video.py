"""Laws of the video: it plays what happened, in real time or a whole multiple, and is there whole or not at all."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from recorded import moved_plan, perfect_rollout

from cableway.core.errors import CablewayError
from cableway.figures import video
from cableway.figures.video import playback, write_video
from cableway.records import Rollout

TASK, PLAN = moved_plan(rows=13)
ROLLOUT = perfect_rollout(TASK, PLAN)


def lasting(seconds: float) -> Rollout:
    """A rollout of that duration at a row each 0.1 s, the first rows of which are real."""
    rows = round(seconds / 0.1) + 1
    keep = np.minimum(np.arange(rows), ROLLOUT.steps)
    names = ("keypoints", "observed", "poses", "centreline", "reference", "clearance", "gripper_clearance")
    per_step = ("actions", "solve_time", "status")
    return replace(
        ROLLOUT,
        times=0.1 * np.arange(rows),
        **{name: getattr(ROLLOUT, name)[keep] for name in names},
        **{name: getattr(ROLLOUT, name)[np.minimum(np.arange(rows - 1), ROLLOUT.steps - 1)] for name in per_step},
    )


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[float]]:
    path, shares = tmp_path_factory.mktemp("video") / "deep" / "rollout.mp4", []

    def progress(stage: str, share: float) -> None:
        assert stage == "video"
        shares.append(share)

    write_video(path, TASK, ROLLOUT, progress=progress)
    return path, shares


def decode(path: Path) -> tuple[str, np.ndarray]:
    """What ffmpeg says of a video, and its frames (k, 720, 1280, 3)."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(command, capture_output=True, check=True)
    return done.stderr.decode(), np.frombuffer(done.stdout, np.uint8).reshape(-1, 720, 1280, 3)


def test_it_is_h264_that_every_player_shows_and_shows_every_row(film: tuple[Path, list[float]]):
    about, frames = decode(film[0])
    assert "h264" in about
    assert "yuv420p" in about
    assert "1280x720" in about
    assert "10 fps" in about
    assert len(frames) == len(ROLLOUT.times) + video.FINAL_PAUSE * 10
    assert all(frame.std() > 10 for frame in frames)
    assert np.abs(frames[0].astype(int) - frames[-1]).max() > 100
    assert np.abs(frames[-2].astype(int) - frames[-1]).max() < 60, "the last row stands still"


def test_it_tells_how_far_it_is(film: tuple[Path, list[float]]):
    assert film[1] == sorted(film[1])
    assert film[1][-1] == 1.0


def test_nothing_else_is_left(film: tuple[Path, list[float]]):
    assert [path.name for path in film[0].parent.iterdir()] == ["rollout.mp4"]


@pytest.mark.parametrize(
    ("seconds", "speed", "rate", "stride"), [(20, 1, 10, 1), (50, 2, 20, 1), (100, 4, 20, 2), (200, 8, 20, 4)]
)
def test_a_long_run_plays_faster_in_whole_multiples(seconds: float, speed: int, rate: float, stride: int):
    rows, found_rate, found_speed = playback(lasting(seconds))
    assert (found_speed, found_rate, rows.step) == (speed, pytest.approx(rate), stride)
    assert len(rows) / found_rate == pytest.approx(seconds / speed, abs=1.0)
    assert seconds / speed <= video.LONGEST


def test_an_interrupt_leaves_nothing_behind(tmp_path: Path):
    def interrupt(stage: str, share: float) -> None:
        if share > 0.3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_video(tmp_path / "rollout.mp4", TASK, ROLLOUT, progress=interrupt)
    assert list(tmp_path.iterdir()) == []


def test_a_failing_encoder_is_named_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", "/bin/false")
    with pytest.raises(CablewayError, match=r"rollout\.mp4: the video could not be encoded \(ffmpeg ended with 1\)"):
        write_video(tmp_path / "rollout.mp4", TASK, ROLLOUT)
    assert list(tmp_path.iterdir()) == []
