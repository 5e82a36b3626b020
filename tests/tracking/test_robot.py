"""Faults of robots and links: a run ends safely or survives them, and says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from quasi_static import START, QuasiStaticPlant, stacked, straight_plan, task_for

from cableway.control.base import Status
from cableway.control.limits import last_filter
from cableway.control.rod_mpc import RodMPC, RodMPCConfig
from cableway.outcome import Outcome
from cableway.records import Observation
from cableway.rod.planar import PlanarRod
from cableway.scene.obstacles import Disc
from cableway.scene.task import Grippers
from cableway.tracking import track
from cableway.tracking.loop import HOLDING, TRIAL, WAITING, Loop
from cableway.tracking.robot import HOLD, HOLDS, SHORT, FollowingError, MessageGate
from cableway.tracking.stopping import TrackConfig
from cableway.tracking.suspicion import Obstruction
from cableway.tracking.watchdog import Watchdog

ROD = PlanarRod(0.3)
PLAN = straight_plan(ROD, steps=60)
TASK = task_for(PLAN)
GRIPPERS = Grippers()


@pytest.fixture(scope="module")
def controller() -> RodMPC:
    return RodMPC(RodMPCConfig(hold=0.5))


class Faulty(QuasiStaticPlant):
    """A plant with faults between two times [s]."""

    def __init__(self, begin: float, end: float) -> None:
        super().__init__(TASK, START, ROD)
        self.begin, self.end = begin, end
        self.lead = 0.0

    @property
    def now(self) -> float:
        return self._step * self.control_step

    @property
    def faulty(self) -> bool:
        return self.begin <= self.now < self.end


class Stalled(Faulty):
    """A gripper stands still for a while, then goes where it was last sent, at its own speed limit."""

    def reset(self) -> Observation:
        observation = super().reset()
        self.target = observation.poses.copy()
        return observation

    def step(self, action: np.ndarray) -> Observation:
        self.target = self.target + action
        moved = self.target - self._poses
        if self.faulty:
            moved[1] = 0.0
        self.lead = max(self.lead, float(np.abs(self.target - self._poses)[:, :2].max()))
        length = np.linalg.norm(moved[:, :2], axis=1, keepdims=True)
        moved[:, :2] *= np.minimum(1.0, TASK.grippers.max_step / np.maximum(length, 1e-12))
        return super().step(moved)


class Obstructed(Stalled):
    """Its right gripper cannot go farther from where it started than `reach` [m]; the other goes where it was sent."""

    def __init__(self, reach: float) -> None:
        super().__init__(np.inf, np.inf)
        self.reach, self.pressed = reach, []

    def step(self, action: np.ndarray) -> Observation:
        self.target = self.target + action
        way = (self.target - PLAN.poses[0])[1]
        beyond = np.linalg.norm(way[:2]) > self.reach
        if beyond:
            self.pressed.append(self.now + self.control_step)
            way[:2] *= self.reach / np.linalg.norm(way[:2])
        poses = np.stack([self.target[0], PLAN.poses[0, 1] + way])
        return QuasiStaticPlant.step(self, poses - self._poses)


class ReportedLate(Stalled):
    """Its poses are those of three steps ago."""

    def reset(self) -> Observation:
        observation = super().reset()
        self.past = [observation.poses] * 3
        return observation

    def step(self, action: np.ndarray) -> Observation:
        observation = super().step(action)
        self.past.append(observation.poses)
        return replace(observation, poses=self.past.pop(0))


class Repeating(Faulty):
    """The link, or the camera alone, repeats its last message."""

    def __init__(self, begin: float, end: float, camera_only: bool) -> None:
        super().__init__(begin, end)
        self.camera_only = camera_only
        self.last: Observation | None = None

    def step(self, action: np.ndarray) -> Observation:
        message = super().step(action)
        if self.faulty and self.last is not None:
            return replace(message, keypoints=self.last.keypoints) if self.camera_only else self.last
        self.last = message
        return message


def test_a_gripper_that_stalls_is_not_left_behind(controller: RodMPC) -> None:
    """It stands for 1.2 s: both do after 0.2 s, then the target is brought back, and the run goes on to its goal."""
    plant = Stalled(2.0, 3.2)
    rollout = track(plant, controller, PLAN)
    held = np.flatnonzero(rollout.status == HOLDING)
    assert 0 < rollout.times[held[0]] - 2.0 <= 1.0
    stalled = (rollout.times > 2.2) & (rollout.times < rollout.times[held[0]])
    np.testing.assert_array_equal(np.ptp(rollout.poses[stalled], axis=0), 0.0)
    assert plant.lead < 0.02
    waited = np.isin(rollout.status, (WAITING, HOLDING, TRIAL))
    assert np.ptp(rollout.reference[np.flatnonzero(waited)[1:]], axis=0).max() == 0.0, "the reference waits, too"
    assert rollout.outcome is Outcome.SETTLED
    assert stacked(rollout.keypoints[-1], TASK.goal) < 0.005


def test_a_gripper_that_did_not_follow_goes_first(controller: RodMPC) -> None:
    """It stalls for 3 s: after every hold it is tried alone, and the other one moves when it has followed."""
    plant = Stalled(2.0, 5.0)
    rollout = track(plant, controller, PLAN)
    tried = np.flatnonzero(rollout.status == TRIAL)
    assert rollout.times[tried[0]] < 4.0 < rollout.times[tried[-1]]
    np.testing.assert_array_equal(rollout.actions[tried, 0], 0.0)
    assert rollout.actions[tried, 1].any()
    span = np.linalg.norm(np.subtract(*rollout.poses.swapaxes(0, 1)[..., :2]), axis=1)
    stalled = (rollout.times > 2.25) & (rollout.times < 5.0)
    assert np.ptp(span[stalled]) < SHORT
    assert rollout.outcome is Outcome.SETTLED


@pytest.mark.parametrize("slack", [0.02, 0.0])
def test_a_taut_cable_waits_where_no_poses_come(controller: RodMPC, slack: float) -> None:
    """A gripper may have stalled; with more slack than one step takes they go on for that step."""
    plant = Stalled(2.0, 3.0)
    loop = Loop(plant, controller, PLAN, TrackConfig(), Watchdog())
    while plant.now < 2.0:
        assert loop.step() is None
    loop.observation = replace(loop.observation, poses=np.full((2, 3), np.nan))
    loop._most_span = float(np.linalg.norm(np.subtract(*loop.poses[:, :2]))) + slack
    assert loop.step() is None
    assert (loop.log.status[-1] == WAITING) is (slack == 0.0)
    assert loop.log.actions[-1].any() is np.bool_(slack > 0.0)


def test_a_stop_takes_back_what_a_stalled_gripper_has_yet_to_do(controller: RodMPC) -> None:
    """It is stopped while it stalls, and does not move when it could again."""
    plant = Stalled(2.0, 2.8)
    loop = Loop(plant, controller, PLAN, TrackConfig(), Watchdog())
    while plant.now < 2.4:
        assert loop.step() is None
    loop.stand()
    stopped = loop.poses.copy()
    for _ in range(8):
        assert loop.stand() is None
    assert plant.now > plant.end + 0.3
    np.testing.assert_allclose(loop.poses, stopped, atol=1e-9)


def test_a_stop_after_the_way_back_takes_back_what_stalled_on_it(controller: RodMPC) -> None:
    """Although the stop before the way back took something back, too."""
    plant = Stalled(2.0, 2.8)
    loop = Loop(plant, controller, PLAN, TrackConfig(), Watchdog())
    while plant.now < 2.4:
        assert loop.step() is None
    while plant.now < 3.2:
        assert loop.stand() is None
    plant.begin, plant.end = plant.now + 0.1, plant.now + 2.0
    assert loop.back_off(3) is None
    while plant.now < plant.end:
        assert loop.stand() is None
    stopped = loop.poses.copy()
    for _ in range(4):
        assert loop.stand() is None
    np.testing.assert_allclose(loop.poses, stopped, atol=1e-9)


def test_a_stop_takes_back_once_where_poses_are_reported_late(controller: RodMPC) -> None:
    """The grippers do not go to and fro until the reports show that they stand."""
    plant = ReportedLate(2.0, 2.8)
    loop = Loop(plant, controller, PLAN, TrackConfig(), Watchdog())
    while plant.now < 2.6:
        assert loop.step() is None
    stopped = len(loop.log.actions)
    for _ in range(10):
        assert loop.stand() is None
    assert np.any(loop.log.actions[stopped])
    assert not np.any(loop.log.actions[stopped + 3 :])


def test_the_way_back_loses_no_motion_to_a_gripper_that_stalls(controller: RodMPC) -> None:
    """It stalls while the last 14 motions are taken back: the grippers end where both were together before."""
    plant = Stalled(2.0, 2.8)
    loop = Loop(plant, controller, PLAN, TrackConfig(), Watchdog())
    while plant.now < 1.9:
        assert loop.step() is None
    went = np.array([row.poses for row in loop.log.measured])
    assert loop.back_off(14) is None
    loop.stand()
    gaps = np.linalg.norm((went - loop.poses)[..., :2], axis=2).max(axis=1)
    assert gaps.min() < 0.004


def test_a_gripper_that_stays_stalled_ends_the_run(controller: RodMPC) -> None:
    plant = Stalled(2.0, np.inf)
    rollout = track(plant, controller, PLAN)
    assert rollout.outcome is Outcome.PLANT_FAILED
    assert "the right gripper does not follow its commands" in rollout.detail
    assert rollout.times[-1] < 2.0 + (HOLD + 0.8) * (HOLDS + 1), "every hold, and seven steps to notice"
    assert plant.lead < 0.02


def test_a_gripper_that_follows_back_but_not_ahead_has_something_in_its_way(controller: RodMPC) -> None:
    """It is tried back, then ahead; without recovery the run ends there, with the place."""
    plant = Obstructed(0.05)
    rollout = track(plant, controller, PLAN)
    assert rollout.outcome is Outcome.BLOCKED_WAY
    assert "before the right gripper near" in rollout.detail
    found = Obstruction(1, np.array([0.3, 0.3]), np.array([1.0, 0.0])).contacts(TASK)
    beside = [contact.place - TASK.cable.radius * contact.direction - [0.3, 0.3] for contact in found]
    np.testing.assert_allclose(np.linalg.norm(beside, axis=1), TASK.grippers.radius)
    np.testing.assert_allclose(np.degrees(np.arctan2(*np.transpose(beside)[::-1])), [-60.0, 0.0, 60.0], atol=1e-9)
    assert plant.pressed[-1] - plant.pressed[0] < 2.0, "six steps to notice, half a second of hold, and two trials"
    tried = rollout.actions[rollout.status == TRIAL][:, 1, :2]
    ahead = PLAN.poses[-1, 1, :2] - PLAN.poses[0, 1, :2]
    assert [*np.sign(tried @ ahead)[:2]] == [-1, 1]
    np.testing.assert_allclose(np.linalg.norm(tried[:2], axis=1), [0.006, 0.012], atol=1e-3)


def test_the_way_back_of_a_gripper_that_ran_into_something_ends_before_it(controller: RodMPC) -> None:
    """What it was led too far is on that way no more, and the other gripper goes back as it came."""
    plant = Obstructed(0.05)
    loop = Loop(plant, controller, PLAN, TrackConfig(), Watchdog())
    while loop.obstructed is None:
        assert loop.step() is None
    reached, pressed = loop.poses, len(plant.pressed)
    assert loop.give_in() is None
    assert loop.obstructed is None
    for _ in range(4):
        assert loop.back_off(1) is None
        gaps = np.linalg.norm((PLAN.poses - loop.poses)[..., :2], axis=2)
        assert gaps.max(axis=1).min() < 1e-3, "both are where the plan had them at once"
    assert len(plant.pressed) <= pressed + 1, "but in the step in which it still stands"
    assert np.linalg.norm((loop.poses - reached)[1, :2]) > 0.01


def test_a_trial_leads_the_grippers_no_farther_apart_than_they_have_been() -> None:
    """The left one ran into something behind the right one: before it goes back, the right one does."""
    robot, time = FollowingError(np.array([[0.2, 0.3, 0.0], [0.5, 0.3, 0.0]]), 0.1), 0.0
    at, trials = robot.target.copy(), []
    while robot.obstructed is None and time < 6.0:
        assert not robot.failed
        time += 0.1
        motion = robot.stop(GRIPPERS) if robot.holding else robot.trial(GRIPPERS)
        trials += [motion] if robot.on_trial else []
        robot.commanded(motion if robot.holding or robot.on_trial else np.array([[0.01, 0.0, 0.0]] * 2))
        at = np.minimum(robot.target, [[0.23, 0.3, 0.0], [np.inf] * 3])
        robot.measured(Observation(time, np.zeros((13, 2)), at))
        assert not robot.on_trial or np.ptp(robot.target[:, 0]) < 0.33 + 1e-9, "as far apart as where it was missed"
    assert robot.obstructed == 0
    assert trials[0][1, 0] < 0
    assert not trials[0][0].any()


@pytest.mark.parametrize("kept", [True, False], ids=["kept from going back", "goes back"])
def test_a_gripper_that_was_not_let_back_is_not_taken_for_obstructed(kept: bool) -> None:
    """The last filter may keep it where it is; then nothing shows that it could have followed."""
    still = np.array([[0.2, 0.3, 0.0], [0.5, 0.3, 0.0]])
    robot, time, at = FollowingError(still, 0.1), 0.0, still.copy()

    def sent(action: np.ndarray, most: float) -> None:
        nonlocal time, at
        time += 0.1
        robot.commanded(action)
        at = np.where(np.arange(2)[:, None] == 1, np.minimum(robot.target, still + most), robot.target)
        robot.measured(Observation(time, np.zeros((13, 2)), at))

    ahead = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0]])
    for _ in range(4):
        sent(ahead, 0.02)
    for _ in range(40):
        if robot.obstructed is not None or robot.failed:
            break
        motion = robot.stop(GRIPPERS) if robot.holding else robot.trial(GRIPPERS)
        sent(np.maximum(motion, 0.0) if kept and not robot.holding else motion, 0.02)
    assert robot.obstructed == (None if kept else 1)


def test_a_new_plan_ends_the_trial_on_the_way_of_the_last_one(controller: RodMPC) -> None:
    """Elsewhere by then, the grippers would be sent all the way back to where one of them stood."""
    plant = Stalled(2.0, 3.2)
    loop = Loop(plant, controller, PLAN, TrackConfig(), Watchdog())
    while not loop.log.status or loop.log.status[-1] != HOLDING:
        assert loop.step() is None
    loop.follow(TASK, replace(PLAN))
    assert loop.step() is None
    assert loop.log.status[-1] not in (HOLDING, TRIAL)


@pytest.mark.parametrize("camera_only", [True, False], ids=["camera", "link"])
def test_what_is_only_repeated_counts_as_nothing(controller: RodMPC, camera_only: bool) -> None:
    rollout = track(Repeating(2.0, 8.0, camera_only), controller, PLAN)
    during = rollout.status[(rollout.times[:-1] > 2.1) & (rollout.times[:-1] < 8.0)]
    assert set(during[:1]) == {Status.UNSEEN}
    assert set(during[12:]) == {Status.STOPPED}
    assert rollout.outcome is Outcome.SETTLED
    assert stacked(rollout.keypoints[-1], TASK.goal) < 0.005


def test_a_clock_that_jumps_back_costs_one_message() -> None:
    gate = MessageGate()
    times = [0.0, 0.1, 0.2, -5.0, -4.9, -4.8, -4.8]
    usable = [
        bool(np.isfinite(gate.accepted(Observation(t, PLAN.shapes[i], PLAN.poses[i])).poses).all())
        for i, t in enumerate(times)
    ]
    assert usable == [True, True, True, False, True, True, False]


def test_a_frame_that_stays_the_same_while_nothing_moves_is_not_frozen() -> None:
    gate, message = MessageGate(), Observation(0.0, PLAN.shapes[0], PLAN.poses[0])
    for step in range(5):
        assert np.isfinite(gate.accepted(replace(message, time=0.1 * step)).keypoints).all()
    moved = replace(message, time=1.0, poses=PLAN.poses[0] + [0.003, 0.0, 0.0])
    assert np.isnan(gate.accepted(moved).keypoints).all()


def test_a_hold_comes_to_rest_however_late_the_encoders_are() -> None:
    """The left gripper stalls, the right one follows, measured two steps late."""
    start, limits = PLAN.poses[0], TASK.grippers
    robot, sent, held = FollowingError(start, 0.1), [start] * 3, []
    for step in range(40):
        action = robot.stop(limits) if robot.holding else np.array([[0.0, 0.008, 0.0]] * 2)
        held.append(robot.holding)
        robot.commanded(action)
        sent.append(robot.target)
        left, right = sent[min(10, step)][0], sent[-3][1]
        robot.measured(Observation(0.1 * step, PLAN.shapes[0], np.array([left, right])))
    first = held.index(True)
    assert held[first : first + 4] == [True] * 4
    right = np.array(sent[3:])[first + 2 : first + 4, 1]
    np.testing.assert_allclose(right[0], right[1], atol=1e-12)


def test_holds_between_which_the_gripper_followed_are_not_added_up() -> None:
    """A stop for another reason ends the trial; then both follow, until one stalls again."""
    robot, observed = FollowingError(PLAN.poses[0], 0.1), PLAN.poses[0].copy()
    for _ in range(HOLDS + 2):
        for step in range(60):
            stalled = 20 <= step < 40
            if robot.holding or robot.short or step == 39:
                action = robot.stop(TASK.grippers, anew=step == 39)
            else:
                action = np.array([[0.0, 0.008, 0.0]] * 2)
            robot.commanded(action)
            observed = np.array([robot.target[0], observed[1] if stalled else robot.target[1]])
            robot.measured(Observation(0.1 * step, PLAN.shapes[0], observed))
    assert not robot.failed


# ---------------------------------------------------------------- the last filter
TOWARDS = np.subtract(*PLAN.poses[0, ::-1, :2]) / np.linalg.norm(np.subtract(*PLAN.poses[0, ::-1, :2]))


def pressed(action: np.ndarray, steps: int, task=TASK) -> np.ndarray:
    """Gripper poses after an action was asked for so many times."""
    poses = PLAN.poses[0]
    for _ in range(steps):
        poses = poses + last_filter(action, poses, task, task.cable.length)
    return poses


def test_grippers_are_not_driven_through_each_other_nor_the_cable_torn() -> None:
    together = 0.01 * np.array([[*TOWARDS, 0.0], [*-TOWARDS, 0.0]])
    for separation, least in ((0.0, 2 * TASK.grippers.radius), (0.05, 0.05)):
        task = replace(TASK, grippers=Grippers(separation=separation))
        span = np.linalg.norm(np.subtract(*pressed(together, 40, task)[:, :2]))
        assert least <= span < least + 0.01
    assert 0.29 < np.linalg.norm(np.subtract(*pressed(-together, 40)[:, :2])) <= 0.3 + 1e-9


def test_no_gripper_is_driven_into_an_obstacle_or_out_of_the_workspace() -> None:
    right = PLAN.poses[0, 1, :2]
    task = replace(TASK, scene=replace(TASK.scene, obstacles=(Disc(center=tuple(right - [0.0, 0.05]), radius=0.02),)))
    down = np.array([[0.0, -0.01, 0.0]] * 2)
    assert 0 <= task.scene.signed_distance(pressed(down, 20, task)[1, :2]) - task.grippers.radius < 0.01
    for direction in ([1, 0], [-1, 0], [0, 1], [0, -1]):
        poses = pressed(0.01 * np.array([[*direction, 0.0]] * 2), 100)
        assert (TASK.scene.signed_distance(poses[:, :2]) >= TASK.grippers.radius - 1e-9).all()


def test_what_is_wrong_already_may_get_better() -> None:
    inside = replace(TASK, scene=replace(TASK.scene, obstacles=(Disc(center=(0.5, 0.1), radius=0.02),)))
    away, deeper = np.zeros((2, 3)), np.zeros((2, 3))
    start = np.array([[0.51, 0.1, 0.0], [0.6, 0.2, 0.0]])
    away[0, 0], deeper[0, 0] = 0.005, -0.005
    np.testing.assert_array_equal(last_filter(away, start, inside, 0.3), away)
    assert not last_filter(deeper, start, inside, 0.3).any()


def test_what_is_allowed_is_not_touched() -> None:
    for before, after in zip(PLAN.poses, PLAN.poses[1:], strict=False):
        np.testing.assert_array_equal(last_filter(after - before, before, TASK, 0.3), after - before)


def test_commands_keep_the_limits_of_acceleration() -> None:
    """A controller that asks for full speed, then for the opposite, then for nothing, gets ramps."""
    limits = replace(TASK.grippers, max_acceleration=0.5, max_turn_acceleration=5.0)
    task, poses, sent = replace(TASK, grippers=limits), PLAN.poses[0], [np.zeros((2, 3))]
    ahead = np.array([[0.012, 0.0, 0.12]] * 2)
    for wanted in (ahead, ahead, ahead, ahead, -ahead, -ahead, np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3))):
        sent.append(last_filter(wanted, poses, task, task.cable.length, before=sent[-1]))
        poses = poses + sent[-1]
    change = np.diff(sent, axis=0)
    assert np.linalg.norm(change[..., :2], axis=2).max() <= 0.005
    assert np.abs(change[..., 2]).max() <= 0.05
    np.testing.assert_array_equal(sent[4], ahead)  # reached, and then not touched
    assert not sent[-1].any()


def test_grippers_brake_harder_than_their_limit_before_an_obstacle() -> None:
    """What they would still go while they slow down leads into it."""
    limits = replace(TASK.grippers, max_acceleration=0.1, max_turn_acceleration=1.0)
    task = replace(TASK, grippers=limits)
    right = PLAN.poses[0, 1, :2]
    blocked = replace(
        task, scene=replace(task.scene, obstacles=(Disc(center=tuple(right - [0.0, 0.026]), radius=0.02),))
    )
    down = np.array([[0.0, -0.01, 0.0]] * 2)
    stopped = last_filter(np.zeros((2, 3)), PLAN.poses[0], blocked, task.cable.length, before=down)
    freely = last_filter(np.zeros((2, 3)), PLAN.poses[0], task, task.cable.length, before=down)
    np.testing.assert_allclose(freely[:, 1], -0.009, atol=1e-9)
    reached = PLAN.poses[0] + stopped
    assert abs(stopped[1, 1]) < 0.003
    assert blocked.scene.signed_distance(reached[1, :2]) >= blocked.grippers.radius - 1e-9


def test_a_controller_whose_computation_fails_for_good_ends_the_run() -> None:
    class Broken(RodMPC):
        def _solve(self, state):
            return np.full((2, 3), np.nan)

    rollout = track(QuasiStaticPlant(TASK, START, ROD), Broken(), PLAN)
    assert rollout.outcome is Outcome.CONTROLLER_FAILED
    assert rollout.metadata["watchdog"]["fallback"] == rollout.steps
    assert rollout.steps <= 31
