"""Laws of approach and retreat: open hands straight above the ends of the cable, the judge, and what is exported."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import cableway as cw
from cableway.core.errors import InputError
from cableway.robot.branches import ArmMotion
from cableway.robot.cell_kinematics import CellKinematics
from cableway.robot.grasping import CLOSING, RISE, hand_bodies, hands_clearance, with_hands
from cableway.scene.arm_models import UR5E
from cableway.scene.cell import Way
from cableway.scene.gripper_bodies import OPENINGS
from cableway.scene.obstacles import Disc
from cableway.scene.task import CONTROL_STEP
from cableway.verification.hands import hand_checks
from cableway.workflow.find import _without_hands
from cableway.workflow.trajectory import Trajectory

TASK = cw.random_task(6, "cell")
PLAN = cw.plan(TASK, seed=0)
SIDES = ("left", "right")


def way() -> Way:
    found = Way.of_record(PLAN.metadata)
    assert found is not None
    return found


def failed(plan: cw.Plan, task: cw.Task = TASK) -> set[str]:
    return {check.name for check in hand_checks(plan, task) if not check.passed}


def beside(gap: float, row: int = 0) -> cw.Task:
    """The task with a post that the left hand, its fingers 50 mm apart, comes so near to [m] in a row of the plan."""
    assert TASK.cell is not None
    outer = max(body.outline[:, 1].max() for body in hand_bodies(TASK.cell, 0.05) if body.heights[0] < 0.04)
    pose, radius = PLAN.poses[row, 0], 0.004
    aside = (outer + radius + gap) * np.array([-np.sin(pose[2]), np.cos(pose[2])])
    post = Disc(center=tuple((pose[:2] + aside).tolist()), radius=radius, height=0.04)
    return TASK.in_scene(replace(TASK.scene, obstacles=(*TASK.scene.obstacles, post)))


def again(task: cw.Task) -> cw.Plan:
    assert PLAN.joints is not None
    return with_hands(PLAN, ArmMotion(PLAN.joints, way(), 0.0), task)


def test_hands_come_down_from_above_and_go_up_again_straight_and_from_rest_to_rest():
    arms = CellKinematics(TASK, way())
    assert PLAN.joints is not None
    for rows, row in ((PLAN.approach, 0), (PLAN.retreat, -1)):
        assert rows is not None
        down = rows if row == 0 else rows[::-1]
        np.testing.assert_array_equal(down[-1], PLAN.joints[row])
        heights = arms.heights(down)
        np.testing.assert_allclose(heights[[0, -1]], TASK.cable.radius + np.array([[RISE], [0.0]]) * [1, 1], atol=1e-9)
        assert (np.diff(heights, axis=0) < 0).all()
        seen = np.array([arms.poses(each) for each in down])
        np.testing.assert_allclose(
            seen[..., :2], np.broadcast_to(PLAN.poses[row, :, :2], seen[..., :2].shape), atol=1e-9
        )
        steps = np.abs(np.diff(down, axis=0, prepend=down[:1], append=down[-1:]))
        assert steps[[1, -2]].max() < 0.2 * steps.max(), "slow at both ends"
    assert cw.verify_plan(PLAN, TASK).passed
    assert failed(PLAN) == set()
    assert {check.where for check in hand_checks(PLAN, TASK)} >= {"the approach", "the retreat"}


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (lambda plan: {"approach": plan.approach[:-1]}, "open hands"),
        (lambda plan: {"approach": plan.retreat}, "open hands"),
        (lambda plan: {"approach": plan.approach[-1:].repeat(3, axis=0)}, "open hands"),
        (lambda plan: {"retreat": plan.retreat[:4]}, "open hands"),
        (lambda plan: {"joints": None}, "open hands"),
        (lambda plan: {"metadata": {}}, "open hands"),
        (lambda plan: {"metadata": {"arms": plan.metadata["arms"] | {"opening": [0.01, 0.05]}}}, "open hands"),
        (lambda plan: {"approach": plan.approach[[0, -1]]}, "joint acceleration"),
        (lambda plan: {"approach": plan.approach[[0, -1]]}, "tool distance"),
        (lambda plan: {"approach": np.vstack([plan.approach[:1] + np.eye(6)[5], plan.approach])}, "tool angle"),
        (lambda plan: {"approach": np.vstack([plan.approach[:1] + 2 * np.pi, plan.approach])}, "joint speed"),
    ],
)  # fmt: skip
def test_the_judge_refuses_what_does_not_lead_straight_to_the_cable(change, name: str):
    assert name in failed(replace(PLAN, **change(PLAN)))


def test_the_judge_finds_what_an_open_hand_touches_and_a_closed_one_does_not():
    assert failed(PLAN, beside(0.006)) == set()
    assert failed(PLAN, beside(0.002)) == {"open hand clearance"}
    (check,) = (each for each in hand_checks(PLAN, beside(0.002)) if not each.passed)
    assert str(check).startswith("the open hand of the left gripper and obstacle")
    assert "are 2.0 mm apart" in str(check)
    assert "open hand clearance" in failed(PLAN, beside(0.002, row=-1))


def test_planner_and_judge_measure_the_same_clearance_of_open_hands():
    for index, row in enumerate((0, -1)):
        opening = PLAN.metadata["arms"]["opening"][index]
        lines = TASK.cable.rod.shapes(PLAN.q[[row]])[0]
        room, apart = hands_clearance(PLAN.poses[[row]], lines, opening, TASK)
        checks = [each for each in hand_checks(PLAN, TASK) if each.name == "open hand clearance"]
        assert checks[index].value == pytest.approx(min(room.min(), apart.min()), abs=2e-4)


def test_hands_open_as_wide_as_there_is_room_and_it_is_said_where_there_is_none():
    assert again(TASK).metadata["arms"]["opening"] == [OPENINGS[0]] * 2
    narrow = again(beside(0.002))
    assert narrow.metadata["arms"]["opening"] == [OPENINGS[1], OPENINGS[0]]
    assert failed(narrow, beside(0.002)) == set()
    none = again(beside(-0.013, row=-1))
    assert none.retreat is None
    assert none.approach is not None
    (said,) = _without_hands(none)
    x, y = PLAN.poses[-1, 0, :2]
    assert re.fullmatch(
        rf"The plan has no retreat: at the goal, the open hand of the left gripper comes .* an obstacle or the cable "
        rf"at \({x:.3f}, {y:.3f}\) m\.",
        said,
    )
    assert _without_hands(PLAN) == ()


def test_links_may_not_touch_anything_as_the_hands_come_down():
    """A post under the first wrist, beside the hand, that the arm is over when its hand is down."""
    assert PLAN.approach is not None
    arms = CellKinematics(TASK, way())
    (ends, radius), _ = arms.links(PLAN.approach[-1:])
    wrist = next(k for k, each in enumerate(UR5E.capsules) if each.frame == 4)
    low = int(ends[0, wrist, :, 2].argmin())
    height = float(ends[0, wrist, low, 2] - radius[wrist] - 0.002)
    post = Disc(center=tuple(ends[0, wrist, low, :2].tolist()), radius=0.005, height=height)
    task = TASK.in_scene(replace(TASK.scene, obstacles=(post,)))
    none = again(task)
    assert none.approach is None
    assert "links come " in none.metadata["arms"]["no_approach"]
    assert "arm clearance from the table" in failed(PLAN, task)


def test_a_plan_keeps_its_approach_and_retreat_in_a_file(tmp_path: Path):
    PLAN.save(tmp_path / "plan.npz")
    read = cw.Plan.load(tmp_path / "plan.npz")
    np.testing.assert_array_equal(read.approach, PLAN.approach)
    np.testing.assert_array_equal(read.retreat, PLAN.retreat)
    assert failed(read) == set()


@pytest.mark.parametrize("rate", [None, 40.0])
def test_exported_hands_come_down_close_carry_open_and_go_up(rate: float | None, tmp_path: Path):
    trajectory = Trajectory.of(PLAN, TASK, rate=rate, cable=True)
    step = CONTROL_STEP if rate is None else 1 / rate
    for path in (tmp_path / "a.csv", tmp_path / "a.json"):
        trajectory.write(path)
    lines = (tmp_path / "a.csv").read_text().splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    columns = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    content = json.loads((tmp_path / "a.json").read_text())
    np.testing.assert_allclose(np.diff(columns["time"]), step, atol=1e-9)
    (begin, end), commands = content["header"]["hands"]["plan"], content["header"]["hands"]["commands"]
    assert [each["opening"] for each in commands] == [0.05, 0.0, 0.05]
    assert begin - commands[1]["time"] == pytest.approx(CLOSING - step, abs=step / 2)
    assert commands[2]["time"] == pytest.approx(end + step)
    carried = (columns["time"] >= begin - 1e-9) & (columns["time"] <= end + 1e-9)
    alone = Trajectory.of(replace(PLAN, approach=None, retreat=None), TASK, rate=rate, unverified=True)
    assert alone.hands is None
    for side in SIDES:
        np.testing.assert_array_equal(content[f"{side}_height"], columns[f"{side}_height"])
        np.testing.assert_array_equal(content[f"{side}_opening"], columns[f"{side}_opening"])
        assert (columns[f"{side}_opening"][carried] == 0).all()
        np.testing.assert_allclose(columns[f"{side}_height"][carried], TASK.cable.radius, atol=1e-3)
        np.testing.assert_allclose(columns[f"{side}_height"][[0, -1]], TASK.cable.radius + RISE, atol=1e-9)
        down = columns["time"] < commands[1]["time"]
        assert np.ptp(columns[f"{side}_height"][~down & ~carried & (columns["time"] < begin)]) < 1e-9, "they stand"
        joints = np.array(
            [[columns[f"{side}_{name}"] for name in trajectory.joints.names[arm]] for arm, side in enumerate(SIDES)]
        )
    np.testing.assert_array_equal(joints.transpose(2, 0, 1)[carried], alone.joints.positions)
    np.testing.assert_array_equal(trajectory.poses[carried], alone.poses)
    assert np.abs(np.diff(joints, axis=2)).max() / step < 3.2, "no jump where the parts meet"


def test_programs_and_messages_have_commands_for_the_hands(tmp_path: Path):
    trajectory = Trajectory.of(PLAN, TASK, rate=125, unverified=True)
    commands = trajectory.header["hands"]["commands"]
    for path in trajectory.write(tmp_path / "a.script"):
        program = [line.strip() for line in path.read_text().splitlines() if not line.startswith("#")]
        moves = [k for k, line in enumerate(program) if line.startswith("servoj")]
        asked = {k: int(re.findall(r"\d+", line)[0]) for k, line in enumerate(program) if '"POS"' in line}
        assert list(asked.values()) == [105, 255, 105]
        first, *later = asked
        assert first < moves[0], "open before the arm moves"
        for each, command in zip(later, commands[1:], strict=True):
            assert sum(move < each for move in moves) == round(125 * command["time"])
    written = Trajectory.of(PLAN, TASK, rate=10, unverified=True).write(tmp_path / "a.yaml")
    names = ["a-left", "a-right", "a-left-gripper", "a-right-gripper"]
    assert [path.name for path in written] == [f"{name}.yaml" for name in names]
    message: dict[str, Any] = yaml.safe_load(written[2].read_text())
    assert message["joint_names"] == ["left_robotiq_85_left_knuckle_joint"]
    angles = [point["positions"][0] for point in message["points"]]
    assert angles == pytest.approx([0.3265, 0.3265, 0.7929, 0.7929, 0.3265], abs=1e-4)
    times = [point["time_from_start"]["sec"] + point["time_from_start"]["nanosec"] / 1e9 for point in message["points"]]
    assert times == sorted(times)
    assert times[2] - times[1] == pytest.approx(CLOSING)


@pytest.mark.parametrize("ending", ["script", "yaml"])
def test_commands_of_a_2f_85_are_not_sent_to_other_hands(ending: str, tmp_path: Path):
    trajectory = Trajectory.of(PLAN, TASK, rate=125, unverified=True)
    hands = {**trajectory.header["hands"], "tool": "hand-e"}
    other = replace(trajectory, header={**trajectory.header, "hands": hands})
    with pytest.raises(InputError, match=r"of a 2F-85 only, and the cell's tool is hand-e; CSV and JSON"):
        other.write(tmp_path / f"a.{ending}")
    assert not list(tmp_path.iterdir())
    assert len(other.write(tmp_path / "a.json")) == 1
