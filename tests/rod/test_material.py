"""The rod that is not uniform: it is the uniform one where its parameters say so, and its derivatives are exact."""

from __future__ import annotations

import numpy as np
import pytest

from cableway.geometry.groups import SE2
from cableway.rod import material
from cableway.rod.fitting import meet_ends, workspace
from cableway.rod.kernels import held_shape
from cableway.rod.material import CURVATURE, GRASPS, PARAMETERS, ROD, STIFFNESS
from cableway.rod.planar import PlanarRod

RODS = [PlanarRod(0.3, 13), PlanarRod(0.5, 10)]  # 24 hinges, and 27 with one at the centre
Q = np.array([0.25, 0.3, 0.3, 5.0, 9.0, -1.5])


def parameters(rod: PlanarRod, seed: int = 0) -> np.ndarray:
    """Some rod that differs in every way."""
    rng = np.random.default_rng(seed)
    spread = np.concatenate([[0.02 * rod.length], np.full(ROD.stop - 1, 0.4)])
    return material.nominal(rod)[ROD] + rng.normal(size=ROD.stop) * spread


def shape(q: np.ndarray, p: np.ndarray, rod: PlanarRod) -> tuple[np.ndarray, ...]:
    arrays = workspace(material.modes(rod.hinges), len(q) + len(p))
    held_shape(q, p, material.modes(rod.hinges), *arrays)
    return arrays


@pytest.mark.parametrize("rod", RODS)
def test_with_nominal_parameters_it_is_the_uniform_rod(rod: PlanarRod) -> None:
    stations, dstations, poses, dposes = shape(Q, material.nominal(rod)[ROD], rod)
    uniform = rod.jacobians(Q[None])
    for found, wanted in zip((stations, dstations[..., :6], poses, dposes[..., :6]), uniform, strict=True):
        np.testing.assert_allclose(found, wanted[0], atol=1e-12)


@pytest.mark.parametrize("rod", RODS)
def test_derivatives_are_exact(rod: PlanarRod) -> None:
    at = np.concatenate([Q, parameters(rod)])
    _, dstations, _, dposes = shape(at[:6], at[6:], rod)
    for k in range(len(at)):
        nudge = 1e-6 * (np.arange(len(at)) == k)
        more, less = (shape((at + sign * nudge)[:6], (at + sign * nudge)[6:], rod) for sign in (1, -1))
        np.testing.assert_allclose(dstations[..., k], (more[0] - less[0]) / 2e-6, atol=1e-8)
        np.testing.assert_allclose(dposes[..., k], (more[2] - less[2]) / 2e-6, atol=1e-7)


@pytest.mark.parametrize("rod", RODS)
def test_moments_balance(rod: PlanarRod) -> None:
    """Stiffness times bend beyond that at rest is linear in the place of the hinge, as under one force."""
    p = parameters(rod)
    stations = shape(Q, p, rod)[0]
    links = np.diff(stations[1::2], axis=0)
    bends = np.diff(np.unwrap(np.arctan2(links[:, 1], links[:, 0])))  # of all hinges but the outer two
    modes = material.modes(rod.hinges)[:, 1:-1]
    stiffness, rest = np.exp(p[STIFFNESS] @ modes), p[CURVATURE] @ modes
    moments = stiffness * (bends * rod.hinges - rest)
    places = stations[3:-2:2]
    rows = np.column_stack([places, np.ones(len(places))])
    left = moments - rows @ np.linalg.lstsq(rows, moments, rcond=None)[0]
    np.testing.assert_allclose(left, 0.0, atol=1e-8)
    assert np.ptp(moments) > 0.5


@pytest.mark.parametrize("rod", RODS)
def test_the_length_scales_the_shape(rod: PlanarRod) -> None:
    p = parameters(rod)
    doubled = p * np.where(np.arange(len(p)) == 0, 2.0, 1.0)
    small, large = shape(Q, p, rod)[0], shape(Q, doubled, rod)[0]
    np.testing.assert_allclose(large - Q[:2], 2 * (small - Q[:2]), atol=1e-12)


@pytest.mark.parametrize("rod", RODS)
def test_a_shape_is_found_between_its_own_ends(rod: PlanarRod) -> None:
    p = parameters(rod)
    ends = shape(Q, p, rod)[2]
    q = Q + [0.01, -0.01, 0.1, 2.0, -2.0, 0.5]
    assert meet_ends(q, ends, p, material.modes(rod.hinges)) < 1e-9
    np.testing.assert_allclose(q, Q, atol=1e-6)


def test_means_of_stiffness_and_rest_curvature_are_left_out() -> None:
    modes = material.modes(RODS[0].hinges)
    np.testing.assert_allclose(modes.mean(axis=1), 0.0, atol=4e-3)  # what the midpoint rule leaves of degree 4
    assert material.nominal(RODS[0]).shape == (PARAMETERS,)
    assert (material.nominal(RODS[0])[GRASPS] == 0).all()


def test_what_is_attached_bears_what_it_is_attached_to() -> None:
    rng = np.random.default_rng(1)
    poses, offsets = rng.normal(size=(5, 2, 3)), rng.normal(size=(5, 2, 3))
    np.testing.assert_allclose(SE2.compose(SE2.compose(poses, offsets), SE2.inverse(offsets)), poses, atol=1e-12)
