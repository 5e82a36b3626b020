"""Laws of signed distance, with Shapely as referee."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from cableway.geometry import convex

LAWS = settings(deadline=None, derandomize=True, max_examples=60)
SIZE = (1.0, 0.8)
EMPTY = convex.pack([], [], SIZE)


def hull(points: list[tuple[float, float]]) -> np.ndarray:
    """Corners of the convex hull, counter-clockwise."""
    ring = shapely.convex_hull(shapely.MultiPoint(points))
    return np.array(shapely.geometry.polygon.orient(ring).exterior.coords)[:-1]  # pyright: ignore


def has_area(points: list[tuple[float, float]]) -> bool:
    return shapely.convex_hull(shapely.MultiPoint(points)).area > 1e-3


inner = st.tuples(st.floats(0.1, 0.9), st.floats(0.1, 0.7)).map(lambda p: (round(p[0], 4), round(p[1], 4)))
polygons = st.lists(inner, min_size=3, max_size=9, unique=True).filter(has_area).map(hull)
places = st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 0.8)).map(np.array)
lines = st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 0.8)), min_size=2, max_size=5).map(np.array)


def shapely_distance(point: np.ndarray, polygon: np.ndarray) -> float:
    solid, spot = shapely.Polygon(polygon), shapely.Point(point)
    return float(-spot.distance(solid.exterior) if solid.contains(spot) else spot.distance(solid))


@LAWS
@given(st.lists(polygons, min_size=1, max_size=4), places, st.floats(0, 0.05))
def test_signed_distance_is_that_of_shapely(shapes: list[np.ndarray], point: np.ndarray, rounding: float):
    world = convex.pack(shapes, [rounding] * len(shapes), SIZE)
    d, _, index = convex.signed_distance(point, world)
    walls = [point[0], point[1], SIZE[0] - point[0], SIZE[1] - point[1]]
    distances = [shapely_distance(point, shape) - rounding for shape in shapes] + walls
    np.testing.assert_allclose(d, min(distances), atol=1e-12)
    np.testing.assert_allclose(distances[int(index)], min(distances), atol=1e-12)


@LAWS
@given(st.lists(polygons, min_size=1, max_size=4), places, st.floats(0.01, 0.4))
def test_beyond_a_ceiling_there_is_nothing_and_below_it_all_is_the_same(
    shapes: list[np.ndarray], point: np.ndarray, ceiling: float
):
    world = convex.pack(shapes, [0.01] * len(shapes), SIZE)
    exact, capped = convex.signed_distance(point, world), convex.signed_distance(point, world, ceiling)
    wanted = exact if exact[0] < ceiling else (ceiling, np.zeros(2), -1)
    for value, other in zip(capped, wanted, strict=True):
        np.testing.assert_array_equal(value, other)


@LAWS
@given(st.lists(polygons, min_size=1, max_size=4), places, st.floats(0, 0.05))
def test_the_distance_alone_is_the_same(shapes: list[np.ndarray], point: np.ndarray, rounding: float):
    world = convex.pack(shapes, [rounding] * len(shapes), SIZE)
    d = convex.distance_at(point[0], point[1], world.arrays, 0.0)
    np.testing.assert_allclose(d, convex.signed_distance(point, world)[0], rtol=0, atol=1e-14)


@LAWS
@given(polygons, places, st.floats(0, 6.3))
def test_the_gradient_is_a_unit_vector_and_the_slope_of_the_distance(shape: np.ndarray, point: np.ndarray, a: float):
    world = convex.pack([shape], [0.0], SIZE)
    d, gradient, _ = convex.signed_distance(point, world)
    np.testing.assert_allclose(np.linalg.norm(gradient), 1.0)
    along = 1e-6 * np.array([np.cos(a), np.sin(a)])
    ahead = convex.signed_distance(point + along, world)[0]
    behind = convex.signed_distance(point - along, world)[0]
    smooth = abs(ahead - 2 * d + behind) < 1e-10  # no edge of the field between the three points
    if smooth:
        np.testing.assert_allclose((ahead - behind) / 2e-6, gradient @ along / 1e-6, atol=1e-4)


@LAWS
@given(polygons, lines)
def test_the_distance_of_a_polyline_is_the_least_of_its_points(shape: np.ndarray, line: np.ndarray):
    """Exact: never above a densely sampled minimum, never below it by more than the spacing allows."""
    world = convex.pack([shape], [0.0], SIZE)
    exact = convex.polyline_distance(line[None], world)[0][0]
    t = np.linspace(0, 1, 801)[:, None]
    dense = np.concatenate([a + t * (b - a) for a, b in pairwise(line)])
    sampled = convex.signed_distance(dense, world)[0].min()
    spacing = np.linalg.norm(np.diff(line, axis=0), axis=1).max() / 800
    assert sampled - spacing / 2 - 1e-12 <= exact <= sampled + 1e-12


def test_a_segment_that_cuts_a_corner_is_as_deep_as_the_corner():
    box = np.array([[0.4, 0.3], [0.6, 0.3], [0.6, 0.5], [0.4, 0.5]])
    world = convex.pack([box], [0.0], SIZE)
    cut = np.array([[[0.35, 0.37], [0.47, 0.25]]])  # passes the corner (0.4, 0.3) 0.0141 m inside
    d, index = convex.polyline_distance(cut, world)
    np.testing.assert_allclose(d, -0.01, atol=1e-12)  # deepest midway, 0.01 from either edge
    assert index[0] == 0
    np.testing.assert_allclose(convex.signed_distance(cut[0], world)[0], [0.05, 0.05])


def test_distance_to_a_disc_is_that_to_its_centre_less_its_radius():
    world = convex.pack([np.array([[0.5, 0.4]])], [0.1], SIZE)
    points = np.array([[0.5, 0.4], [0.55, 0.4], [0.5, 0.6]])
    d, gradient, _ = convex.signed_distance(points, world)
    np.testing.assert_allclose(d, [-0.1, -0.05, 0.1])
    np.testing.assert_allclose(np.linalg.norm(gradient, axis=1), 1.0)
    np.testing.assert_allclose(convex.polyline_distance(np.array([[[0.3, 0.45], [0.7, 0.45]]]), world)[0], -0.05)


@pytest.mark.parametrize(("point", "wall"), [((0.1, 0.4), 0), ((0.5, 0.1), 1), ((0.9, 0.4), 2), ((0.5, 0.7), 3)])
def test_without_obstacles_the_nearest_wall_counts(point: tuple[float, float], wall: int):
    d, gradient, index = convex.signed_distance(np.array(point), EMPTY)
    np.testing.assert_allclose(d, 0.1)
    assert index == wall
    inward = [(1, 0), (0, 1), (-1, 0), (0, -1)][wall]
    np.testing.assert_array_equal(gradient, inward)
    name = ("left", "bottom", "right", "top")[wall]
    assert convex.WALLS[wall] == f"{name} wall"


def test_beyond_a_wall_the_distance_is_negative():
    assert convex.signed_distance(np.array([-0.02, 0.4]), EMPTY)[0] == pytest.approx(-0.02)
    assert convex.polyline_distance(np.array([[[0.5, 0.4], [0.5, 0.83]]]), EMPTY)[0][0] == pytest.approx(-0.03)


def test_any_shape_of_points_goes_in():
    d, gradient, index = convex.signed_distance(np.full((3, 4, 2), 0.3), EMPTY)
    assert (d.shape, gradient.shape, index.shape) == ((3, 4), (3, 4, 2), (3, 4))
    assert convex.signed_distance(np.empty((0, 2)), EMPTY)[0].shape == (0,)


def test_polygons_of_different_size_are_packed_together():
    triangle, square = np.eye(3, 2), np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    world = convex.pack([triangle, square], [0.0, 0.01], SIZE)
    assert world.vertices.shape == (2, 4, 2)
    np.testing.assert_array_equal(world.counts, [3, 4])
