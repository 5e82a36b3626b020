"""Laws of the obstacles and of distances in a scene."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from cableway.core.errors import TaskError
from cableway.geometry import se2
from cableway.scene.obstacles import Box, Disc, Obstacle, Polygon, describe, to_shapely
from cableway.scene.scene import Scene

LAWS = settings(deadline=None, derandomize=True, max_examples=25)
spots = st.tuples(st.floats(0.25, 0.45), st.floats(0.25, 0.45))
boxes = st.builds(
    lambda center, size, angle: Box(center=center, size=size, angle=angle),
    spots,
    st.tuples(st.floats(0.01, 0.2), st.floats(0.01, 0.2)),
    st.floats(-6.2, 6.2),
)
discs = st.builds(lambda center, radius: Disc(center=center, radius=radius), spots, st.floats(0.001, 0.2))
polygons = st.builds(
    lambda center, radius, corners, turn: Polygon(
        vertices=np.array(center) + radius * se2.direction(turn + 2 * np.pi / corners * np.arange(corners))
    ),
    spots,
    st.floats(0.01, 0.2),
    st.integers(3, 30),
    st.floats(-4, 4),
)
obstacles = st.one_of(boxes, discs, polygons)
curves = st.lists(st.tuples(st.floats(0.01, 0.69), st.floats(0.01, 0.69)), min_size=2, max_size=6).map(np.array)


@LAWS
@given(boxes)
def test_a_box_has_its_sides_and_its_centre(box: Box):
    corners = box.vertices
    np.testing.assert_allclose(corners.mean(axis=0), box.center)
    sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    np.testing.assert_allclose(sides, [*box.size, *box.size])
    np.testing.assert_allclose(corners[1] - corners[0], box.size[0] * se2.direction(box.angle), atol=1e-12)


@LAWS
@given(obstacles)
def test_vertices_go_counter_clockwise(obstacle: Obstacle):
    if len(obstacle.vertices) > 1:
        assert shapely.LinearRing(obstacle.vertices).is_ccw
    assert to_shapely(obstacle).is_valid


@LAWS
@given(polygons)
def test_a_polygon_is_the_same_given_in_either_sense(polygon: Polygon):
    backwards = Polygon(vertices=polygon.vertices[::-1])
    assert backwards == polygon
    assert hash(backwards) == hash(polygon)
    assert backwards != Polygon(vertices=polygon.vertices + 0.01)


def test_a_disc_is_its_centre_grown_by_its_radius():
    disc = Disc(center=(0.3, 0.4), radius=0.05)
    np.testing.assert_array_equal(disc.vertices, [[0.3, 0.4]])
    assert disc.rounding == 0.05
    np.testing.assert_allclose(to_shapely(disc).area, np.pi * 0.05**2, rtol=2e-4)


def test_points_in_line_and_figures_rounded_to_micrometres_are_convex():
    ring = 0.35 + 0.2 * se2.direction(np.linspace(0, 2 * np.pi, 40, endpoint=False))
    along = np.linspace(ring, np.roll(ring, -1, axis=0), 4)[:3].transpose(1, 0, 2).reshape(-1, 2)
    assert len(Polygon(vertices=along.round(6)).vertices) == 120


def test_a_polygon_does_not_keep_the_array_it_was_given():
    vertices = np.array([[0.1, 0.1], [0.2, 0.1], [0.1, 0.2]])
    polygon = Polygon(vertices=vertices)
    vertices[:] = 0.0
    assert polygon.vertices.max() == 0.2


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Box(center=(0.1, np.nan), size=(0.1, 0.1)), r"^center\[1\] must be finite, got nan$"),
        (lambda: Box(center=(0.1, 0.1), size=(1.0, np.nan)), r"^size\[1\] must be positive and finite, got nan$"),
        (lambda: Box(center=(0.1, 0.1), size=(0.1, 0.0)), r"^size\[1\] must be positive, got 0.0$"),
        (lambda: Box(center=(0.1, 0.1), size=0.1), r"^size must be two numbers, got 0.1$"),  # pyright: ignore
        (lambda: Box(center=(0.1, 0.1), size=(0.1, 0.1), angle=np.inf), r"^angle must be finite, got inf$"),
        (lambda: Box(center=("0.1", 0.1), size=(0.1, 0.1)), r"^center\[0\] must be a number, got '0.1'$"),  # pyright: ignore
        (lambda: Disc(center=(0.1, 0.1), radius=-1.0), "^radius must be positive, got -1.0$"),
        (lambda: Disc(center=(0.1, 0.1), radius=10**400), "^radius must be positive and finite, got inf$"),
        (lambda: Polygon(vertices=np.zeros((3, 3))), r"^vertices must be rows of 2 numbers, got an array of shape"),
        (lambda: Polygon(vertices=[[0, 1], [1]]), "^vertices must be rows of 2 numbers, got "),  # pyright: ignore
        (lambda: Polygon(vertices=[[0, 0], [1, 0], [0, np.inf]]), r"^vertices\[2\]\[1\] must be finite, got inf$"),  # pyright: ignore
        (lambda: Scene((0.7, -1.0)), r"^workspace.size\[1\] must be positive, got -1.0$"),
        (lambda: Scene((0.7, 0.7), (Disc(center=(0.1, 0.1), radius=0.2),)), r"^obstacles\[0\] \(disc at .*100 mm$"),
    ],
)  # fmt: skip
def test_obstacles_that_are_none_are_refused(make, said: str):  # pyright: ignore[reportMissingParameterType]
    with pytest.raises(TaskError, match=said):
        make()


def test_values_are_kept_as_plain_floats():
    box = Box(center=np.array([0.1, 0.2]), size=(1, np.float32(0.5)), angle=np.float64(1))  # pyright: ignore
    assert repr(box) == "Box(center=(0.1, 0.2), size=(1.0, 0.5), angle=1.0, height=None)"


@LAWS
@given(st.lists(obstacles, max_size=3), curves)
def test_shapely_and_the_kernels_agree_on_the_distance_of_a_curve(inside: list[Obstacle], curve: np.ndarray):
    """`overlap` goes through Shapely, `clearance` through compiled kernels; depths to its step of 0.1 mm."""
    scene = Scene((0.7, 0.7), tuple(inside))
    depth, index, _ = scene.overlap(curve, 0.004)
    clearance = scene.clearance(curve[None], 0.004)[0]
    assert -depth == pytest.approx(clearance, abs=3e-4 if depth > 0.004 else 1e-9)
    assert scene.name_of(index).startswith(("obstacles[", "the "))


@LAWS
@given(st.lists(obstacles, min_size=1, max_size=3), spots)
def test_a_single_point_is_as_deep_as_its_signed_distance(inside: list[Obstacle], spot: tuple[float, float]):
    scene = Scene((0.7, 0.7), tuple(inside))
    depth, *_ = scene.overlap(np.array([spot]), 0.01)
    assert depth == pytest.approx(0.01 - float(scene.signed_distance(np.array(spot))), abs=1e-9)


def test_things_have_names_for_messages():
    scene = Scene((0.7, 0.7), (Box(center=(0.1, 0.2), size=(0.1, 0.1)), Disc(center=(0.5, 0.5), radius=0.1)))
    assert scene.name_of(1) == "obstacles[1] (disc at (500, 500) mm)"
    assert [scene.name_of(i) for i in range(2, 6)] == [
        "the left wall",
        "the bottom wall",
        "the right wall",
        "the top wall",
    ]
    assert describe(scene.obstacles[0]) == "box at (100, 200) mm"
