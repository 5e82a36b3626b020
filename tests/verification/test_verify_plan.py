"""A true plan passes; each way of spoiling it fails the check that is there for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import problems
import pytest

from cableway.core.errors import InputError
from cableway.geometry import se2
from cableway.planning.projection import ProjectionConfig, step_evenly
from cableway.records import Plan
from cableway.scene.cable import Cable
from cableway.scene.obstacles import Box, Disc
from cableway.scene.scene import Scene
from cableway.scene.task import Grippers, Task
from cableway.verification import verify_plan
from cableway.verification.plan import self_clearance, with_halves


def plan_of(q: np.ndarray, task: Task) -> Plan:
    stations, poses = task.cable.rod.shapes(q)
    shapes = task.cable.rod.at_keypoints(stations)
    return Plan(shapes, poses)


@pytest.fixture(scope="module")
def good() -> tuple[Task, Plan]:
    task = problems.moved()
    q = problems.line_in_q(task.cable.rod, problems.LOW_ARC, problems.MOVED_ARC, 30)
    return task, plan_of(step_evenly(q, task, ProjectionConfig())[0], task)


def failed(plan: Plan, task: Task) -> set[str]:
    return {check.name for check in verify_plan(plan, task).failures()}


RAMPS = {"max_acceleration": 0.5, "max_turn_acceleration": 5.0, "max_jerk": 5.0, "max_turn_jerk": 50.0}


@pytest.mark.parametrize(("limit", "check"), [
    ("max_acceleration", "gripper acceleration"), ("max_turn_acceleration", "gripper turn acceleration"),
    ("max_jerk", "gripper jerk"), ("max_turn_jerk", "gripper turn jerk"),
])  # fmt: skip
def test_a_plan_without_ramps_fails_where_the_task_limits_them(good, limit, check):
    """At even steps the first one starts at full speed; with ramps all limits are kept."""
    task, plan = good
    low = {name: 0.02 * most for name, most in RAMPS.items()}
    limited = replace(task, grippers=replace(task.grippers, **{limit: low[limit]}))
    assert check in failed(plan, limited)
    assert "gripper step" not in failed(plan, limited)
    ramped = replace(task, grippers=replace(task.grippers, **RAMPS))
    again = plan_of(step_evenly(plan_line(task), ramped, ProjectionConfig())[0], ramped)
    verdict = verify_plan(again, ramped)
    assert check in {entry.name for entry in verdict.checks if entry.passed and entry.value > 0}


def plan_line(task: Task) -> np.ndarray:
    return problems.line_in_q(task.cable.rod, problems.LOW_ARC, problems.MOVED_ARC, 30)


@pytest.mark.parametrize("rows", [slice(10, None), slice(10, 11), slice(None, None, 2)])
def test_angles_that_jump_by_a_turn_are_a_step_that_no_gripper_makes(good, rows: slice):
    task, plan = good
    poses = plan.poses.copy()
    poses[rows, 1, 2] += 2 * np.pi
    assert failed(replace(plan, poses=poses), task) == {"gripper turn"}


def test_rod_coordinates_are_those_of_the_shapes(good):
    task, plan = good
    q = problems.line_in_q(task.cable.rod, problems.LOW_ARC, problems.MOVED_ARC, 30)[:1].repeat(
        len(plan.shapes), axis=0
    )
    assert failed(replace(plan, q=q), task) == {"error of the rod coordinates"}


def test_rod_coordinates_do_not_jump_by_a_turn(good):
    """They are those of the same shapes before and after, but a controller would take the turn for a motion."""
    task, plan = good
    q = step_evenly(plan_line(task), task, ProjectionConfig())[0]
    jumping = q.copy()
    jumping[10:, 2] += 2 * np.pi
    assert failed(replace(plan, q=jumping), task) == {"error of the rod coordinates"}
    assert failed(replace(plan, q=q), task) == set()
    assert failed(replace(plan, q=q + [0, 0, 2 * np.pi, 0, 0, 0]), task) == set()


def test_a_line_of_equilibria_passes(good):
    """In free space a straight line in q is a true plan."""
    task, plan = good
    verdict = verify_plan(plan, task)
    assert verdict.passed, str(verdict)


def test_an_obstacle_in_the_way_is_found(good):
    """A disc on the way: clearance fails, and the check names the disc."""
    task, plan = good
    blocked = replace(task, scene=Scene(obstacles=(Disc(center=(0.34, 0.36), radius=0.02),)))
    check = next(check for check in verify_plan(plan, blocked).failures() if check.name == "cable clearance")
    assert check.value < -0.004
    assert "disc" in check.where


@pytest.mark.parametrize("gap", [0.012, 0.007])
def test_clearance_of_the_cable_from_itself(gap):
    """A hairpin: what is nearest are its legs, or in a wide one the ends of half a turn of the cable's radius."""
    radius = 0.004
    half_turn = min(np.pi / 2, np.pi * radius / gap)
    wanted = gap * np.sin(half_turn) - 2 * radius
    turn = np.linspace(-np.pi / 2, np.pi / 2, 60)
    bend = gap / 2 * np.column_stack([np.cos(turn), np.sin(turn)])
    leg = np.linspace(-0.1, 0.0, 40, endpoint=False)
    lower = np.column_stack([leg, np.full(40, -gap / 2)])
    line = np.vstack([lower, bend, lower[::-1] * [1, -1]])
    check = self_clearance(line[None], radius)
    assert check.value == pytest.approx(wanted, abs=2e-4)
    assert check.passed == (wanted > 0)


def test_the_sweep_between_rows_is_judged(good):
    """A thin wall that lies between two rows touches neither, and is found all the same."""
    task, plan = good
    rows = plan.shapes[[0, -1]]
    far = replace(plan, shapes=rows, poses=plan.poses[[0, -1]])
    walled = replace(task, scene=Scene(obstacles=(Box(center=(0.35, 0.36), size=(0.2, 0.004)),)))
    assert task.scene.clearance(rows, 0.004).min() > 0.004
    assert "cable clearance" in failed(far, walled)


def test_grippers_that_pass_each_other_between_rows_are_found(good):
    """The left one jumps from one side of the right one to the other: apart by 20 mm in either row."""
    task, plan = good
    poses = plan.poses[:2].copy()
    poses[:, 0, :2] = poses[:, 1, :2] + np.array([[0.02, 0.0], [-0.02, 0.001]])
    jumping = replace(plan, shapes=plan.shapes[:2], poses=poses, q=None)
    found = next(check for check in verify_plan(jumping, task).checks if check.name == "gripper separation")
    assert found.value < 0.002
    assert not found.passed


def test_a_cable_that_touches_itself_between_rows_is_found():
    """Two strands that change sides, 20 mm apart in either row."""
    along = np.linspace(0.0, 0.1, 21)
    strand = np.column_stack([along, np.zeros(21)])
    lines = np.stack([np.vstack([strand, strand[::-1] + [0.0, gap]]) for gap in (0.02, -0.02)])
    assert self_clearance(lines[:1], 0.004).passed
    both = self_clearance(with_halves(lines), 0.004)
    assert not both.passed
    assert both.row == 0.5


def test_a_corner_between_keypoints_is_judged(good):
    """A needle through the middle of a segment, away from every keypoint, is found."""
    task, plan = good
    a, b = plan.shapes[0, 3], plan.shapes[0, 4]
    angle = float(np.arctan2(*(b - a)[::-1])) + np.pi / 2
    needle = Box(center=tuple((a + b) / 2 + 0.012 * se2.direction(angle)), size=(0.02, 0.001), angle=angle)
    twice = [0, 0]
    spoiled = replace(plan, shapes=plan.shapes[twice], poses=plan.poses[twice])
    still = Task(name="needle", scene=task.scene, cable=task.cable, start=task.start, goal=task.start)
    assert "cable clearance" not in failed(spoiled, still)
    object.__setattr__(still, "scene", Scene(obstacles=(needle,)))
    assert "cable clearance" in failed(spoiled, still)


def test_grippers_are_judged_by_their_own_disc(good):
    """A large gripper disc fails where the cable alone would pass."""
    task, plan = good
    x, y, angle = plan.poses[len(plan.poses) // 2, 0]
    behind = (float(x - 0.024 * np.cos(angle)), float(y - 0.024 * np.sin(angle)))
    beside = replace(task, scene=Scene(obstacles=(Disc(center=behind, radius=0.005),)))
    assert failed(plan, beside) == set()
    assert failed(plan, replace(beside, grippers=Grippers(radius=0.017))) == {"gripper clearance"}


def test_wrong_ends_are_found(good):
    """A plan that stops short, or begins elsewhere, is no plan for this task."""
    task, plan = good
    cut = slice(0, -3)
    assert failed(replace(plan, shapes=plan.shapes[cut], poses=plan.poses[cut]), task) == {"distance to goal"}
    cut = slice(3, None)
    assert failed(replace(plan, shapes=plan.shapes[cut], poses=plan.poses[cut]), task) == {"distance to start"}


def test_skipping_rows_breaks_the_gripper_limits(good):
    """Every second row only: the steps are too long."""
    task, plan = good
    keep = np.r_[0 : plan.steps : 3, plan.steps]
    fast = replace(plan, shapes=plan.shapes[keep], poses=plan.poses[keep])
    assert {"gripper step", "gripper turn"} & failed(fast, task)


def test_shapes_no_rod_takes_are_found(good):
    """Keypoints moved by 5 mm in the middle, poses as before: the rod that follows says so."""
    task, plan = good
    bump = 0.005 * np.sin(np.linspace(0, np.pi, 13))[:, None] * np.sin(np.linspace(0, np.pi, len(plan.shapes)))
    shapes = plan.shapes.copy()
    shapes[..., 1] += bump.T
    assert "rod deviation" in failed(replace(plan, shapes=shapes), task)


def test_wrong_gripper_angles_are_found(good):
    """Angles off by 0.1 rad make another shape."""
    task, plan = good
    poses = plan.poses.copy()
    poses[1:, 0, 2] += 0.1
    assert "rod deviation" in failed(replace(plan, poses=poses), task)


def test_a_snap_is_found():
    """Pushed together past its fold and back, a bent cable does not return the way the plan says."""
    task = problems.free()
    rod = task.cable.rod
    shapes, poses = rod.shapes(np.array([problems.LOW_ARC, problems.LOW_ARC * [1, 1, 1, 1, 1, -1]]))
    keypoints = rod.at_keypoints(shapes)
    rows = np.linspace(0, 1, 40)[:, None, None]
    mirrored = keypoints[0] + rows * (keypoints[1] - keypoints[0])
    turned = poses[0] + rows * (poses[1] - poses[0])
    assert failed(Plan(mirrored, turned), task) & {"rod deviation", "rows the rod does not reach", "rod stability"}


def test_optional_limits_are_judged_where_the_task_has_them(good):
    """Separation and bend radius count only when they are asked for."""
    task, plan = good
    apart = Grippers(separation=0.29)
    object.__setattr__(judged := replace(task), "grippers", apart)
    assert failed(plan, judged) == {"gripper separation"}
    object.__setattr__(judged := replace(task), "cable", Cable(min_bend_radius=0.2))
    assert failed(plan, judged) == {"bend radius"}


def test_a_plan_for_another_cable_is_refused(good):
    """The number of keypoints must be the task's."""
    task, plan = good
    fewer = replace(plan, shapes=plan.shapes[:, ::2])
    with pytest.raises(InputError, match="7 keypoints, the task 13"):
        verify_plan(fewer, task)


def test_stated_gripper_poses_are_judged(good):
    """Where the task states poses, half a degree is near enough and two degrees are not."""
    task, plan = good
    near, far = plan.poses[-1].copy(), plan.poses[-1].copy()
    near[0, 2] += 0.009 + 2 * np.pi
    far[0, 2] += 0.035
    assert failed(plan, replace(task, goal_poses=near)) == set()
    object.__setattr__(judged := replace(task), "goal_poses", far)
    assert failed(plan, judged) == {"gripper angle to goal"}
