"""Where a cable in space may be: each limit has a shape that breaks it alone, or nearly so."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from spatial_problems import HANGING, past_a_ball

from cableway.geometry import rotations
from cableway.geometry.groups import SE3
from cableway.geometry.spatial_convex import Solid, hull_distance, signed_distance
from cableway.motion import spatial_kernels
from cableway.motion.limits import Margins
from cableway.motion.spatial import SpatialBodies, SpatialFreeSpace, continuous_poses, rows_between
from cableway.motion.spatial_kernels import OFF, OTHER, WORLD
from cableway.motion.time_parametrization import gripper_effort, ramp_effort
from cableway.scene.grippers import Grippers
from cableway.scene.spatial.grippers import GripperPiece, SpatialGrippers

PROBLEM = past_a_ball()
SPACE = SpatialFreeSpace.of(PROBLEM, Margins())
STATIONS = PROBLEM.rod.shapes(HANGING[None])[0][0]


def changed(**places: float) -> np.ndarray:
    """The hanging cable with some of its numbers changed."""
    q = HANGING.copy()
    for place, value in places.items():
        q[int(place[1:])] = value
    return q


FORBIDDEN = {
    "cable in the ball": changed(_0=0.4),
    "cable through the table": changed(_2=0.005),
    "gripper through a wall": changed(_0=0.7, _1=0.155),
    "too taut": changed(_6=60.0, _11=0.0),
    "too twisted": changed(_9=13 * 2 / 3),
    "unstable": changed(_6=-45.0),
}


def test_start_and_goal_are_free():
    assert SPACE.are_free(np.array([PROBLEM.start, PROBLEM.goal])).all()


@pytest.mark.parametrize("q", FORBIDDEN.values(), ids=FORBIDDEN)
def test_what_breaks_a_limit_is_not_free(q):
    assert not SPACE.are_free(q[None])[0]


@pytest.mark.parametrize(
    ("name", "loose"),
    [
        ("cable in the ball", {"cable_distance": -1.0}),
        ("gripper through a wall", {"gripper_clearance": -1.0}),
        ("too taut", {"most_span": 9.0}),
        ("too twisted", {"most_twist": 99.0, "stability": -1e6}),
    ],
)
def test_without_its_limit_it_is_free(name, loose):
    rod, world, limits, bodies, arms = SPACE.arrays
    free = SpatialFreeSpace((rod, world, limits._replace(**loose), bodies, arms))
    assert free.are_free(FORBIDDEN[name][None])[0]


def test_a_gripper_that_the_cable_comes_back_to_is_in_its_way():
    rod, world, limits, bodies, arms = SPACE.arrays
    curl = changed(_6=-20.0, _11=12.0)
    loose = limits._replace(least_span=0.0, most_span=9.0, stability=-1e9, bodies_apart=-1.0, self_distance=0.0)
    assert not SpatialFreeSpace((rod, world, loose, bodies, arms)).are_free(curl[None])[0]
    assert SpatialFreeSpace((rod, world, loose._replace(bodies_off_cable=-1.0), bodies, arms)).are_free(curl[None])[0]


def test_a_cable_that_touches_itself_is_not_free():
    """A loop whose ends pass each other at 5.8 mm, and it is 8 mm thick."""
    rod, world, limits, bodies, arms = SPACE.arrays
    loop = changed(_6=0.0, _9=0.0, _11=6.2)
    loose = limits._replace(
        least_span=0.0, most_span=9.0, stability=-1e9, bodies_apart=-1.0, bodies_off_cable=-1.0, most_twist=9.0
    )
    stations = PROBLEM.rod.shapes(loop[None])[0][0]
    gap = np.linalg.norm(stations[0] - stations[-1])
    assert gap < limits.self_distance
    assert not SpatialFreeSpace((rod, world, loose, bodies, arms)).are_free(loop[None])[0]
    assert SpatialFreeSpace((rod, world, loose._replace(self_distance=0.5 * gap), bodies, arms)).are_free(loop[None])[0]


def test_the_way_between_two_shapes_is_that_of_the_rod():
    rng, rod = np.random.default_rng(0), PROBLEM.rod
    a, b = rng.normal(0, 1.5, (2, 12))
    turn, found = np.empty(3), np.empty(12)
    angle = spatial_kernels.turn_between(a, b, turn)
    assert angle == pytest.approx(np.linalg.norm(rod.difference(a, b)[3:6]))
    spatial_kernels.between(a, b, turn, 0.3, found)
    np.testing.assert_allclose(rod.written_near(found, rod.between(a, b, 0.3)), rod.between(a, b, 0.3), atol=1e-12)
    np.testing.assert_allclose(rows_between(rod, np.array([a, b]), np.array([0.3]))[0], rod.between(a, b, 0.3))


def box_at(point: tuple[float, float, float], q: np.ndarray, size: float = 0.01) -> GripperPiece:
    """A box of the left gripper about a point in the world, and the same mirrored of the right one."""
    pose = PROBLEM.rod.end_poses(q[None])[0, 0]
    middle = rotations.rotate(rotations.conjugate(pose[3:]), np.array(point) - pose[:3]) * (-1, 1, 1)
    return GripperPiece(points=middle + size / 2 * (np.indices((2, 2, 2)).reshape(3, 8).T * 2 - 1))


LOW = changed(_0=0.4, _2=0.25)
"""Below the ball."""

HANDS = {
    "in the ball": (LOW, (box_at((0.4, 0.36, 0.34), LOW),), "gripper_clearance"),
    "in a wall": (HANGING, (box_at((0.003, 0.27, 0.39), HANGING),), "gripper_clearance"),
    "in the other": (HANGING, (box_at((0.25, 0.395, 0.45), HANGING, 0.02),), "bodies_apart"),
    "in a ball of the other": (HANGING, (box_at((0.138, 0.532, 0.41), HANGING),), "bodies_apart"),
    "on the cable": (HANGING, (box_at(tuple(STATIONS[30].tolist()), HANGING),), "bodies_off_cable"),
}
"""Shapes that are free but for what pieces of hands are in, and the limit that says so."""


@pytest.mark.parametrize("case", HANDS)
def test_a_hand_is_kept_off_what_it_may_be_in(case: str):
    q, pieces, limit = HANDS[case]
    assert SPACE.are_free(q[None])[0]
    (rod, world, limits, _, arms), radius = SPACE.arrays, PROBLEM.radius
    bodies = SpatialBodies.of(SpatialGrippers(body=pieces).bodies, radius).arrays(PROBLEM.rod.length, len(STATIONS))
    assert not SpatialFreeSpace((rod, world, limits, bodies, arms)).are_free(q[None])[0]
    loose = limits._replace(**{limit: -np.inf})
    assert SpatialFreeSpace((rod, world, loose, bodies, arms)).are_free(q[None])[0]


def test_gaps_of_hulls_are_those_of_many_points_on_them():
    rng, rod = np.random.default_rng(3), PROBLEM.rod
    bodies = SpatialBodies.of(SpatialGrippers(body="2f-85").bodies, PROBLEM.radius)
    q = HANGING + rng.normal(0, (0.1, 0.1, 0.1, 1, 1, 1, 3, 3, 3, 1, 1, 1), (40, 12))
    q[:, 11] += 2.5
    stations, poses = rod.shapes(q)
    away, _, _, near, share = bodies.hull_gaps(poses, stations, PROBLEM.world, rod.length, np.full(3, np.inf))
    corners, first = bodies.hulls.placed(poses), bodies.hulls.first
    for row in range(len(q)):
        hulls = [corners[row, i:j] for i, j in pairwise(first)]
        for p, hull in enumerate(hulls):
            others = [each for k, each in enumerate(hulls) if bodies.hulls.side[k] != bodies.hulls.side[p]]
            wanted = [hull_distance(hull, Solid.hull(other)) for other in others]
            (k,) = np.flatnonzero(bodies.side != bodies.hulls.side[p])
            wanted.append(hull_distance(hull, Solid.sphere(bodies.points(poses)[row, k], bodies.radius[k])))
            assert away[row, p, OTHER] == pytest.approx(min(wanted), abs=1e-5)
            points = rng.dirichlet(np.full(len(hull), 0.4), 300) @ hull
            assert away[row, p, WORLD] < signed_distance(points, PROBLEM.world)[0].min() + 1e-9
            line, one = stations[row], near[row, p]
            nearest = line[one] + share[row, p] * (line[one + 1] - line[one])
            if away[row, p, OFF] > 0:
                assert hull_distance(nearest[None], Solid.hull(hull)) == pytest.approx(away[row, p, OFF], abs=1e-5)
    assert np.sum(away[..., OTHER] < 0) > 20


def test_effort_in_space_is_that_of_the_plane_for_motions_of_the_plane():
    rng = np.random.default_rng(1)
    flat = np.cumsum(rng.normal(0, 0.01, (9, 2, 3)), axis=0)
    poses = np.zeros((9, 2, 7))
    poses[..., :2], poses[..., 3], poses[..., 6] = flat[..., :2], np.cos(flat[..., 2] / 2), np.sin(flat[..., 2] / 2)
    limits = Grippers(max_acceleration=0.5, max_turn_acceleration=5.0, max_jerk=5.0, max_turn_jerk=50.0)
    np.testing.assert_allclose(gripper_effort(poses, 0.01, 0.1), gripper_effort(flat, 0.01, 0.1))
    np.testing.assert_allclose(ramp_effort(poses, limits), ramp_effort(flat, limits), atol=1e-9)


def test_quaternions_do_not_jump():
    poses = SE3.plus(np.tile([0, 0, 0, 1.0, 0, 0, 0], (40, 2, 1)), np.linspace(0, 9, 40)[:, None, None] * np.eye(6)[5])
    jumping = poses * np.where(np.arange(40) % 3, 1.0, -1.0)[:, None, None]
    jumping[..., :3] = poses[..., :3]
    found = continuous_poses(jumping)
    assert np.abs(np.diff(found[..., 3:], axis=0)).max() < 0.2
