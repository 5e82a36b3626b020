"""Feedback in space: it removes what open loop leaves, within the grippers' limits, and stands still when blind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from spatial_problems import HANGING, ball_task

from cableway.control.base import Status
from cableway.control.spatial_feedback import BLIND_STEPS, SpatialFeedback, SpatialFeedbackConfig, within_limits
from cableway.core.errors import InputError
from cableway.records import Observation, Plan
from cableway.simulation.spatial_perturbation import SpatialPerturbation
from cableway.workflow.spatial_run import follow_in_space

TASK = replace(ball_task(), scene=replace(ball_task().scene, obstacles=()))


def straight() -> Plan:
    """From start to goal, no ball between."""
    rows = np.linspace(0, 1, 40)[:, None]
    return Plan.of(TASK.rod, HANGING + rows * (TASK.goal - HANGING))


def test_a_perturbed_cable_comes_nearer_to_the_goal_with_feedback():
    off = SpatialPerturbation.drawn(TASK, 3)
    off = replace(off, config=replace(off.config, links=21))
    errors = []
    for controller in ("open-loop", "rod-jacobian"):
        rollout, verdict, outcome, _ = follow_in_space(
            TASK, straight(), controller=controller, perturbation=off, seed=1
        )
        assert rollout is not None
        errors.append(rollout.shape_error(TASK.keypoints("goal")))
    assert errors[1] < 0.5 * errors[0]
    assert verdict is not None
    assert verdict.passed
    assert outcome == "success"


def test_actions_keep_the_limits_and_do_not_pull_the_cable_taut():
    poses = TASK.gripper_poses("start")
    wild = np.random.default_rng(0).normal(size=(2, 6))
    action = within_limits(wild, poses, TASK.grippers, 1.0)
    assert np.linalg.norm(action[:, :3], axis=1).max() <= TASK.grippers.max_step
    assert np.linalg.norm(action[:, 3:], axis=1).max() <= TASK.grippers.max_turn
    apart = poses[1, :3] - poses[0, :3]
    span = float(np.linalg.norm(apart))
    pulled = np.zeros((2, 6))
    pulled[:, :3] = 0.01 * np.outer([-1, 1], apart / span) + [0.0, 0.0, 0.002]
    kept = within_limits(pulled, poses, TASK.grippers, span + 0.001)
    np.testing.assert_allclose(kept[:, :3], np.tile([0.0, 0.0, 0.002], (2, 1)), atol=1e-12)
    assert not within_limits(np.full((2, 6), np.nan), poses, TASK.grippers, 1.0).any()


def test_without_keypoints_the_plan_goes_on_for_a_second_and_then_stops():
    controller, plan = SpatialFeedback(SpatialFeedbackConfig(hold=0.0)), straight()
    state, blind = controller.init(TASK, plan), np.full_like(plan.shapes[0], np.nan)
    said = []
    for step in range(BLIND_STEPS + 3):
        action, state = controller.step(state, Observation(0.1 * step, blind, plan.poses[step]))
        said.append(state.status)
    assert said[:BLIND_STEPS] == [Status.UNSEEN] * BLIND_STEPS
    assert said[-1] == Status.STOPPED
    assert not action.any()
    with pytest.raises(InputError, match="rod coordinates"):
        controller.init(TASK, replace(plan, q=None))
