"""A rollout of a cable that is not the task's: its shape at the start is its own, its ends are the task's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cableway.control.open_loop import OpenLoop
from cableway.records import Rollout
from cableway.scene.task import Task
from cableway.simulation.plant import CableSimulator
from cableway.tracking import track
from cableway.verification import verify_rollout
from tests import problems
from tests.quasi_static import straight_plan, task_for


def begins_right(rollout: Rollout, task: Task, length: float | None) -> bool:
    (check,) = [check for check in verify_rollout(rollout, task, length=length).checks if "start" in check.name]
    return check.passed


@pytest.fixture(scope="module")
def rollout() -> tuple[Task, Rollout]:
    plan = straight_plan(problems.free().cable.rod)
    task = task_for(plan)
    return task, track(CableSimulator(task), OpenLoop(), plan)


def test_another_cable_may_lie_otherwise_but_not_elsewhere(rollout: tuple[Task, Rollout]):
    task, run = rollout
    bent = run.keypoints.copy()
    bent[0, 1:-1] += [0.0, 0.01]
    otherwise = replace(run, keypoints=bent)
    elsewhere = replace(run, keypoints=run.keypoints + np.array([0.02, 0.0]))
    assert begins_right(run, task, None)
    assert not begins_right(otherwise, task, None)
    assert begins_right(otherwise, task, 1.03 * task.cable.length)
    assert not begins_right(elsewhere, task, 1.03 * task.cable.length)
