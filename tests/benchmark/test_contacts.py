"""What counts as a contact that no controller could have avoided."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cableway.benchmark.contacts import is_unavoidable
from cableway.benchmark.episode import Result
from cableway.metrics import METRICS
from cableway.records import Rollout
from cableway.scene.files.loading import load_task
from cableway.scene.obstacles import Disc

TASK = load_task("multi-obstacle-1")
ROWS = 100


def touching(*times: float) -> Rollout:
    """A rollout at rest at the start that touches something at these times [s]."""
    poses = TASK.cable.rod.shapes(TASK.start_equilibrium[None])[1][0]
    clearance = np.full(ROWS + 1, 0.01)
    clearance[[round(10 * time) for time in times]] = -1e-4
    still, step = np.repeat(TASK.start[None], ROWS + 1, axis=0), np.zeros(ROWS)
    return Rollout(
        times=0.1 * np.arange(ROWS + 1), keypoints=still, observed=still, centreline=still,
        poses=np.repeat(poses[None], ROWS + 1, axis=0),
        actions=np.zeros((ROWS, 2, 3)), reference=still, solve_time=step, status=step.astype(str),
        clearance=clearance, gripper_clearance=np.full(ROWS + 1, 0.01),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("times", "revealed", "unavoidable"),
    [
        ((), None, False),
        ((2.0, 2.1, 4.0), None, True),
        ((2.0, 2.1, 4.0), 2.5, True),
        ((2.0,), 1.0, False),
        ((2.0, 6.0), None, False),
        (tuple(np.arange(2.0, 5.5, 0.1)), None, False),
    ],
    ids=["none", "unknown", "known meanwhile", "known before", "again", "not left"],
)
def test_only_the_first_touch_of_something_unknown_is_unavoidable(
    times: tuple[float, ...], revealed: float | None, unavoidable: bool
) -> None:
    assert is_unavoidable(touching(*times), TASK, revealed) is unavoidable


@pytest.mark.parametrize(
    ("since", "unavoidable"),
    [(2.0, False), (2.2, True), (2.3, False), (1.9, False)],
    ids=["at once", "0.2 s later", "0.3 s later", "before"],
)
def test_what_the_planner_knew_is_avoidable_unless_nobody_could_stop_any_more(since: float, unavoidable: bool) -> None:
    """The cable lies on a known peg from then on, and touches something unknown from 2 s to 3 s."""
    middle = TASK.start[len(TASK.start) // 2]
    peg = Disc(center=(float(middle[0]), float(middle[1]) - 0.1), radius=0.005)
    known = TASK.in_scene(replace(TASK.scene, obstacles=(*TASK.scene.obstacles, peg)))
    rollout = touching(*np.arange(2.0, 3.0, 0.1))
    lines = rollout.centreline + np.array([0.0, -0.1]) * (rollout.times >= since - 1e-9)[:, None, None]
    clearance = np.where(rollout.times >= since - 1e-9, -1e-4, rollout.clearance)
    clearance[rollout.times > 3.05] = 0.01
    moved = replace(rollout, centreline=lines, clearance=clearance)
    assert is_unavoidable(moved, known, None) is unavoidable


def test_what_is_said_of_it() -> None:
    def values(**given: bool | None) -> tuple[bool | None, bool | None]:
        row = Result(suite="faults", episode="", method="", task="", plant="", seed=0, digest="", made_by="",
                     outcome="", **given)  # fmt: skip
        return METRICS["avoidable_contact"].value(row), METRICS["survived"].value(row)

    assert values(contact=True, unavoidable=True) == (False, None)
    assert values(contact=True, unavoidable=False) == (True, False)
    assert values(success=True, unavoidable=False) == (False, True)
    assert values(success=True, unavoidable=None) == (None, None)
