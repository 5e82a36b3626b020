"""Laws of arms in space: hands are where grippers are, the search sees what the judge measures, faults are found."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cableway.cli.entry import main
from cableway.core.errors import InputError, PlanningError, TaskError
from cableway.geometry import rotations
from cableway.geometry.spatial_convex import SpatialWorld, signed_distance
from cableway.planning.spatial_planner import plan_in_space
from cableway.records import Plan, Verdict
from cableway.robot.branches import SINGULAR
from cableway.robot.free_spatial_arms import arm_joints, bends, own_room
from cableway.robot.links import arm_clearances
from cableway.robot.spatial_arms import SpatialArms, SpatialWay
from cableway.scene.arm_models import ARM_MODELS
from cableway.scene.cell import CELLS, TOOLS
from cableway.scene.files.loading import load_task
from cableway.scene.own_arms import OwnArm
from cableway.scene.spatial.obstacles import Sphere
from cableway.scene.spatial.task import SpatialTask
from cableway.studio.opening import opened
from cableway.tasks.space.generation import random_spatial_task
from cableway.verification.arms import TOOL, flanges_of, solids_of
from cableway.verification.spatial_arms import spatial_arm_checks
from cableway.verification.spatial_plan import verify_spatial_plan
from cableway.workflow import solve_in_space
from cableway.workflow.solve_in_space import SpatialOptions
from cableway.workflow.spatial_run import follow_in_space

pytest.importorskip("coal")

Hold = tuple[int, float, int, int]
"""Arm, roll, turn and branch."""


@pytest.fixture(scope="module")
def task() -> SpatialTask:
    return random_spatial_task(4, "yu", cell="dual-ur5e")


@pytest.fixture(scope="module")
def plan(task: SpatialTask) -> Plan:
    return plan_in_space(task)


def way_of(plan: Plan) -> SpatialWay:
    way = SpatialWay.of_record(plan.metadata)
    assert way is not None
    return way


def together(left: Hold, right: Hold) -> SpatialWay:
    return SpatialWay(*zip(left, right, strict=True))  # pyright: ignore[reportArgumentType]


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
    made = min(check.value for check in spatial_arm_checks(plan, task) if check.name.startswith("arm clearance"))
    assert made > 0.011, "the optimisation makes more room than the search"
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


def test_the_search_and_the_judge_agree_on_ways_of_holding(task: SpatialTask):
    """At the start, in ways drawn among those in which both arms reach."""
    arms, rng, found = SpatialArms(task, 0.01), np.random.default_rng(0), Counter()
    poses, stations, shapes = (
        np.repeat(each[None], 2, axis=0)
        for each in (task.gripper_poses("start"), task.stations("start"), task.keypoints("start"))
    )

    def reaching(side: int) -> list[tuple[float, Hold]]:
        """In which ways an arm reaches, and what it keeps alone."""
        reached = []
        for one in product((0, 1), 2 * np.pi * np.arange(24) / 24, (0,), range(8)):
            other = (1 - one[0], *one[1:])
            *held, around = arms.held(together(*((one, other) if side == 0 else (other, one))))
            arm, joints = held[side], np.empty((1, 6))
            if arm_joints(poses[0, side], arm, joints[0]) >= SINGULAR:
                ends = np.empty((1, len(arm.capsules.frame), 2, 3))
                reached.append((own_room(arm, joints, stations[0], bool(side), around, 0.05, ends), one))
        return reached

    left, right = (reaching(side) for side in (0, 1))
    pairs = [(one, other, min(a, b) >= 0.01) for (a, one), (b, other) in product(left, right) if one[0] != other[0]]
    some = [*rng.permutation(len(pairs))[:25], *rng.permutation([k for k, pair in enumerate(pairs) if pair[2]])[:60]]
    for index in some:
        way = together(*pairs[index][:2])
        joints = arms.joints(poses, way)
        plan = Plan(shapes, poses, joints=joints, metadata={"arms": way.described()})
        checks = {check.name: check for check in spatial_arm_checks(plan, task)}
        assert checks["tool distance"].passed
        clear = {name: check.value for name, check in checks.items() if name.startswith("arm clearance")}
        if isinstance(arms.along(poses, stations, way), str):
            assert min(clear.values()) < 0.0101 or not checks["joint position"].passed
            others = [value for name, value in clear.items() if name != "arm clearance"]
            apart = "itself" not in checks["arm clearance"].where
            found["the arms alone" if min(others) > 0.0101 and apart else "something"] += 1
        else:
            assert all(check.passed for check in checks.values())
            assert clear.pop("arm clearance") > 0.004  # folded elbows are left to limits of position
            assert min(clear.values()) > 0.0099
            found["kept"] += 1
    assert min(found[each] for each in ("kept", "the arms alone", "something")) >= 2, found


def test_the_room_of_an_arm_is_what_points_all_along_it_have(task: SpatialTask):
    """From a cable and a ball at random beside a link or the hand, from the table and itself."""
    ways, rng, nearest = SpatialArms(task).ways(), np.random.default_rng(1), Counter()
    assert not isinstance(ways, str)
    arm, _, around = SpatialArms(task).held(ways[0])
    around, capsules = around._replace(clearance=-np.inf), arm.capsules
    shares, line = np.linspace(0, 1, 61)[:, None], np.linspace(-0.15, 0.15, 25)[:, None]
    for trial in range(120):
        joints, placed = rng.uniform(-2.5, 2.5, (1, 6)), np.empty((1, len(capsules.frame), 2, 3))
        others = arm_clearances(arm.lengths, arm.base, joints, capsules, around.table, placed)[0]
        along, beside = (each / np.linalg.norm(each) for each in rng.normal(size=(2, 3)))
        at = placed[0, trial % len(capsules.frame), 0]
        stations = at + rng.uniform(0.05, 0.25) * beside + line * along
        ball = Sphere(center=tuple(at - rng.uniform(0.1, 0.3) * beside), radius=0.05).solid
        solid = SpatialWorld.of([ball], np.full(3, 200.0), np.full(3, -100.0))
        around = around._replace(worlds=(solid.arrays, solid.arrays))
        room = own_room(arm, joints, stations, bool(trial % 2), around, 0.1, placed.copy())
        cable = world = np.inf
        for k, (start, end) in enumerate(placed[0]):
            away = signed_distance(start + shares * (end - start), solid)[0].min() - capsules.radius[k]
            world = min(world, away)
            held = stations[::-1] if trial % 2 else stations
            free = held[np.ceil(around.held / 0.3 * 24).astype(int) :] if k >= capsules.hand else held
            dense = np.concatenate([free[:-1] + share * np.diff(free, axis=0) for share in shares[::3]])
            apart = np.linalg.norm((start + shares * (end - start))[:, None] - dense, axis=2).min()
            cable = min(cable, apart - capsules.radius[k] - around.radius)
        rooms = {"cable": cable, "ball": world, "others": others, "nothing": 0.1}
        nearest[min(rooms, key=lambda name: rooms[name])] += rooms["ball"] > 0
        assert room == pytest.approx(min(rooms.values()), abs=2e-3)
    assert min(nearest["cable"], nearest["ball"]) > 5


def at_speed(share: float, task: SpatialTask) -> SpatialTask:
    """The task between arms whose joints turn at a share of the speed of a UR5e's."""
    assert task.cell is not None
    model = ARM_MODELS["ur5e"]
    d1, a2, a3, d4, d5, d6 = model.lengths
    turn = np.pi / 2
    other = OwnArm(
        name="other", like="ur5e", capsules=model.capsules,
        speed_limit=tuple(share * speed for speed in model.speed_limit),
        dh=((0, d1, turn), (a2, 0, 0), (a3, 0, 0), (0, d4, turn), (0, d5, -turn), (0, d6, 0)),
    )  # fmt: skip
    return task.in_cell(replace(task.cell, arms=tuple(replace(arm, model=other) for arm in task.cell.arms)))


def test_slow_joints_are_given_the_time_that_they_need(task: SpatialTask):
    slower = plan_in_space(at_speed(0.1, task))
    assert slower.verdict is not None
    assert slower.verdict.passed
    (speed,) = (check for check in slower.verdict.checks if check.name == "joint speed")
    assert 0.5 < speed.value <= 1.0, "the joints are what is slow"


def test_where_rows_are_far_apart_a_tool_is_off_its_way_as_the_judge_has_it(task: SpatialTask, plan: Plan):
    arms, way, stations = SpatialArms(task, 0.0), way_of(plan), task.rod.shapes(plan.q)[0]
    for stride in (1, 3, 8, 14):
        names = ("shapes", "poses", "q", "joints")
        few = replace(plan, **{name: getattr(plan, name)[::stride] for name in names})
        assert few.joints is not None
        judged = {check.name: check.value for check in spatial_arm_checks(few, task)}
        found = np.empty((2, len(few.joints) - 1, 2))
        for arm, joints, out in zip(arms.held(way)[:2], few.joints.swapaxes(0, 1), found, strict=True):
            bends(arm, np.ascontiguousarray(joints), out)
        off, turn = found.max(axis=(0, 1))
        assert off == pytest.approx(judged["tool distance"], rel=0.02)
        assert turn == pytest.approx(judged["tool angle"], rel=0.15)
        steps = SpatialArms(at_speed(10.0, task)).effort(few.joints, way)
        assert steps.max() == pytest.approx(max(off / 0.8e-3, turn / 8e-3) ** 0.5, rel=1e-6)
        followed = arms.along(few.poses, stations[::stride], way)
        assert isinstance(followed, str) == (stride > 3)


def test_where_grippers_have_a_body_the_hand_is_there():
    held = random_spatial_task(1, "yu", body="2f-85", cell="dual-ur5e")
    made = plan_in_space(held)
    assert way_of(made).rolls == (0.0, 0.0)
    assert faults(made, held) == set()
    free = replace(held, grippers=replace(held.grippers, body=None))
    other = plan_in_space(free)
    assert way_of(other).rolls != (0.0, 0.0)
    assert faults(other, free) == set()
    assert "tool angle" in faults(other, held)
    with pytest.raises(TaskError, match=r"grippers\.body must be left out, or be the cell's tool, 2f-85, got 'hand-e'"):
        replace(held, grippers=replace(held.grippers, body="hand-e"))


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


def test_a_cell_in_space_is_written_read_drawn_and_not_simulated(
    task: SpatialTask, plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    task.save(tmp_path / "task.yaml")
    assert load_task(tmp_path / "task.yaml") == task
    plan.save(tmp_path / "plan.npz")
    assert main(["check", str(tmp_path / "task.yaml"), str(tmp_path / "plan.npz"), "--quiet"]) == 0
    monkeypatch.setattr(solve_in_space, "find_plan", lambda *_, **__: pytest.fail("it is refused before planning"))
    for led in (
        lambda: follow_in_space(task, plan),
        lambda: solve_in_space.solve_in_space(task, SpatialOptions(controller="rod-mpc")),
    ):
        with pytest.raises(InputError, match="planned for and judged, but not simulated"):
            led()
    assert task.cell is not None
    assert opened(replace(task, cell=None), "dual-ur5e").draft.cell == task.cell
    shown = ["show", str(tmp_path / "task.yaml"), str(tmp_path / "plan.npz"), "--out", str(tmp_path / "out")]
    assert main([*shown, "--quiet"]) == 0
    assert (tmp_path / "out" / "plan.png").exists()
