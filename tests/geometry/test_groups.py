"""Laws of the groups of rigid motions."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cableway.geometry import rotations
from cableway.geometry.groups import SE2, SE3

LAWS = settings(deadline=None, derandomize=True, max_examples=60)
angles = st.floats(-50, 50)
points = st.tuples(st.floats(-3, 3), st.floats(-3, 3)).map(np.array)
poses = st.tuples(st.floats(-3, 3), st.floats(-3, 3), angles).map(np.array)


@LAWS
@given(poses, poses, poses)
def test_composition_is_associative_and_has_inverses(a: np.ndarray, b: np.ndarray, c: np.ndarray):
    left, right = SE2.compose(SE2.compose(a, b), c), SE2.compose(a, SE2.compose(b, c))
    np.testing.assert_allclose(left, right, atol=1e-12)
    np.testing.assert_allclose(SE2.compose(a, SE2.inverse(a)), np.zeros(3), atol=1e-12)
    np.testing.assert_allclose(SE2.compose(SE2.inverse(a), a), np.zeros(3), atol=1e-12)


@LAWS
@given(poses, poses, poses)
def test_small_steps_in_a_frame_are_turned_into_the_world(a: np.ndarray, b: np.ndarray, step: np.ndarray):
    moved = SE2.compose(a, b + 1e-6 * step)
    np.testing.assert_allclose(moved, SE2.compose(a, b) + 1e-6 * SE2.to_world(a) @ step, atol=1e-10)


@LAWS
@given(poses, poses)
def test_plus_undoes_minus_and_turns_the_short_way(a: np.ndarray, b: np.ndarray):
    step, reached = SE2.minus(b, a), SE2.plus(a, SE2.minus(b, a))
    assert abs(step[2]) <= np.pi
    np.testing.assert_allclose(SE2.distance(reached, b), (0.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(reached, SE2.continued(b, a), atol=1e-12)
    np.testing.assert_allclose(SE2.between(a, b, np.array([0.0, 1.0])), [a, reached], atol=1e-12)


def test_a_step_leads_from_one_pose_to_the_other_the_short_way():
    before = np.array([[0.0, 0.0, 3.0], [1.0, 2.0, -3.0]])
    after = np.array([[0.1, 0.0, -3.0], [1.0, 2.5, 3.0]])
    step = SE2.minus(after, before)
    np.testing.assert_allclose(step[:, :2], [[0.1, 0.0], [0.0, 0.5]])
    np.testing.assert_allclose(step[:, 2], [2 * np.pi - 6, 6 - 2 * np.pi])
    np.testing.assert_array_equal(after[:, 2], [-3.0, 3.0])


@LAWS
@given(points, angles, points, angles)
def test_pose_distance_is_symmetric_and_zero_for_full_turns(p: np.ndarray, a: float, r: np.ndarray, b: float):
    one, other = np.array([*p, a]), np.array([*r, b])
    there, back = SE2.distance(one, other), SE2.distance(other, one)
    np.testing.assert_allclose(there, back, atol=1e-12)
    np.testing.assert_allclose(SE2.distance(one, one + np.array([0, 0, 4 * np.pi])), (0.0, 0.0), atol=1e-12)


@LAWS
@given(points, points, poses, poses)
def test_a_slope_by_points_is_pulled_back_to_their_pose(g: np.ndarray, p: np.ndarray, pose: np.ndarray, by: np.ndarray):
    """The points, fixed to the pose, move with a small step of it."""
    inside, h = SE2.compose(SE2.inverse(pose), np.array([*p, 0.0])), 1e-6
    after, before = (SE2.position(SE2.compose(SE2.plus(pose, sign * h * by), inside)) for sign in (1, -1))
    np.testing.assert_allclose(SE2.pulled_back(g, p, pose) @ by, g @ (after - before) / (2 * h), atol=1e-5)


def drawn_poses(count: int, seed: int) -> np.ndarray:
    """Poses in space anywhere, turned anyhow."""
    rng = np.random.default_rng(seed)
    turns = rng.normal(size=(count, 4))
    return np.column_stack([rng.normal(size=(count, 3)), turns / np.linalg.norm(turns, axis=1, keepdims=True)])


def test_poses_in_space_are_a_group():
    a, b, c = (drawn_poses(20, seed) for seed in range(3))
    left, right = SE3.compose(SE3.compose(a, b), c), SE3.compose(a, SE3.compose(b, c))
    np.testing.assert_allclose(left, right, atol=1e-12)
    np.testing.assert_allclose(SE3.compose(a, SE3.inverse(a)), np.tile(np.eye(7)[3], (20, 1)), atol=1e-12)


def test_steps_in_space_lead_the_short_way_and_are_small_motions():
    a, b = drawn_poses(20, 0), drawn_poses(20, 1)
    step = SE3.minus(b, a)
    assert np.linalg.norm(step[:, 3:], axis=1).max() <= np.pi
    np.testing.assert_allclose(SE3.plus(a, step), SE3.continued(b, SE3.plus(a, step)), atol=1e-12)
    np.testing.assert_allclose(SE3.distance(SE3.between(a, b, 0.5), b)[1], np.linalg.norm(step[:, 3:], axis=1) / 2)
    small = 1e-6 * step
    local = SE3.plus(np.tile(np.eye(7)[3], (20, 1)), small)
    world = SE3.plus(a, np.einsum("kij,kj->ki", SE3.to_world(a), small))
    np.testing.assert_allclose(SE3.compose(a, local), world, atol=1e-10)


def test_a_slope_by_points_in_space_is_pulled_back_to_their_pose():
    pose, by = drawn_poses(5, 0), np.random.default_rng(3).normal(size=(5, 6))
    points, slope = np.random.default_rng(4).normal(size=(2, 5, 3))
    inside = SE3.compose(SE3.inverse(pose), np.column_stack([points, np.tile([1.0, 0, 0, 0], (5, 1))]))
    after, before = (SE3.position(SE3.compose(SE3.plus(pose, sign * 1e-6 * by), inside)) for sign in (1, -1))
    rate = np.sum(slope * (after - before), axis=1) / 2e-6
    np.testing.assert_allclose(np.sum(SE3.pulled_back(slope, points, pose) * by, axis=1), rate, atol=1e-8)


def test_quaternions_are_those_of_their_matrices():
    turns = np.vstack([drawn_poses(20, 5)[:, 3:], np.eye(4)])
    again = rotations.from_matrices(rotations.matrices(turns))
    np.testing.assert_allclose(np.abs(np.sum(again * turns, axis=1)), 1, atol=1e-12)
    vectors = rotations.to_vector(turns)
    np.testing.assert_allclose(np.abs(np.sum(rotations.from_vector(vectors) * turns, axis=1)), 1, atol=1e-12)
