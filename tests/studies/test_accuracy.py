"""The reference of the accuracy figures: its two solutions agree, and both have the known limits."""

# MuJoCo's bindings are compiled and carry no type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from accuracy import on_a_table
from accuracy.elastica import clamped_shape, pushed_together
from hypothesis import given, settings
from hypothesis import strategies as st

from cableway.scene.cable import Cable
from cableway.simulation.table import GRAVITY


@pytest.mark.parametrize("shortening", [0.02, 0.2, 0.5, 0.8])
def test_the_collocation_finds_the_closed_form(shortening: float):
    exact = pushed_together(shortening, 13)
    poses = np.array([[0.0, 0.0, 0.0], [1 - shortening, 0.0, 0.0]])
    found, _ = clamped_shape(1.0, poses, pushed_together(shortening, 40), 13)
    np.testing.assert_allclose(found, exact, atol=2e-7)


def test_the_closed_form_has_the_height_of_the_rod_that_stands_upright_at_its_quarters():
    """There k^2 = 1/2, with K = 1.85407 and E = 1.35064 by the tables, and the height is k/K."""
    whole, arc = 1.854_074_677_3, 1.350_643_881_0
    line = pushed_together(2 - 2 * arc / whole, 4001)
    quarter = line[1001] - line[999]
    assert abs(quarter[0]) < 1e-6 * quarter[1]
    assert line[2000, 1] == pytest.approx(np.sqrt(0.5) / whole, abs=1e-9)


def test_a_little_shortening_buckles_into_a_cosine():
    """y = A (1 - cos 2 pi x)/2 with the shortening (pi A)^2/4."""
    line = pushed_together(1e-4, 13)
    amplitude = 2 * np.sqrt(1e-4) / np.pi
    np.testing.assert_allclose(line[:, 1], amplitude / 2 * (1 - np.cos(2 * np.pi * line[:, 0])), atol=1e-3 * amplitude)


@pytest.mark.parametrize("shortening", [0.02, 0.3, 0.6])
def test_the_closed_form_keeps_its_length_and_ends(shortening: float):
    line = pushed_together(shortening, 2001)
    assert np.linalg.norm(np.diff(line, axis=0), axis=1).sum() == pytest.approx(1.0, abs=1e-5)
    np.testing.assert_allclose(line[[0, -1]], [[0.0, 0.0], [1 - shortening, 0.0]], atol=1e-9)


@pytest.mark.parametrize("turn", [-4.0, 0.5, 3.0])
def test_ends_on_a_circle_hold_an_arc(turn: float):
    """With no force along it the rod is bent alike everywhere."""
    length = 0.3
    angles = turn * np.linspace(0, 1, 13)
    arc = length / turn * np.column_stack([np.sin(angles), 1 - np.cos(angles)])
    found, radius = clamped_shape(length, np.array([[0.0, 0.0, 0.0], [*arc[-1], turn]]), arc, 13)
    np.testing.assert_allclose(found, arc, atol=1e-8)
    assert radius == pytest.approx(length / abs(turn))


def test_small_offsets_bend_it_into_the_cubic_of_a_beam():
    """Clamped ends moved apart sideways by d, the rod free to draw in: y = d (3 x^2 - 2 x^3)."""
    offset = 1e-3
    poses = np.array([[0.0, 0.0, 0.0], [1 - 0.6 * offset**2, offset, 0.0]])
    x = np.linspace(0, 1, 13)
    cubic = np.column_stack([x, offset * (3 * x**2 - 2 * x**3)])
    found, _ = clamped_shape(1.0, poses, cubic, 13)
    np.testing.assert_allclose(found[:, 1], cubic[:, 1], atol=1e-3 * offset)


@settings(deadline=None, max_examples=20)
@given(x=st.floats(-2, 2), y=st.floats(-2, 2), turn=st.floats(-9, 9), scale=st.floats(0.1, 10))
def test_it_moves_turns_and_scales_with_its_grippers(x: float, y: float, turn: float, scale: float):
    poses = np.array([[0.0, 0.0, 0.4], [0.7, 0.1, -0.8]])
    base, radius = clamped_shape(1.0, poses, NEAR, 13)
    cos, sin = np.cos(turn), np.sin(turn)

    def moved(points: np.ndarray) -> np.ndarray:
        return scale * points @ [[cos, sin], [-sin, cos]] + [x, y]

    there = np.column_stack([moved(poses[:, :2]), poses[:, 2] + turn])
    found, wider = clamped_shape(scale, there, moved(NEAR), 13)
    np.testing.assert_allclose(found, moved(base), atol=1e-5 * scale)
    assert wider == pytest.approx(scale * radius, rel=1e-4)


def test_ends_farther_apart_than_its_length_have_no_shape():
    poses = np.array([[0.0, 0.0, 0.0], [1.2, 0.0, 0.0]])
    with pytest.raises(RuntimeError, match="no elastica"):
        clamped_shape(1.0, poses, NEAR, 13)


NEAR = np.column_stack([np.linspace(0, 0.7, 25), 0.3 * np.sin(np.pi * np.linspace(0, 1, 25))])


# ---------------------------------------------------------------- the chain in space
def test_let_go_on_a_tilted_table_it_slides_when_pushed_by_more_than_its_friction():
    """Along its axis; sideways a straight cable rolls."""
    cable, threshold = Cable(friction=0.3), 0.3 * GRAVITY
    for push, acceleration in ((0.9 * threshold, 0.0), (2.0 * threshold, threshold)):
        model = on_a_table.spatial_chain(cable, on_a_table.TIME_STEP)
        model.opt.gravity[0] = push
        data = mujoco.MjData(model)
        data.qpos[2] = cable.radius
        data.eq_active[:] = 0
        mujoco.mj_step(model, data, nstep=round(0.5 / on_a_table.TIME_STEP))
        assert data.qpos[0] == pytest.approx(acceleration * 0.5**2 / 2, rel=0.02, abs=2e-5)


def test_without_friction_it_moves_as_the_plant_does():
    cable = Cable()
    q = np.array([0.35, 0.35, 0.4, -20.0, 2.0, 3.0])
    poses = cable.rod.shapes(q + np.linspace(0, 1, 6)[:, None] * [0.02, 0.01, 0.1, 4.0, -3.0, 1.0])[1]
    reference, _ = on_a_table.spatial_keypoints(cable, q, poses)
    np.testing.assert_allclose(on_a_table.planar_keypoints(cable, q, poses), reference, atol=5e-5)
