"""Laws of polylines, with the degenerate ones."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from cableway.geometry import polyline, se2

LAWS = settings(deadline=None, derandomize=True, max_examples=60)
coordinates = st.floats(-1, 1).map(lambda value: round(value, 3))
polylines = st.lists(st.tuples(coordinates, coordinates), min_size=2, max_size=12, unique=True).map(np.array)


@LAWS
@given(polylines)
def test_length_is_that_of_shapely(points: np.ndarray):
    np.testing.assert_allclose(polyline.length(points), shapely.LineString(points).length)


def test_length_goes_over_batches_and_is_zero_for_one_vertex():
    batch = np.array([[[0.0, 0.0], [3.0, 4.0]], [[0.0, 0.0], [0.0, 2.0]]])
    np.testing.assert_array_equal(polyline.length(batch), [5.0, 2.0])
    assert polyline.length(np.zeros((1, 2))) == 0.0


@LAWS
@given(polylines, st.integers(2, 40))
def test_resampled_points_lie_on_the_line_at_equal_arc_length(points: np.ndarray, count: int):
    line = shapely.LineString(points)
    resampled = polyline.resample(points, count)
    wanted = [line.interpolate(s).coords[0] for s in np.linspace(0, line.length, count)]
    np.testing.assert_allclose(resampled, wanted, atol=1e-12)


def test_points_beyond_the_ends_are_the_ends():
    line = np.array([[0.0, 0.0], [1.0, 0.0]])
    np.testing.assert_array_equal(polyline.point_at(line, np.array([-1.0, 2.0])), line)


def test_a_repeated_vertex_does_not_disturb_arc_length():
    line = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    np.testing.assert_allclose(polyline.resample(line, 5)[:, 0], [0.0, 0.5, 1.0, 1.5, 2.0])
    np.testing.assert_array_equal(polyline.remove_repeated(line), line[[0, 1, 3]])


@LAWS
@given(polylines, st.integers(1, 5))
def test_a_spline_goes_through_its_vertices(points: np.ndarray, pieces: int):
    np.testing.assert_allclose(polyline.spline(points, pieces)[::pieces], points, atol=1e-12)


def test_a_spline_through_a_half_circle_keeps_its_length():
    angles = np.linspace(0, np.pi, 13)
    np.testing.assert_allclose(polyline.length(polyline.spline(se2.direction(angles), 6)), np.pi, rtol=1e-3)


@LAWS
@given(polylines, st.floats(-4, 4))
def test_signed_area_changes_sign_in_the_mirror_and_in_reverse(points: np.ndarray, angle: float):
    area = polyline.signed_area(points)
    np.testing.assert_allclose(polyline.signed_area(se2.transform(points, np.ones(2), angle)), area, atol=1e-9)
    np.testing.assert_allclose(polyline.signed_area(points * [1, -1]), -area, atol=1e-12)
    np.testing.assert_allclose(polyline.signed_area(points[::-1]), -area, atol=1e-12)


def test_signed_area_is_positive_left_of_the_chord():
    assert polyline.signed_area(np.array([[0.0, 0.0], [0.5, 0.3], [1.0, 0.0]])) > 0


@LAWS
@given(polylines)
def test_crossing_is_what_shapely_calls_not_simple(points: np.ndarray):
    """A spike back along the line before is not simple for Shapely, but meets a neighbour only."""
    steps = np.diff(points, axis=0)
    turns = steps[:-1, 0] * steps[1:, 1] - steps[:-1, 1] * steps[1:, 0]
    if np.abs(turns).min(initial=1.0) > 1e-9:
        assert polyline.crosses_itself(points) == (not shapely.LineString(points).is_simple)


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.1, np.pi / 2, 2.0, -2.7])
@pytest.mark.parametrize("count", [2, 3, 4, 13, 73])
def test_a_straight_line_does_not_cross_itself(angle: float, count: int):
    line = np.column_stack([np.linspace(0.1, 0.4, count), np.full(count, 0.2)])
    assert not polyline.crosses_itself(se2.transform(line, np.array([0.3, 0.1]), angle))


def test_a_line_that_comes_back_on_itself_crosses_itself():
    back = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.5, 0.0]])
    assert polyline.crosses_itself(back)
    assert polyline.crosses_itself(back[:, ::-1])
    folded = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [2.0, 0.0], [1.0, 0.0]])
    assert polyline.crosses_itself(folded)
