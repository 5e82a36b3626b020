"""`plan`, `run` and `check` of a task in space: what they leave, and what they refuse."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import Command
from spatial_problems import ball_task

from cableway.records import Plan, Rollout
from cableway.scene.files.saving import save_task
from cableway.scene.spatial.obstacles import Sphere

pytest.importorskip("coal")


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    save_task(ball_task(), tmp_path / "ball.yaml")
    return tmp_path / "ball.yaml"


def test_a_cable_is_planned_led_and_checked_in_space(cableway: Command, tmp_path: Path, ball: Path):
    done = cableway("run", ball, "--out", "led")
    assert done.status == 0, done.err
    report, rollout = json.loads(Path("led/report.json").read_text()), Rollout.load(Path("led/rollout.npz"))
    assert report["outcome"] == "success"
    assert report["shape_error"] == pytest.approx(rollout.shape_error(ball_task().keypoints("goal")), abs=1e-9)
    assert report["shape_error"] < 0.01
    assert rollout.keypoints.shape[2] == 3
    assert np.linalg.norm(rollout.keypoints[-1] - rollout.keypoints[0], axis=1).min() > 0.3
    assert {path.name for path in Path("led").iterdir()} >= {
        "plan.npz",
        "plan.png",
        "rollout.png",
        "rollout.mp4",
        "task.yaml",
    }
    assert cableway("check", ball, "led/rollout.npz").status == 0
    for name in ("plan", "rollout"):
        assert cableway("show", ball, f"led/{name}.npz", "--out", "shown").status == 0
        assert Path(f"shown/{name}.png").read_bytes() == Path(f"led/{name}.png").read_bytes()
    Path("long.yaml").write_text("cableway: 1\ncable: {length: 0.302}\n")
    again = cableway(
        "run",
        ball,
        "--from",
        "led/plan.npz",
        "--controller",
        "open-loop",
        "--plant",
        "long.yaml",
        "--no-video",
        "--out",
        "again",
    )
    assert again.status == 0, again.err
    plant = json.loads(Path("again/report.json").read_text())["configuration"]["rollout"]["plant"]
    assert plant["cable"]["length"] == 0.302
    assert not np.array_equal(Rollout.load(Path("again/rollout.npz")).keypoints[0], rollout.keypoints[0])
    assert np.array_equal(Plan.load(Path("again/plan.npz")).poses, Plan.load(Path("led/plan.npz")).poses)
    larger = replace(
        ball_task(), scene=replace(ball_task().scene, obstacles=(Sphere(center=(0.4, 0.4, 0.4), radius=0.1),))
    )
    save_task(larger, tmp_path / "larger.yaml")
    for command in (("run", "larger.yaml", "--from", "led/plan.npz"), ("show", "single-obstacle-2", "led/rollout.npz")):
        refused = cableway(*command, "--out", "refused")
        assert refused.status == 2
        assert refused.err.startswith("cableway: led/")


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (("--plant", "package.module:Mine"), "in space the plant is the simulated one; give a YAML file"),
        (("--cell", "dual-ur5e", "--camera", "front", "--depth"), "no --depth, --cell yet"),
        (("--controller", "broyden"), "open-loop, rod-jacobian, rod-mpc"),
    ],
)
def test_what_there_is_not_in_space_is_refused(cableway: Command, ball: Path, given: tuple[str, ...], words: str):
    done = cableway("run", ball, *given)
    assert done.status == 2
    assert words in done.err
