"""Controllers that fail on purpose fail as often as they say, and the loop makes no command of it."""

from __future__ import annotations

import numpy as np
import pytest
from quasi_static import GOAL, START, QuasiStaticPlant, straight_plan, task_for

from cableway.benchmark.faulty import FAULTS, SHARE, FaultyController
from cableway.control.limits import exceeds_limits
from cableway.control.open_loop import OpenLoop, OpenLoopConfig
from cableway.outcome import Outcome
from cableway.rod.planar import PlanarRod
from cableway.tracking import track

ROD = PlanarRod(0.3)
PLAN = straight_plan(ROD, START, START + 0.6 * (GOAL - START), steps=60)


@pytest.mark.parametrize("fault", FAULTS)
def test_spoilt_answers_are_missed_steps_and_nothing_else(fault: str) -> None:
    task = task_for(PLAN)
    controller = FaultyController(OpenLoop(OpenLoopConfig(hold=0.0)), fault, seed=3)
    rollout = track(QuasiStaticPlant(task, START, ROD), controller, PLAN)
    spoilt = np.char.startswith(rollout.status, "failed")
    cut = np.char.endswith(rollout.status, "cut to the limits")
    assert SHARE / 2 < (spoilt | cut).mean() < 2 * SHARE
    assert spoilt.sum() == rollout.metadata["watchdog"]["failed"] > 0
    assert not any(exceeds_limits(action, task.grippers) for action in rollout.actions)
    assert np.isfinite(rollout.actions).all()
    assert rollout.outcome in (Outcome.SETTLED, Outcome.TIMED_OUT)


def test_the_same_seed_spoils_the_same_steps() -> None:
    task = task_for(PLAN)

    def statuses(seed: int) -> list[str]:
        controller = FaultyController(OpenLoop(OpenLoopConfig(hold=0.0)), "fault-raises", seed)
        return track(QuasiStaticPlant(task, START, ROD), controller, PLAN).status.tolist()

    assert statuses(1) == statuses(1) != statuses(2)
