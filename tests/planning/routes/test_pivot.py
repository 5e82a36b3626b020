"""The pivot path is the cheapest way for the cable's centre, and exists exactly where there is room."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from cableway.core.errors import InputError, PlanningError, UnknownNameError
from cableway.geometry import polyline
from cableway.planning.config import PivotConfig
from cableway.planning.routes.pivot import pivot_cost, pivot_keypoint, plan_pivot_path
from cableway.scene.obstacles import Box, Disc, Polygon
from cableway.scene.scene import Scene

RADIUS = 0.004
START, GOAL = np.array([0.1, 0.1]), np.array([0.6, 0.55])

CLUTTER = Scene(
    obstacles=(
        Box(center=(0.35, 0.35), size=(0.2, 0.1), angle=0.4),
        Disc(center=(0.2, 0.5), radius=0.06),
        Polygon(vertices=np.array([[0.5, 0.15], [0.6, 0.2], [0.5, 0.3]])),
    )
)


def doorway(gap: float, thickness: float = 0.01) -> Scene:
    """A thin wall across the workspace with one gap that starts at x = 0.4."""
    right = 0.7 - 0.4 - gap
    return Scene(
        obstacles=(
            Box(center=(0.2, 0.35), size=(0.4, thickness)),
            Box(center=(0.7 - right / 2, 0.35), size=(right, thickness)),
        )
    )


def test_without_obstacles_and_clearance_weight_it_is_the_straight_line():
    path = plan_pivot_path(Scene(), START, GOAL, RADIUS, PivotConfig(clearance_weight=0.0))
    straight = np.linspace(START, GOAL, len(path))
    assert float(polyline.length(path)) == pytest.approx(float(np.linalg.norm(GOAL - START)), rel=1e-9)
    off = (path - START) @ np.array([GOAL[1] - START[1], START[0] - GOAL[0]])
    assert np.abs(off).max() < 1e-9
    assert np.abs(path[[0, -1]] - straight[[0, -1]]).max() == 0


def test_length_alone_gives_the_shortest_way_round_a_corner():
    """Known: over a box's two corners, by tangents and arcs of the radius kept."""
    box = Scene(obstacles=(Box(center=(0.35, 0.15), size=(0.1, 0.3)),))
    start, goal = np.array([0.1, 0.2]), np.array([0.6, 0.2])
    path = plan_pivot_path(box, start, goal, RADIUS, PivotConfig(clearance_weight=0.0))
    rise, run = 0.1, 0.2
    distance = float(np.hypot(rise, run))
    tangent = np.sqrt(distance**2 - RADIUS**2)
    turn = np.arctan2(rise, run) + np.arcsin(RADIUS / distance)
    shortest = 2 * tangent + 2 * RADIUS * turn + 0.1
    assert shortest <= float(polyline.length(path)) < 1.003 * shortest


@pytest.mark.parametrize("clearance_weight", [0.0, 0.1, 1.0])
def test_the_whole_path_keeps_the_radius(clearance_weight: float):
    path = plan_pivot_path(CLUTTER, START, GOAL, RADIUS, PivotConfig(clearance_weight=clearance_weight))
    assert CLUTTER.clearance(path[None], RADIUS)[0] >= 0


def test_more_clearance_weight_gives_more_clearance_and_more_length():
    paths = [
        plan_pivot_path(CLUTTER, START, GOAL, RADIUS, PivotConfig(clearance_weight=weight))
        for weight in (0.0, 0.03, 1.0)
    ]
    lengths = [float(polyline.length(path)) for path in paths]
    integrals = [pivot_cost(CLUTTER, path, PivotConfig(length_weight=1e-6, clearance_weight=1.0)) for path in paths]
    assert lengths[0] < lengths[1] < lengths[2]
    assert integrals[0] > integrals[1] > integrals[2]


def test_it_is_the_same_backwards():
    config = PivotConfig()
    there = pivot_cost(CLUTTER, plan_pivot_path(CLUTTER, START, GOAL, RADIUS, config), config)
    back = pivot_cost(CLUTTER, plan_pivot_path(CLUTTER, GOAL, START, RADIUS, config), config)
    assert there == pytest.approx(back, rel=0.005)


def test_a_finer_grid_changes_the_cost_by_less_than_one_percent():
    costs = [
        pivot_cost(CLUTTER, plan_pivot_path(CLUTTER, START, GOAL, RADIUS, PivotConfig(resolution=h)), PivotConfig())
        for h in (0.005, 0.002)
    ]
    assert costs[0] == pytest.approx(costs[1], rel=0.01)


def test_cost_of_a_known_path():
    """Along the middle of a 0.2 m corridor: k_l length + k_c length / 0.1."""
    scene = Scene(size=(0.7, 0.2))
    path = np.array([[0.2, 0.1], [0.5, 0.1]])
    config = PivotConfig(length_weight=2.0, clearance_weight=0.5)
    assert pivot_cost(scene, path, config) == pytest.approx(2.0 * 0.3 + 0.5 * 0.3 / 0.1)


@pytest.mark.skipif(sys.platform != "linux", reason="OMPL has wheels for Linux only")
def test_rrt_star_keeps_the_radius_is_repeatable_and_costs_no_less_than_the_grid():
    config = PivotConfig(method="rrt_star", iterations=300)
    first, again, other = (plan_pivot_path(CLUTTER, START, GOAL, RADIUS, config, seed=seed) for seed in (3, 3, 4))
    assert np.array_equal(first, again)
    assert first.shape != other.shape or not np.allclose(first, other)
    assert np.array_equal(first[[0, -1]], [START, GOAL])
    assert CLUTTER.clearance(first[None], RADIUS)[0] >= 0
    grid = plan_pivot_path(CLUTTER, START, GOAL, RADIUS, PivotConfig())
    best = pivot_cost(CLUTTER, grid, config)
    assert best <= pivot_cost(CLUTTER, first, config) < 1.3 * best


@pytest.mark.skipif(sys.platform != "linux", reason="OMPL has wheels for Linux only")
def test_rrt_star_says_when_it_finds_nothing():
    config = PivotConfig(method="rrt_star", iterations=50)
    with pytest.raises(PlanningError, match=r"RRT\* found no path .* 4 mm .* 50 iterations"):
        plan_pivot_path(doorway(0.0), START, GOAL, RADIUS, config)


def test_a_gap_narrower_than_the_grid_is_found():
    scene = doorway(0.0095)
    path = plan_pivot_path(scene, START, GOAL, RADIUS, PivotConfig(resolution=0.01))
    assert scene.clearance(path[None], RADIUS)[0] >= 0


def test_a_gap_narrower_than_the_cable_is_named():
    with pytest.raises(PlanningError, match=r"no path .* keeps 4\.0 mm .*the widest route keeps 3\.\d mm"):
        plan_pivot_path(doorway(0.0075), START, GOAL, RADIUS, PivotConfig())


def test_a_wall_thinner_than_the_grid_is_no_way():
    scene = Scene(obstacles=(Box(center=(0.35, 0.35), size=(0.7, 0.0005)),))
    with pytest.raises(PlanningError, match="there is no route at all"):
        plan_pivot_path(scene, START, GOAL, 0.001, PivotConfig(resolution=0.02))


def test_start_or_goal_too_near_an_obstacle_is_named():
    with pytest.raises(PlanningError, match=r"the goal of the pivot path .* is 2\.0 mm from .* the 4 mm required"):
        plan_pivot_path(Scene(), START, np.array([0.002, 0.3]), RADIUS, PivotConfig())


def test_start_at_goal_is_a_path_of_length_zero():
    path = plan_pivot_path(CLUTTER, START, START, RADIUS, PivotConfig())
    assert np.array_equal(path, [START, START])


def test_what_is_not_a_point_is_refused():
    with pytest.raises(InputError, match="two finite points"):
        plan_pivot_path(CLUTTER, START, np.array([np.nan, 0.1]), RADIUS, PivotConfig())


def test_pivot_keypoint_is_the_middle():
    assert [pivot_keypoint(n) for n in (3, 4, 13)] == [1, 1, 6]


def test_an_unknown_method_lists_the_known_ones():
    with pytest.raises(UnknownNameError, match="'prm'; known: grid, rrt_star"):
        PivotConfig(method="prm")  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    ("name", "value"),
    [("length_weight", 0.0), ("clearance_weight", -1.0), ("resolution", float("nan")), ("iterations", 0)],
)
def test_a_config_value_out_of_range_is_named(name: str, value: float):
    with pytest.raises(InputError, match=rf"pivot\.{name} must be from"):
        PivotConfig(**{name: value})
