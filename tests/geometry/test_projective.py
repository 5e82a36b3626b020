"""Laws of maps between planes: the points that say them are exact, and what is straight stays so."""

from __future__ import annotations

import numpy as np
import pytest

from cableway.geometry.projective import mapped, plane_map

SQUARE = np.array([[0.0, 0.0], [0.7, 0.0], [0.7, 0.7], [0.0, 0.7]])
SEEN = np.array([[100.0, 900.0], [1200.0, 950.0], [1000.0, 300.0], [250.0, 200.0]])


@pytest.mark.parametrize("count", [3, 4])
def test_the_points_that_say_a_map_are_exact_both_ways(count):
    there, back = plane_map(SQUARE[:count], SEEN[:count]), plane_map(SEEN[:count], SQUARE[:count])
    np.testing.assert_allclose(mapped(there, SQUARE[:count]), SEEN[:count], rtol=1e-12)
    inside = np.random.default_rng(0).uniform(0, 0.7, (100, 2))
    np.testing.assert_allclose(mapped(back, mapped(there, inside)), inside, atol=1e-12)


def test_lines_stay_straight():
    line = np.linspace([0.05, 0.1], [0.6, 0.5], 9)
    a, *points = mapped(plane_map(SQUARE, SEEN), line)
    along = np.array(points) - a
    area = along[:, 0] * along[-1, 1] - along[:, 1] * along[-1, 0]
    np.testing.assert_allclose(area, 0, atol=1e-9 * np.square(along).sum(axis=1).max())
    assert np.ptp(np.diff(along, axis=0), axis=0).max() > 1, "while equal distances are not"


def test_beyond_the_horizon_there_is_nothing():
    matrix = plane_map(SEEN, SQUARE)
    horizon = -matrix[2, 2] / matrix[2, 1]
    beside = mapped(matrix, np.array([[0.0, horizon - 1.0], [0.0, horizon + 1.0]]))
    assert np.isnan(beside).any(axis=1).sum() == 1
