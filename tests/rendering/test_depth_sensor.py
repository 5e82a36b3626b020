"""Laws of the depth sensor: errors grow with the square of the depth; what only one of its cameras sees is unknown."""

from __future__ import annotations

import numpy as np
import pytest

from cableway.rendering.depth_sensor import MILLIMETRE, DepthSensor, measured

FOCAL = 1000.0


@pytest.mark.parametrize("depth", [1.0, 2.0])
def test_errors_are_those_of_disparities(depth: float):
    sensor = DepthSensor(step=1e-3)
    found = measured(np.full((200, 200), depth), FOCAL, sensor, np.random.default_rng(0))
    expected = depth**2 * sensor.subpixel / (FOCAL * sensor.baseline)
    assert found.std() == pytest.approx(expected, rel=0.1)
    assert found.mean() == pytest.approx(depth, abs=0.1 * expected)


def test_neighbours_err_alike():
    found = measured(np.full((200, 200), 1.5), FOCAL, DepthSensor(), np.random.default_rng(0))
    off = found - found.mean()
    assert np.mean(off[:, 1:] * off[:, :-1]) > 0.7 * np.mean(off**2)
    assert abs(np.mean(off[:, 20:] * off[:, :-20])) < 0.2 * np.mean(off**2)


def test_depths_are_of_disparities_in_steps():
    sensor = DepthSensor(offset=0.25)
    found = measured(np.full((50, 50), 1.5), FOCAL, sensor, np.random.default_rng(0))
    steps = FOCAL * sensor.baseline / found / sensor.step
    assert np.abs(steps - steps.round()).max() * sensor.step < FOCAL * sensor.baseline / 1.4**2 * MILLIMETRE
    assert found.mean() < 1.5


def test_the_left_of_a_thing_is_hidden_from_the_right_camera():
    """A strip as wide as the difference of the disparities: 1000 * 0.055 * (1 / 1 - 1 / 2) = 27.5 pixels."""
    depth = np.full((20, 200), 2.0)
    depth[:, 100:140] = 1.0
    found = measured(depth, FOCAL, DepthSensor(jitter=0.0), np.random.default_rng(0))
    np.testing.assert_allclose((found == 0).sum(axis=1), 27, atol=1)
    assert (found[:, 75:98] == 0).all()
    assert (found[:, 141:] > 1.9).all()


def test_nothing_has_no_depth():
    assert not measured(np.full((5, 5), np.inf), FOCAL, DepthSensor(), np.random.default_rng(0)).any()
