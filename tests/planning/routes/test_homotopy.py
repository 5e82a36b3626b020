"""Homotopy classes: words of known paths, plans of different classes, and ways asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import problems
import pytest

from cableway.core.errors import InputError, PlanningError
from cableway.planning.alternatives import plan_cost
from cableway.planning.config import PivotConfig
from cableway.planning.planner import plan
from cableway.planning.routes.homotopy import different_routes, motion_class, signature, unmet_request
from cableway.planning.routes.passages import find_passages
from cableway.scene.files.loading import load_task
from cableway.scene.obstacles import Box, Disc
from cableway.scene.scene import Scene
from cableway.tasks.generation import random_task
from cableway.verification import verify_plan

THREE = Scene((1.0, 1.0), tuple(Disc(center=(x, 0.5), radius=0.05) for x in (0.3, 0.5, 0.7)))


def through(*points: tuple[float, float]) -> np.ndarray:
    return np.array([(0.1, 0.5), *points, (0.9, 0.5)])


@pytest.mark.parametrize(
    ("points", "letters"),
    [
        ([(0.3, 0.2), (0.7, 0.2)], 0),
        ([(0.3, 0.8), (0.7, 0.8)], 3),
        ([(0.3, 0.8), (0.4, 0.5), (0.5, 0.2), (0.6, 0.5), (0.7, 0.8)], 2),
        ([(0.4, 0.8), (0.4, 0.9), (0.2, 0.9), (0.2, 0.2)], 0),
        ([(0.3, 0.8), (0.4, 0.2), (0.2, 0.2), (0.3, 0.8), (0.4, 0.2)], 2),
    ],
)
def test_words_of_known_paths(points, letters):
    """Below all, above all, in and out, there and back again (which cancels), and once round the first disc."""
    assert len(signature(THREE, through(*points))) == letters


def test_a_path_and_its_reverse_cancel():
    rng = np.random.default_rng(0)
    for _ in range(20):
        path = rng.uniform(0, 1, (30, 2))
        assert signature(THREE, np.vstack([path, path[::-1]])) == ()
        assert signature(THREE, path[::-1]) == tuple(-letter for letter in signature(THREE, path)[::-1])


def test_a_small_change_leaves_the_class():
    """Moving vertices by less than the path's distance to every obstacle changes no class."""
    rng = np.random.default_rng(1)
    path = through((0.3, 0.8), (0.4, 0.5), (0.5, 0.2), (0.6, 0.5), (0.7, 0.8))
    fine = np.column_stack([np.interp(np.linspace(0, 6, 200), np.arange(7), column) for column in path.T])
    room = THREE.signed_distance(fine).min()
    for _ in range(20):
        moved = fine + rng.uniform(-0.5, 0.5, fine.shape) * room
        moved[[0, -1]] = fine[[0, -1]]
        assert signature(THREE, moved) == signature(THREE, fine)


def test_obstacles_that_touch_are_one():
    """Nothing passes between them, so one ray is enough."""
    pair = Scene((1.0, 1.0), (Box(center=(0.45, 0.5), size=(0.1, 0.1)), Box(center=(0.55, 0.5), size=(0.1, 0.1))))
    assert len(signature(pair, through((0.5, 0.8)))) == 1


def two_islands():
    """Two discs in the way, with room on both sides of each: three ways."""
    discs = (Disc(center=(0.2, 0.36), radius=0.05), Disc(center=(0.45, 0.36), radius=0.05))
    return problems.task_between(problems.LOW_ARC, problems.HIGH_ARC, discs, name="two-islands")


def test_routes_differ():
    task = two_islands()
    routes = list(different_routes(task, PivotConfig(), 0, 5))  # the next ones close every way, and take seconds
    words = [signature(task.scene, route) for route in routes]
    assert len(set(words)) == len(words) >= 3


def test_alternatives_are_true_different_and_ranked():
    task = two_islands()
    plans = plan(task, alternatives=3)
    assert len(plans) == 3
    assert len({motion_class(task, found.shapes) for found in plans}) == 3
    assert all(verify_plan(found, task).passed for found in plans)
    costs = [plan_cost(found, task) for found in plans]
    assert costs == sorted(costs)


@pytest.mark.parametrize(("name", "count"), [("multi-obstacle-1", 2), ("clutter-7", 1), ("clutter-21", 2)])
def test_the_default_plan_is_among_the_alternatives(name: str, count: int):
    """So the first is never worse than the plan that is found where none are asked for."""
    kind, _, seed = name.partition("-")
    task = random_task(int(seed), kind) if kind == "clutter" else load_task(name)
    default, plans = plan(task), plan(task, alternatives=2)
    assert any(np.array_equal(found.poses, default.poses) for found in plans)
    assert plan_cost(plans[0], task) <= plan_cost(default, task)
    assert len({motion_class(task, found.shapes) for found in plans}) == len(plans) == count


def test_alternatives_where_there_is_one_way_only():
    assert len(plan(problems.doorway(), alternatives=3)) == 1
    with pytest.raises(PlanningError, match="there is no plan: the left gripper needs a route 16 mm wide"):
        plan(problems.sealed(), alternatives=3)
    with pytest.raises(InputError, match="alternatives must be 1 or more"):
        plan(problems.free(), alternatives=0)


def test_a_way_that_is_asked_for():
    """Through the passage of the best plan, and not through it."""
    task = two_islands()
    passages = find_passages(task.scene)
    between = next(passage for passage in passages if passage.between == (0, 1))
    with_it, without = plan(task, through=[between]), plan(task, avoiding=[between])
    assert motion_class(task, with_it.shapes) != motion_class(task, without.shapes)
    assert verify_plan(without, task).passed
    leftmost = next(passage for passage in passages if passage.between == (0, 2))
    left = plan(task, through=[leftmost], avoiding=[between])
    assert left.shapes[:, 6, 0].min() < 0.2


def test_a_motion_is_held_to_the_way_asked_for():
    """Its middle goes through two gaps between three discs, the left one first, and not past the right end."""
    discs = tuple(Disc(center=(x, 0.4), radius=0.03) for x in (0.2, 0.35, 0.5))
    task = problems.task_between(problems.LOW_ARC, problems.HIGH_ARC, discs, name="three-discs")
    passages = {passage.between: passage for passage in find_passages(task.scene)}
    left, right = passages[0, 1], passages[1, 2]
    middle = np.array([(0.275, 0.3), (0.275, 0.5), (0.35, 0.5), (0.35, 0.48), (0.425, 0.48), (0.425, 0.3)])
    shapes = np.repeat(middle[:, None], 13, axis=1)
    assert unmet_request(shapes, task, [left, right], []) == ""
    assert unmet_request(shapes, task, [right, left], []).endswith("in another order")
    assert "goes through the passage between" in unmet_request(shapes, task, [left], [right])
    assert "does not go through the passage between" in unmet_request(shapes[:2], task, [right], [])


def test_a_way_that_does_not_exist():
    """The only door is not to be used."""
    task = problems.doorway()
    door = min(find_passages(task.scene), key=lambda passage: -passage.ends[:, 0].mean())
    with pytest.raises(PlanningError, match="no plan was found: no path of the cable's midpoint keeps"):
        plan(task, avoiding=[door])


def test_what_is_left_of_a_plan_is_used_again():
    """Half way, a disc has moved: the new plan starts where the cable is and is made from the old one."""
    task = problems.beside_disc()
    old = plan(task)
    half = old.shapes[old.steps // 2]
    noisy = half + 0.0005 * np.random.default_rng(0).normal(size=half.shape)
    center = np.array([0.34, 0.36])
    away = 0.01 * (center - half.mean(axis=0)) / np.linalg.norm(center - half.mean(axis=0))
    moved = Scene(task.scene.size, (Disc(center=tuple(center + away), radius=0.07),))
    now = replace(task.resumed_from(noisy), scene=moved)
    new = plan(now, previous=old)
    assert new.metadata["initial_trajectory"] == "previous"
    assert new.steps < old.steps
    assert verify_plan(new, now).passed
    assert np.linalg.norm(new.shapes[0] - half) < 0.005


def test_an_earlier_plan_that_no_longer_leads_anywhere():
    """Its way is closed from side to side: the other initial trajectories are tried."""
    task = two_islands()
    old = plan(task)
    x = float(np.interp(0.36, old.shapes[:, 6, 1], old.shapes[:, 6, 0]))
    left, right = next(gap for gap in ((0.0, 0.15), (0.25, 0.4), (0.5, 0.7)) if gap[0] < x < gap[1])
    wall = Box(center=((left + right) / 2, 0.36), size=(right - left, 0.06))
    closed = replace(task, scene=Scene(task.scene.size, (*task.scene.obstacles, wall)))
    new = plan(closed, previous=old)
    assert new.metadata["initial_trajectory"] != "previous"
    assert motion_class(task, new.shapes) != motion_class(task, old.shapes)
    assert verify_plan(new, closed).passed
