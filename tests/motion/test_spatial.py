"""Where a cable in space may be: each limit has a shape that breaks it alone, or nearly so."""

from __future__ import annotations

import numpy as np
import pytest
from spatial_problems import HANGING, past_a_ball

from cableway.geometry.groups import SE3
from cableway.motion import spatial_kernels
from cableway.motion.limits import Margins
from cableway.motion.spatial import SpatialBodies, SpatialFreeSpace, continuous_poses, rows_between
from cableway.motion.time_parametrization import gripper_effort, ramp_effort
from cableway.scene.grippers import Grippers
from cableway.scene.spatial.grippers import SpatialGrippers

PROBLEM = past_a_ball()
SPACE = SpatialFreeSpace.of(PROBLEM, Margins())


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
    rod, world, limits, bodies = SPACE.arrays
    free = SpatialFreeSpace((rod, world, limits._replace(**loose), bodies))
    assert free.are_free(FORBIDDEN[name][None])[0]


def test_a_gripper_that_the_cable_comes_back_to_is_in_its_way():
    rod, world, limits, bodies = SPACE.arrays
    curl = changed(_6=-20.0, _11=12.0)
    loose = limits._replace(least_span=0.0, most_span=9.0, stability=-1e9, bodies_apart=-1.0, self_distance=0.0)
    assert not SpatialFreeSpace((rod, world, loose, bodies)).are_free(curl[None])[0]
    assert SpatialFreeSpace((rod, world, loose._replace(bodies_off_cable=-1.0), bodies)).are_free(curl[None])[0]


def test_a_cable_that_touches_itself_is_not_free():
    """A loop whose ends pass each other at 5.8 mm, and it is 8 mm thick."""
    rod, world, limits, bodies = SPACE.arrays
    loop = changed(_6=0.0, _9=0.0, _11=6.2)
    loose = limits._replace(
        least_span=0.0, most_span=9.0, stability=-1e9, bodies_apart=-1.0, bodies_off_cable=-1.0, most_twist=9.0
    )
    stations = PROBLEM.rod.shapes(loop[None])[0][0]
    gap = np.linalg.norm(stations[0] - stations[-1])
    assert gap < limits.self_distance
    assert not SpatialFreeSpace((rod, world, loose, bodies)).are_free(loop[None])[0]
    assert SpatialFreeSpace((rod, world, loose._replace(self_distance=0.5 * gap), bodies)).are_free(loop[None])[0]


def test_the_way_between_two_shapes_is_that_of_the_rod():
    rng, rod = np.random.default_rng(0), PROBLEM.rod
    a, b = rng.normal(0, 1.5, (2, 12))
    turn, found = np.empty(3), np.empty(12)
    angle = spatial_kernels.turn_between(a, b, turn)
    assert angle == pytest.approx(np.linalg.norm(rod.difference(a, b)[3:6]))
    spatial_kernels.between(a, b, turn, 0.3, found)
    np.testing.assert_allclose(rod.written_near(found, rod.between(a, b, 0.3)), rod.between(a, b, 0.3), atol=1e-12)
    np.testing.assert_allclose(rows_between(rod, np.array([a, b]), np.array([0.3]))[0], rod.between(a, b, 0.3))


def test_points_cover_the_surface_of_a_gripper_and_move_with_it():
    hull = next(body for body in SpatialGrippers(body="2f-85").bodies if len(body.points) > 1)
    bodies = SpatialBodies.of([hull])
    poses = PROBLEM.rod.end_poses(HANGING[None])
    placed = hull.placed(poses[:, hull.side])[0]
    points = bodies.points(poses)[0]
    assert len(points) > 20
    for corner in placed:
        assert np.linalg.norm(points - corner, axis=1).min() < 1e-5
    assert (points.min(0) >= placed.min(0) - 1e-5).all()


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
