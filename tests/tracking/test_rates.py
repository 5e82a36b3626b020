"""Measurement and control at different rates: between frames a controller sees nothing, and arrives all the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from quasi_static import START, stacked, straight_plan, task_for

from cableway.control.base import Controller, Status
from cableway.control.jacobian import JacobianConfig, JacobianFeedback
from cableway.control.rod_mpc import RodMPC
from cableway.records import Rollout
from cableway.rod.planar import PlanarRod
from cableway.simulation.perturbations.sensing import SensedPlant, SensingConfig
from cableway.simulation.plant import CableSimulator
from cableway.tang2025.control.mpc_config import MPCConfig
from cableway.tang2025.control.neural_mpc import NeuralMPC
from cableway.tang2025.models.base import RigidBlend
from cableway.tracking import track

ROD = PlanarRod(0.3)
PLAN = straight_plan(ROD, steps=60)
TASK = task_for(PLAN)
ASIDE = START + np.array([0.006, -0.004, 0.06, 0.0, 0.0, 0.0])
MOVED = replace(TASK, start=ROD.at_keypoints(ROD.shapes(ASIDE[None])[0])[0])
"""Starts 7 mm and 3.4 degrees beside the plan."""
OTHER = replace(TASK.cable, length=1.01 * TASK.cable.length, stiffness_profile=(0.5, 2.0))

MAKERS: dict[str, Callable[[], Controller[Any]]] = {
    "rod": RodMPC,
    "neural": lambda: NeuralMPC(RigidBlend()),
    "paper": lambda: NeuralMPC(RigidBlend(), MPCConfig.paper()),
    "rod jacobian": JacobianFeedback,
    "broyden": lambda: JacobianFeedback(JacobianConfig.broyden()),
}


@cache
def made(name: str) -> Controller[Any]:
    return MAKERS[name]()


@cache
def run(name: str, rate: float | None) -> Rollout:
    """A longer cable that is stiffer at one end, with 1 mm of noise on keypoints, at `rate` frames a second."""
    camera = SensingConfig(frame_rate=rate, keypoint_noise=0.001)
    return track(SensedPlant(CableSimulator(MOVED, cable=OTHER), camera, seed=1), made(name), PLAN)


@pytest.mark.parametrize("rate", [10 / 3, 1.7])
@pytest.mark.parametrize("name", MAKERS)
def test_with_few_frames_a_controller_arrives_as_with_many(name: str, rate: float) -> None:
    full, few = run(name, None), run(name, rate)
    unseen = np.isnan(few.observed[:-1]).all(axis=(1, 2))
    assert unseen.mean() == pytest.approx(1 - rate / 10, abs=0.05)
    expected = np.where(unseen, Status.UNSEEN, Status.TRACKING)
    np.testing.assert_array_equal(few.status, expected)
    errors = [stacked(rollout.keypoints[-1], TASK.goal) for rollout in (full, few)]
    assert errors[0] < 0.015
    assert errors[1] < max(1.3 * errors[0], errors[0] + 0.005)
    assert few.metadata["outcome"] == "settled"


@pytest.mark.parametrize("name", MAKERS)
def test_fewer_than_a_frame_a_second_are_waited_for(name: str) -> None:
    """Blind for more than a second, the grippers stand still and the reference waits, and then they go on."""
    rollout = run(name, 0.6)
    stopped = rollout.status == Status.STOPPED
    assert stopped.any()
    assert not rollout.actions[stopped].any()
    waited = np.flatnonzero(stopped)
    np.testing.assert_array_equal(rollout.reference[waited + 1], rollout.reference[waited])
    np.testing.assert_array_equal(rollout.reference[-1], PLAN.shapes[-1])
    assert stacked(rollout.keypoints[-1], TASK.goal) < 0.03
