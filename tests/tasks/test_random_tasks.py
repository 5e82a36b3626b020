"""Laws of random tasks: a witness verifies, blocked ones have no way, and a seed makes the same file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from cableway.core.errors import CablewayError, InputError
from cableway.records import Plan
from cableway.robot.branches import ArmMotion, arm_motion
from cableway.scene.files.loading import load_task
from cableway.scene.files.saving import save_task
from cableway.scene.task import Task
from cableway.tasks.generation import KINDS, Witness, random_task, random_task_with_witness
from cableway.verification import verify_plan

SOLVABLE = {
    "clutter": (0, 1),
    "dense": (1, 2),
    "sizes": (4, 5),
    "posts": (0, 1),
    "cell": (0, 1, 3),
    "cell-clutter": (1,),
    "cell-dense": (2,),
    "straight": (2, 3),
    "s-shaped": (0,),
    "table": (0,),
    "slot": (2, 3),
    "corridor": (1,),
    "serpentine": (2,),
    "maze": (1,),
}
OPEN = ("open-near", "open-far")
CASES = [(kind, seed) for kind, seeds in SOLVABLE.items() for seed in seeds]


def plan_of(task: Task, witness: Witness) -> Plan:
    """The witness as a plan."""
    rod = task.cable.rod
    stations, poses = rod.shapes(witness.q)
    plan = Plan(np.ascontiguousarray(rod.at_keypoints(stations)), poses)
    if task.cell is None:
        return plan
    motion = arm_motion(poses, task, task.cell)
    assert isinstance(motion, ArmMotion)
    return replace(plan, joints=motion.joints, metadata={"arms": motion.way.described()})


def test_every_kind_is_tried():
    assert {*SOLVABLE, *OPEN, "blocked"} == set(KINDS)


@pytest.mark.parametrize("kind", OPEN)
def test_without_obstacles_the_witness_is_a_plan(kind: str):
    for seed in range(3):
        task, witness = random_task_with_witness(seed, kind)
        assert witness is not None
        assert not task.scene.obstacles
        assert verify_plan(plan_of(task, witness), task).passed
        assert np.linalg.norm(task.goal - task.start, axis=1).mean() > 0.1 * task.cable.length


@pytest.mark.parametrize(("kind", "seed"), CASES)
def test_the_witness_is_a_plan_and_the_straight_way_none(kind: str, seed: int):
    task, witness = random_task_with_witness(seed, kind)
    assert witness is not None
    verdict = verify_plan(plan_of(task, witness), task)
    assert verdict.passed, str(verdict)
    assert np.linalg.norm(task.goal - task.start, axis=1).mean() > 0.4 * task.cable.length
    assert touches(task, witness.q[[0, -1]])


def touches(task: Task, ends: np.ndarray) -> bool:
    """Whether the cable meets an obstacle or wall on the straight line in q, by Shapely."""
    ends = np.array([ends[0], ends[1]])
    ends[1, 2] -= 2 * np.pi * np.round((ends[1, 2] - ends[0, 2]) / (2 * np.pi))
    rows = ends[0] + np.linspace(0, 1, 400)[:, None] * (ends[1] - ends[0])
    cables = shapely.buffer(shapely.linestrings(task.cable.rod.shapes(rows)[0]), task.cable.radius)
    table = shapely.box(0, 0, *task.scene.size)
    return bool(
        shapely.intersects(cables, shapely.union_all(task.scene.solids)).any()
        or not shapely.contains(table, cables).all()
    )


@pytest.mark.parametrize("seed", range(8))
def test_a_blocked_task_leaves_a_gripper_or_the_cable_no_way(seed: int):
    task, witness = random_task_with_witness(seed, "blocked")
    assert witness is None
    middle = task.cable.keypoints // 2
    bodies = ((0, task.grippers.radius), (-1, task.grippers.radius), (middle, task.cable.radius))
    assert any(parted(task, task.start[k], task.goal[k], radius) for k, radius in bodies)


def parted(task: Task, start: np.ndarray, goal: np.ndarray, radius: float) -> bool:
    """Whether no path of a disc's centre joins two places, by Shapely."""
    grown = shapely.union_all(shapely.buffer(np.array(task.scene.solids), radius))
    free = shapely.box(0, 0, *task.scene.size).buffer(-radius).difference(grown)
    parts = shapely.get_parts(free)
    return not any(part.contains(shapely.Point(start)) and part.contains(shapely.Point(goal)) for part in parts)


@pytest.mark.parametrize("kind", ["clutter", "blocked"])
def test_a_seed_makes_the_same_file_which_reads_back_to_the_same_task(kind: str, tmp_path: Path):
    files = [tmp_path / name for name in ("a.yaml", "b.yaml", "c.yaml")]
    task = random_task(3, kind)
    save_task(task, files[0])
    save_task(random_task(3, kind), files[1])
    again = load_task(files[0])
    save_task(again, files[2])
    assert again == task
    assert files[0].read_bytes() == files[1].read_bytes() == files[2].read_bytes()


def test_dense_tasks_are_dense_and_passable():
    task = random_task(1, "dense")
    solids = np.array(task.scene.solids)
    assert 10 <= len(solids) <= 14
    gaps = [shapely.distance(a, b) for i, a in enumerate(solids) for b in solids[:i]]
    assert min(gaps) >= 0.025


def test_grippers_and_heights_between_arms_come_in_turn():
    for kind, seed, body, height in (("cell-dense", 3, "2f-85-long-fingers", 0.1), ("cell-clutter", 4, "2f-85", 0.05)):
        task = random_task(seed, kind)
        assert (task.grippers.body, {obstacle.height for obstacle in task.scene.obstacles}) == (body, {height})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (dict(seed=0, kind="fog"), "unknown kind of random task 'fog'; known: blocked, cell, cell-clutter"),
        (dict(seed=-1, kind="clutter"), "seed must not be negative, got -1"),
        (dict(seed=0, kind="clutter", width=0.1), "width is not for clutter; kinds with a width: slot"),
        (dict(seed=0, kind="slot", width=0.01), "width of slot must be from 0.025 to 0.2 m, got 0.01"),
        (dict(seed=0, kind="slot", width=float("nan")), "width of slot must be from 0.025 to 0.2 m, got nan"),
    ],
)
def test_wrong_arguments_are_told_what_is_right(arguments: dict, message: str):
    with pytest.raises(CablewayError, match=message.replace("(", r"\(")) as caught:
        random_task(**arguments)
    assert isinstance(caught.value, InputError)
