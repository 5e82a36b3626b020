"""What the loop sends, the way back included, passes the last filter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from quasi_static import GOAL, START, QuasiStaticPlant, outward, straight_plan, task_for

from cableway.control.base import Contact
from cableway.control.following import FollowerState
from cableway.control.open_loop import OpenLoop, OpenLoopConfig
from cableway.core.errors import CablewayError, PlanningError
from cableway.estimation.parameter_filter import LONGEST
from cableway.geometry.convex import signed_distance
from cableway.outcome import Outcome
from cableway.records import Observation, Plan
from cableway.rod.planar import PlanarRod
from cableway.scene.clearance import body_clearance
from cableway.scene.files.loading import load_cell, load_task
from cableway.scene.obstacles import Disc
from cableway.scene.scene import Scene
from cableway.scene.task import CONTROL_STEP, Task
from cableway.tracking.loop import Loop
from cableway.tracking.observed import hysteresis
from cableway.tracking.recovering import ATTEMPTS, BACK, Recovery
from cableway.tracking.recovery import FRICTION, Watch
from cableway.tracking.stopping import TrackConfig
from cableway.tracking.suspicion import has_left, suspected
from cableway.tracking.watchdog import Watchdog

ROD = PlanarRod(0.3)
PLAN = straight_plan(ROD, START, START + 0.4 * (GOAL - START), steps=30)
TASK = task_for(PLAN)


class HalfHidden(QuasiStaticPlant):
    """What is not fully seen, the loop cannot judge by the cable: only the last filter is left."""

    def _observe(self) -> Observation:
        seen = super()._observe()
        return replace(seen, keypoints=np.where(np.arange(13)[:, None] == 6, np.nan, seen.keypoints))


def led(task: Task, steps: int = 20, plant: QuasiStaticPlant | None = None) -> Loop:
    """A run that has followed the plan for some steps."""
    loop = Loop(
        plant or HalfHidden(task, START, ROD), OpenLoop(OpenLoopConfig(hold=0.0)), PLAN, TrackConfig(), Watchdog()
    )
    for _ in range(steps):
        loop.look_round()
        assert loop.step() is None
    return loop


def test_the_grippers_return_the_way_they_came() -> None:
    loop = led(TASK)
    assert loop.back_off(5) is None
    np.testing.assert_allclose(loop.poses, PLAN.poses[15], atol=1e-6)
    np.testing.assert_array_equal(loop.log.actions[20], 0.0)
    np.testing.assert_allclose(loop.log.actions[21], -loop.log.actions[19])


def test_nothing_that_appeared_behind_a_gripper_is_run_into() -> None:
    loop = led(TASK)
    back = PLAN.poses[5, 0, :2] - loop.poses[0, :2]
    center = loop.poses[0, :2] + back * (TASK.grippers.radius + 0.026) / np.linalg.norm(back)
    behind = Disc(center=(float(center[0]), float(center[1])), radius=0.02)
    assert np.linalg.norm(back) > 0.02
    loop.plant.task = TASK.in_scene(Scene(obstacles=(behind,)))  # pyright: ignore[reportAttributeAccessIssue]
    assert loop.back_off(20) is None
    way = np.array([row.poses[0, :2] for row in loop.log.measured[20:]])
    assert signed_distance(way, loop.plant.task.scene.world)[0].min() >= TASK.grippers.radius - 1e-6


def test_limits_of_acceleration_hold_from_rest_on() -> None:
    limited = replace(TASK, grippers=replace(TASK.grippers, max_acceleration=0.02))
    first = led(limited, steps=1).log.actions[0]
    assert 0 < np.linalg.norm(first[:, :2], axis=1).max() <= 0.02 * CONTROL_STEP**2 + 1e-12
    assert np.linalg.norm(led(TASK, steps=1).log.actions[0][:, :2], axis=1).max() > 0.001


def test_limits_of_acceleration_hold_from_the_stop_on() -> None:
    most = 0.02
    limited = replace(TASK, grippers=replace(TASK.grippers, max_acceleration=most))
    loop = led(limited)
    loop.back_off(10)
    sent = np.array(loop.log.actions[20:])
    assert sent[1:].any()
    assert np.linalg.norm(np.diff(sent[:, :, :2], axis=0), axis=-1).max() <= most * CONTROL_STEP**2 + 1e-12


def test_a_contact_is_suspected_once_however_often_a_plan_is_looked_for() -> None:
    asked = []

    def replan(task: Task, left: Plan) -> Plan:
        asked.append(len(task.scene.obstacles))
        raise PlanningError("there is none")

    loop = led(TASK)
    watch = Watch(Recovery(replan=replan), CONTROL_STEP)
    middle = PLAN.shapes[20, 6]
    ending = watch.avoid(loop, Contact(middle, outward(PLAN.shapes[20])))
    assert ending is not None
    assert ending.outcome is Outcome.BLOCKED_WAY
    assert asked == [1] * ATTEMPTS
    assert len(loop.suspected) == 1


def test_a_cable_that_still_lies_at_the_contact_goes_back_farther() -> None:
    """It was held before the way that is taken back at first: what held it has no room beside it yet."""
    loop = led(TASK, steps=28)
    watch = Watch(Recovery(replan=lambda task, left: PLAN), CONTROL_STEP)
    place, later = PLAN.shapes[10, 6], PLAN.shapes[20, 6]
    contact = Contact(place, (place - later) / np.linalg.norm(place - later))
    back = PLAN.shapes[28 - round(BACK / CONTROL_STEP)]
    back_poses = PLAN.poses[28 - round(BACK / CONTROL_STEP)]
    assert not has_left([contact], back, back_poses, TASK)
    assert not suspected([contact], back, back_poses, TASK)
    assert watch.avoid(loop, contact) is None
    np.testing.assert_allclose(loop.poses, PLAN.poses[0], atol=1e-6)
    assert len(loop.suspected) == 1


def test_a_peg_felt_beside_a_wide_hand_is_planned_round() -> None:
    """The hand stands above where the peg is supposed to be, which is as high as the cable and lower than the hand."""
    task = replace(TASK, grippers=replace(TASK.grippers, body="2f-85"), scene=replace(TASK.scene, wall_height=0.001))
    loop = led(task)
    assert loop.task.grippers.pieces
    asked: list[Task] = []

    def replan(task: Task, left: Plan) -> Plan:
        asked.append(task)
        return replace(PLAN, metadata={"from": "there"})

    watch, back = Watch(Recovery(replan=replan), CONTROL_STEP), PLAN.shapes[5]  # where the grippers go back to
    assert watch.avoid(loop, Contact(back[1] + 0.003 * outward(back), -outward(back))) is None
    (disc,), (now,) = loop.suspected, asked
    blind = [body_clearance(body, loop.poses[None], Scene(obstacles=(replace(disc, height=None),), wall_height=0.001))
             for body in task.grippers.pieces]  # fmt: skip
    assert min(blind) < 0, "were it as high as can be, the hand would be in it"
    assert disc.height is not None
    assert disc.height >= 2 * task.cable.radius
    assert now.scene.obstacles[-1] == disc
    assert min(body_clearance(body, loop.poses[None], now.scene) for body in task.grippers.pieces) > 0


def test_what_is_suspected_between_arms_is_no_higher_than_their_cells_obstacles() -> None:
    """Links may be above it, and where they are nothing stands."""
    task = load_task("single-obstacle-2")
    contact = Contact(task.start[6] + 0.006 * outward(task.start), -outward(task.start))
    for placed, height in ((task, None), (task.in_cell(load_cell("dual-ur5e")), 0.05)):
        (disc,) = suspected([contact], task.start, task.gripper_poses("start"), placed)
        assert disc.height == height


class HeldByFriction(HalfHidden):
    """Once its grippers turn back, the middle of the cable stays behind."""

    off = 0.0

    def step(self, action: np.ndarray) -> Observation:
        back = np.sum(action[:, :2] * (PLAN.poses[-1] - PLAN.poses[0])[:, :2]) < 0
        self.off += 0.002 * back
        seen = super().step(action)
        middle = np.clip(3 - np.abs(np.arange(13) - 6), 0, 2)[:, None] / 2
        return replace(seen, keypoints=seen.keypoints + self.off * middle * outward(PLAN.shapes[20]))


def test_what_does_not_go_back_the_way_it_came_is_held_by_friction_and_by_no_disc() -> None:
    plant = HeldByFriction(TASK, START, ROD)
    loop = led(TASK, plant=plant)
    watch = Watch(Recovery(replan=lambda task, left: replace(PLAN, metadata={"from": "there"})), CONTROL_STEP)
    contact = Contact(PLAN.shapes[20, 6], outward(PLAN.shapes[20]), 0.004)
    assert not watch.takes_for_friction(contact)
    assert watch.avoid(loop, contact) is None
    assert loop.plan.metadata == {"from": "there"}
    assert not loop.suspected
    assert plant.off / 4 < watch.friction < plant.off
    assert watch.takes_for_friction(contact)
    assert not watch.takes_for_friction(replace(contact, off=float(2 * plant.off)))


def test_how_far_a_cable_lies_from_its_way() -> None:
    rng = np.random.default_rng(3)
    way = PLAN.shapes + rng.normal(0, 0.002, PLAN.shapes.shape)
    way[17] = np.nan
    way[10:20, 4] = np.nan
    between = (PLAN.shapes[17] + PLAN.shapes[18]) / 2
    assert hysteresis(between, way) < FRICTION / 2
    assert 0.005 < hysteresis(between + 0.01 * outward(between), way) < 0.011
    assert np.isnan(hysteresis(between, np.full_like(way, np.nan)))


class PullingApart(OpenLoop):
    def step(self, state: FollowerState, observation: Observation | None) -> tuple[np.ndarray, FollowerState]:
        _, after = super().step(state, observation)
        return np.array([[-0.005, 0.0, 0.0], [0.005, 0.0, 0.0]]), after


class NeverRefusing(QuasiStaticPlant):
    """Its grippers go wherever they are sent, even where the rod cannot follow."""

    def step(self, action: np.ndarray) -> Observation:
        try:
            return super().step(action)
        except CablewayError:
            self._poses = self._poses + action
            return self._observe()


def test_a_controller_that_pulls_the_grippers_apart_is_stopped() -> None:
    """Where the slack that is seen never ends, at the longest that a cable may turn out to be."""
    start = np.array([0.3, 0.3, 0.0, -10.0, 0.0, 4.0])
    plan = straight_plan(ROD, start, start + [0.01, 0.0, 0.0, 0.0, 0.0, 0.0])
    task = task_for(plan)
    controller = PullingApart(OpenLoopConfig(hold=0.0))
    loop = Loop(NeverRefusing(task, start, ROD), controller, plan, TrackConfig(), Watchdog())
    for _ in range(20):
        loop.look_round()
        assert loop.step() is None
    spans = np.array([np.linalg.norm(row.poses[1, :2] - row.poses[0, :2]) for row in loop.log.measured])
    assert spans[0] + 0.08 < spans.max() < LONGEST * task.cable.length + 1e-6
