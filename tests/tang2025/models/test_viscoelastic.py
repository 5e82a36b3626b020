"""Laws of the visco-elastic rod: it tends to the equilibria of `cableway.rod`, and its derivative is exact."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cableway.geometry import se2
from cableway.rod import material as rod_material
from cableway.rod.fitting import workspace
from cableway.rod.kernels import held_shape
from cableway.rod.planar import PlanarRod
from cableway.tang2025.models.viscoelastic import RodParameters, chain_hinges, link_angles, positions, rod_step

FROM = np.array([0.3, 0.2, 0.7, -20.0, 6.0, 2.5])
TO = FROM + np.array([0.004, -0.003, 0.02, 0.8, -0.6, 0.1])


def material(keypoints: int, damping_time: float = 0.1):
    return RodParameters(damping_time).material(chain_hinges(keypoints))


def equilibria(keypoints: int, length: float = 0.3):
    """Keypoints and poses of two neighbouring equilibria."""
    rod = PlanarRod(length, keypoints)
    stations, poses = rod.shapes(np.array([FROM, TO]))
    return np.float32(rod.at_keypoints(stations)), np.float32(poses)


step = jax.jit(rod_step)


@pytest.mark.parametrize("keypoints", [25, 13, 10])
def test_without_lag_it_goes_from_one_equilibrium_of_the_chain_to_the_next(keypoints):
    shapes, poses = equilibria(keypoints)
    moved = step(material(keypoints, 1e-4), shapes[0], poses[0], poses[1] - poses[0])
    way = shapes[1] - shapes[0]
    np.testing.assert_allclose(moved, way, atol=0.01 * np.abs(way).max())


@pytest.mark.parametrize("keypoints", [13, 10])
def test_a_rod_that_is_not_uniform_is_the_rod_of_the_estimator(keypoints):
    """Stiffness and rest curvature along the length as in `cableway.rod.material`."""
    rod = PlanarRod(0.3, keypoints)
    stiffness, rest = np.array([0.5, -0.4 * 2 / 3]), np.array([0.6, 0.8 * 2 / 3])
    p = np.concatenate([[rod.length], stiffness, rest])
    modes = rod_material.modes(rod.hinges, len(rest))
    shapes, poses = [], []
    for q in (FROM, TO):
        stations, _, ends, _ = arrays = workspace(modes, len(q) + len(p))
        held_shape(q, p, modes, *arrays)
        shapes.append(rod.at_keypoints(stations[None])[0])
        poses.append(ends)
    parameters = RodParameters(1e-4)
    parameters = eqx.tree_at(lambda r: (r.stiffness, r.rest), parameters, (jnp.float32(stiffness), jnp.float32(rest)))
    action = np.float32(poses[1] - poses[0])
    moved = step(parameters.material(rod.hinges), np.float32(shapes[0]), np.float32(poses[0]), action)
    way = shapes[1] - shapes[0]
    np.testing.assert_allclose(moved, way, atol=0.02 * np.abs(way).max())


def test_the_angles_of_the_links_are_found_from_the_keypoints():
    rod = PlanarRod(0.5, 13)
    stations, poses = rod.shapes(FROM[None])
    links = np.diff(stations[0, 1::2], axis=0)
    found = jax.jit(link_angles)(np.float32(rod.at_keypoints(stations)[0]), np.float32(poses[0, :, 2]))
    np.testing.assert_allclose(found[1:-1], np.unwrap(np.arctan2(links[:, 1], links[:, 0])), atol=2e-3)
    np.testing.assert_allclose(found[jnp.array([0, -1])], poses[0, :, 2], atol=1e-5)


def test_a_cable_at_rest_stays_and_one_that_lags_follows_between_still_grippers():
    shapes, poses = equilibria(13)
    still = np.zeros((2, 3), np.float32)
    assert np.abs(np.asarray(step(material(13), shapes[0], poses[0], still))).max() < 2e-5
    lagging = shapes[0] + np.asarray(step(material(13, 10.0), shapes[0], poses[0], poses[1] - poses[0]))
    behind = np.linalg.norm(lagging - shapes[1])
    after = lagging + np.asarray(step(material(13, 0.1), lagging, poses[1], still))
    assert behind > 1e-4
    np.testing.assert_allclose(np.linalg.norm(after - shapes[1]) / behind, np.exp(-1.0), atol=0.1)


def waved(size):
    """An equilibrium, the same with two waves of bends of so much rms curvature times length added, and the poses."""
    shapes, poses = equilibria(13)
    angles = np.asarray(link_angles(shapes[0], poses[0, :, 2]))
    waves = size * np.sqrt(2) / (4 * np.pi) * np.sin(4 * np.pi * np.linspace(0, 1, len(angles)))
    plain, bent = (0.3 * np.asarray(positions(np.float32(a)))[::2] for a in (angles, angles + waves))
    return plain, bent, np.column_stack([bent[[0, -1]], angles[[0, -1]]])


def test_a_shape_of_its_own_stays_and_lag_does_not():
    still = np.zeros((2, 3), np.float32)
    for size, low, high in ((0.05, 0.3, 0.8), (1.0, 0.0, 0.1)):
        plain, bent, poses = waved(size)
        lost = np.linalg.norm(step(material(13), bent, poses, still)) / np.linalg.norm(bent - plain)
        assert low < lost < high


def test_a_shape_of_its_own_goes_with_the_grippers():
    """Cables waved at rest, which no parameter describes, are predicted ten times as well as by a rod without waves."""
    _, bent, poses = waved(1.0)
    rest = np.diff(np.asarray(link_angles(bent, poses[:, 2])))
    action = np.float32([[0.0, 0.0, 0.05], [-0.003, 0.002, -0.05]])
    true = step(material(13)._replace(rest=np.float32(rest)), bent, poses, action)
    found, plain = (
        step(material(13)._replace(kept=kept), bent, poses, action) - true for kept in (material(13).kept, 0.0)
    )
    assert 10 * np.linalg.norm(found) < np.linalg.norm(plain)


def test_the_ends_move_with_the_grippers_even_where_no_rod_could_follow():
    shapes, poses = equilibria(13)
    action = np.float32([[-0.05, 0.02, 0.1], [0.2, 0.1, -0.3]])
    moved = np.asarray(step(material(13), shapes[0], poses[0], action))
    np.testing.assert_allclose(moved[[0, -1]], action[:, :2], atol=1e-6)
    assert np.isfinite(moved).all()


def test_it_moves_and_grows_with_the_cable():
    shapes, poses = equilibria(13)
    action = poses[1] - poses[0]
    turn, size = se2.rotation(2.2), 1.7
    there = step(
        material(13),
        np.float32(size * shapes[0] @ turn.T + 0.4),
        np.float32(np.column_stack([size * poses[0, :, :2] @ turn.T + 0.4, poses[0, :, 2] + 2.2])),
        np.float32(np.column_stack([size * action[:, :2] @ turn.T, action[:, 2]])),
    )
    here = np.asarray(step(material(13), shapes[0], poses[0], action))
    np.testing.assert_allclose(there, size * here @ turn.T, atol=1e-5)


def test_the_jacobian_matches_finite_differences():
    shapes, poses = equilibria(13)
    action = poses[1] - poses[0]

    def moved(action):
        return rod_step(material(13), shapes[0], poses[0], action)

    jacobian = np.asarray(jax.jit(jax.jacfwd(moved))(action)).reshape(13, 2, 6)
    for k, direction in enumerate(np.eye(6, dtype=np.float32).reshape(6, 2, 3)):
        change = np.float32(2e-3) * direction
        ahead, back = (
            np.asarray(step(material(13), shapes[0], poses[0], a)) for a in (action + change, action - change)
        )
        assert np.abs((ahead - back) / 4e-3 - jacobian[..., k]).max() < 0.01 * np.abs(jacobian[..., k]).max() + 1e-3


def test_a_stiff_end_bends_less_than_a_soft_one():
    shapes, poses = equilibria(13)
    stiff_right = eqx.tree_at(lambda rod: rod.stiffness, RodParameters(1e-4), jnp.array([0.8, 0.0]))
    still = np.zeros((2, 3), np.float32)
    settled = shapes[0] + np.asarray(jax.jit(lambda r, *s: r(*s))(stiff_right, shapes[0], poses[0], still))
    bends = np.abs(np.diff(np.asarray(link_angles(settled, poses[0, :, 2]))))
    before = np.abs(np.diff(np.asarray(link_angles(shapes[0], poses[0, :, 2]))))
    assert bends[:8].sum() > before[:8].sum()
    assert bends[-8:].sum() < before[-8:].sum()
