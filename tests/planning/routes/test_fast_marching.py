"""The reference of the pivot path: fast marching finds the known cost of known paths."""

from __future__ import annotations

import numpy as np
import pytest
from fast_marching import least_cost

from cableway.planning.config import PivotConfig
from cableway.scene.obstacles import Box
from cableway.scene.scene import Scene

SHORTEST = PivotConfig(clearance_weight=0.0)
LEFT, RIGHT = np.array([0.12, 0.2]), np.array([0.58, 0.31])


def test_where_nothing_stands_the_way_is_straight():
    assert least_cost(Scene(), LEFT, RIGHT, 0.004, SHORTEST, 0.002) == pytest.approx(np.hypot(0.46, 0.11), rel=0.01)


def test_round_a_box_the_way_bends_about_two_corners():
    """The box reaches down to the wall; the path keeps its radius from the upper corners."""
    scene = Scene(obstacles=(Box(center=(0.35, 0.25), size=(0.1, 0.5)),))
    left, right = np.array([0.1, 0.5]), np.array([0.6, 0.5])
    assert least_cost(scene, left, right, 0.001, SHORTEST, 0.001) == pytest.approx(0.502, rel=0.01)
    assert least_cost(scene, left - [0, 0.2], right - [0, 0.2], 0.001, SHORTEST, 0.001) == pytest.approx(
        2 * np.hypot(0.2, 0.2) + 0.1, rel=0.01
    )


def test_behind_a_wall_there_is_no_way():
    scene = Scene(obstacles=(Box(center=(0.35, 0.35), size=(0.02, 0.7)),))
    assert least_cost(scene, LEFT, RIGHT, 0.004, SHORTEST, 0.002) == np.inf


def test_beside_one_wall_the_cost_is_that_of_the_logarithm():
    """Straight towards the wall, k_c integral of dx/x."""
    config = PivotConfig(length_weight=1e-3, clearance_weight=1.0)
    cost = least_cost(Scene((2.0, 0.4)), np.array([0.15, 0.2]), np.array([0.05, 0.2]), 0.004, config, 0.001)
    assert cost == pytest.approx(np.log(3), rel=0.01)
