"""The rod against the closed form of the elastica.

A rod of length L between clamped ends with parallel tangents, pushed together by d: with the complete elliptic
integrals K, E of modulus k, d/L = 2 (1 - E/K) and the middle stands h/L = k/K off the line; the axial force is
F L^2/EI = 16 K^2 and the curvature L kappa = 8 K k cn(4 K s/L) (Love, "A treatise on the mathematical theory of
elasticity", section 263).
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipe, ellipk

from cableway.rod.inverse import shape_between
from cableway.rod.planar import PlanarRod

LENGTH = 0.5
"""[m]; a longer rod has more hinges."""


def pushed_together(k: float, keypoints: int) -> tuple[float, float, float]:
    """Height of the middle in lengths, axial force and energy of the rod at the modulus k."""
    rod, whole = PlanarRod(LENGTH, keypoints), ellipk(k**2)
    poses = np.array([[0.0, 0.0, 0.0], [LENGTH * (2 * ellipe(k**2) / whole - 1), 0.0, 0.0]])
    q = shape_between(rod, poses, "left")
    stations, reached = rod.shapes(q[None])
    np.testing.assert_allclose(reached[0], poses, atol=1e-9)
    middle = stations[0, rod.hinges]
    np.testing.assert_allclose(middle[0], poses[:, 0].mean(), atol=1e-8)
    return float(middle[1]) / LENGTH, float(q[3]), float(rod.energy(q[None])[0])


def closed_form(k: float) -> tuple[float, float, float]:
    whole, part = ellipk(k**2), ellipe(k**2)
    mean_cn_squared = (part - (1 - k**2) * whole) / (k**2 * whole)
    return k / whole, -16 * whole**2, 0.5 * (8 * whole * k) ** 2 * mean_cn_squared


@pytest.mark.parametrize("k", [0.2, 0.5, 0.75])
def test_the_rod_converges_to_the_elastica_with_the_square_of_the_hinges(k: float):
    """24, 48 and 96 hinges: the error falls four times at each doubling, to below 0.1%."""
    errors = np.array([np.array(pushed_together(k, n)) / closed_form(k) - 1 for n in (13, 49, 97)])
    np.testing.assert_allclose(errors[0] / errors[1], 4.0, rtol=0.15)
    np.testing.assert_allclose(errors[1] / errors[2], 4.0, rtol=0.15)
    assert np.abs(errors[2]).max() < 1e-3
