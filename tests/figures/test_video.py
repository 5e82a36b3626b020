"""Laws of the video: it plays what happened, in real time or a whole multiple, and is there whole or not at all."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from recorded import moved_plan, perfect_rollout
from spatial_problems import ball_task

from cableway.core.errors import CablewayError
from cableway.figures import video
from cableway.figures.moving import captions
from cableway.figures.space import SpaceView
from cableway.figures.video import playback, write_video
from cableway.records import Plan, Rollout

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


def test_in_space_the_cable_is_shown_where_it_is(tmp_path: Path):
    """In perspective, and the goal, too."""
    task = ball_task()
    plan = Plan.of(task.rod, task.rod.between(task.start, task.goal, np.array([0.0, 0.2, 0.4])))
    rollout = Rollout(
        times=np.array([0.0, 0.1, 0.2]), keypoints=plan.shapes, observed=plan.shapes, poses=plan.poses,
        centreline=plan.shapes, actions=np.zeros((2, 2, 6)), reference=plan.shapes, solve_time=np.full(2, 0.001),
        status=np.array(["tracking"] * 2), clearance=np.full(3, 0.1), gripper_clearance=np.full(3, 0.1),
        metadata={"outcome": "settled"},
    )  # fmt: skip
    write_video(tmp_path / "space.mp4", task, rollout)
    _, frames = decode(tmp_path / "space.mp4")
    assert len(frames) == 3 + video.FINAL_PAUSE * 10
    left, bottom, width, height = (round(video.INCH * part) for part in video.SPACE.scene)
    view = SpaceView(task, pixels=(width, height))
    for row, frame in enumerate(frames[:3]):
        at = view.at(np.stack([plan.shapes[row, 4], plan.shapes[(row + 1) % 3, 4], task.keypoints("goal")[4]]))
        x, y = (at + [left, bottom]).round().astype(int).T
        here, elsewhere, goal = (
            frame[719 - v - 2 : 719 - v + 3, u - 2 : u + 3].reshape(-1, 3).astype(int)
            for u, v in zip(x, y, strict=True)
        )
        assert here.max(axis=1).min() < 100
        assert elsewhere.max(axis=1).min() > 120
        assert (goal[:, 0] - goal[:, 2]).max() > 80


def test_the_insertion_is_shown_to_its_end(tmp_path: Path):
    """The rows of the insertion follow those of the tracking, and the last frames show its last row."""
    insertion = replace(
        ROLLOUT, **{name: getattr(ROLLOUT, name)[::-1] for name in ("keypoints", "poses", "centreline")}
    )
    write_video(tmp_path / "both.mp4", TASK, ROLLOUT, insertion)
    _, frames = decode(tmp_path / "both.mp4")
    assert len(frames) == len(ROLLOUT.times) + insertion.steps + video.FINAL_PAUSE * 10
    first, last = _cable_pixels(frames[0]), _cable_pixels(frames[-1])
    assert (first & last).sum() > 0.8 * first.sum(), "it ends where it began"
    assert (_cable_pixels(frames[ROLLOUT.steps]) & first).sum() < 0.5 * first.sum()
    whole = video.joined(ROLLOUT, insertion)
    assert whole.times[-1] == pytest.approx(ROLLOUT.times[-1] + insertion.times[-1])
    assert (np.diff(whole.times) > 0).all()
    joints = np.arange(12.0 * len(ROLLOUT.times)).reshape(-1, 2, 6)
    before, after = replace(ROLLOUT, joints=joints), replace(insertion, joints=joints[::-1].copy())
    both = video.joined(before, after).joints
    assert both is not None
    assert np.array_equal(both[ROLLOUT.steps :], after.joints)
    assert video.joined(before, insertion).joints is None
    assert video.joined(ROLLOUT, after).joints is None


def _cable_pixels(frame: np.ndarray) -> np.ndarray:
    """Where the scene of a frame, inside its walls, is as dark as the cable."""
    return frame[90:610, 70:590].max(axis=2) < 80


def test_nothing_of_the_curves_is_seen_ahead_of_the_cursor():
    """What is to come is masked from bottom to top on both axes, from where the cursor stands."""
    stage = video._Stage(TASK, ROLLOUT, None)
    stage.title(1)
    for row in (0, 5, ROLLOUT.steps):
        stage.frame(row)
        now = ROLLOUT.times[row]
        assert len(stage._cursors) == 2
        for mask, cursor in stage._cursors:
            assert mask.get_x() == pytest.approx(now)
            assert mask.get_x() + mask.get_width() == pytest.approx(ROLLOUT.times[-1])
            assert (mask.get_y(), mask.get_height()) == (0, 1), "of the axes' height"
            assert np.allclose(cursor.get_xdata(), now)
            assert np.allclose(cursor.get_ydata(), (0, 1))


def test_each_row_says_what_is_going_on():
    """Before the reference moves it is a hold, after its end settling; other statuses are said as they are."""
    rows = np.concatenate([[0] * 4, np.arange(len(ROLLOUT.times)), [ROLLOUT.steps] * 3])
    names = ("keypoints", "observed", "poses", "centreline", "reference", "clearance", "gripper_clearance")
    held = replace(
        ROLLOUT,
        times=0.1 * np.arange(len(rows)),
        **{name: getattr(ROLLOUT, name)[rows] for name in names},
        **{name: np.zeros((len(rows) - 1, *getattr(ROLLOUT, name).shape[1:])) for name in ("actions", "solve_time")},
        status=np.array(["tracking"] * (len(rows) - 2) + ["unseen: stopped"]),
    )
    said = captions(TASK, held)
    assert len(said) == len(rows)
    assert said[:5] == ["hold"] * 5
    assert set(said[5:-3]) == {"tracking"}
    assert said[-3:] == ["settling", "settling", "unseen: stopped"]


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
