"""Rollouts of plants that differ from the task are accepted, as they are and from a file; the margins are wide."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cableway.control.open_loop import OpenLoop
from cableway.core.errors import InputError
from cableway.planning.planner import plan
from cableway.records import Check, Plan, Rollout, Verdict
from cableway.scene.files.loading import load_task
from cableway.scene.task import Task
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.perturbations.sensing import SensingConfig
from cableway.simulation.perturbations.variants import named_perturbation
from cableway.simulation.table_plant import TableConfig
from cableway.tracking import track
from cableway.verification import verify_record

PLANTS = {
    name: named_perturbation(name, load_task("single-obstacle-2"))
    for name in ("nominal", "tau-0.05", "tau-1.5", "friction", "long-1", "short-1", "grasp", "graded", "half-curved")
} | {
    "obstacles-moved": Perturbation(obstacles=((0.004, 0.003),)),
    "late": Perturbation(sensing=SensingConfig(action_delay=0.3)),
    "table": Perturbation(table=TableConfig(friction=0.3, segments=20, time_step=0.005)),
}
HALF = "gripper step", "gripper turn", "shape error at the end", "distance to start", "time between rows"
"""Checks of limits that true rollouts may use up."""


@pytest.fixture(scope="module")
def task() -> Task:
    return load_task("single-obstacle-2")


@pytest.fixture(scope="module")
def found(task: Task) -> Plan:
    return plan(task, seed=0)


@pytest.mark.parametrize("name", PLANTS)
def test_a_true_rollout_is_accepted(task: Task, found: Plan, name: str, tmp_path: Path):
    """By wide margins; what a file says of its plant is enough to judge it by the task alone."""
    perturbation = PLANTS[name]
    run = track(perturbation.build(task), OpenLoop(), found)
    replace(run, metadata={**run.metadata, "plant": perturbation.as_dict(task)}).save(tmp_path / "rollout.npz")
    read = Rollout.load(tmp_path / "rollout.npz")
    verdict = verify_record(read, task)
    assert verdict.passed, str(verdict)
    assert all(check.value <= check.limit / 2 for check in upper(verdict) if check.name not in HALF)


def test_obstacles_are_where_the_record_has_them(task: Task, found: Plan):
    run = track(Perturbation().build(task), OpenLoop(), found)
    for name, stated in (("obstacles", [[0.08, 0.0]]), ("pegs", [[*task.goal[6], 0.003]])):
        moved = replace(run, metadata={**run.metadata, "plant": {name: stated}})
        assert "cable clearance" in {check.name for check in verify_record(moved, task).failures()}
    with pytest.raises(InputError, match=r"plant\.obstacles and plant\.pegs do not fit the task"):
        verify_record(replace(run, metadata={"plant": {"obstacles": [[0.0, 0.0]] * 2}}), task)


def upper(verdict: Verdict) -> list[Check]:
    """The checks with a largest value."""
    return [check for check in verdict.checks if check.limit > 0 and check.name != "gripper separation"]


def test_wrapped_angles_and_whole_turns_are_the_same_poses(task: Task, found: Plan):
    """Of a robot that reports its angles between -pi and pi, or off by whole turns."""
    run = track(Perturbation().build(task), OpenLoop(), found)
    for angles in (np.angle(np.exp(1j * (run.poses[..., 2] + 2.5))) - 2.5, run.poses[..., 2] + 4 * np.pi):
        poses = np.concatenate([run.poses[..., :2], angles[..., None]], axis=2)
        assert verify_record(replace(run, poses=poses), task).passed
