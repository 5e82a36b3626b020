"""Laws of exported trajectories: limits by differences, ends, what files hold, and what is not exported."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded import moved_plan, perfect_rollout

import cableway as cw
from cableway.core.errors import InputError
from cableway.records import Plan
from cableway.scene.grippers import Grippers
from cableway.scene.task import CONTROL_STEP, Task
from cableway.workflow.trajectory import Trajectory, greatest_rates, limits_of

TASK, PLAN = moved_plan()
RAMPS = {"max_acceleration": 0.4, "max_turn_acceleration": 3.0, "max_jerk": 4.0, "max_turn_jerk": 30.0}


@pytest.fixture(scope="module")
def ramped() -> tuple[Task, Plan]:
    """A task that limits acceleration and jerk, and a plan of it."""
    task = replace(cw.load_task("single-obstacle-2"), grippers=Grippers(**RAMPS))
    return task, cw.plan(task)


def differences(times: np.ndarray, poses: np.ndarray, order: int) -> tuple[float, float]:
    """Greatest of the differences of an order, of position and angle, from rest to rest."""
    padded = np.pad(poses, ((order, order), (0, 0), (0, 0)), mode="edge")
    found = np.diff(padded, order, axis=0) / (times[1] - times[0]) ** order
    return np.linalg.norm(found[..., :2], axis=-1).max(), np.abs(found[..., 2]).max()


@pytest.mark.parametrize("rate", [None, 10.0, 62.5, 500.0])
def test_limits_are_kept_at_every_rate(ramped: tuple[Task, Plan], rate: float | None):
    task, plan = ramped
    trajectory = Trajectory.of(plan, task, rate=rate)
    limits, reached = limits_of(task.grippers), trajectory.header["reached"]
    for order, name in enumerate(("speed", "acceleration", "jerk"), start=1):
        turn = "turn_rate" if order == 1 else f"turn_{name}"
        for each, value in zip((name, turn), differences(trajectory.times, trajectory.poses, order), strict=True):
            assert reached[each] == pytest.approx(value, rel=1e-6)
            assert value <= limits[each] * (1 + 1e-6)


def test_a_given_plan_at_a_share_of_the_speed_keeps_ramps(ramped: tuple[Task, Plan]):
    """As it is, and without rod coordinates."""
    task, plan = ramped
    for given in (plan, replace(plan, q=None)):
        run = cw.solve(task, cw.SolveOptions(plan=given, speed=0.3, track=False))
        assert run.success, run.report.failure
        assert run.plan is not None
        assert run.plan.steps > 2 * plan.steps


@pytest.mark.parametrize("rate", [20.0, 130.0, 1000.0])
def test_the_curve_begins_and_ends_in_the_plan_and_is_as_near_to_its_rows_as_it_says(rate: float):
    trajectory = Trajectory.of(PLAN, TASK, rate=rate, cable=True)
    assert trajectory.shapes is not None
    np.testing.assert_allclose(trajectory.poses[[0, -1]], PLAN.poses[[0, -1]], atol=1e-12)
    np.testing.assert_allclose(trajectory.shapes[[0, -1]], PLAN.shapes[[0, -1]], atol=1e-12)
    np.testing.assert_allclose(np.diff(trajectory.times), 1 / rate)
    assert 0 <= trajectory.times[-1] - CONTROL_STEP * (PLAN.steps + 2) < 1 / rate
    rows = CONTROL_STEP * (np.arange(len(PLAN.poses)) + 1)
    there = np.stack([np.interp(rows, trajectory.times, column) for column in trajectory.poses.reshape(-1, 6).T], 1)
    apart = np.linalg.norm((there.reshape(-1, 2, 3) - PLAN.poses)[..., :2], axis=-1).max()
    said = trajectory.header["off_rows"]["distance"]
    assert said < 2e-3
    assert apart <= said + 0.125 * trajectory.header["reached"]["acceleration"] / rate**2


def test_rows_without_a_rate_are_those_of_the_record():
    for record in (PLAN, perfect_rollout(TASK, PLAN)):
        trajectory = Trajectory.of(record, TASK)
        np.testing.assert_array_equal(trajectory.poses, PLAN.poses)
        np.testing.assert_allclose(trajectory.times, CONTROL_STEP * np.arange(len(PLAN.poses)))
        assert trajectory.shapes is None
        assert trajectory.header["verified"] == "the rows"
    curved = Trajectory.of(perfect_rollout(TASK, PLAN), TASK, rate=50)
    np.testing.assert_allclose(curved.poses, Trajectory.of(PLAN, TASK, rate=50).poses, atol=1e-9)


def test_angles_run_on_whatever_turns_a_robot_reports():
    rollout = perfect_rollout(TASK, PLAN)
    poses = rollout.poses.copy()
    poses[20:, 1, 2] -= 2 * np.pi
    turned = Trajectory.of(replace(rollout, poses=poses), TASK)
    np.testing.assert_allclose(turned.poses, rollout.poses, atol=1e-12)


def test_csv_holds_it_all(tmp_path: Path):
    trajectory = Trajectory.of(PLAN, TASK, rate=100, cable=True)
    trajectory.write(tmp_path / "a.csv")
    lines = (tmp_path / "a.csv").read_text().splitlines()
    comments = [line[2:].partition(": ") for line in lines if line.startswith("# ")]
    assert {name: json.loads(value) for name, _, value in comments} == trajectory.header
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert list(rows[0])[:8] == ["time", "left_x", "left_y", "left_theta", "right_x", "right_y", "right_theta", "x0"]
    assert [float(row["time"]) for row in rows] == trajectory.times.tolist()
    assert [float(row["right_theta"]) for row in rows] == trajectory.poses[:, 1, 2].tolist()
    assert trajectory.shapes is not None
    assert [float(row["y12"]) for row in rows] == trajectory.shapes[:, 12, 1].tolist()


def test_json_holds_the_same(tmp_path: Path):
    trajectory = Trajectory.of(PLAN, TASK, rate=100, cable=True)
    trajectory.write(tmp_path / "a.json")
    content = json.loads((tmp_path / "a.json").read_text())
    assert content["header"] == trajectory.header
    np.testing.assert_array_equal(np.stack([content["left"], content["right"]], axis=1), trajectory.poses)
    np.testing.assert_array_equal(content["cable"], trajectory.shapes)
    assert content["time"] == trajectory.times.tolist()


def test_the_header_says_what_a_robot_needs_to_know():
    header = Trajectory.of(PLAN, TASK, source="plan-2.npz").header
    assert header["task"] == "moved"
    assert header["source"] == {"kind": "plan", "file": "plan-2.npz", "seed": 7}
    assert header["units"] == {"time": "s", "x": "m", "y": "m", "theta": "rad"}
    assert header["grippers"]["right"] == "holds keypoint 12"
    for name, words in (("frame", "y up"), ("tool_point", "tangent"), ("use", "open loop"), ("format", "trajectory 1")):
        assert words in header[name]


def test_what_does_not_verify_is_exported_only_on_demand():
    far = replace(PLAN, shapes=PLAN.shapes[::3], poses=PLAN.poses[::3], stages=None)
    fast = replace(TASK, grippers=Grippers(max_step=0.001))
    with pytest.raises(InputError, match=r"^x.npz: not a verified plan of the task 'moved': a gripper moves .*limit"):
        Trajectory.of(far, fast, source="x.npz")
    assert Trajectory.of(far, fast, rate=20, unverified=True).header["verified"].startswith("no: a gripper moves")


def test_what_cannot_be_exported_is_refused(tmp_path: Path):
    for rate in (0.0, -5.0, np.nan, np.inf, 1e6):
        with pytest.raises(InputError, match="the rate must be from 1 to 10000 Hz"):
            Trajectory.of(PLAN, TASK, rate=rate)
    rollout = perfect_rollout(TASK, PLAN)
    uneven = replace(rollout, times=rollout.times + 0.01 * np.sin(np.arange(len(rollout.times))))
    with pytest.raises(InputError, match="CSV and JSON take them as they are, without a rate"):
        Trajectory.of(uneven, TASK, rate=100)
    assert np.diff(Trajectory.of(uneven, TASK).times).std() > 0
    still = replace(rollout, times=np.zeros_like(rollout.times))
    with pytest.raises(InputError, match="each later than the one before"):
        Trajectory.of(still, TASK, unverified=True)
    with pytest.raises(InputError, match=r"a.txt: .* must end in .csv, .json, .script or .yaml"):
        Trajectory.of(PLAN, TASK).write(tmp_path / "a.txt")
    assert list(tmp_path.iterdir()) == []


def test_rates_of_a_motion_that_is_known():
    """A second at 0.1 m/s: it starts and stops within one row."""
    times = np.linspace(0, 1, 11)
    poses = np.zeros((11, 2, 3))
    poses[:, 0, 0] = 0.1 * times
    found = greatest_rates(times, poses)
    assert found["speed"] == pytest.approx(0.1)
    assert found["acceleration"] == pytest.approx(1.0)
    assert found["turn_rate"] == 0.0
