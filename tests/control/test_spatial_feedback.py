"""Feedback in space: it removes what open loop leaves, within the grippers' limits, and stands still when blind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from spatial_problems import HANGING, ball_task

from cableway.control.base import Status
from cableway.control.spatial_feedback import SpatialFeedback, SpatialFeedbackConfig
from cableway.control.spatial_following import BLIND_STEPS, kept_clear, within_limits
from cableway.control.spatial_mpc import SpatialMPC, SpatialMPCConfig
from cableway.core.errors import InputError, PlanningError, SimulationError, UnknownNameError
from cableway.estimation.spatial_filter import SpatialEstimatorConfig
from cableway.geometry.groups import SE3
from cableway.motion.spatial import SpatialProblem
from cableway.records import Measurement, Observation, Plan
from cableway.scene.spatial.obstacles import Sphere
from cableway.scene.spatial.task import SpatialTask
from cableway.simulation.spatial_perturbation import SpatialPerturbation
from cableway.simulation.spatial_plant import SpatialConfig
from cableway.tracking.spatial_loop import track_in_space
from cableway.verification.record import verify_record
from cableway.workflow.spatial_run import follow_in_space

TASK = replace(ball_task(), scene=replace(ball_task().scene, obstacles=()))


def straight() -> Plan:
    """From start to goal, no ball between."""
    rows = np.linspace(0, 1, 40)[:, None]
    return Plan.of(TASK.rod, HANGING + rows * (TASK.goal - HANGING))


def no_way(task: SpatialTask) -> Plan:
    """Finds no plan."""
    raise PlanningError("a wall stands there")


def test_a_perturbed_cable_comes_nearer_to_the_goal_with_feedback():
    off = SpatialPerturbation.drawn(TASK, 3)
    off = replace(off, config=replace(off.config, links=21))
    errors = []
    for controller in ("open-loop", "rod-jacobian", "rod-mpc"):
        rollout, verdict, outcome, _ = follow_in_space(
            TASK, straight(), controller=controller, perturbation=off, seed=1
        )
        assert rollout is not None
        errors.append(rollout.shape_error(TASK.keypoints("goal")))
        assert verdict is not None
        assert verdict.passed
        assert outcome == "success"
    assert max(errors[1:]) < 0.5 * errors[0]


def test_a_cable_is_led_round_what_its_plan_grazes():
    """The ball is where the straight way would touch it; feedback alone follows the plan into it."""
    under = float(HANGING[2]) - TASK.cable.radius - 0.0305
    ball = Sphere(center=(0.4, 0.4, under), radius=0.03)
    grazed = replace(TASK, scene=replace(TASK.scene, obstacles=(ball,)))
    nothing, clearances = SpatialPerturbation(config=SpatialConfig(links=21)), []
    for controller in ("rod-jacobian", "rod-mpc"):
        rollout, *_ = follow_in_space(grazed, straight(), controller=controller, perturbation=nothing)
        assert rollout is not None
        clearances.append(rollout.least_clearance)
    assert clearances[1] > clearances[0] + 0.002


BELOW = replace(TASK, scene=replace(TASK.scene, obstacles=(Sphere(center=(0.4, 0.4, 0.1), radius=0.06),)))
"""With a ball below the straight way."""

RAISED = SpatialPerturbation(config=SpatialConfig(links=21), obstacles=((0.0, 0.0, 0.26),), revealed=1.0)
"""It turns out to stand in the middle of it."""


def test_what_turns_out_to_stand_in_the_way_is_gone_round():
    rollout, verdict, outcome, why = follow_in_space(BELOW, straight(), perturbation=RAISED)
    assert rollout is not None
    assert (outcome, why) == ("success", "")
    assert verdict is not None
    (since,) = rollout.metadata["recovered"]
    still = rollout.poses[(rollout.times > since - 0.4) & (rollout.times < since)]
    assert np.abs(still - still[0]).max() < 1e-3
    stopped, soon = (rollout.reference[int(np.searchsorted(rollout.times, since + by))] for by in (-0.05, 0.55))
    assert np.abs(soon - stopped).max() > 1e-4, "what was learned stays, so nothing waits for it again"
    assert BELOW.as_recorded(rollout.metadata).scene.obstacles[0] == Sphere(center=(0.4, 0.4, 0.36), radius=0.06)
    assert verify_record(rollout, BELOW).as_dict() == verdict.as_dict(), "judged among the obstacles as they were"
    never = replace(RAISED, revealed=None)
    rollout, _, outcome, _ = follow_in_space(BELOW, straight(), controller="open-loop", perturbation=never)
    assert outcome == "contact", "nothing is known of it, and nothing stops"
    assert rollout is not None
    assert "cable clearance" in {check.name for check in verify_record(rollout, BELOW).failures()}


def test_what_stands_in_the_way_of_a_hand_alone_stops_it():
    """A ball is to stand 15 mm beside the way of the left end, where only the hand, 20 mm about it, would be."""
    pose, ball = straight().poses[20, 0], BELOW.scene.obstacles[0]
    by = pose[:3] - [0.0, 0.06 + 0.015, 0.0] - np.array(ball.center)
    beside = replace(RAISED, obstacles=(tuple(by.tolist()),), revealed=0.3)
    rollout = track_in_space(BELOW, beside.build(BELOW, 0), SpatialFeedback(), straight(), no_way)
    assert (rollout.outcome, rollout.detail) == ("blocked way", "a wall stands there")
    assert rollout.least_clearance > 0.03


def test_the_grippers_stand_where_nothing_leads_round():
    plant, controller = RAISED.build(BELOW, 0), SpatialFeedback(SpatialFeedbackConfig(hold=0.5))
    rollout = track_in_space(BELOW, plant, controller, straight(), no_way)
    assert (rollout.outcome, rollout.detail) == ("blocked way", "a wall stands there")
    assert rollout.least_clearance > 0.05
    assert not rollout.actions[-5:].any()


def test_what_stands_elsewhere_is_known_and_the_plan_goes_on():
    aside = replace(RAISED, obstacles=((0.0, 0.0, 0.02),))
    rollout = track_in_space(BELOW, aside.build(BELOW, 0), SpatialFeedback(), straight(), no_way)
    assert rollout.outcome == "settled"
    assert rollout.metadata["recovered"] == []


def test_what_no_rod_explains_is_left_to_the_nominal_one():
    plan, controllers = (
        straight(),
        (SpatialMPC(SpatialMPCConfig(hold=0.0)), SpatialFeedback(SpatialFeedbackConfig(hold=0.0))),
    )
    torn = SE3.plus(plan.poses[0], np.array([[0.0, -0.2, 0, 0, 0, 0], [0, 0.2, 0, 0, 0, 0]]))
    said, actions = [], []
    for controller in controllers:
        action, state = controller.step(controller.init(TASK, plan), Observation(0.0, plan.shapes[0], torn))
        said.append(state.status)
        actions.append(action)
    assert said == [Status.NOMINAL, Status.TRACKING]
    np.testing.assert_allclose(*actions)


def test_the_tasks_cable_held_askew_begins_in_another_shape_and_is_judged_so():
    nothing = SpatialPerturbation(config=SpatialConfig(links=21))
    askew = SE3.plus(
        np.tile(SE3.identity, (2, 1)), np.array([[0, 0.006, 0, 0, 0.1, 0.1], [0.006, 0, 0.004, 0, 0, 0.1]])
    )
    held = replace(nothing, grasps=askew)
    assert (nothing.another_start, held.another_start) == (False, True)
    rollout, verdict, outcome, _ = follow_in_space(TASK, straight(), perturbation=held)
    assert rollout is not None
    assert np.linalg.norm(rollout.keypoints[0] - TASK.keypoints("start")) > 0.02, "it would not pass for the task's"
    assert verdict is not None
    assert verdict.passed
    assert outcome == "success"
    assert rollout.metadata["configuration"]["plant"]["grasps"] == held.grasps.tolist()
    (begin,) = (check for check in verify_record(rollout, TASK).checks if check.name == "distance to start")
    assert begin.passed


def test_a_drawn_cable_differs_as_said_and_the_same_seed_draws_it_again():
    drawn = [SpatialPerturbation.drawn(TASK, seed) for seed in range(40)]
    cables = [each.cable for each in drawn if each.cable is not None]
    for name, most in (("length", 0.02), ("bending_stiffness", 0.3)):
        off = np.array([getattr(cable, name) for cable in cables]) / getattr(TASK.cable, name) - 1
        assert 0.6 * most < np.abs(off).max() <= most
    off = np.abs(SE3.minus(np.array([each.grasps for each in drawn]), np.tile(SE3.identity, (2, 1))))
    for part, most in ((off[..., :3], 0.003), (off[..., 3:], np.radians(5.0))):
        assert 0.6 * most < np.linalg.norm(part, axis=-1).max() <= most
    assert {each.config.measurement_delay for each in drawn} == {1}
    assert SpatialPerturbation.drawn(TASK, 3).cable == drawn[3].cable


def test_motion_under_way_is_not_asked_for_again():
    """A late frame shows the cable where it was: what the grippers did since needs no correction."""
    controller, plan = SpatialFeedback(SpatialFeedbackConfig(hold=0.0)), straight()
    state = controller.init(TASK, plan)
    for row in range(4):
        late = max(0, row - 2)
        seen = Observation(0.1 * row, plan.shapes[late], plan.poses[row], taken=0.1 * late)
        action, state = controller.step(state, seen)
        np.testing.assert_allclose(action, SE3.minus(plan.poses[row + 1], plan.poses[row]), atol=2e-4)


def test_a_plant_that_cannot_start_or_fails_on_the_way_is_said():
    short = SpatialPerturbation(cable=replace(TASK.cable, length=0.1))
    rollout, _, outcome, why = follow_in_space(TASK, straight(), perturbation=short)
    assert (rollout, outcome) == (None, "plant failed")
    assert "no stable shape" in why
    with pytest.raises(UnknownNameError, match="rod-jacobian, rod-mpc"):
        follow_in_space(TASK, straight(), controller="broyden")

    class Failing:
        control_step = 0.1
        task = TASK

        def reset(self) -> Observation:
            return Observation(0.0, TASK.keypoints("start"), TASK.gripper_poses("start"))

        def step(self, action: np.ndarray) -> Observation:
            raise SimulationError("a gripper stopped")

        def measure(self) -> Measurement:
            return Measurement(TASK.keypoints("start"), TASK.gripper_poses("start"), TASK.stations("start"), 0.1, 0.1)

    led = track_in_space(TASK, Failing(), SpatialFeedback(), straight(), no_way)
    assert (led.outcome, led.detail, led.steps) == ("plant failed", "a gripper stopped", 0)


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


def test_hands_are_not_led_into_what_stands_there():
    poses = TASK.gripper_poses("start")
    beside = Sphere(center=tuple(poses[0, :3] + [0.05, 0.0, 0.0]), radius=0.02)
    problem = SpatialProblem.of(replace(TASK, scene=replace(TASK.scene, obstacles=(beside,))))
    ahead = np.zeros((2, 6))
    ahead[:, 0] = 0.02
    room = 0.03 - TASK.grippers.radius
    kept = kept_clear(ahead, poses, problem)
    assert 0 < kept[0, 0] <= room + 1e-9
    np.testing.assert_allclose(kept_clear(-ahead, poses, problem), -ahead)
    inside = SE3.plus(poses, 2 * ahead)
    assert not kept_clear(ahead, inside, problem).any()


def test_a_plan_that_leads_a_hand_into_something_stops_before_it():
    poses, plan = TASK.gripper_poses("start"), straight()
    ahead = Sphere(center=tuple(poses[0, :3] + [0.1, 0.0, 0.0]), radius=0.02)
    task = replace(TASK, scene=replace(TASK.scene, obstacles=(ahead,)))
    controller = SpatialFeedback(SpatialFeedbackConfig(gain=0.0, hold=0.0))
    state, gaps = controller.init(task, plan), []
    for row in range(20):
        action, state = controller.step(state, Observation(0.1 * row, plan.shapes[row], state.commanded))
        gaps.append(state.problem.bodies.gaps(state.commanded[None], state.problem.world).min())
    assert 0 <= min(gaps) < 0.011, "a quarter of a step may be left"
    assert plan.poses[20, 0, 0] - poses[0, 0] > 0.15, "the plan goes on"
    assert not action.any()


def test_what_parameters_leave_is_taken_off_the_way():
    """A cable that is seen 4 mm higher than any rod between these grippers is led lower."""
    known = SpatialEstimatorConfig(length=0, twist=0, weight=0, stiffness=0, grasp=0, grasp_turn=0)
    controller, plan, ways = SpatialMPC(SpatialMPCConfig(hold=0.0, estimator=known)), straight(), []
    for height in (0.0, 0.004):
        state = controller.init(TASK, plan)
        action, _ = controller.step(state, Observation(0.0, plan.shapes[0] + [0, 0, height], plan.poses[0]))
        ways.append(action[:, 2].mean())
    assert -0.004 < ways[1] - ways[0] < -0.0005


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
