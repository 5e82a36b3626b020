"""Laws of arms in space: hands are where grippers are, the search sees what the judge measures, faults are found."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cableway.cli.entry import main
from cableway.core.errors import InputError, PlanningError, TaskError
from cableway.geometry import rotations
from cableway.planning.spatial_planner import plan_in_space
from cableway.records import Plan, Verdict
from cableway.robot.spatial_arms import SpatialArms, SpatialWay
from cableway.scene.cell import CELLS, TOOLS
from cableway.scene.files.loading import load_task
from cableway.scene.spatial.obstacles import Sphere
from cableway.scene.spatial.task import SpatialTask
from cableway.tasks.space.generation import random_spatial_task
from cableway.verification.arms import TOOL, flanges_of, solids_of
from cableway.verification.spatial_arms import spatial_arm_checks
from cableway.verification.spatial_plan import verify_spatial_plan
from cableway.workflow.spatial_run import follow_in_space

pytest.importorskip("coal")


@pytest.fixture(scope="module")
def task() -> SpatialTask:
    return random_spatial_task(4, "yu", cell="dual-ur5e")


@pytest.fixture(scope="module")
def plan(task: SpatialTask) -> Plan:
    return plan_in_space(task)


def way_of(plan: Plan) -> SpatialWay:
    held = plan.metadata["arms"]
    return SpatialWay(*(tuple(held[name]) for name in SpatialWay._fields))


def test_hands_are_where_grippers_are(task: SpatialTask):
    arms, poses = SpatialArms(task), np.stack([task.gripper_poses("start"), task.gripper_poses("goal")])
    ways = arms.ways()
    assert not isinstance(ways, str)
    assert len({way.holders for way in ways}) >= 1
    for way in ways[:8]:
        joints = arms.joints(poses, way)
        for side in range(2):
            flange = flanges_of(arms.cell, way.holders[side], joints[:, side], task)
            axes = rotations.matrices(poses[:, side, 3:])
            hand = np.cos(way.rolls[side]) * axes[:, :, 2] - np.sin(way.rolls[side]) * axes[:, :, 1]
            np.testing.assert_allclose(flange[:, :3, 2], -hand, atol=1e-9)
            np.testing.assert_allclose(flange[:, :3, 0], (2 * way.turns[side] - 1) * axes[:, :, 0], atol=1e-9)
            tip = flange[:, :3, 3] + TOOLS["2f-85"].reach * flange[:, :3, 2]
            np.testing.assert_allclose(tip, poses[:, side, :3], atol=1e-9)


def test_a_plan_between_arms_is_made_that_a_plan_for_grippers_alone_is_not(task: SpatialTask, plan: Plan):
    assert plan.verdict is not None
    assert plan.verdict.passed
    assert {"tool distance", "arm clearance from the cable"} <= {check.name for check in plan.verdict.checks}
    alone = plan_in_space(replace(task, cell=None))
    assert alone.joints is None
    arms, ways = SpatialArms(task, 0.0), SpatialArms(task).ways()
    stations = task.rod.shapes(alone.q)[0]
    assert all(isinstance(arms.along(alone.poses, stations, way), str) for way in ways if isinstance(way, SpatialWay))


def test_the_search_keeps_what_the_judge_measures(task: SpatialTask, plan: Plan):
    judged = {check.name: check.value for check in spatial_arm_checks(plan, task)}
    least = min(value for name, value in judged.items() if name.startswith("arm clearance"))
    stations = task.rod.shapes(plan.q)[0]
    assert not isinstance(SpatialArms(task, least).along(plan.poses, stations, way_of(plan)), str)
    refused = SpatialArms(task, least + 0.004).along(plan.poses, stations, way_of(plan))
    assert isinstance(refused, str)  # the judge takes up to 4 mm off for what it does not look at
    assert re.fullmatch(r"the arms cannot follow beyond \d+\.\d s of \d+\.\d s", refused)


def faults(plan: Plan, task: SpatialTask) -> set[str]:
    return {check.name for check in Verdict(tuple(spatial_arm_checks(plan, task))).failures()}


def test_the_judge_finds_what_is_wrong_with_arms(task: SpatialTask, plan: Plan):
    few = slice(plan.steps // 2, plan.steps // 2 + 12)
    assert plan.joints is not None
    plan = Plan(plan.shapes[few], plan.poses[few], joints=plan.joints[few], metadata=plan.metadata)
    assert plan.joints is not None
    assert faults(plan, task) == set()
    told: dict[str, Any] = plan.metadata["arms"]

    def said(**changes: Any) -> Plan:
        return replace(plan, metadata={**plan.metadata, "arms": {**told, **changes}})

    assert "tool distance" in faults(replace(plan, joints=plan.joints + 0.01), task)
    assert faults(said(rolls=[told["rolls"][0] + 0.02, told["rolls"][1]]), task) == {"tool angle"}
    assert faults(said(turns=[1 - told["turns"][0], told["turns"][1]]), task) == {"tool angle"}
    assert "tool distance" in faults(said(holders=told["holders"][::-1]), task)
    for broken in (said(rolls=["x", 0]), replace(plan, joints=None), replace(plan, metadata={})):
        assert faults(broken, task) == {"arms"}
    quick = plan.joints.copy()
    quick[1:, 0, 5] += 0.5
    assert "joint speed" in faults(replace(plan, joints=quick), task)
    assert task.cell is not None
    links = solids_of(task.cell, told["holders"][0], plan.joints[[6], 0], task)
    elbow, hand = (next(each for each in links if each.link == k).ends[0].mean(axis=0) for k in (3, TOOL))
    inside = Sphere(center=tuple(np.clip(elbow, 0.0, task.scene.size)), radius=0.04)
    crowded = replace(task, scene=replace(task.scene, obstacles=(*task.scene.obstacles, inside)))
    assert faults(plan, crowded) == {"arm clearance from the scene"}
    first, second = task.cell.arms
    beside = replace(task.cell, arms=(first, replace(second, position=(-0.45, 0.1, 0.15))))
    assert "arm clearance" in faults(plan, replace(task, cell=beside))
    coiled = plan.shapes.copy()
    coiled[:, 6] = hand
    assert "arm clearance from the cable" in faults(replace(plan, shapes=coiled), task)
    for arms, shapes in ((SpatialArms(crowded, 0.0), plan.shapes), (SpatialArms(task, 0.0), coiled)):
        assert isinstance(arms.along(plan.poses, shapes, way_of(plan)), str), "the search sees the same"
    assert "arms" in {check.name for check in verify_spatial_plan(replace(plan, joints=None), task).failures()}


def test_arms_that_cannot_hold_the_ends_are_said(task: SpatialTask):
    assert task.cell is not None
    first, second = task.cell.arms
    away = replace(task.cell, arms=(replace(first, position=(-3.0, 0.0, 0.0)), second))
    with pytest.raises(PlanningError, match=r"one arm would have to hold both|no arm can hold") as caught:
        plan_in_space(replace(task, cell=away))
    assert caught.value.outcome == "infeasible"
    with pytest.raises(TaskError, match=r"cell\.tilt must be 0 in space"):
        replace(task, cell=CELLS["dual-ur5e-tilted"])


def test_a_cell_in_space_is_written_read_drawn_and_not_simulated(task: SpatialTask, plan: Plan, tmp_path: Path):
    task.save(tmp_path / "task.yaml")
    assert load_task(tmp_path / "task.yaml") == task
    plan.save(tmp_path / "plan.npz")
    assert main(["check", str(tmp_path / "task.yaml"), str(tmp_path / "plan.npz"), "--quiet"]) == 0
    with pytest.raises(InputError, match="planned for and judged, but not simulated"):
        follow_in_space(task, plan)
    shown = ["show", str(tmp_path / "task.yaml"), str(tmp_path / "plan.npz"), "--out", str(tmp_path / "out")]
    assert main([*shown, "--quiet"]) == 0
    assert (tmp_path / "out" / "plan.png").exists()
