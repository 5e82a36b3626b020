"""A cable that comes nearer to an obstacle than its plan is stopped before it touches it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from quasi_static import GOAL, START, QuasiStaticPlant, outward, straight_plan, task_for

from cableway.control.open_loop import OpenLoop
from cableway.core.errors import PlanningError
from cableway.geometry import se2
from cableway.geometry.groups import SE2
from cableway.outcome import KEYPOINTS, Outcome
from cableway.records import Observation, Plan
from cableway.rod.inverse import nearest_shapes
from cableway.rod.planar import PlanarRod
from cableway.scene.clearance import clearances
from cableway.scene.obstacles import Disc
from cableway.scene.scene import Scene
from cableway.scene.task import CONTROL_STEP, Task
from cableway.tasks.generation import random_task
from cableway.tracking import Recovery, track
from cableway.tracking.observed import clearance
from cableway.tracking.recovery import AHEAD, NEAR, Watch

UNIFORM = PlanarRod(0.3)
FIRST, LAST = START + np.array([[0.5], [0.825]]) * (GOAL - START)
PLAN = replace(straight_plan(UNIFORM, FIRST, LAST, steps=40), q=np.linspace(FIRST, LAST, 41))
TASK = task_for(PLAN)
RADIUS = 0.01
BUMP = np.sin(np.linspace(0, np.pi, 13))[:, None] ** 2


def nowhere(task: Task, left: Plan) -> Plan:
    raise PlanningError("there is no plan")


def beside(at: np.ndarray, toward: np.ndarray, clearance: float) -> Task:
    """The task with a disc at a distance from a place of the cable."""
    center = at + (RADIUS + TASK.cable.radius + clearance) * toward
    return TASK.in_scene(Scene(obstacles=(Disc(center=(float(center[0]), float(center[1])), radius=RADIUS),)))


def told(shapes: np.ndarray, task: Task, plan: Plan = PLAN) -> int | None:
    """The first of some frames after which the cable is about to touch something."""
    watch = Watch(Recovery(replan=nowhere), CONTROL_STEP)
    frames = [Observation(0.0, shape, plan.poses[0]) for shape in shapes]
    return next((i for i, frame in enumerate(frames) if watch.is_closing_in(frame, plan, 0.0, task)), None)


def test_a_cable_that_nears_an_obstacle_unlike_its_plan_is_about_to_touch_it() -> None:
    """The faster, the farther from it."""
    shape = PLAN.shapes[0]
    normal = outward(shape)
    task = beside(shape[6], normal, 0.02)
    ways = {speed: np.arange(0.0, 0.02, speed)[:, None, None] * BUMP * normal for speed in (0.001, 0.002, 0.003)}
    when = {speed: told(shape + way, task) or 0 for speed, way in ways.items()}
    left = {speed: clearances(shape + ways[speed][i : i + 1], PLAN.poses[:1], task).min() for speed, i in when.items()}
    assert NEAR < left[0.001] < left[0.002] < left[0.003] < 0.02 - NEAR
    near = replace(PLAN, shapes=PLAN.shapes + 0.014 * BUMP * normal)
    assert told(shape + ways[0.003], task, near) is None, "the plan comes as near"
    hidden = shape + ways[0.003]
    hidden[::AHEAD, 3] = np.nan
    assert told(hidden, task) is None


def test_noise_does_not_bring_a_cable_near() -> None:
    rng = np.random.default_rng(0)
    task = beside(PLAN.shapes[0][6], outward(PLAN.shapes[0]), 0.015)
    assert told(PLAN.shapes[0] + rng.normal(0.0, 0.002, (500, 13, 2)), task) is None


@pytest.mark.parametrize(("goal", "times"), [(0.005, 2), (0.01, 0)])
def test_a_cable_that_lies_near_something_is_not_replanned_for_ever(goal: float, times: int) -> None:
    """Its plan has more room than it has. Where it is near enough to its goal, it has arrived; where it is not, a new
    plan is made as it is stopped, and one as it comes to rest."""
    plant = QuasiStaticPlant(TASK, PLAN.q[0], UNIFORM)
    shape = PLAN.shapes[0]
    plant.task = beside(shape[6], outward(shape), NEAR / 2)
    away = shape - 0.012 * BUMP * outward(shape)
    staying = replace(
        PLAN, shapes=np.repeat(away[None], 41, axis=0), poses=np.repeat(PLAN.poses[:1], 41, axis=0), q=None
    )
    recovery = Recovery(replan=lambda task, left: staying, start=1.0, deviation=1.0, beside=1.0, goal=goal)
    stayed = track(plant, OpenLoop(), staying, recovery=recovery)
    assert stayed.outcome is Outcome.SETTLED
    assert len(stayed.metadata["recovered"]) == times


def test_it_is_stopped_before_it_touches() -> None:
    """Another cable bends into a disc that the plan keeps clear of, while it is near its plan as a whole."""
    rod = TASK.cable.estimated(0.3, (0.6, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0)).rod
    plant = QuasiStaticPlant(TASK, nearest_shapes(rod, PLAN.q[:1], PLAN.shapes[:1])[0], rod)
    alone = track(plant, OpenLoop(), PLAN)
    apart = alone.keypoints[-1] - PLAN.shapes[-1]
    far = np.linalg.norm(apart, axis=1)
    assert far.mean() < 0.009, "no reason to stop in itself"
    worst = int(far.argmax())
    plant.task = beside(alone.keypoints[-1, worst], apart[worst] / far[worst], -0.002)
    assert clearances(PLAN.shapes, PLAN.poses, plant.task).min() > NEAR
    assert track(plant, OpenLoop(), PLAN).least_clearance < 0
    stopped = track(plant, OpenLoop(), PLAN, recovery=Recovery(replan=nowhere))
    assert stopped.outcome in (Outcome.LEFT_PLAN, Outcome.BLOCKED_WAY)
    assert stopped.least_clearance > 0.002


def test_a_cable_that_rests_almost_a_failure_away_from_its_goal_is_led_on_while_it_comes_closer() -> None:
    watch = Watch(Recovery(replan=nowhere), CONTROL_STEP)
    for stacked, missed in ((0.026, False), (0.035, True), (0.033, False), (np.nan, False), (0.03, True)):
        shape = PLAN.shapes[-1] + [stacked / np.sqrt(KEYPOINTS), 0.0]
        assert watch.is_off_goal(Observation(0.0, shape, PLAN.poses[-1]), PLAN, TASK) == missed, stacked


@pytest.mark.parametrize("seed", range(4))
def test_a_frame_older_than_the_gripper_poses_shows_no_hand_on_its_own_cable(seed: int) -> None:
    """Hands that go on at full speed along the cable, each way, 150 mm from all else."""
    task = random_task(seed, "posts")
    assert task.grippers.pieces
    task = task.in_scene(Scene((5.0, 5.0), (), 0.001))
    shape, poses = task.start + 2.0, task.gripper_poses("start") + [2.0, 2.0, 0.0]
    plan = Plan(np.repeat(shape[None], 2, axis=0), np.repeat(poses[None], 2, axis=0))
    for ahead in (-task.grippers.max_step, task.grippers.max_step):
        watch = Watch(Recovery(replan=nowhere), CONTROL_STEP)
        late = SE2.plus(poses, np.stack([[*(ahead * se2.direction(pose[2])), 0.0] for pose in poses]))
        frames = [Observation(0.0, shape, at) for at in (poses, poses, poses, late)]
        assert not any(watch.is_closing_in(frame, plan, 0.0, task) for frame in frames)
        assert clearance(frames[-1], task) > 0.01
