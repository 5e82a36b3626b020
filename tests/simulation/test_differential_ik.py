"""Laws of arms of any kind: they lead the grippers along a plan as the closed form does, or say why they cannot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import described_arms
import numpy as np
import problems
import pytest

import cableway as cw
from cableway.core.errors import FileFormatError, InputError, PlanningError, TaskError
from cableway.geometry.se2 import wrap_angle
from cableway.records import Rollout
from cableway.robot.cell_kinematics import CellKinematics
from cableway.scene.cell import CELLS, Way
from cableway.scene.files.described_arms import load_described_arms
from cableway.simulation import differential_ik
from cableway.simulation.differential_ik import Followed, follow
from cableway.verification.described_arms import described_arm_checks
from cableway.workflow.described_arms import follow_plan

TASK = replace(problems.moved(), grippers=cw.Grippers(body="2f-85"))


@pytest.fixture(scope="module")
def plan() -> cw.Plan:
    return cw.plan(TASK)


@pytest.fixture(scope="module")
def seven(plan: cw.Plan, tmp_path_factory: pytest.TempPathFactory) -> Followed:
    arms = described_arms.two(tmp_path_factory.mktemp("seven") / "a.xml", described_arms.SEVEN, height=0.0)
    return follow_plan(plan, TASK, arms)


def failing(found: Followed, poses: np.ndarray, task: cw.Task = TASK) -> set[str]:
    checks = described_arm_checks(poses, found.joints, found.chains, found.turns, task, 0.05)
    return {check.name for check in checks if not check.passed}


@pytest.mark.parametrize("kind", ["xml", "urdf"])
def test_a_ur5e_that_a_file_describes_moves_as_the_closed_form_has_it(plan: cw.Plan, tmp_path: Path, kind: str):
    text = described_arms.ur5e_mjcf() if kind == "xml" else described_arms.ur5e_urdf()
    arms = described_arms.two(tmp_path / f"ur5e.{kind}", text)
    found = follow_plan(plan, TASK, arms)
    task = TASK.in_cell(CELLS["dual-ur5e"])
    branches = [CellKinematics(task, Way(found.holders, found.turns, (k, k))).along(plan.poses) for k in range(8)]
    off = np.abs(wrap_angle(np.array(branches) - found.joints)).max(axis=(1, 3))
    assert off.min(axis=0).max() < 0.01
    assert found.names == (("0", "1", "2", "3", "4", "5"),) * 2


def test_an_arm_with_seven_joints_passes_the_judge_and_altered_motions_do_not(plan: cw.Plan, seven: Followed):
    assert seven.joints.shape == (plan.steps + 1, 2, 7)
    assert not failing(seven, plan.poses)
    turned = seven.joints.copy()
    turned[:, 0, 6] += 0.05
    assert failing(replace(seven, joints=turned), plan.poses) == {"tool angle"}
    moved = plan.poses.copy()
    moved[5, 1, 0] += 0.002
    assert failing(seven, moved) == {"tool distance"}
    jumping = seven.joints.copy()
    jumping[7:, 1, 0] += 0.4
    assert failing(replace(seven, joints=jumping), plan.poses) >= {"tool distance", "joint speed"}
    narrow = tuple(
        replace(chain, joints=tuple(replace(joint, range=(-0.1, 0.1)) for joint in chain.joints))
        for chain in seven.chains
    )
    assert failing(replace(seven, chains=narrow), plan.poses) == {"joint position beyond its range"}


def test_the_judge_sees_what_arms_touch(plan: cw.Plan, seven: Followed):
    x, y = plan.poses[0, 0, :2]
    tall = (cw.Box(center=(x - 0.06, y), size=(0.02, 0.1), height=0.6),)
    assert "arm clearance from the table" in failing(seven, plan.poses, _among(tall))
    shifted = [replace(solid, pose=_lifted(solid.pose, -0.45)) for solid in seven.chains[0].solids]
    sunk = replace(seven.chains[0], solids=tuple(shifted))
    assert "arm clearance from the table" in failing(replace(seven, chains=(sunk, seven.chains[1])), plan.poses)
    first, further = seven.chains[0], np.zeros((4, 4))
    further[:3, 3] = 0.02 * first.tip[:3, 2]
    low = tuple(replace(each, pose=each.pose + further) if each.hand else each for each in first.solids)
    reaching = replace(first, solids=low)
    assert failing(replace(seven, chains=(reaching, seven.chains[1])), plan.poses) == {"hand clearance from the table"}
    same = replace(seven, joints=seven.joints[:, [0, 0]], chains=(seven.chains[0],) * 2)
    assert "arm clearance" in failing(same, plan.poses)


def _among(obstacles: tuple[cw.Box, ...]) -> cw.Task:
    return replace(TASK, scene=replace(TASK.scene, obstacles=obstacles), grippers=cw.Grippers())


def _lifted(pose: np.ndarray, by: float) -> np.ndarray:
    lifted = pose.copy()
    lifted[2, 3] += by
    return lifted


def test_what_arms_cannot_do_is_said(plan: cw.Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    text = described_arms.SEVEN
    monkeypatch.setattr(differential_ik, "SEEDS", 4)
    with pytest.raises(PlanningError, match="no arm reaches the start"):
        follow(plan, TASK, described_arms.two(tmp_path / "far.xml", text, apart=3.0))
    slow = described_arms.two(tmp_path / "slow.xml", text, height=0.0, speed_limit=0.1)
    messages = []
    for _ in range(2):
        with pytest.raises(PlanningError, match=r"faster than 5.7\d* degrees/s, at .*lower --speed") as refused:
            follow(plan, TASK, slow)
        messages.append(str(refused.value))
    assert messages[0] == messages[1], "the same arms come as far each time"


def test_what_no_motion_is_made_of_is_refused(plan: cw.Plan, tmp_path: Path):
    arms = described_arms.two(tmp_path / "seven.xml", described_arms.SEVEN)
    with pytest.raises(InputError, match="for the arms of the cell 'dual-ur5e'"):
        follow_plan(plan, TASK.in_cell(CELLS["dual-ur5e"]), arms)
    rollout = Rollout.__new__(Rollout)
    with pytest.raises(InputError, match="only a plan"):
        follow_plan(rollout, TASK, arms)
    lost = replace(arms, arms=tuple(replace(arm, frame="nowhere") for arm in arms.arms))
    with pytest.raises(FileFormatError, match=r"no site, body or link 'nowhere'; it has grasp, link0"):
        follow(plan, TASK, lost)
    for name, content, fault in (
        ("empty.xml", "", "no arm that MuJoCo can read"),
        ("still.xml", '<mujoco><worldbody><body name="grasp"/></worldbody></mujoco>', "no joint moves that frame"),
        ("slide.xml", _one('type="slide"'), "is no hinge"),
        ("thin.xml", _one("").replace('size="0.1"', 'size="0.1" contype="0" conaffinity="0"'), "no geoms"),
    ):
        with pytest.raises(FileFormatError, match=fault):
            follow(plan, TASK, described_arms.two(tmp_path / name, content))


def _one(kind: str) -> str:
    geom = '<geom type="sphere" size="0.1"/>'
    return f'<mujoco><worldbody><body name="grasp"><joint name="j" {kind}/>{geom}</body></worldbody></mujoco>'


def test_a_file_of_arms_says_what_is_wrong_and_where(tmp_path: Path):
    file = tmp_path / "arms.yaml"
    arm = "  - {model: a.xml, frame: grasp, position: [0.5, 0, 0], speed_limit: 2}\n"
    file.write_text(f"cableway: 1\nname: two\narms:\n{arm}{arm}")
    arms = load_described_arms(file)
    assert [each.model for each in arms.arms] == [str(tmp_path / "a.xml")] * 2
    assert arms.clearance == 0.01
    file.write_text(f"cableway: 1\nname: two\narms:\n{arm}")
    with pytest.raises(TaskError, match="must be 2 arms, got 1"):
        load_described_arms(file)
    file.write_text(f"cableway: 1\nname: two\narms:\n{arm}{arm.replace('speed_limit: 2', 'speed_limit: -2')}")
    with pytest.raises(TaskError, match=r"arms.yaml:5: arms\[1\].speed_limit"):
        load_described_arms(file)
