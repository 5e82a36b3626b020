"""How the grippers stop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recorded import moved_plan, perfect_rollout

from cableway.commands import stopping_time
from cableway.records import Rollout
from cableway.tracking.loop import WAITING


def stopped(sent: list[float], moved: list[float]) -> Rollout:
    """The left gripper is sent, and goes, so many millimetres in each control step."""
    rollout = perfect_rollout(*moved_plan(len(sent) + 1))
    actions, poses = np.zeros((len(sent), 2, 3)), np.repeat(rollout.poses[:1], len(sent) + 1, axis=0)
    actions[:, 0, 0] = np.multiply(sent, 1e-3)
    poses[1:, 0, 0] += np.cumsum(moved) * 1e-3
    return replace(rollout, actions=actions, poses=poses)


@pytest.mark.parametrize(
    ("sent", "moved", "seconds"),
    [
        ([5, 5, 5, 5], [5, 5, 5, 5], None),
        ([5, 0, 0, 5, 0], [5, 5, 5, 5, 5], None),  # too short for a stop
        ([5, 0, 0, 0, 0, 5], [5, 0, 0, 0, 0, 5], 0.0),
        ([5, 5, 0, 0, 0, 0], [4, 5, 2, 1, 0.3, 0], 0.2),
        ([5, 0, 0, 0, 5, 0, 0, 0], [5, 1, 0, 0, 5, 3, 2, 1], 0.3),  # the longest, and never at rest
    ],
)
def test_time_from_a_stop_to_rest(sent: list[float], moved: list[float], seconds: float | None) -> None:
    assert stopping_time(stopped(sent, moved)) == (None if seconds is None else pytest.approx(seconds))


def test_waiting_for_a_gripper_that_is_late_is_no_stop() -> None:
    late = stopped([5, 0, 0, 0, 0, 0], [5, 0, 0, 0, 5, 0])
    assert stopping_time(late) == pytest.approx(0.4)
    waiting = np.array(["tracking", *[WAITING] * 5])
    assert stopping_time(replace(late, status=waiting)) is None


def test_a_turn_is_a_motion() -> None:
    turning = stopped([5, 0, 0, 0], [5, 0, 0, 0])
    turning.poses[3:, 1, 2] += 0.01
    assert stopping_time(turning) == pytest.approx(0.2)
