"""The insertion as a plan: straight, verified, or not at all."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cableway.core.errors import InputError, PlanningError
from cableway.geometry.groups import SE2
from cableway.planning.insertion import STEP, plan_insertion
from cableway.robot.branches import ArmMotion
from cableway.robot.grasping import HELD, with_hands
from cableway.scene.cell import CELLS, Way
from cableway.scene.files.loading import load_task
from cableway.scene.obstacles import Disc
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.verification import VerificationLimits, verify_insertion_plan
from cableway.verification.bodies import body_checks


@pytest.fixture(scope="module")
def task() -> Task:
    return load_task("insertion")


def with_disc(task: Task, x: float, y: float, radius: float) -> Task:
    return replace(task, scene=Scene(task.scene.size, (*task.scene.obstacles, Disc(center=(x, y), radius=radius))))


def test_the_plug_goes_straight_from_before_the_port_until_it_is_in(task: Task):
    plan = plan_insertion(task)
    assert task.plug is not None
    assert task.port is not None
    alignment = task.port.alignment(task.plug, plan.poses[:, 1])
    np.testing.assert_allclose(alignment.depth[[0, -1]], [-0.015, 0.012], atol=3e-4)
    np.testing.assert_allclose(alignment.lateral[1:], 0.0, atol=1e-9)
    np.testing.assert_allclose(alignment.angle[1:], 0.0, atol=1e-9)
    assert (np.diff(alignment.depth[1:]) > 0).all()
    assert np.diff(alignment.depth).max() <= STEP + 1e-9
    assert verify_insertion_plan(plan, task).passed


def test_both_grippers_go_along_so_that_the_cable_keeps_its_shape(task: Task):
    plan = plan_insertion(task)
    assert plan.metadata["left gripper"] == "goes along"
    moved = plan.shapes - plan.shapes[:, :1]
    np.testing.assert_allclose(moved[1:], np.broadcast_to(moved[1], moved[1:].shape), atol=1e-9)


def test_where_the_left_gripper_has_no_room_it_stands_still(task: Task):
    blocked = with_disc(task, 0.43, 0.545, 0.012)
    plan = plan_insertion(blocked)
    assert plan.metadata["left gripper"] == "stands still"
    np.testing.assert_allclose(plan.poses[:, 0], plan.poses[:1, 0].repeat(len(plan.poses), axis=0), atol=1e-9)
    assert verify_insertion_plan(plan, blocked).passed


def test_a_push_that_cannot_be_says_why_and_shows_the_attempt(task: Task):
    blocked = with_disc(task, 0.57, 0.483, 0.005)
    said = r"^the plug cannot be inserted: .* goes along: the plug and .* stands still: the plug and obstacles"
    with pytest.raises(PlanningError, match=said) as caught:
        plan_insertion(blocked)
    attempt = caught.value.attempt
    assert attempt is not None
    assert attempt.verdict is not None
    assert {check.name for check in attempt.verdict.failures()} == {"plug clearance"}
    assert attempt.poses is not None


def test_the_limits_are_those_given(task: Task):
    with pytest.raises(PlanningError, match=r"would stray .* from the planned shape"):
        plan_insertion(task, VerificationLimits(follow=1e-9))


def test_a_task_without_a_port_has_no_push(task: Task):
    with pytest.raises(InputError, match="has no port"):
        plan_insertion(replace(task, port=None))


def test_arms_go_on_as_they_hold_the_cable_and_do_not_let_go_of_a_plug_before_its_port():
    task = load_task("insertion").in_cell(CELLS["dual-ur5e-long-fingers"])
    plan = plan_insertion(task)
    way = Way.of_record(plan.metadata)
    assert plan.joints is not None
    assert way is not None
    turned = plan.joints - np.copysign(math.tau, plan.joints[:1]) * np.eye(6)[5]
    on = plan_insertion(task, after=replace(plan, joints=turned))
    assert on.joints is not None
    np.testing.assert_allclose(on.joints, turned, atol=1e-9)
    assert Way.of_record(on.metadata) == way
    held = with_hands(plan, ArmMotion(plan.joints, way, 0.0), task)
    assert held.retreat is None
    assert held.metadata["arms"]["no_retreat"] == HELD


def test_arms_that_cannot_hold_the_plug_in_its_port_are_told():
    cell = CELLS["dual-ur5e-long-fingers"]
    far = tuple(replace(arm, position=(4 * arm.position[0], 0.0, 0.15)) for arm in cell.arms)
    with pytest.raises(PlanningError, match=r"if the left gripper goes along: no arm reaches the left gripper at \(0"):
        plan_insertion(load_task("insertion").in_cell(replace(cell, arms=far)))


def test_the_hand_at_the_left_end_is_kept_off_the_plug(task: Task):
    task = task.in_cell(CELLS["dual-ur5e-long-fingers"])
    shape, poses = task.goal[None], task.gripper_poses("goal")[None]
    (check,) = (check for check in body_checks(shape, poses, task, 0.004) if check.name == "gripper body from the plug")
    assert check.passed
    beside = poses.copy()
    beside[:, 0] = SE2.plus(poses[:, 1], np.array([0.03, 0.0, 0.0]))
    (check,) = (
        check for check in body_checks(shape, beside, task, 0.004) if check.name == "gripper body from the plug"
    )
    assert not check.passed
