"""The judge of plugs: what is in their way, and how straight they go into their port."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely

from cableway.core.errors import InputError
from cableway.records import Check
from cableway.scene.files.loading import load_task
from cableway.scene.obstacles import Disc
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.verification.plug import insertion_checks, measure_insertion, plug_clearance, require_port


@pytest.fixture(scope="module")
def task() -> Task:
    return load_task("insertion")


def way_in(task: Task, aside: float = 0.0, turned: float = 0.0, depth: float | None = None) -> np.ndarray:
    """A straight insertion with the tip `aside` [m] of the axis and the plug `turned` [rad]."""
    assert task.plug is not None
    assert task.port is not None
    end = task.port.depth if depth is None else depth
    tips = np.linspace(-task.port.standoff, end, 14)
    poses = np.array([task.port.pose(task.plug, tip) for tip in tips])
    poses[:, :2] += [0.0, aside]
    poses[:, 2] += turned
    poses[:, 0] += task.plug.length * (1 - np.cos(turned))
    poses[:, 1] -= task.plug.length * np.sin(turned)
    return poses


def failures(checks: list[Check]) -> set[str]:
    return {check.name for check in checks if not check.passed}


def test_clearance_is_that_of_the_rectangle(task: Task):
    """On random motions in the open, the least distance of Shapely's polygons, sampled densely."""
    rng, walls = np.random.default_rng(3), shapely.box(0, 0, *task.scene.size).exterior
    assert task.plug is not None
    for _ in range(5):
        poses = np.array([[0.3, 0.45, 0.4]]) + rng.uniform(-1, 1, (3, 3)) * [0.04, 0.02, 0.4]
        least = np.inf
        for a, b in pairwise(task.plug.body.placed(poses, 0.04)):
            for f in np.linspace(0, 1, 200):
                area = shapely.Polygon(a + f * (b - a))
                least = min(least, area.distance(walls), *(area.distance(solid) for solid in task.scene.solids))
        (check,) = plug_clearance(poses, task, 0.0)
        assert check.value == pytest.approx(least, abs=6e-4)


def test_no_plug_no_check(task: Task):
    assert plug_clearance(way_in(task), replace(task, plug=None, port=None), 0.004) == []


def test_what_is_in_the_plugs_way_is_found_between_rows(task: Task):
    poses = np.array([[0.2, 0.5, 0.0], [0.2, 0.2, 0.0]])
    blocked = replace(task, scene=Scene(task.scene.size, (Disc(center=(0.23, 0.4), radius=0.004),)), port=None)
    (check,) = plug_clearance(poses, blocked, 0.0)
    assert not check.passed
    assert check.value < -0.002
    assert "obstacles[0] (disc" in check.where


def test_touching_fails_even_where_nothing_is_asked(task: Task):
    assert task.plug is not None
    edge = task.scene.solids[0].bounds[0] - task.plug.length
    (check,) = plug_clearance(np.array([[edge, 0.47, 0.0]]), task, 0.0)
    assert (check.passed, check.value) == (False, 0.0)


def test_a_straight_push_passes(task: Task):
    poses = way_in(task)
    assert failures([*plug_clearance(poses, task, 0.004, inserting=True), *insertion_checks(poses, task)]) == set()
    found = measure_insertion(poses, task)
    assert found.inserted
    assert found.depth == pytest.approx(0.012)
    assert str(found) == (
        "yes, 12.0 mm deep, 0.00 mm and 0.00 degrees off at the port, 0.00 mm and 0.00 degrees off at the end"
    )


@pytest.mark.parametrize(
    ("insertion", "name"),
    [
        ({"aside": 0.0022}, "plug misalignment"),
        ({"aside": -0.0022}, "plug misalignment"),
        ({"turned": 0.055}, "plug angle"),
        ({"turned": -0.055}, "plug angle"),
        ({"depth": 0.0105}, "inserted depth"),
    ],
)
def test_what_is_not_straight_or_deep_enough_fails(task: Task, insertion: dict[str, float], name: str):
    poses = way_in(task, **insertion)
    assert failures(insertion_checks(poses, task)) == {name}
    assert not measure_insertion(poses, task).inserted


def test_a_little_is_allowed(task: Task):
    poses = way_in(task, aside=0.0018, turned=0.05, depth=0.0112)
    assert failures(insertion_checks(poses, task)) == set()
    found = measure_insertion(poses, task)
    assert (found.inserted, found.lateral_at_mouth) == (True, pytest.approx(0.0018))
    assert found.angle == pytest.approx(0.05)


def test_alignment_is_that_at_the_mouth_not_only_at_the_end(task: Task):
    """A tip that comes in 3 mm aside and ends on the axis was not aligned."""
    poses = way_in(task)
    assert task.plug is not None
    assert task.port is not None
    depth = task.port.alignment(task.plug, poses).depth
    poses[:, 1] += np.interp(depth, [0.0, task.port.depth], [0.003, 0.0])
    found = measure_insertion(poses, task)
    assert (found.inserted, found.lateral_at_mouth) == (False, pytest.approx(0.003, abs=2e-4))
    assert found.lateral == pytest.approx(0.0, abs=1e-9)


def test_a_plug_that_never_came_to_the_port_is_not_in(task: Task):
    poses = way_in(task, depth=-0.005)
    found = measure_insertion(poses, task)
    assert (found.inserted, found.lateral_at_mouth, found.angle_at_mouth) == (False, None, None)
    assert failures(insertion_checks(poses, task)) == {"inserted depth", "plug misalignment", "plug angle"}


def test_the_box_of_the_port_counts_until_the_mouth(task: Task):
    """A plug turned by half a radian has a corner in the box while its tip is still 2 mm before the mouth."""
    poses = way_in(task, turned=0.5, depth=-0.002)
    assert failures(plug_clearance(poses, task, 0.0, inserting=True)) == {"plug clearance before the port"}
    assert failures(plug_clearance(poses[:-1], task, 0.0, inserting=True)) == set()


def test_other_obstacles_count_all_the_way(task: Task):
    pin = Disc(center=(0.56, 0.485), radius=0.005)
    crowded = replace(task, scene=Scene(task.scene.size, (*task.scene.obstacles, pin)))
    checks = plug_clearance(way_in(task), crowded, 0.006, inserting=True)
    assert failures(checks) == {"plug clearance"}


def test_a_task_without_a_port_is_refused(task: Task):
    with pytest.raises(InputError, match=r"^task 'insertion' has no port$"):
        require_port(replace(task, port=None))
