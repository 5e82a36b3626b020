"""A plug that is held askew finds its port all the same, in the simulator and within the limits."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cableway.control.base import Status
from cableway.control.insertion import InsertionConfig, InsertionController
from cableway.core.errors import InputError
from cableway.estimation.rod_filter import EstimatorConfig
from cableway.planning.insertion import plan_insertion
from cableway.records import INSERTION, Estimate, Plan, Rollout
from cableway.scene.files.loading import load_task
from cableway.scene.task import CONTROL_STEP, Task
from cableway.simulation.perturbations.grasp import GraspConfig, GraspedCable
from cableway.simulation.perturbations.sensing import SensedPlant, SensingConfig
from cableway.simulation.plant import CableSimulator
from cableway.tracking import insert_plug, may_insert
from cableway.verification import measure_insertion, verify_insertion

ASKEW = GraspConfig(left=(0.001, 0.001, -0.03), right=(0.0, 0.002, 0.035))


@pytest.fixture(scope="module")
def before() -> Task:
    """The task of the catalogue, its cable already before the port."""
    task = load_task("insertion")
    return replace(task, start=task.goal)


@pytest.fixture(scope="module")
def insertion(before: Task) -> Plan:
    return plan_insertion(before)


def inserted(task: Task, insertion: Plan, grasp: GraspConfig, estimator: EstimatorConfig, **sensing: float) -> Rollout:
    plant = SensedPlant(GraspedCable(CableSimulator(task), grasp), SensingConfig(**sensing), seed=1)
    return insert_plug(plant, insertion, controller=InsertionController(InsertionConfig(estimator=estimator)), seed=1)


@pytest.fixture(scope="module")
def askew(before: Task, insertion: Plan) -> Rollout:
    return inserted(before, insertion, ASKEW, EstimatorConfig(), keypoint_noise=0.001, measurement_delay=0.1)


def test_a_nominal_cable_goes_in_exactly(before: Task, insertion: Plan):
    rollout = inserted(before, insertion, GraspConfig(), EstimatorConfig())
    found = measure_insertion(rollout.poses[:, 1], before)
    assert found.inserted
    assert abs(found.lateral) < 1e-4
    assert abs(found.angle) < 1e-3
    assert verify_insertion(rollout, before).passed


def test_held_askew_it_goes_in_because_the_grasp_is_estimated(before: Task, insertion: Plan, askew: Rollout):
    assert verify_insertion(askew, before).passed
    blindly = inserted(before, insertion, ASKEW, EstimatorConfig.nominal(), keypoint_noise=0.001, measurement_delay=0.1)
    assert not measure_insertion(blindly.poses[:, 1], before).inserted


def test_what_the_run_to_the_port_learned_is_kept(before: Task, insertion: Plan):
    """Held askew by 5 mm and 6 degrees, more than one shape tells: told the grasp, the controller aligns the plug."""
    grasp = GraspConfig(right=(0.0, 0.005, 0.1))
    turn = {"right grasp y": 0.005, "right grasp turn": 0.1}
    known = {name: Estimate(value, 1e-3, nominal=0.0, prior=1.0) for name, value in turn.items()}
    plants = [GraspedCable(CableSimulator(before), grasp) for _ in range(2)]
    told = insert_plug(plants[0], insertion, controller=InsertionController(known=known))
    untold = insert_plug(plants[1], insertion)
    off = [measure_insertion(each.poses[:, 1], before).lateral for each in (told, untold)]
    assert off[0] < 0.5 * off[1]


def test_a_plug_that_is_not_aligned_yet_waits_before_the_port(before: Task, insertion: Plan):
    """Grippers that turn slowly need longer than the hold; the plan goes on once the plug is aligned."""
    slow = replace(before, grippers=replace(before.grippers, max_turn=0.0005))
    known = {"right grasp turn": Estimate(0.1, 1e-3, nominal=0.0, prior=1.0)}
    controller = InsertionController(known=known)
    state = controller.init(slow, insertion)
    frame, held = CableSimulator(slow).reset(), state.plan.held_steps
    indices = []
    for _ in range(3 * held):
        action, state = controller.step(state, frame)
        frame = replace(frame, time=frame.time + CONTROL_STEP, poses=frame.poses + action)
        indices.append(state.index)
    assert indices[held + 5] < held
    assert indices[-1] > held


def test_in_the_port_it_goes_straight(before: Task, askew: Rollout):
    assert before.plug is not None
    assert before.port is not None
    alignment = before.port.alignment(before.plug, askew.poses[:, 1])
    inside = alignment.depth > 0
    assert inside.sum() > 5
    assert np.ptp(alignment.lateral[inside]) < 1e-4
    assert np.ptp(alignment.angle[inside]) < 1e-3


def test_the_record_says_what_it_is_of(askew: Rollout):
    assert askew.metadata["part"] == INSERTION
    assert askew.metadata["controller"]["name"] == "InsertionController"


def test_limits_are_kept(before: Task, insertion: Plan):
    """Also where the plug would have to turn by half a radian at once."""
    controller = InsertionController(InsertionConfig(gain=1.0))
    state = controller.init(before, insertion)
    away = insertion.poses[0] + [[0.0, 0.0, 0.0], [0.03, -0.02, 0.5]]
    observation = replace(CableSimulator(before).reset(), poses=away)
    action, _ = controller.step(state, observation)
    assert np.linalg.norm(action[1, :2]) <= before.grippers.max_step
    assert abs(action[1, 2]) <= before.grippers.max_turn
    np.testing.assert_array_equal(action[0], 0.0)


def test_without_gripper_poses_it_stops_and_waits(before: Task, insertion: Plan):
    controller = InsertionController(InsertionConfig(hold=0.0))
    state = controller.init(before, insertion)
    action = np.ones((2, 3))
    for _ in range(6):
        action, state = controller.step(state, None)
    assert state.status == Status.STOPPED
    np.testing.assert_array_equal(action, 0.0)
    assert state.progress < 1.0


@pytest.mark.parametrize("wrong", [{"gain": 1.5}, {"hold": -1.0}, {"max_span": np.nan}])
def test_settings_out_of_range_are_refused(wrong: dict[str, Any]):
    with pytest.raises(InputError, match=next(iter(wrong))):
        InsertionConfig(**wrong)


def test_only_a_run_that_came_to_its_goal_goes_on(before: Task, askew: Rollout):
    there = replace(askew, keypoints=np.repeat(before.goal[None], len(askew.times), axis=0))
    assert may_insert(there, before)
    for outcome in ("plant failed: it broke", "the cable left its plan"):
        ended = {**there.metadata, "outcome": outcome}
        assert not may_insert(replace(there, metadata=ended), before)
    assert not may_insert(replace(there, keypoints=there.keypoints + 0.01), before)
