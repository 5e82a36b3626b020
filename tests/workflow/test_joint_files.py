"""Laws of exported joints: every format read back is the record, or its curve, and keeps the limits of its rows."""

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
from recorded import moved_plan, perfect_rollout

from cableway.core.errors import InputError
from cableway.records import Plan
from cableway.robot.ur_arm import JOINTS
from cableway.scene.task import CONTROL_STEP
from cableway.workflow.trajectory import Trajectory

TASK, BARE = moved_plan()
SIDES = ("left", "right")
HOME = np.array([[0.1, -1.6, 1.9, -1.9, -1.57, 0.3], [3.2, -1.4, -2.0, -1.2, 1.57, -0.4]])
TURNS = np.array([[0.5, 0.3, -0.4, 0.1, 0.02, 1.2], [-0.6, 0.2, 0.5, -0.3, 0.01, -0.9]])
NUMBER = r"-?\d+(?:\.\d+)?"


def with_joints() -> Plan:
    """From rest to rest, each joint by its turn."""
    share = np.linspace(0, 1, len(BARE.poses))
    eased = 10 * share**3 - 15 * share**4 + 6 * share**5
    return replace(BARE, joints=HOME + eased[:, None, None] * TURNS)


PLAN = with_joints()
assert PLAN.joints is not None


def servo_rows(text: str) -> tuple[np.ndarray, np.ndarray]:
    """Joint positions and duration [s] of each servoj of a program."""
    found = re.findall(rf"^  servoj\(\[((?:{NUMBER}(?:, )?)+)\], 0, 0, ({NUMBER}), 0.1, 300\)$", text, re.MULTILINE)
    rows = [[float(value) for value in row.split(", ")] for row, _ in found]
    return np.array(rows), np.array([float(seconds) for _, seconds in found])


def duration(fields: dict[str, int]) -> float:
    assert set(fields) == {"sec", "nanosec"}
    assert 0 <= fields["nanosec"] < 1_000_000_000
    return fields["sec"] + fields["nanosec"] / 1e9


def read_yaml(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The message, and what stands in comments above it."""
    text = path.read_text()
    comments = [line[2:].partition(": ") for line in text.splitlines() if line.startswith("# ")]
    return yaml.safe_load(text), {name: json.loads(value) for name, _, value in comments}


@pytest.mark.parametrize("rate", [None, 40.0, 125.0])
def test_csv_and_json_have_a_column_for_each_joint(tmp_path: Path, rate: float | None):
    trajectory = Trajectory.of(PLAN, TASK, rate=rate)
    assert trajectory.joints is not None
    if rate is None:
        np.testing.assert_array_equal(trajectory.joints.positions, PLAN.joints)
    trajectory.write(tmp_path / "a.csv")
    trajectory.write(tmp_path / "a.json")
    rows = list(
        csv.DictReader(line for line in (tmp_path / "a.csv").read_text().splitlines() if not line.startswith("#"))
    )
    content = json.loads((tmp_path / "a.json").read_text())
    columns = {"": trajectory.joints.positions}
    if rate is not None:
        assert trajectory.joints.velocities is not None
        assert trajectory.joints.accelerations is not None
        columns |= {"_velocity": trajectory.joints.velocities, "_acceleration": trajectory.joints.accelerations}
    assert [name for name in rows[0] if "wrist_3" in name] == [
        f"{s}_wrist_3_joint{end}" for end in columns for s in SIDES
    ]
    for end, values in columns.items():
        for arm, side in enumerate(SIDES):
            np.testing.assert_array_equal(content[f"{side}_joints{end}"], values[:, arm])
            for joint, name in enumerate(JOINTS):
                assert [float(row[f"{side}_{name}{end}"]) for row in rows] == values[:, arm, joint].tolist()
    assert content["header"]["joints"]["names"] == list(JOINTS)


@pytest.mark.parametrize("rate", [10.0, 125.0, 500.0])
def test_the_curve_of_the_joints_keeps_the_limits_of_the_rows(rate: float):
    """And its velocities and accelerations are its derivatives, zero at both ends."""
    trajectory = Trajectory.of(PLAN, TASK, rate=rate)
    joints, times = trajectory.joints, trajectory.times
    assert joints is not None
    assert PLAN.joints is not None
    assert joints.velocities is not None
    assert joints.accelerations is not None
    padded = np.pad(PLAN.joints, ((2, 2), (0, 0), (0, 0)), mode="edge")
    for order, values in ((1, joints.velocities), (2, joints.accelerations)):
        most = np.abs(np.diff(padded, order, axis=0) / CONTROL_STEP**order).max(axis=0)
        assert (np.abs(values).max(axis=0) <= most + 1e-9).all()
        np.testing.assert_allclose(values[[0, -1]], 0.0, atol=1e-12)
        assert np.abs(values).max() > 0.7 * most.max()
    np.testing.assert_allclose(joints.positions[[0, -1]], PLAN.joints[[0, -1]], atol=1e-12)
    if rate == 500.0:
        np.testing.assert_allclose(
            np.gradient(joints.positions, times, axis=0)[1:-1], joints.velocities[1:-1], atol=2e-4
        )
        slopes = np.gradient(joints.velocities, times, axis=0)[1:-1]
        np.testing.assert_allclose(slopes, joints.accelerations[1:-1], atol=2e-2)
    reached = trajectory.header["joints"]["reached"]
    assert reached["speed"] <= np.abs(np.diff(PLAN.joints, axis=0)).max() / CONTROL_STEP + 1e-9
    np.testing.assert_allclose(reached["speed"], np.abs(joints.velocities).max(), rtol=0.05)


@pytest.mark.parametrize("rate", [125.0, 250.0, 500.0])
def test_programs_of_the_arms_are_the_rows_in_time(tmp_path: Path, rate: float):
    trajectory = Trajectory.of(PLAN, TASK, rate=rate)
    assert trajectory.joints is not None
    written = trajectory.write(tmp_path / "a.script")
    assert [path.name for path in written] == ["a-left.script", "a-right.script"]
    for arm, (side, path) in enumerate(zip(SIDES, written, strict=True)):
        text, wanted = path.read_text(), trajectory.joints.positions[:, arm]
        rows, seconds = servo_rows(text)
        assert text.count("servoj(") == len(rows) == len(wanted) + 1
        np.testing.assert_allclose(rows[:-1], wanted, atol=1e-9)
        np.testing.assert_array_equal(rows[-1], rows[-2])
        np.testing.assert_allclose(np.cumsum(seconds[:-1]) - seconds[0], trajectory.times, atol=1e-9)
        starts = re.findall(r"^  start = \[(.*)\]$", text, re.MULTILINE)
        np.testing.assert_allclose([float(value) for value in starts[0].split(", ")], wanted[0], atol=1e-9)
        program = [line.strip() for line in text.splitlines() if not line.startswith("#")]
        first = next(place for place, line in enumerate(program) if line.startswith("servoj"))
        assert program[0] == f"def cableway_{side}():"
        assert program[-2:] == ["stopj(2.0)", "end"]
        assert program[first - 4].startswith("if away(get_actual_joint_positions(), start) > ")
        assert program[first - 3].startswith(f'popup("The {side} arm is not at the start of its program.')
        assert program[first - 2 : first] == ["halt", "end"]
        opened = sum(line.endswith(":") for line in program)
        assert opened == program.count("end"), "each def, if and while has its end"


@pytest.mark.parametrize("rate", [10.0, 37.0, 125.0])
def test_messages_of_ros_are_the_curve(tmp_path: Path, rate: float):
    trajectory = Trajectory.of(PLAN, TASK, rate=rate)
    joints = trajectory.joints
    assert joints is not None
    for arm, path in enumerate(trajectory.write(tmp_path / "a.yaml")):
        content, header = read_yaml(path)
        assert header["message"] == "trajectory_msgs/msg/JointTrajectory"
        assert list(content) == ["header", "joint_names", "points"]
        assert content["joint_names"] == [f"{SIDES[arm]}_{name}" for name in JOINTS]
        points = content["points"]
        stamps = np.array([duration(point["time_from_start"]) for point in points])
        np.testing.assert_allclose(stamps, trajectory.times, atol=1e-9)
        assert (np.diff(stamps) > 0).all()
        for field in ("positions", "velocities", "accelerations"):
            values = getattr(joints, field)[:, arm]
            np.testing.assert_array_equal([point[field] for point in points], values)
            assert all(isinstance(value, float) for point in points for value in point[field])
        np.testing.assert_allclose(points[-1]["velocities"], 0.0, atol=1e-12)


def test_quintic_splines_through_a_row_per_control_step_are_the_curve_itself():
    """What a joint_trajectory_controller does between the points, by the six conditions at the ends of a segment."""
    coarse, fine = Trajectory.of(PLAN, TASK, rate=10), Trajectory.of(PLAN, TASK, rate=100)
    assert coarse.joints is not None
    assert fine.joints is not None
    powers = np.arange(6)
    t = CONTROL_STEP

    def row(at: float, order: int) -> np.ndarray:
        factors = np.array([np.prod([p - k for k in range(order)]) for p in powers])
        return factors * at ** np.clip(powers - order, 0, None) * (powers >= order)

    system = np.stack([row(at, order) for at in (0.0, t) for order in range(3)])
    sides = [coarse.joints.positions, coarse.joints.velocities, coarse.joints.accelerations]
    for k in range(len(coarse.times) - 1):
        ends = np.stack([values[k + at].ravel() for at in (0, 1) for values in sides if values is not None])
        weights = np.linalg.solve(system, ends)
        between = np.stack([row(0.01 * m, 0) for m in range(11)]) @ weights
        np.testing.assert_allclose(between, fine.joints.positions[10 * k : 10 * k + 11].reshape(11, -1), atol=1e-9)


def test_without_joints_ros_gets_a_path_of_each_gripper(tmp_path: Path):
    for rate in (None, 30.0):
        trajectory = Trajectory.of(BARE, TASK, rate=rate)
        for arm, path in enumerate(trajectory.write(tmp_path / "a.yaml")):
            content, header = read_yaml(path)
            assert header["message"] == "nav_msgs/msg/Path"
            assert list(content) == ["header", "poses"]
            assert {content["header"]["frame_id"], *(each["header"]["frame_id"] for each in content["poses"])} == {
                "table"
            }
            stamps = [duration(each["header"]["stamp"]) for each in content["poses"]]
            np.testing.assert_allclose(stamps, trajectory.times, atol=1e-9)
            places = [list(each["pose"]["position"].values()) for each in content["poses"]]
            np.testing.assert_array_equal(np.array(places)[:, :2], trajectory.poses[:, arm, :2])
            turns = np.array([list(each["pose"]["orientation"].values()) for each in content["poses"]])
            np.testing.assert_allclose(np.linalg.norm(turns, axis=1), 1.0)
            angles = np.unwrap(2 * np.arctan2(turns[:, 2], turns[:, 3]))
            np.testing.assert_allclose(np.cos(angles - trajectory.poses[:, arm, 2]), 1.0)
            assert not turns[:, :2].any()


def test_joints_of_a_rollout_are_exported_as_well(tmp_path: Path):
    rollout = replace(perfect_rollout(TASK, PLAN), joints=PLAN.joints)
    mine, planned = (Trajectory.of(record, TASK, rate=125).joints for record in (rollout, PLAN))
    assert mine is not None
    assert planned is not None
    for field in ("positions", "velocities", "accelerations"):
        np.testing.assert_allclose(getattr(mine, field), getattr(planned, field), atol=1e-9)


def test_what_no_arm_can_do_is_refused(tmp_path: Path):
    far = with_joints()
    assert far.joints is not None
    four = replace(far, joints=far.joints[..., :4])
    beyond = replace(far, joints=far.joints + 5.0)
    jump = np.where(np.arange(len(far.joints)) < 30, 0.0, 1.0)
    fast = replace(far, joints=far.joints + jump[:, None, None])
    cases = [
        (BARE, 125.0, "a.script", "needs joint positions, and the record has none"),
        (PLAN, None, "a.script", "must be 125, 250 or 500 Hz, got none"),
        (PLAN, 100.0, "a.script", "must be 125, 250 or 500 Hz, got 100"),
        (four, 125.0, "a.script", "needs 6 joints an arm, and the record has 4"),
        (beyond, 125.0, "a.script", "left arm would have to turn its elbow_joint to 395 degrees, limit 157 degrees"),
        (
            fast,
            125.0,
            "a.script",
            "_joint of the left arm turns at .* degrees/s, and that of a UR5e reaches 180 degrees/s",
        ),
        (PLAN, None, "a.yaml", "only a curve has these: give a rate"),
    ]
    for record, rate, name, said in cases:
        with pytest.raises(InputError, match=said):
            Trajectory.of(record, TASK, rate=rate).write(tmp_path / name)
    assert list(tmp_path.iterdir()) == []
    assert Trajectory.of(four, TASK, rate=10).write(tmp_path / "b.yaml")
    assert read_yaml(tmp_path / "b-left.yaml")[0]["joint_names"][0] == "left_joint_1"
