"""Laws of signed distance in space, with Coal as referee outside and by many points inside."""

from __future__ import annotations

import coal
import numpy as np
import pytest

from cableway.geometry import rotations
from cableway.geometry import spatial_pair_kernels as pairs
from cableway.geometry.spatial_convex import (
    WALLS,
    Solid,
    SpatialWorld,
    chain_distance,
    hull_distance,
    signed_distance,
)
from cableway.geometry.spatial_convex_kernels import self_distance

RNG = np.random.default_rng(5)
SIZE = np.array([1.0, 0.9, 0.8])
HALF = SIZE / 2
TURN = rotations.matrices(rotations.from_vector(np.array([0.4, -0.9, 1.3])))
SECTION = 0.2 * np.array([[-0.6, -0.5], [0.7, -0.4], [0.5, 0.6], [-0.4, 0.3]])
POINTS = HALF + 0.2 * np.random.default_rng(3).normal(size=(14, 3)) * [0.8, 1.0, 0.6]


def convex_of(points: np.ndarray) -> coal.Convex:
    vertices = coal.StdVec_Vec3s()
    vertices.extend([point for point in points])
    return coal.Convex.convexHull(vertices, True, None)


def prism_corners() -> np.ndarray:
    return np.array([[x, y, z] for x, y in SECTION for z in (-0.15, 0.15)])


# name: (solid, Coal's shape, its pose)
SOLIDS = {
    "box": (
        Solid.box(HALF, np.array([0.3, 0.2, 0.4]), TURN.T),
        coal.Box(0.3, 0.2, 0.4),
        coal.Transform3s(TURN, HALF),
    ),
    "cylinder": (
        Solid.cylinder(HALF, 0.1, 0.4, TURN.T),
        coal.Cylinder(0.1, 0.4),
        coal.Transform3s(TURN, HALF),
    ),
    "sphere": (Solid.sphere(HALF, 0.15), coal.Sphere(0.15), coal.Transform3s(np.eye(3), HALF)),
    "prism": (
        Solid.extruded(SECTION, HALF, 0.15, axes=TURN.T),
        convex_of(prism_corners()),
        coal.Transform3s(TURN, HALF),
    ),
    "hull": (Solid.hull(POINTS), convex_of(POINTS), coal.Transform3s.Identity()),
}


@pytest.fixture(params=list(SOLIDS))
def solid(request):
    return SOLIDS[request.param]


def alone(solid: Solid) -> SpatialWorld:
    """A world whose walls are far away."""
    return SpatialWorld.of([solid], 200 * SIZE, -100 * SIZE)


def by_coal(shape, pose, point, radius: float = 0.0) -> float:
    return float(coal.distance(shape, pose, coal.Sphere(max(radius, 1e-9)), coal.Transform3s(np.eye(3), point),
                               coal.DistanceRequest(), coal.DistanceResult())) + max(radius, 1e-9)  # fmt: skip


def test_outside_it_is_the_distance_of_coal(solid):
    points = RNG.uniform(-0.1, 1.0, (60, 3))
    d = signed_distance(points, alone(solid[0]))[0]
    outside = d > 1e-3
    assert outside.sum() > 30
    expected = [by_coal(solid[1], solid[2], point) for point in points[outside]]
    np.testing.assert_allclose(d[outside], expected, atol=2e-5)


def test_inside_a_ball_of_that_depth_fits_and_no_larger_one(solid):
    points = HALF + 0.06 * RNG.normal(size=(60, 3))
    world = alone(solid[0])
    d, _, _ = signed_distance(points, world)
    inside = d < -1e-3
    assert inside.sum() > 5
    directions = RNG.normal(size=(2000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for point, depth in zip(points[inside], -d[inside], strict=True):
        assert signed_distance(point + 0.999 * depth * directions, world)[0].max() <= 1e-12
        assert signed_distance(point + 1.1 * depth * directions, world)[0].max() > 0


def test_gradient_is_the_slope(solid):
    points, world, step = RNG.uniform(0.0, 0.9, (40, 3)), alone(solid[0]), 1e-6
    _, gradient, _ = signed_distance(points, world)
    slopes = [
        (signed_distance(points + step * axis, world)[0] - signed_distance(points - step * axis, world)[0]) / (2 * step)
        for axis in np.eye(3)
    ]
    off = np.abs(gradient - np.array(slopes).T).max(1)
    assert np.median(off) < 1e-7
    assert (off < 1e-5).mean() > 0.9  # but at corners of the distance


def test_walls_are_counted_after_the_obstacles():
    world = SpatialWorld.of([Solid.sphere(HALF, 0.1)], SIZE)
    for k, name in enumerate(WALLS):
        point = HALF.copy()
        point[k % 3] = 0.02 if k < 3 else SIZE[k % 3] - 0.03
        d, gradient, index = signed_distance(point, world)
        assert (d, int(index)) == (pytest.approx(0.02 if k < 3 else 0.03), 1 + k), name
        assert gradient[k % 3] == (1 if k < 3 else -1)
    assert WALLS[2] == "table"


def test_above_a_ceiling_there_is_nothing_and_below_it_all_is_the_same():
    world = SpatialWorld.of([each[0] for each in SOLIDS.values()], SIZE)
    points = RNG.uniform(0, 1, (200, 3)) * SIZE
    exact, capped = signed_distance(points, world), signed_distance(points, world, 0.05)
    near = exact[0] < 0.05
    assert near.any()
    assert not near.all()
    for a, b in zip(exact, capped, strict=True):
        np.testing.assert_array_equal(a[near], b[near])
    assert (capped[0][~near] == 0.05).all()
    assert (capped[2][~near] == -1).all()


def test_unlimited_prisms_have_no_top():
    world = alone(Solid.extruded(SECTION, HALF, np.inf))
    high = signed_distance(HALF + np.array([0.5, 0.0, 40.0]), world)
    low = signed_distance(HALF + np.array([0.5, 0.0, 0.0]), world)
    assert high[0] == pytest.approx(float(low[0]))
    assert abs(high[1][2]) == 0


def test_a_chain_is_as_near_as_its_nearest_point(solid):
    world = alone(solid[0])
    chains = RNG.uniform(0, 0.9, (20, 4, 3))
    found, index = chain_distance(chains, world)
    shares = np.linspace(0, 1, 801)[:, None, None, None]
    dense = chains[None, :, :-1] + shares * np.diff(chains, axis=1)[None]
    expected = signed_distance(dense, world)[0].min(axis=(0, 2))
    assert (found <= expected + 1e-9).all()
    np.testing.assert_allclose(found, expected, atol=2e-3)
    assert (index == 0).all()
    for ceiling in np.quantile(found, (0.0, 0.3, 0.7, 1.0)):
        capped, which = chain_distance(chains, world, ceiling)
        np.testing.assert_array_equal(capped, np.minimum(found, ceiling))
        np.testing.assert_array_equal(which, np.where(found < ceiling, 0, -1))


def test_self_distance_is_that_of_parts_far_along_the_line():
    line = np.column_stack([np.cos(np.linspace(0, 2 * np.pi, 41)), np.sin(np.linspace(0, 2 * np.pi, 41)), np.zeros(41)])
    line[:, 2] = np.linspace(0, 0.3, 41)
    assert self_distance(line, 38) == pytest.approx(np.linalg.norm(line[0] - line[-1]), abs=0.02)
    assert self_distance(line, 41) == np.inf


# ------------------------------------------------------------------------------------------------ hulls
def bodies(count: int) -> list[np.ndarray]:
    """Corners of boxes and of other hulls, at random about the middle."""
    rng, corners = np.random.default_rng(8), np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    found = []
    for k in range(count):
        shape = corners * rng.uniform(0.02, 0.1, 3) if k % 2 else 0.08 * rng.normal(size=(rng.integers(4, 12), 3))
        turn = rotations.matrices(rotations.from_vector(rng.normal(size=3)))
        found.append(HALF + 0.15 * rng.normal(size=3) + shape @ turn.T)
    return found


def test_hulls_are_as_far_from_solids_as_coal_says_and_as_deep_in_them(solid):
    ours, theirs, place = solid
    inside = 0
    for corners in bodies(200):
        wanted = coal.distance(
            convex_of(corners),
            coal.Transform3s.Identity(),
            theirs,
            place,
            coal.DistanceRequest(),
            coal.DistanceResult(),
        )
        assert hull_distance(corners, ours) == pytest.approx(wanted, abs=2e-6)
        inside += wanted < 0
    assert 20 < inside < 180


def test_a_point_of_hull_distance_is_one_of_signed_distance(solid):
    for point in HALF + 0.2 * RNG.normal(size=(50, 3)):
        assert hull_distance(point[None], solid[0]) == pytest.approx(
            signed_distance(point, alone(solid[0]))[0], abs=1e-12
        )


def test_the_slope_of_a_gap_is_that_of_moves_of_the_hull_and_its_point_is_on_it(solid):
    room, normal, at, nothing = np.empty((pairs.ROOM, 3)), np.empty(3), np.empty(3), np.empty((2, 3))
    core, disc, axis, _ = pairs.solid_core(alone(solid[0]).arrays, 0)
    for corners in bodies(60):
        gap = pairs.signed_gap(corners, core, disc, axis, np.inf, room, normal, at)
        assert np.linalg.norm(normal) == pytest.approx(1)
        for _ in range(3):
            step = 1e-4 * RNG.normal(size=3)
            moved = pairs.signed_gap(corners + step, core, disc, axis, np.inf, room, *nothing)
            assert moved - gap == pytest.approx(normal @ step, abs=5e-6)
        assert hull_distance(corners, Solid.sphere(at, 1e-9)) < 1e-6


def test_enough_is_said_as_soon_as_it_is_known_and_never_too_much():
    room, normal, at = np.empty((pairs.ROOM, 3)), np.empty(3), np.empty(3)
    shapes = bodies(40)
    for a, b in zip(shapes[::2], shapes[1::2], strict=True):
        gap = pairs.core_gap(a, b, 0.0, np.zeros(3), np.inf, room, normal, at)
        for enough in (0.5 * gap, 0.01, 0.1):
            said = pairs.core_gap(a, b, 0.0, np.zeros(3), enough, room, normal, at)
            assert said <= gap + 1e-12
            assert (said >= enough) is bool(gap >= enough)


@pytest.mark.parametrize("shift", [[0.1, 0, 0], [0.1, 0.05, 0], [0.1, 0.1, 0], [0.1, 0.1, 0.1]])
def test_boxes_that_meet_in_a_face_an_edge_or_a_corner_touch(shift: list[float]):
    box = np.array([[x, y, z] for x in (0, 0.1) for y in (0, 0.1) for z in (0.0, 0.1)])
    for away in (0.0, 0.003, -0.003):
        moved = box + shift + np.array([away, 0, 0])
        assert hull_distance(moved, Solid.hull(box)) == pytest.approx(
            away if away > 0 or shift[1] < 0.1 else 0, abs=2e-6
        )
