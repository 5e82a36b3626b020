"""Laws of `export`: a file that any program reads, or one sentence and none."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from commands import Command

from cableway.records import Plan, Rollout

ARMS = Path(__file__).parents[2] / "examples" / "arms" / "two-arms.yaml"


def test_a_plan_and_a_rollout_are_exported(cableway: Command, run_folder: Path):
    plan = Plan.load(run_folder / "plan.npz")
    done = cableway("export", run_folder / "plan.npz")
    assert done.status == 0
    assert "limit 133 mm/s" in done.out
    lines = Path("runs/export/moved-plan.csv").read_text().splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert [float(row["left_x"]) for row in rows] == plan.poses[:, 0, 0].tolist()
    done = cableway("export", run_folder / "rollout.npz", "--out", "b.json", "--rate", 125, "--cable", "--json")
    report, content = json.loads(done.out), json.loads(Path("b.json").read_text())
    assert content["header"] == report["header"]
    assert report["rows"] == len(content["time"]) == len(content["cable"])
    assert content["header"]["source"]["kind"] == "rollout"
    ends = Rollout.load(run_folder / "rollout.npz").poses[[0, -1], 1]
    np.testing.assert_allclose(np.array(content["right"])[[0, -1]], ends, atol=1e-12)


def test_a_folder_stands_for_its_plan_and_the_format_decides_the_files(cableway: Command, run_folder: Path):
    done = cableway("export", run_folder, "--format", "ros", "--json")
    assert (done.status, done.err) == (0, "")
    report = json.loads(done.out)
    assert report["files"] == [f"runs/export/moved-plan-{side}.yaml" for side in ("left", "right")]
    plan = Plan.load(run_folder / "plan.npz")
    for arm, path in enumerate(report["files"]):
        poses = yaml.safe_load(Path(path).read_text())["poses"]
        assert len(poses) == report["rows"] == len(plan.poses) + 2
        last = poses[-1]["pose"]["position"]
        np.testing.assert_allclose([last["x"], last["y"]], plan.poses[-1, arm, :2], atol=1e-12)


def test_joints_are_exported_for_each_arm(cableway: Command, run_folder: Path, moved_file: Path):
    plan = Plan.load(run_folder / "plan.npz")
    share = np.linspace(0, 1, len(plan.poses))[:, None, None]
    replace(plan, joints=np.ones((2, 6)) * 0.3 * share).save("arms.npz")
    done = cableway("export", "arms.npz", "--task", moved_file, "--out", "a.script")
    assert (done.status, done.err) == (0, "")
    assert "joint speed" in done.out
    for side in ("left", "right"):
        assert Path(f"a-{side}.script").read_text().count("servoj") > 12 * plan.steps
    assert cableway("export", "arms.npz", "--task", moved_file, "--out", "a.csv").status == 0
    lines = [line for line in Path("a.csv").read_text().splitlines() if not line.startswith("#")]
    assert lines[0].endswith(",right_wrist_3_joint")
    assert float(lines[-1].rsplit(",", 1)[1]) == 0.3


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("lone.npz",), "task.yaml: no such file; --task must say what lone.npz is of"),
        (("lone.npz", "--task", "maze-1"), "lone.npz: not a verified plan of the task 'maze-1': the cable and "),
        (("lone.npz", "--task", "{task}", "--rate", "0"), "the rate must be from 1 to 10000 Hz, got 0.0"),
        (
            ("lone.npz", "--task", "{task}", "--out", "a.txt"),
            "a.txt: the name of a trajectory's file must end in .csv, .json",
        ),
        (("lone.npz", "--task", "{task}", "--out", "a.csv", "--format", "ros"), "--out a.csv must end in .yaml with "),
        (("lone.npz", "--format", "rosbag"), "'rosbag'; known: csv, json, lerobot, parquet, ros, urscript"),
        (("lone.npz", "--task", "{task}", "--out", "a.script"), "needs joint positions, and the record has none"),
        ((".",), "plan.npz: no such file"),
        (("none.npz", "--task", "{task}"), "none.npz: no such file"),
        (("{task}", "--task", "{task}"), "moved.yaml: not an .npz archive"),
    ],
)
def test_what_cannot_be_exported(
    cableway: Command, run_folder: Path, moved_file: Path, arguments: tuple[str, ...], said: str
):
    Path("lone.npz").write_bytes((run_folder / "plan.npz").read_bytes())
    done = cableway("export", *(each.format(task=moved_file) for each in arguments))
    assert (done.status, done.out) == (2, "")
    assert said in done.err
    assert done.err.count("\n") == 1
    assert [path.name for path in Path().iterdir()] == ["lone.npz"]


def test_an_unverified_plan_is_exported_on_demand(cableway: Command, run_folder: Path):
    done = cableway(
        "export", run_folder / "plan.npz", "--task", "single-obstacle-2", "--unverified", "--out", "a.csv", "--quiet"
    )
    assert (done.status, done.out, done.err) == (0, "", "")
    assert '# verified: "no: ' in Path("a.csv").read_text()


def test_arms_that_files_describe_are_led_along_a_plan(cableway: Command, run_folder: Path):
    """Each arm's joints stand in the file; nothing is written where they cannot be, nor in URScript."""
    plan = Plan.load(run_folder / "plan.npz")
    done = cableway("export", run_folder, "--arms", ARMS, "--out", "two.csv")
    assert (done.status, done.err) == (0, "")
    lines = Path("two.csv").read_text().splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert len(rows) == plan.steps + 1
    assert {f"{side}_joint{k}" for side in ("left", "right") for k in range(1, 8)} <= set(rows[0])
    header = json.loads(next(line for line in lines if line.startswith("# joints: ")).removeprefix("# joints: "))
    assert header["arms"]["described"] == "two-arms"
    assert header["arms"]["models"] == ["seven-joints.xml"] * 2
    for options, fault in (
        (["--arms", ARMS, "--format", "urscript"], "URScript is for arms of Universal Robots"),
        (["--arms", "nowhere.yaml", "--out", "three.csv"], "nowhere.yaml: no such file"),
    ):
        done = cableway("export", run_folder, *options)
        assert done.status == 2
        assert fault in done.err
    done = cableway("export", run_folder / "rollout.npz", "--arms", ARMS, "--out", "three.csv")
    assert (done.status, "only a plan" in done.err) == (2, True)
    assert sorted(path.name for path in Path().glob("*.csv")) == ["two.csv"]
