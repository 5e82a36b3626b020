"""Laws of `plan` and `run`: which files there are, what is in them, and what is left when something stops them."""

from __future__ import annotations

import json
import time
from contextlib import nullcontext
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from commands import Command

from cableway.cli.options import TaskOptions
from cableway.control.open_loop import OpenLoop
from cableway.core import compiled
from cableway.core.errors import SimulationError
from cableway.core.files import read_arrays
from cableway.figures import video
from cableway.planning import candidates
from cableway.records import Plan, Rollout
from cableway.scene.files.loading import load_task
from cableway.scene.task import Task
from cableway.verification import VerificationLimits, verify_plan, verify_rollout
from cableway.workflow import compilation

PLANNED = {"plan.npz", "plan.png", "report.json", "task.yaml"}
TRACKED = PLANNED | {"rollout.npz", "rollout.png", "rollout.mp4"}


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def report(folder: Path) -> dict:
    return json.loads((folder / "report.json").read_text())


def test_a_run_leaves_all_its_files(run_folder: Path):
    assert names(run_folder) == TRACKED
    for picture in ("plan.png", "rollout.png"):
        assert matplotlib.image.imread(run_folder / picture).std() > 0.05


def test_the_files_of_a_run_belong_together(run_folder: Path):
    task = load_task(run_folder / "task.yaml")
    plan, rollout = Plan.load(run_folder / "plan.npz"), Rollout.load(run_folder / "rollout.npz")
    content = report(run_folder)
    assert content["success"] is True
    assert verify_plan(plan, task).passed
    assert verify_rollout(rollout, task).passed
    assert content["shape_error"] == pytest.approx(np.linalg.norm(rollout.keypoints[-1] - task.goal), abs=1e-12)
    assert content["min_clearance"] == rollout.clearance.min()
    assert content["steps"] == rollout.steps
    assert content["plan_steps"] == plan.steps


def test_the_files_hold_the_arrays_that_are_documented(run_folder: Path):
    plan, rollout = read_arrays(run_folder / "plan.npz"), read_arrays(run_folder / "rollout.npz")
    assert set(plan) == {"shapes", "poses", "q", "metadata"}
    assert {"times", "keypoints", "observed", "poses", "centreline", "actions", "reference"} <= set(rollout)
    assert {"solve_time", "status", "clearance", "gripper_clearance", "metadata"} <= set(rollout)


def test_report_and_records_say_where_they_come_from(run_folder: Path):
    content = report(run_folder)
    assert content["seed"] == 3
    assert content["versions"]["cableway"]
    assert {"set up", "pivot path", "initial trajectory", "projection", "verification"} <= set(content["stage_times"])
    assert content["planning_time"] == pytest.approx(sum(content["stage_times"].values()))
    assert all("compiled" in note for note in content["notes"])
    configuration = content["configuration"]
    assert configuration["plan"]["planner"]["pivot"]["method"] == "grid"
    assert configuration["rollout"]["controller"]["name"] == "OpenLoop"
    assert configuration["rollout"]["plant"]["time_step"] == 0.005
    for name, record in (("plan", Plan), ("rollout", Rollout)):
        assert record.load(run_folder / f"{name}.npz").metadata == configuration[name]


def test_plan_alone_says_so(cableway: Command, moved_file: Path):
    done = cableway("plan", moved_file, "--pivot", "grid")
    assert done.status == 0
    assert names(Path("runs/moved")) == PLANNED
    assert "success" in done.out
    assert "pivot path" in done.err, "progress goes to stderr"
    assert "shape_error" not in report(Path("runs/moved"))


def test_planning_again_replaces_what_belonged_to_another_plan(cableway: Command, moved_file: Path, run_folder: Path):
    Path("mixed").mkdir()
    for path in run_folder.iterdir():
        (Path("mixed") / path.name).write_bytes(path.read_bytes())
    (Path("mixed") / "notes.txt").write_text("mine")
    assert cableway("plan", moved_file, "--quiet", "--out", "mixed").status == 0
    assert names(Path("mixed")) == PLANNED | {"notes.txt"}


def test_the_same_seed_gives_the_same_plan(cableway: Command, moved_file: Path, run_folder: Path):
    assert cableway("plan", moved_file, "--quiet", "--seed", "3", "--out", "again") == (0, "", "")
    first, second = Plan.load(run_folder / "plan.npz"), Plan.load("again/plan.npz")
    assert np.array_equal(first.shapes, second.shapes)
    assert np.array_equal(first.poses, second.poses)


def test_json_is_the_report_alone(cableway: Command, moved_file: Path):
    done = cableway("run", moved_file, "--controller", "open-loop", "--no-video", "--json", "--out", "o")
    assert done.status == 0
    assert json.loads(done.out) == report(Path("o"))
    assert names(Path("o")) == TRACKED - {"rollout.mp4"}
    assert "track" in done.err


def test_vector_graphics_are_made_told_and_cleared(cableway: Command, moved_file: Path):
    """Another run in the folder leaves no picture of the earlier one."""
    done = cableway("plan", moved_file, "--vector", "svg", "--out", "o")
    assert done.status == 0
    assert names(Path("o")) == PLANNED | {"plan.svg"}
    assert "plan.npz, plan.png, plan.svg" in done.err
    assert cableway("plan", moved_file, "--vector", "pdf", "--out", "o").status == 0
    assert names(Path("o")) == PLANNED | {"plan.pdf"}


def test_what_was_found_out_about_the_cable_is_a_picture_of_its_own(cableway: Command, moved_file: Path):
    """Only where an estimate moved: of the nominal cable there is none."""
    Path("soft.yaml").write_text("cableway: 1\ncable: {length: 0.303, stiffness_profile: [0.5, 2.0]}\n")
    assert cableway("run", moved_file, "--plant", "soft.yaml", "--no-video", "--out", "o").status == 0
    assert names(Path("o")) == TRACKED - {"rollout.mp4"} | {"estimates.png"}


def test_a_task_without_a_plan_is_status_1_with_reason_and_picture(cableway: Command, sealed_file: Path):
    done = cableway("run", sealed_file, "--controller", "open-loop", "--out", "o")
    assert done.status == 1
    assert names(Path("o")) == {"report.json", "plan.png", "task.yaml"}
    content = report(Path("o"))
    assert content["success"] is False
    assert content["failure"]
    assert content["configuration"]["plan"]["planner"]
    assert "failed" in done.out
    assert matplotlib.image.imread("o/plan.png").std() > 0.05
    assert "Traceback" not in done.err


@pytest.mark.parametrize("compiling", [False, True])
def test_reading_the_task_counts_against_the_time_limit_but_not_compiling_kernels(
    cableway: Command, moved_file: Path, monkeypatch: pytest.MonkeyPatch, compiling: bool
):
    """A file that takes longer to read than the limit leaves no time to search."""
    load, limit = TaskOptions.load, 1.5 if compiling else 0.2

    def slow(options: TaskOptions) -> Task:
        with compiled._BUSY if compiling else nullcontext():
            time.sleep(1.05 * limit)
        return load(options)

    monkeypatch.setattr(TaskOptions, "load", slow)
    done = cableway("plan", moved_file, "--time-limit", limit, "--out", "o")
    assert done.status == (0 if compiling else 1)
    failure = report(Path("o")).get("failure")
    assert failure is None if compiling else failure.startswith("the time limit ran out")


def test_a_goal_that_is_missed_is_status_1(cableway: Command, moved_file: Path, monkeypatch: pytest.MonkeyPatch):
    """Grippers that never move leave the cable where it was."""
    whole = OpenLoop.step
    monkeypatch.setattr(OpenLoop, "step", lambda *args: (np.zeros((2, 3)), whole(*args)[1]))
    done = cableway("run", moved_file, "--controller", "open-loop", "--no-video", "--out", "o")
    assert done.status == 1
    assert report(Path("o"))["failure"].startswith("the final shape error is ")
    assert names(Path("o")) == TRACKED - {"rollout.mp4"}


def test_an_interrupt_while_planning_leaves_what_was_there(
    cableway: Command, moved_file: Path, run_folder: Path, monkeypatch: pytest.MonkeyPatch
):
    Path("o").mkdir()
    (Path("o") / "plan.npz").write_bytes(b"earlier")
    monkeypatch.setattr(candidates, "verify_plan", interrupt)
    done = cableway("plan", moved_file, "--out", "o")
    assert (done.status, done.out) == (130, "")
    assert done.err.endswith("cableway: interrupted\n")
    assert names(Path("o")) == {"plan.npz"}
    assert (Path("o") / "plan.npz").read_bytes() == b"earlier"


def test_an_interrupt_after_a_failed_attempt_leaves_its_picture(
    cableway: Command, moved_file: Path, monkeypatch: pytest.MonkeyPatch
):
    """The plan of the first initial trajectory is refused, what comes next is interrupted."""
    judge = candidates.verify_plan
    strict = VerificationLimits(clearance=0.5)
    verdicts = iter([lambda plan, task, limits: judge(plan, task, strict), interrupt])
    monkeypatch.setattr(candidates, "verify_plan", lambda *given: next(verdicts)(*given))
    done = cableway("plan", moved_file, "--out", "o")
    assert done.status == 130
    assert names(Path("o")) == {"report.json", "plan.png", "task.yaml"}
    assert report(Path("o"))["failure"].startswith("interrupted before a plan was found; the closest attempt: ")


def test_a_first_run_says_how_many_kernels_are_compiled(
    cableway: Command, moved_file: Path, monkeypatch: pytest.MonkeyPatch
):
    """Here all of them are at once, as only the mark is missing that says so."""
    monkeypatch.setattr(compilation, "is_compiled", lambda stage: stage != compilation.PLANNING)
    done = cableway("plan", moved_file, "--out", "o")
    total = len(compilation.kernels_of(compilation.PLANNING))
    assert done.status == 0
    assert compilation.COMPILING in done.err
    assert f"compilation {total} of {total}" in done.err
    assert any(note.startswith("Kernels were compiled for ") for note in report(Path("o"))["notes"])


def test_an_interrupt_while_tracking_leaves_the_plan_and_what_was_tracked(
    cableway: Command, moved_file: Path, monkeypatch: pytest.MonkeyPatch
):
    """In the middle of a step, from which nothing is kept."""
    whole, asked = OpenLoop.step, iter(range(100))
    monkeypatch.setattr(OpenLoop, "step", lambda *given: interrupt() if next(asked) == 5 else whole(*given))
    done = cableway("run", moved_file, "--controller", "open-loop", "--out", "o")
    assert (done.status, done.out) == (130, "")
    kept = "report.json, task.yaml, plan.npz, plan.png, rollout.npz, rollout.png"
    assert done.err.endswith(f"cableway: interrupted; in o: {kept}\n")
    assert names(Path("o")) == PLANNED | {"rollout.npz", "rollout.png"}
    rollout = Rollout.load("o/rollout.npz")
    assert (Plan.load("o/plan.npz").steps > 0, rollout.steps, rollout.outcome) == (True, 5, "interrupted")
    content = report(Path("o"))
    assert (content["success"], content["outcome"], content["steps"]) == (False, "interrupted", 5)


def test_an_interrupt_before_tracking_leaves_no_success(
    cableway: Command, moved_file: Path, monkeypatch: pytest.MonkeyPatch
):
    """While the controller and the plant are made."""
    monkeypatch.setattr(OpenLoop, "init", interrupt)
    done = cableway("run", moved_file, "--controller", "open-loop", "--out", "o")
    assert done.status == 130
    assert names(Path("o")) == PLANNED
    assert (report(Path("o"))["success"], report(Path("o"))["outcome"]) == (False, "interrupted")


def test_an_interrupt_in_the_video_leaves_the_rollout_and_its_report(
    cableway: Command, moved_file: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(video._Stage, "frame", interrupt)
    done = cableway("run", moved_file, "--controller", "open-loop", "--out", "o")
    assert done.status == 130
    assert names(Path("o")) == TRACKED - {"rollout.mp4"}
    assert "shape_error" in report(Path("o"))


def test_a_plant_that_cannot_start_is_reported(cableway: Command, moved_file: Path, monkeypatch: pytest.MonkeyPatch):
    from cableway.simulation import plant

    def refuse(*_: object) -> None:
        raise SimulationError("the cable overlaps the scene at the start")

    monkeypatch.setattr(plant.CableSimulator, "__init__", refuse)
    done = cableway("run", moved_file, "--controller", "open-loop", "--out", "o")
    assert done.status == 1
    assert report(Path("o"))["failure"] == "tracking failed: the cable overlaps the scene at the start"
    assert names(Path("o")) == PLANNED


def test_a_deadline_that_no_step_meets_ends_the_run(cableway: Command, moved_file: Path):
    done = cableway("run", moved_file, "--controller", "open-loop", "--deadline", "1e-9", "--no-video", "--out", "o")
    assert done.status == 1
    assert report(Path("o"))["failure"].startswith("controller failed: 30 steps in a row were missed; all of them were")
    assert not Rollout.load("o/rollout.npz").actions.any()
    refused = cableway("run", moved_file, "--deadline", "0")
    assert (refused.status, refused.err) == (2, "cableway: watchdog.deadline must be finite and positive, got 0.0\n")


def test_a_dry_run_leaves_a_plan_and_says_what_would_be_sent(cableway: Command, moved_file: Path):
    command = ["run", moved_file, "--controller", "open-loop", "--dry-run", "--speed", "0.5"]
    done = cableway(*command, "--out", "o")
    assert done.status == 0
    assert names(Path("o")) == PLANNED
    assert "would be sent" in done.out
    assert "Dry run: nothing was moved." in " ".join(done.out.split())
    sent, limits = report(Path("o"))["commands"], load_task(moved_file).grippers
    assert 0 < sent["speed"] <= 0.5 * limits.max_step / 0.1
    assert sent["duration"] > 0
    refused = cableway("run", moved_file, "--speed", "0")
    assert (refused.status, refused.err) == (2, "cableway: speed must be above 0 and at most 1, got 0.0\n")


def interrupt(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


def test_alternatives(cableway: Command):
    """Three ways, each a plan that `check` accepts, and one picture of all; planning again leaves one plan."""
    assert cableway("plan", "multi-obstacle-1", "--alternatives", "3", "--out", "o").status == 0
    assert names(Path("o")) == {*PLANNED, "plan-2.npz", "plan-3.npz", "alternatives.png"}
    assert cableway("check", "multi-obstacle-1", "o/plan-3.npz").status == 0
    assert any(note.startswith("Plans, best first, by travel of both grippers") for note in report(Path("o"))["notes"])
    assert cableway("plan", "multi-obstacle-1", "--out", "o").status == 0
    assert names(Path("o")) == PLANNED
    refused = cableway("plan", "maze-1", "--alternatives", "0")
    assert (refused.status, refused.err) == (2, "cableway: --alternatives must be 1 or more, got 0\n")
