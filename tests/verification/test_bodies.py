"""The judge's own bodies: what the planner makes passes, what ignores bodies does not, and both measure the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import cableway as cw
from cableway.geometry.groups import SE2
from cableway.records import Plan
from cableway.scene.clearance import pieces_clearance
from cableway.scene.obstacles import Disc
from cableway.scene.task import Task
from cableway.simulation.table_plant import TablePlant
from cableway.tasks.generation import random_task_with_witness
from cableway.verification.bodies import body_checks, piece_clearances
from cableway.verification.geometry import curve_through


@pytest.fixture(scope="module", params=[2, 3])
def planned(request: pytest.FixtureRequest) -> tuple[Task, Plan]:
    """A task with posts and its plan."""
    task = cw.random_task(request.param, "posts")
    return task, cw.plan(task, seed=0)


@pytest.fixture(scope="module")
def run(planned: tuple[Task, Plan]) -> cw.Run:
    """The plan, followed with feedback."""
    task, plan = planned
    return cw.solve(task, cw.SolveOptions(plan=plan))


def test_plans_pass(planned: tuple[Task, Plan]):
    task, plan = planned
    verdict = cw.verify_plan(plan, task)
    assert verdict.passed
    assert {check.name for check in verdict.checks} >= {"gripper body clearance", "gripper bodies apart"}


def test_judge_and_planner_measure_the_same(planned: tuple[Task, Plan]):
    task, plan = planned
    lines = curve_through(plan.shapes, 4)
    ours, theirs = pieces_clearance(lines, plan.poses, task), piece_clearances(plan.poses, lines, task)
    np.testing.assert_allclose(ours, theirs, atol=1e-4)


def test_a_post_beside_the_way_of_a_hand_fails_it(planned: tuple[Task, Plan]):
    """The cable and the discs pass it by."""
    task, plan = planned
    pose = plan.poses[len(plan.poses) // 2, 0]
    aside = pose[:2] + 0.03 * np.array([-np.sin(pose[2]), np.cos(pose[2])])
    post = Disc(center=(float(aside[0]), float(aside[1])), radius=0.003, height=0.16)
    changed = task.in_scene(replace(task.scene, obstacles=(*task.scene.obstacles, post)))
    failures = {check.name for check in cw.verify_plan(plan, changed).failures()}
    assert "gripper body clearance" in failures
    lower = task.in_scene(replace(task.scene, obstacles=(*task.scene.obstacles, replace(post, height=0.001))))
    assert "gripper body clearance" not in {check.name for check in cw.verify_plan(plan, lower).failures()}


def test_hands_in_each_other_and_on_the_cable_fail():
    """The left gripper is led to beside the right one, as no cable allows, and across the cable."""
    task, witness = random_task_with_witness(2, "posts")
    assert witness is not None
    stations, poses = task.cable.rod.shapes(witness.q)
    poses = poses.copy()
    poses[:, 0, :2] = stations[:, 40]
    names = {check.name for check in body_checks(stations, poses, task, 0.0) if not check.passed}
    assert names >= {"gripper body from the cable", "gripper bodies apart"}


def test_a_run_records_the_clearance_of_the_hands(planned: tuple[Task, Plan], run: cw.Run):
    task = planned[0]
    assert run.report.success
    assert run.rollout is not None
    found = piece_clearances(run.rollout.poses, run.rollout.centreline, task)
    assert (run.rollout.gripper_clearance <= found + 1e-4).all()
    assert run.rollout.gripper_clearance.min() < 0.05


def test_a_record_that_leaves_the_hands_out_is_found(planned: tuple[Task, Plan], run: cw.Run):
    """Clearances that the discs do have."""
    task, rollout = planned[0], run.rollout
    assert rollout is not None
    forged = replace(rollout, gripper_clearance=rollout.gripper_clearance + 0.022)
    discs = [task.scene.signed_distance(poses[:, :2]).min() - task.grippers.radius for poses in rollout.poses]
    assert (forged.gripper_clearance < discs).any()
    failures = {check.name for check in cw.verify_rollout(forged, task).failures()}
    assert failures == {"recorded gripper clearance above that of its row"}


def test_hands_are_judged_where_they_are_and_not_where_the_ends_are_that_they_hold_askew(
    planned: tuple[Task, Plan], run: cw.Run
):
    """A record has the poses of the ends, and may state how these are held."""
    task, rollout = planned[0], run.rollout
    assert rollout is not None
    offsets = [[-0.003, 0.004, 0.12], [0.002, -0.003, -0.1]]
    held = SE2.compose(rollout.poses, np.array(offsets))
    plant = rollout.metadata["plant"] | {"grasp": dict(zip(("left", "right"), offsets, strict=True))}
    askew = replace(rollout, poses=held, metadata=rollout.metadata | {"plant": plant})
    hands = [{check.name: check.value for check in cw.verify_rollout(each, task).checks} for each in (rollout, askew)]
    for name in ("gripper clearance", "gripper body clearance", "gripper bodies apart", "gripper body from the cable"):
        assert hands[1][name] == pytest.approx(hands[0][name], abs=1e-9)


@pytest.mark.parametrize("plant", [cw.CableSimulator, TablePlant])
def test_plants_measure_the_hands(planned: tuple[Task, Plan], plant: type):
    """Beside a post that is near to a hand alone."""
    task, plan = planned
    pose = plan.poses[0, 0]
    aside = pose[:2] + 0.07 * np.array([-np.sin(pose[2]), np.cos(pose[2])])
    post = Disc(center=(float(aside[0]), float(aside[1])), radius=0.003, height=0.16)
    beside = plant(task.in_scene(replace(task.scene, obstacles=(post,))))
    beside.reset()
    beside.step(np.zeros((2, 3)))
    assert 0 < beside.measure().gripper_clearance < 0.012
    assert beside.measure().clearance > 0.03
