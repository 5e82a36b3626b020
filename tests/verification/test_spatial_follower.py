"""The judge's rod in space against the planner's: other unknowns, another energy, the same cable."""

from __future__ import annotations

import numpy as np
import pytest

from cableway.core.errors import InputError
from cableway.geometry import rotations
from cableway.rod.continuation import lead
from cableway.rod.spatial import SpatialRod
from cableway.verification.spatial_follower import FollowedInSpace, follow_in_space


def followed(rod: SpatialRod, stations: np.ndarray, poses: np.ndarray) -> FollowedInSpace:
    return follow_in_space(stations, poses, length=rod.length, twist=rod.twist, weight=rod.weight)


def line_of(rod: SpatialRod, seed: int, rows: int) -> np.ndarray:
    """A line of stable equilibria."""
    rng = np.random.default_rng(seed)
    while True:
        ends = rng.normal(0, [*[0.2] * 3, *[0.8] * 3, *[6.0] * 3, 0.8, 1.5, 1.5], (2, 12))
        line = rod.between(ends[0], ends[1], np.linspace(0, 1, rows))
        if rod.stability(line, ceiling=8.0)[0].min() >= 8:
            return line


@pytest.mark.parametrize(("weight", "seed"), [(0.0, 1), (18.5, 2)])
def test_a_line_of_equilibria_is_followed(weight: float, seed: int):
    """Up to what two chains of 24 and 48 hinges differ by, and as stable."""
    rod = SpatialRod(0.5, 13, 0.8, weight)
    line = line_of(rod, seed, 3)
    stations, poses = rod.shapes(line)
    found = followed(rod, stations, poses)
    assert found.lost_at is None
    assert found.deviation.max() < 0.002
    assert 0 < found.stability.min() < 4 * np.pi**2 + 60


def test_it_loses_the_rod_where_that_snaps():
    """An arch twisted by one gripper."""
    rod = SpatialRod(0.5, 13, 1.0, 18.5)
    rows = np.random.default_rng(7).normal(0, [*[0.3] * 3, *[1.2] * 3, *[8.0] * 3, *[2.0] * 3], (400, 12))
    q = rows[rod.stability(rows, ceiling=20.0)[0] > 5][5]
    poses = np.repeat(rod.end_poses(q[None]), 9, axis=0)
    turns = rotations.from_vector(np.linspace(0, 4, 9)[:, None] * [1.0, 0.0, 0.0])
    poses[:, 1, 3:] = rotations.product(poses[0, 1, 3:], turns)
    led = lead(rod, q, poses)
    assert led.snap is not None
    shapes = rod.shapes(led.q)[0]
    expected = np.concatenate([shapes, np.repeat(shapes[-1:], 9 - len(shapes), axis=0)])
    found = followed(rod, expected, poses)
    assert found.lost_at is not None
    assert abs(found.lost_at - led.snap) < 2
    assert found.deviation[: found.lost_at - 1].max() < 0.005


def test_what_the_rod_does_not_do_shows_as_deviation():
    rod = SpatialRod(0.5, 13, 0.8, 18.5)
    stations, poses = rod.shapes(line_of(rod, 2, 2))
    light = follow_in_space(stations, poses, length=0.5, twist=0.8, weight=0.0)
    assert light.deviation.max() > 0.004


@pytest.mark.wrong_types
def test_arrays_that_do_not_fit_are_refused():
    rod = SpatialRod(0.5, 13, 0.8, 18.5)
    stations, poses = rod.shapes(line_of(rod, 2, 2))
    with pytest.raises(InputError, match="as many shapes as poses"):
        followed(rod, stations, poses[:1])
