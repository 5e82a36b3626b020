"""Laws of `check`: it tells the kinds of file apart and judges each afresh."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import Command

from cableway.records import Plan, Rollout


def test_what_run_wrote_holds(cableway: Command, moved_file: Path, run_folder: Path):
    for name in ("plan", "rollout"):
        done = cableway("check", moved_file, run_folder / f"{name}.npz", "--json")
        content = json.loads(done.out)
        assert (done.status, done.err) == (0, "")
        assert (content["kind"], content["passed"], content["task"]) == (name, True, "moved")
        assert len(content["checks"]) > 8


def test_it_believes_no_figure_that_the_file_states(cableway: Command, moved_file: Path, run_folder: Path):
    """The plan bent by 5 mm in the middle is no longer one that a rod takes."""
    plan = Plan.load(run_folder / "plan.npz")
    bent = plan.shapes.copy()
    bent[:, 6] += 0.005
    replace(plan, shapes=bent).save("bent.npz")
    done = cableway("check", moved_file, "bent.npz", "--out", "o")
    assert done.status == 1
    assert "FAIL" in done.out
    assert "rod deviation" in done.out
    assert json.loads(Path("o/report.json").read_text())["passed"] is False


def test_a_rollout_that_touched_fails(cableway: Command, moved_file: Path, run_folder: Path):
    rollout = Rollout.load(run_folder / "rollout.npz")
    replace(rollout, clearance=rollout.clearance - rollout.clearance.min() - 1e-4).save("touched.npz")
    done = cableway("check", moved_file, "touched.npz", "--quiet")
    assert done == (1, "", "")


def test_a_rollout_that_says_it_failed_fails(cableway: Command, moved_file: Path, run_folder: Path):
    rollout = Rollout.load(run_folder / "rollout.npz")
    replace(rollout, metadata={**rollout.metadata, "outcome": "plant failed", "detail": "stopped"}).save("failed.npz")
    done = cableway("check", moved_file, "failed.npz")
    assert done.status == 1
    assert "failures recorded" in done.out
    assert "plant failed: stopped" in " ".join(done.out.split())


def test_a_number_too_large_is_named_at_once(cableway: Command, moved_file: Path, run_folder: Path):
    arrays = dict(np.load(run_folder / "rollout.npz"))
    np.savez("huge.npz", **{**arrays, "centreline": np.full_like(arrays["centreline"], 1e300)})
    sentence = "centreline holds 1e+300; numbers of a record are at most 1e+06"
    assert cableway("check", moved_file, "huge.npz") == (2, "", f"cableway: huge.npz: {sentence}\n")


def test_another_task_is_another_verdict(cableway: Command, run_folder: Path):
    assert cableway("check", "maze-1", run_folder / "rollout.npz", "--quiet").status == 1


def write_text(path: Path) -> None:
    path.write_text("no archive")


def write_foreign(path: Path) -> None:
    np.savez(path, a=np.zeros(3), b=np.zeros(3))


def write_empty(path: Path) -> None:
    np.savez(path)


def write_half_a_plan(path: Path) -> None:
    np.savez(path, shapes=np.zeros((3, 13, 2)))


def write_objects(path: Path) -> None:
    np.savez(path, shapes=np.array([{}]))


def write_wrong_shape(path: Path) -> None:
    arrays = {"shapes": np.zeros((3, 13, 2)), "poses": np.zeros((4, 2, 3)), "pivot": np.zeros((5, 2))}
    rest = {"passages": np.zeros((0, 2, 2)), "path_set": np.zeros((13, 9, 2)), "progress": np.zeros((3, 13))}
    np.savez(path, metadata=np.array("{}"), **arrays, **rest)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    ("write", "sentence"),
    [
        (write_text, "not an .npz archive"),
        (write_foreign, "neither a plan (it would have an array 'shapes') nor a rollout ('centreline'); it has a, b"),
        (write_empty, "neither a plan (it would have an array 'shapes') nor a rollout ('centreline'); it has nothing"),
        (write_half_a_plan, "not a plan file: there is no array 'poses'"),
        (write_objects, "array 'shapes' holds Python objects, which are never read"),
        (write_wrong_shape, "poses has shape (4, 2, 3), not (T+1, 2, pose) with T = 2, n = 13, space = 2"),
    ],
)
def test_a_file_of_another_kind_is_status_2_and_one_sentence(cableway: Command, write, sentence: str):
    write(Path("file.npz"))
    assert cableway("check", "maze-1", "file.npz") == (2, "", f"cableway: file.npz: {sentence}\n")


def test_another_number_of_keypoints_is_named(cableway: Command, moved_file: Path, run_folder: Path):
    rollout = Rollout.load(run_folder / "rollout.npz")
    kept = {name: getattr(rollout, name)[:, ::2] for name in ("keypoints", "observed", "reference")}
    replace(rollout, **kept).save("seven.npz")
    done = cableway("check", moved_file, "seven.npz")
    assert done == (2, "", "cableway: seven.npz: the rollout has 7 keypoints, the task 13\n")
