"""From a task file to a judged rollout, through the command, with the shipped model."""

from __future__ import annotations

import json

import numpy as np
import problems
import pytest

import cableway as cw
from cableway.cli import main
from cableway.scene.files.saving import save_task


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What `cableway run` leaves for a task that is in no catalogue."""
    path = tmp_path_factory.mktemp("run")
    save_task(problems.beside_disc(), path / "own.yaml")
    assert main(["run", str(path / "own.yaml"), "--out", str(path / "out"), "--seed", "1", "--quiet"]) == 0
    return path


def test_leaves_everything(folder):
    """All the files of a run are there and nothing else, no temporary ones either."""
    names = {path.name for path in (folder / "out").iterdir()}
    assert names == {
        "report.json", "task.yaml", "plan.npz", "plan.png", "rollout.npz", "rollout.png", "rollout.mp4"
    }  # fmt: skip


def test_report_agrees_with_the_arrays(folder):
    """The figures of the report follow from the rollout's arrays."""
    report = json.loads((folder / "out" / "report.json").read_text())
    task = cw.load_task(folder / "own.yaml")
    rollout = cw.Rollout.load(folder / "out" / "rollout.npz")
    offset = rollout.keypoints[-1] - task.goal
    assert report["success"] is True
    assert report["shape_error"] == pytest.approx(float(np.linalg.norm(offset)), abs=1e-6)
    assert report["mean_keypoint_error"] == pytest.approx(float(np.linalg.norm(offset, axis=1).mean()), abs=1e-6)
    assert report["min_clearance"] == pytest.approx(float(rollout.clearance.min()), abs=1e-9)
    assert report["seed"] == 1
    assert report["versions"]["mujoco"]


def test_tracks_closely(folder):
    """On the nominal cable the goal is met within 5 mm stacked and the cable stays within 10 mm of the plan."""
    rollout = cw.Rollout.load(folder / "out" / "rollout.npz")
    task = cw.load_task(folder / "own.yaml")
    assert np.linalg.norm(rollout.keypoints[-1] - task.goal) < 0.005
    assert np.linalg.norm(rollout.keypoints - rollout.reference, axis=2).max() < 0.010
    assert rollout.clearance.min() > 0.002


def test_check_agrees(folder):
    """Judged afresh, plan and rollout pass; the rollout of another task does not."""
    out = folder / "out"
    for name in ("plan.npz", "rollout.npz"):
        assert main(["check", str(folder / "own.yaml"), str(out / name), "--quiet"]) == 0
        assert main(["check", "single-obstacle-1", str(out / name), "--quiet"]) == 1


def test_the_same_in_python(folder):
    """The calls of the tutorial give the rollout that the command gave, bit for bit."""
    task = cw.load_task(folder / "own.yaml")
    plan = cw.plan(task, seed=1)
    rollout = cw.track(cw.CableSimulator(task), cw.RodMPC(), plan)
    recorded = cw.Rollout.load(folder / "out" / "rollout.npz")
    assert np.array_equal(rollout.keypoints, recorded.keypoints)
    assert np.array_equal(rollout.actions, recorded.actions)
    assert cw.summarize(task, plan, rollout).success


def test_the_learned_model_leads_it_there_too(folder):
    """Neural MPC with the shipped transformer, from the plan on disk."""
    task, plan = cw.load_task(folder / "own.yaml"), cw.Plan.load(folder / "out" / "plan.npz")
    rollout = cw.track(cw.CableSimulator(task), cw.NeuralMPC(cw.load_model("transformer")), plan)
    report = cw.summarize(task, plan, rollout)
    assert report.success
    assert report.shape_error < 0.005
