"""The judge's rod in space against the planner's: other unknowns, another energy, the same cable."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cableway.core.errors import InputError
from cableway.geometry import rotations
from cableway.geometry.catenary import hanging
from cableway.rod.continuation import lead
from cableway.rod.spatial import SpatialRod
from cableway.rod.spatial_inverse import fit_sequence, fit_shape
from cableway.verification import spatial_follower_kernels as kernels
from cableway.verification.spatial_follower import FollowedInSpace, follow_in_space


def followed(rod: SpatialRod, stations: np.ndarray, poses: np.ndarray) -> FollowedInSpace:
    return follow_in_space(stations, poses, length=rod.length, twist=rod.twist, weight=rod.weight)


def line_of(rod: SpatialRod, seed: int, rows: int) -> np.ndarray:
    """A line of stable equilibria."""
    rng = np.random.default_rng(seed)
    while True:
        ends = rng.normal(0, [*[0.2] * 3, *[0.8] * 3, *[6.0] * 3, 0.8, 1.5, 1.5], (2, 12))
        line = rod.between(ends[0], ends[1], np.linspace(0, 1, rows))
        if rod.stability(line, ceiling=8.0)[0].min() >= 8:
            return line


@pytest.mark.parametrize(("weight", "seed"), [(0.0, 1), (18.5, 2)])
def test_a_line_of_equilibria_is_followed(weight: float, seed: int):
    """Up to what two chains of 24 and 48 hinges differ by, and as stable."""
    rod = SpatialRod(0.5, 13, 0.8, weight)
    line = line_of(rod, seed, 3)
    stations, poses = rod.shapes(line)
    found = followed(rod, stations, poses)
    assert found.lost_at is None
    assert found.deviation.max() < 0.002
    assert 0 < found.stability.min() < 4 * np.pi**2 + 60


@pytest.mark.parametrize(("keypoints", "near"), [(13, 5e-4), (193, 2e-4)])
def test_heavy_chains_are_fine_enough(keypoints: int, near: float):
    """The planner's rod beside the judge's, and the judge's beside one of 192 hinges: gamma = 241 bends them at ends.
    With 24 hinges the first would be 1.3 mm off, with 48 the second 0.4 mm."""
    rod = SpatialRod(0.5, keypoints, 2 / 3, 240.8)
    ends = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]) * rod.length * np.linspace(0.2, 0.85, 6)[:, None, None]
    hung = hanging(ends, rod.length, keypoints)
    stations, poses = rod.shapes(fit_sequence(rod, hung, None, fit_shape(rod, hung[0])[0]))
    found = followed(rod, stations, poses)
    assert found.lost_at is None
    assert found.deviation.max() < near


def test_it_loses_the_rod_where_that_snaps():
    """An arch twisted by one gripper."""
    rod = SpatialRod(0.5, 13, 1.0, 18.5)
    rows = np.random.default_rng(7).normal(0, [*[0.3] * 3, *[1.2] * 3, *[8.0] * 3, *[2.0] * 3], (400, 12))
    q = rows[rod.stability(rows, ceiling=20.0)[0] > 5][5]
    poses = np.repeat(rod.end_poses(q[None]), 9, axis=0)
    turns = rotations.from_vector(np.linspace(0, 4, 9)[:, None] * [1.0, 0.0, 0.0])
    poses[:, 1, 3:] = rotations.product(poses[0, 1, 3:], turns)
    led = lead(rod, q, poses)
    assert led.snap is not None
    shapes = rod.shapes(led.q)[0]
    expected = np.concatenate([shapes, np.repeat(shapes[-1:], 9 - len(shapes), axis=0)])
    found = followed(rod, expected, poses)
    assert found.lost_at is not None
    assert abs(found.lost_at - led.snap) < 2
    assert found.deviation[: found.lost_at - 1].max() < 0.005


def test_what_the_rod_does_not_do_shows_as_deviation():
    rod = SpatialRod(0.5, 13, 0.8, 18.5)
    stations, poses = rod.shapes(line_of(rod, 2, 2))
    light = follow_in_space(stations, poses, length=0.5, twist=0.8, weight=0.0)
    assert light.deviation.max() > 0.004


def energy(rows: np.ndarray, force: np.ndarray, links: np.ndarray, stiffness: np.ndarray, hanging: np.ndarray) -> float:
    """Of bending, twist and weight, and the work of the force that closes the chain; written apart from the kernels."""
    turns = rotations.product(rows[:-1] * [1, -1, -1, -1], rows[1:])[:, 1:]
    along = rotations.rotate(rows, np.array([1.0, 0.0, 0.0]))
    return float(np.sum(stiffness * turns**2) / 2 + np.sum(along * (links[:, None] * force)) + hanging @ along[:, 2])


def twisted_chain(links: int) -> tuple[np.ndarray, tuple[Any, Any, Any, Any]]:
    """A coiled, twisted chain of links that is no equilibrium, and its force, lengths, stiffness and weights."""
    rng, count = np.random.default_rng(3), links - 1
    turns = rotations.from_vector(0.1 * rng.normal(size=(links, 3)) + [0.05, 0.0, 0.02])
    rows = [turns[0]]
    for turn in turns[1:]:
        rows.append(rotations.product(rows[-1], turn))
    lengths = np.full(links, 1 / count)
    return np.array(rows), (np.array([5.0, -8.0, 3.0]), lengths, 4 * count * np.array([0.7, 1.0, 1.0]), 20 * lengths)


def test_slope_and_second_derivative_are_those_of_the_energy():
    """By finite differences in the turns of the inner links, of the energy and of its slope."""
    rows, load = twisted_chain(6)
    free, step = 12, 1e-5

    def derivatives(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        right, band = np.empty((free, 4)), np.empty((free, kernels.BANDS))
        kernels.derivatives(rows, *load, right, band)
        return right, band

    def turned(j: int, angle: float) -> np.ndarray:
        out, turn = rows.copy(), np.zeros(3)
        turn[j % 3] = angle
        out[1 + j // 3] = rotations.product(rows[1 + j // 3], rotations.from_vector(turn))
        return out

    right, band = derivatives(rows)
    slope = [(energy(turned(j, step), *load) - energy(turned(j, -step), *load)) / (2 * step) for j in range(free)]
    np.testing.assert_allclose(right[:, 0], slope, atol=1e-6)
    change = np.array([derivatives(turned(j, step))[0] - derivatives(turned(j, -step))[0] for j in range(free)])
    second = change[..., 0] / (2 * step)
    for j in range(free):  # slopes are by turns in a frame that turns along: half of the rotated slope is taken off
        own = slice(3 * (j // 3), 3 * (j // 3) + 3)
        second[j, own] -= np.cross(right[own, 0], np.eye(3)[j % 3]) / 2
    full = np.zeros((free, free + kernels.BANDS))
    for j in range(free):
        full[j, j : j + kernels.BANDS] = band[j]
    upper = full[:, :free]
    np.testing.assert_allclose(upper + np.triu(upper, 1).T, second, atol=1e-5)


def test_the_margin_is_the_least_eigenvalue_on_what_the_closure_allows():
    """A dense eigenvalue problem in place of counted pivots; 0 where that is negative."""
    for scale, stable in ((0.2, True), (6.0, False)):
        rows, (force, *material) = twisted_chain(12)
        load, free = (scale * force, *material), 30
        right, band = np.empty((free, 4)), np.empty((free, kernels.BANDS))
        kernels.derivatives(rows, *load, right, band)
        upper = sum(np.diag(band[: free - k, k], k) for k in range(kernels.BANDS))
        kept = np.linalg.svd(right[:, 1:].T)[2][3:]
        least = 11 * np.linalg.eigvalsh(kept @ (upper + np.triu(upper, 1).T) @ kept.T)[0]
        assert bool(least > 0) is stable
        assert kernels.margin(rows, *load) == pytest.approx(max(0.0, least), abs=2e-5)


@pytest.mark.wrong_types
def test_arrays_that_do_not_fit_are_refused():
    rod = SpatialRod(0.5, 13, 0.8, 18.5)
    stations, poses = rod.shapes(line_of(rod, 2, 2))
    with pytest.raises(InputError, match="as many shapes as poses"):
        followed(rod, stations, poses[:1])
