"""Laws of angles and rigid motions."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cableway.geometry import se2

LAWS = settings(deadline=None, derandomize=True, max_examples=60)
angles = st.floats(-50, 50)
points = st.tuples(st.floats(-3, 3), st.floats(-3, 3)).map(np.array)


@LAWS
@given(angles)
def test_a_wrapped_angle_is_the_same_direction_within_half_a_turn(angle: float):
    wrapped = float(se2.wrap_angle(angle))
    assert -np.pi < wrapped <= np.pi
    np.testing.assert_allclose(se2.direction(wrapped), se2.direction(angle), atol=1e-12)


def test_half_a_turn_stays_positive():
    np.testing.assert_array_equal(se2.wrap_angle(np.array([np.pi, -np.pi, 3 * np.pi])), [np.pi] * 3)


@LAWS
@given(points, points, points, angles, angles)
def test_transforms_compose(p: np.ndarray, t: np.ndarray, u: np.ndarray, alpha: float, beta: float):
    """Turning by alpha and moving by t, then beta and u, is one transform by alpha + beta."""
    twice = se2.transform(se2.transform(p, t, alpha), u, beta)
    once = se2.transform(p, se2.rotation(beta) @ t + u, alpha + beta)
    np.testing.assert_allclose(twice, once, atol=1e-9)


@LAWS
@given(points, points, points, angles)
def test_a_transform_keeps_distances(p: np.ndarray, r: np.ndarray, t: np.ndarray, angle: float):
    moved = se2.transform(np.stack([p, r]), t, angle)
    np.testing.assert_allclose(np.linalg.norm(moved[1] - moved[0]), np.linalg.norm(r - p), atol=1e-12)


@LAWS
@given(points, angles)
def test_rotation_turns_counter_clockwise_from_x(p: np.ndarray, angle: float):
    np.testing.assert_allclose(se2.rotation(angle) @ [1.0, 0.0], se2.direction(angle), atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(se2.rotation(angle)), 1.0)
