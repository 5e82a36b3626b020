"""Laws of `see --depth`: pictures and depths in, a task with what stands on the table out."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from commands import Command
from seen_tables import PICTURE, SIZE, pictured, standing

from cableway.perception.calibration_file import save_camera
from cableway.perception.capture import depth_picture
from cableway.perception.placement import camera_at
from cableway.rendering.picture import Picture
from cableway.scene.files.loading import load_task
from cableway.scene.files.saving import save_task
from cableway.scene.obstacles import Box, Disc, to_shapely
from cableway.scene.scene import Scene

cv2 = pytest.importorskip("cv2")

POST, WALL = (
    Disc(center=(0.15, 0.35), radius=0.03, height=0.05),
    Box(center=(0.35, 0.52), size=(0.3, 0.03), height=0.12),
)
"""In the way of nothing; and one that hides what is behind it from the front, the goal of the task."""


@cache
def shown() -> Picture:
    """The post and the wall from the front."""
    return pictured(standing(POST, WALL), camera_at("front", SIZE, PICTURE))


@pytest.fixture
def taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The files of a user: a task, and of a camera in front the calibration, a picture, and depths."""
    monkeypatch.chdir(tmp_path)
    task = load_task("single-obstacle-1")
    save_task(replace(task, scene=Scene(SIZE)), Path("task.yaml"))
    cv2.imwrite("wall.png", cv2.cvtColor(shown().color, cv2.COLOR_RGB2BGR))
    depth = np.where(np.isfinite(shown().depth), shown().depth, 0.0)
    cv2.imwrite("wall-depth.png", (1000 * depth).round().astype(np.uint16))
    save_camera("camera.json", camera_at("front", SIZE, PICTURE))
    return tmp_path


def options(*more: str) -> list[str]:
    return ["--calibration", "camera.json", "--color", "217,89,13", *more]


def test_a_task_has_what_stands_on_the_table(cableway: Command, taken: Path):
    given = options("--depth", "wall-depth.png", "--task", "task.yaml", "--out", "seen", "--hidden", "free")
    done = cableway("see", "wall.png", *given)
    assert done.status == 0, done.err
    assert "FREE" in done.out
    report, found = json.loads(Path("seen/report.json").read_text()), load_task(Path("seen/seen.yaml"))
    assert report["obstacles"] == len(found.scene.obstacles) == 2
    mine = next(each for each in found.scene.obstacles if to_shapely(each).intersects(to_shapely(POST)))
    assert mine.height == pytest.approx(0.054, abs=0.001)
    assert to_shapely(POST).difference(to_shapely(mine)).area < 0.01 * to_shapely(POST).area
    assert to_shapely(mine).area < 1.5 * to_shapely(POST).area
    assert cv2.imread("seen/seen.png") is not None
    assert "found from  12.0 mm on" in done.out


def test_what_is_hidden_stands_there_unless_asked_otherwise(cableway: Command, taken: Path):
    """Where it is in the goal of the task, the files are written all the same, and the status is 1."""
    done = cableway("see", "wall.png", *options("--depth", "wall-depth.png", "--task", "task.yaml", "--out", "seen"))
    report = json.loads(Path("seen/report.json").read_text())
    assert report["hidden"] > 0
    assert (done.status, bool(report["faults"])) == (1, True)
    assert "not possible" in done.out
    assert Path("seen/seen.yaml").exists()


def test_depths_of_a_folder_are_their_medians(taken: Path):
    folder = taken / "many"
    folder.mkdir()
    for k, depth in enumerate((1000, 0, 1010, 1004)):
        cv2.imwrite(str(folder / f"{k}.png"), np.array([[depth, 700 * (k == 0)]], np.uint16))
    np.testing.assert_allclose(depth_picture(folder), [[1.004, 0.0]])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--depth", "wall-depth.png"), "--depth needs --task"),
        (("--depth", "wall.png", "--task", "task.yaml"), "wall.png: not a depth picture: one channel of 16 bits"),
        (("--depth", "none.png", "--task", "task.yaml"), "none.png: not a depth picture"),
        (("--depth", "a.png,b.png", "--task", "task.yaml"), "--depth must be one for each of 1 sources"),
        (("--depth", "wall-depth.png", "--task", "task.yaml", "--seconds", "1"), "--seconds: does not go with --depth"),
        (("--depth", "wall-depth.png", "--task", "task.yaml", "--hidden", "x"), "known: free, stands"),
        (("--hidden", "free"), "--hidden: only goes with --depth"),
    ],
)
def test_what_is_wrong_is_told(cableway: Command, taken: Path, arguments: tuple[str, ...], said: str):
    done = cableway("see", "wall.png", *options(*arguments))
    assert (done.status, said in done.err) == (2, True), done.err


def test_a_recording_of_a_realsense_camera_becomes_a_task(cableway: Command, taken: Path):
    record = pytest.importorskip("recorded_realsense").record
    depth = np.where(np.isfinite(shown().depth), shown().depth, 0.0)
    record(Path("table.db3"), [shown().color] * 3, [depth] * 3)
    given = options("--depth", "table.db3", "--task", "task.yaml", "--out", "seen", "--hidden", "free")
    done = cableway("see", "table.db3", *given)
    assert done.status == 0, done.err
    found = load_task(Path("seen/seen.yaml")).scene.obstacles
    assert len(found) == 2
    mine = next(each for each in found if to_shapely(each).intersects(to_shapely(POST)))
    assert to_shapely(POST).difference(to_shapely(mine)).area < 0.02 * to_shapely(POST).area
