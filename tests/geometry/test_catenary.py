"""A hanging chain: its length, its ends, and the balance of its weight."""

from __future__ import annotations

import numpy as np
import pytest

from cableway.geometry.catenary import LONGEST_CHORD, hanging

LENGTH = 0.5


def drawn_ends(seed: int) -> np.ndarray:
    """Pairs of points less than the longest chord apart, and not one above the other."""
    ends = np.random.default_rng(seed).uniform(-0.2, 0.2, (300, 2, 3))
    way = ends[:, 1] - ends[:, 0]
    kept = (np.linalg.norm(way, axis=1) < LONGEST_CHORD * LENGTH) & (np.linalg.norm(way[:, :2], axis=1) > 0.02)
    return ends[kept]


def test_it_has_its_length_and_its_ends():
    ends = drawn_ends(0)
    points = hanging(ends, LENGTH, 4001)
    np.testing.assert_allclose(points[:, [0, -1]], ends, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(np.diff(points, axis=1), axis=2), LENGTH / 4000, rtol=1e-3)


def test_it_carries_its_own_weight():
    """Horizontal tension is the same everywhere, so the slope grows evenly along the arc; and it hangs in one plane."""
    ends = drawn_ends(1)
    steps = np.diff(hanging(ends, LENGTH, 2001), axis=1)
    across = np.linalg.norm(steps[..., :2], axis=2)
    slope = steps[..., 2] / across
    growth = np.diff(slope, axis=1)
    assert np.all(growth > 0)
    np.testing.assert_allclose(growth, np.broadcast_to(growth.mean(1, keepdims=True), growth.shape), rtol=3e-3)
    way = (ends[:, 1] - ends[:, 0])[:, None, :2]
    assert np.abs(way[..., 0] * steps[..., 1] - way[..., 1] * steps[..., 0]).max() < 1e-12


@pytest.mark.parametrize("ends", [[[0, 0, 0], [0.6, 0, 0]], [[0, 0, 0], [0, 0, 0.3]], [[0.1, 0.1, 0.1]] * 2])
def test_ends_too_far_apart_or_above_each_other_are_moved(ends: list[list[float]]):
    given = np.array([ends], float)
    points = hanging(given, LENGTH, 2001)[0]
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).sum() == pytest.approx(LENGTH, rel=1e-3)
    np.testing.assert_allclose(points[[0, -1]].mean(0), given[0].mean(0), atol=1e-12)
    assert np.abs(points[[0, -1]] - given[0]).max() < 0.07
