"""Laws of runs whose grippers are held by the arms of a cell: the last filter and the loop see them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from quasi_static import QuasiStaticPlant

import cableway as cw
from cableway.control.limits import last_filter
from cableway.control.open_loop import OpenLoop
from cableway.core.errors import SimulationError
from cableway.outcome import Outcome
from cableway.records import Observation
from cableway.robot.branches import SINGULAR, ArmMotion, arm_motion
from cableway.robot.cell_kinematics import LEAST
from cableway.robot.held_arms import HANDS, ROOM, HeldArms
from cableway.scene.arm_models import ARM_MODELS
from cableway.scene.cell import Way
from cableway.scene.clearance import body_clearance
from cableway.scene.obstacles import Disc
from cableway.scene.task import CONTROL_STEP
from cableway.tracking import track
from cableway.tracking.stopping import TrackConfig
from cableway.tracking.watchdog import CUT

FAR_APART = 10.0
"""[m], more than any cable."""


@pytest.fixture(scope="module")
def planned() -> tuple[cw.Task, cw.Plan]:
    task = cw.random_task(0, "cell")
    return task, cw.plan(task, seed=0)


def moved(task: cw.Task, by: float) -> cw.Task:
    """The task with arm 1 nearer to arm 0 [m]; nothing looks whether a plan for it would be another one."""
    assert task.cell is not None
    first, second = task.cell.arms
    x, y, z = second.position
    return replace(task, cell=replace(task.cell, arms=(first, replace(second, position=(x - by, y, z)))))


def column(task: cw.Task) -> cw.Task:
    """The task with a column before the base of arm 0, where the plan's motion of its links ends."""
    post = Disc(center=(0.15, task.scene.size[1] / 2), radius=0.02, height=0.6)
    return task.in_scene(replace(task.scene, obstacles=(*task.scene.obstacles, post)))


def held(plan: cw.Plan, task: cw.Task) -> HeldArms:
    arms = HeldArms.of_plan(plan, task, plan.poses[0])
    assert arms is not None
    return arms


def led(
    plan: cw.Plan, task: cw.Task, times: float = 1.0, seen: bool = True, last: int | None = None
) -> tuple[np.ndarray, int]:
    """Joints of arms that are sent along a plan, to its end or a last row, through the last filter; and the cuts.

    With `times`, the plan is gone through so many times as fast, by grippers whose own limits allow it.
    """
    quick = replace(task.grippers, max_step=0.1, max_turn=1.0)
    arms, task = held(plan, task), replace(task, grippers=quick)
    at, before, joints, cuts = plan.poses[0], np.zeros((2, 3)), [], 0
    last = last or plan.steps
    for row in np.minimum(np.arange(times, last + times, times), last):
        joints.append(arms.joints)
        action = plan.poses[round(row)] - at
        action = np.clip(action, -0.1, 0.1)
        sent = last_filter(action, at, task, FAR_APART, before, arms=arms if seen else None)
        cuts += not np.array_equal(sent, action)
        at, before = at + sent, sent
        arms = arms.led(at)
    return np.array([*joints, arms.joints]), cuts


def clearances(joints: np.ndarray, plan: cw.Plan, task: cw.Task) -> np.ndarray:
    return held(plan, task).kinematics.room(joints)[0]


def test_a_plan_that_arms_can_follow_passes_unchanged(planned: tuple[cw.Task, cw.Plan]):
    task, plan = planned
    joints, cuts = led(plan, task)
    assert cuts == 0
    np.testing.assert_allclose(joints, plan.joints, atol=1e-9)


@pytest.mark.parametrize("change", [lambda task: moved(task, 0.4), column], ids=["other arm", "column"])
def test_links_are_not_led_into_what_is_in_their_way(
    planned: tuple[cw.Task, cw.Plan], change: Callable[[cw.Task], cw.Task]
):
    task, plan = change(planned[0]), planned[1]
    blind, _ = led(plan, task, seen=False)
    assert clearances(blind, plan, task).min() < 0, "an elbow would swing into it"
    joints, cuts = led(plan, task)
    assert cuts > 3
    assert clearances(joints, plan, task).min() >= ROOM - 1e-9
    assert len(np.unique(joints.round(9), axis=0)) > 5, "they go on until they are near"


def test_links_that_are_near_already_may_go_away_only(planned: tuple[cw.Task, cw.Plan]):
    task, plan = moved(planned[0], 0.4), planned[1]
    at = plan.poses[0]
    arms = held(plan, task)
    rows = [plan.poses[0]]
    for pose in plan.poses[1:]:
        if clearances(arms.joints[None], plan, task).min() < 0:
            break
        at, arms = pose, arms.led(pose)
        rows.append(pose)
    assert len(rows) > 5
    still = replace(arms, moved=np.zeros((2, 6)))
    nearer, away = plan.poses[len(rows)] - at, 0.2 * (rows[-4] - at)
    assert np.abs(last_filter(nearer, at, task, FAR_APART, arms=still)).max() == 0.0
    np.testing.assert_array_equal(last_filter(away, at, task, FAR_APART, arms=still), away)


def test_hands_that_arms_carry_keep_off_an_obstacle(planned: tuple[cw.Task, cw.Plan]):
    """By as much as they may be off where they are sent; what moves by itself comes as near as can be."""
    task, plan = planned
    start, far = plan.poses[0], plan.poses[len(plan.poses) // 2]
    ahead = (far - start)[0, :2] / np.linalg.norm((far - start)[0, :2])
    center = start[0, :2] + 0.2 * ahead
    post = Disc(center=(float(center[0]), float(center[1])), radius=0.02, height=0.05)
    task = task.in_scene(replace(task.scene, obstacles=(post,)))
    for arms, least in ((None, 0.0), (held(plan, task), HANDS)):
        at = start
        for _ in range(400):
            sent = last_filter(np.tile([*(0.001 * ahead), 0.0], (2, 1)), at, task, FAR_APART, arms=arms)
            if not sent.any():
                break
            at, arms = at + sent, arms and arms.led(at + sent)
        room = min(float(body_clearance(body, at[None], task.scene)[0]) for body in task.outer_bodies)
        assert least - 1e-9 <= room < least + 0.0003


@pytest.mark.parametrize("limit", ["speed_limit", "acceleration_limit"])
def test_joints_keep_their_limits_of_speed_and_acceleration(
    planned: tuple[cw.Task, cw.Plan], limit: str, monkeypatch: pytest.MonkeyPatch
):
    task, plan = planned
    task = task.in_scene(replace(task.scene, obstacles=()))  # grippers may brake harder before those
    loose: dict[str, Any] = {"speed_limit": (50.0,) * 6, "acceleration_limit": (1e3,) * 6}
    monkeypatch.setitem(ARM_MODELS, "ur5e", replace(ARM_MODELS["ur5e"], **{**loose, limit: (0.6,) * 6}))
    greatest = []
    for seen in (False, True):
        joints, cuts = led(plan, task, times=2.0, seen=seen, last=30)  # where arms have room and need not brake hard
        changes = np.diff(joints[[0, *range(len(joints))]], 1 if limit == "speed_limit" else 2, axis=0)
        order = 1 if limit == "speed_limit" else 2
        greatest.append(float(np.abs(changes).max()) / CONTROL_STEP**order)
        assert (cuts > 0) == seen
    assert greatest[0] > 0.8
    assert greatest[1] <= 0.6 + 1e-6


def test_from_rest_any_command_gets_through_in_part(planned: tuple[cw.Task, cw.Plan]):
    """However much less than a quarter of it the limit of acceleration allows."""
    task, plan = planned
    arms, at = held(plan, task), plan.poses[0]
    still, action = np.zeros((2, 3)), np.array([[0.0, 0.0, 0.13], [0.0, 0.0, -0.13]])
    slow = replace(arms, kinematics=held(plan, task).kinematics)
    slow.kinematics.acceleration_limit[:] = 0.5
    sent = last_filter(action, at, task, FAR_APART, still, arms=slow)
    assert np.abs(sent[:, 2]).min() > 0.004
    assert np.abs(slow.led(at + sent).moved).max() <= 0.5 * CONTROL_STEP**2


def test_joints_are_kept_within_their_limits_of_position(
    planned: tuple[cw.Task, cw.Plan], monkeypatch: pytest.MonkeyPatch
):
    task, plan = planned
    assert plan.joints is not None
    most = np.abs(plan.joints).max(axis=(0, 1))
    limit = np.maximum(np.abs(plan.joints[0]).max(axis=0) + 0.02, most - 0.1)
    assert (limit < most).any()
    monkeypatch.setitem(ARM_MODELS, "ur5e", replace(ARM_MODELS["ur5e"], position_limit=tuple(limit)))
    joints, cuts = led(plan, task)
    assert cuts > 0
    assert (np.abs(joints) <= limit + 1e-9).all()


def test_arms_are_not_led_out_of_their_reach(planned: tuple[cw.Task, cw.Plan]):
    task, plan = moved(planned[0], -0.1), planned[1]
    arms, at = held(plan, task), plan.poses[0]
    free = replace(task, scene=replace(task.scene, size=(3.0, 3.0), obstacles=()))
    outward = np.zeros((2, 3))
    outward[plan.metadata["arms"]["holders"].index(1), 0] = -1.0  # away from the base of arm 1
    for step in (0.012, 0.0001):  # the latter, so that joints stay slow
        for _ in range(200):
            sent = last_filter(step * outward, at, free, FAR_APART, arms=arms)
            if not sent.any():
                break
            at = at + sent
            arms = arms.led(at)
        else:
            raise AssertionError("it did not stand before the arm is stretched out")
    away = arms.kinematics.held(at[None], arms.joints)[1].min()
    assert SINGULAR <= away < SINGULAR + 0.02
    with pytest.raises(SimulationError, match=r"the arm at the (left|right) gripper cannot reach"):
        arms.led(at + 0.1 * outward)


def test_without_a_cell_or_a_plan_for_arms_there_are_none(planned: tuple[cw.Task, cw.Plan]):
    task, plan = planned
    floating = replace(task, cell=None)
    assert HeldArms.of_plan(plan, floating, plan.poses[0]) is None
    assert HeldArms.of_plan(replace(plan, metadata={}), task, plan.poses[0]) is None


class Furnished(QuasiStaticPlant):
    """A column comes to stand there during the run."""

    def step(self, action: np.ndarray) -> Observation:
        if self._step == 5:
            self.task = column(self.task)
        return super().step(action)


@pytest.mark.parametrize("change", [lambda task: moved(task, 0.4), column, None], ids=["arm", "column", "appears"])
def test_a_run_stops_its_arms_before_they_touch_anything(
    planned: tuple[cw.Task, cw.Plan], change: Callable[[cw.Task], cw.Task] | None
):
    task, plan = (change or column)(planned[0]), planned[1]
    way = Way.of_record(plan.metadata)
    assert task.cell is not None
    least = []
    for followed in (replace(plan, metadata={}), plan):
        kind, known = (Furnished, planned[0]) if change is None else (QuasiStaticPlant, task)
        plant = kind(known, task.start_equilibrium, task.cable.rod)
        rollout = track(plant, OpenLoop(), followed, config=TrackConfig(overtime=1.0))
        made = arm_motion(rollout.poses, task, replace(task.cell, way=way), made=True)
        assert isinstance(made, ArmMotion)
        least.append(made.clearance)
        assert any(str(status).endswith(CUT) for status in rollout.status) == (followed is plan)
    assert least[0] < 0
    assert least[1] >= LEAST
    assert rollout.outcome is Outcome.TIMED_OUT


def test_arms_that_cannot_hold_the_cable_where_it_is_end_the_run_before_it_begins(planned: tuple[cw.Task, cw.Plan]):
    task, plan = moved(planned[0], -0.6), planned[1]
    rollout = track(cw.CableSimulator(task), OpenLoop(), plan)
    assert rollout.outcome is Outcome.WRONG_SETUP
    assert rollout.detail.startswith("the arm at the ")
    assert " gripper cannot reach (0." in rollout.detail
    assert rollout.detail.endswith(" m in its branch")
    assert rollout.steps == 0


class Displaced(QuasiStaticPlant):
    """After a second one gripper reports a place that its arm cannot reach, and stays there."""

    away = np.zeros((2, 3))

    def _observe(self) -> Observation:
        observation = super()._observe()
        gone = self.away if self._step > 10 else 0.0
        return replace(observation, poses=observation.poses + gone)


def test_a_gripper_that_is_where_its_arm_cannot_be_ends_the_run(planned: tuple[cw.Task, cw.Plan]):
    task, plan = moved(planned[0], -0.1), planned[1]
    plant = Displaced(task, task.start_equilibrium, task.cable.rod)
    plant.away[plan.metadata["arms"]["holders"].index(1), 0] = -0.4
    rollout = track(plant, OpenLoop(), plan)
    assert rollout.outcome is Outcome.PLANT_FAILED
    assert "gripper cannot reach" in rollout.detail
