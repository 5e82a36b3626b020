"""Laws of the rod's equilibria and of their stability."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import null_space

from cableway.core.errors import InputError
from cableway.geometry import polyline, se2
from cableway.rod.inverse import equilibria_at, fit_keypoints
from cableway.rod.planar import STRAIGHT_STABILITY, PlanarRod, hinge_count

SIZES = [5, 10, 13]
"""Keypoints; 5 and 13 have 24 hinges, so a link in the middle, 10 has 27, so a hinge there."""


def random_rows(count: int, seed: int = 0) -> np.ndarray:
    """Rod coordinates of moderately bent rods anywhere."""
    rng = np.random.default_rng(seed)
    return np.column_stack(
        [rng.uniform(0, 1, (count, 2)), rng.uniform(-4, 4, count), rng.normal(0, [9, 9, 2], (count, 3))]
    )


def chain_angles(rod: PlanarRod, q: np.ndarray) -> np.ndarray:
    """Angles of all N + 1 links of one row, unwrapped, from the stations alone."""
    stations, poses = rod.shapes(q[None])
    corners = np.vstack([stations[0][:1], stations[0][1::2], stations[0][-1:]])
    steps = np.diff(corners, axis=0)
    angles = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    np.testing.assert_allclose(se2.wrap_angle(angles[[0, -1]] - poses[0, :, 2]), 0, atol=1e-12)
    return angles


@pytest.mark.parametrize(("keypoints", "hinges"), [(3, 24), (5, 24), (10, 27), (13, 24), (25, 24), (26, 25), (30, 29)])
def test_hinges_are_the_least_multiple_of_the_segments_from_24_on(keypoints: int, hinges: int):
    assert hinge_count(keypoints) == hinges


@pytest.mark.parametrize("n", SIZES)
def test_keypoints_are_at_equal_arc_length_with_both_ends(n: int):
    rod = PlanarRod(0.3, n)
    stations, poses = rod.shapes(random_rows(5))
    links = np.linalg.norm(np.diff(stations, axis=1), axis=2)
    np.testing.assert_allclose(links, 0.3 / (2 * rod.hinges), rtol=1e-12)
    keypoints = rod.at_keypoints(stations)
    assert keypoints.shape == (5, n, 2)
    np.testing.assert_array_equal(keypoints[:, [0, -1]], poses[:, :, :2])
    assert rod.stride * (n - 1) == stations.shape[1] - 1


@pytest.mark.parametrize("n", SIZES)
def test_the_bend_at_each_hinge_is_its_moment(n: int):
    """phi_j N = m + a x (p_j - c)/L, with a turned into the world by the centre's angle."""
    rod = PlanarRod(0.7, n)
    for q in random_rows(4):
        hinges = rod.shapes(q[None])[0][0][1::2]
        arm = (hinges - q[:2]) / rod.length
        a = se2.rotation(q[2]) @ q[3:5]
        moments = q[5] + a[0] * arm[:, 1] - a[1] * arm[:, 0]
        np.testing.assert_allclose(rod.hinges * np.diff(chain_angles(rod, q)), moments, atol=1e-9)


@pytest.mark.parametrize("n", SIZES)
def test_the_energy_is_stationary_while_the_ends_are_held(n: int):
    """The gradient of the energy by the free link angles lies in the span of the two closure rows."""
    rod = PlanarRod(1.0, n)
    for q in random_rows(4):
        angles = chain_angles(rod, q)
        bends = np.diff(angles)
        gradient = rod.hinges * (bends[:-1] - bends[1:])
        closure = np.stack([-np.sin(angles[1:-1]), np.cos(angles[1:-1])])
        np.testing.assert_allclose(null_space(closure).T @ gradient, 0, atol=1e-10)
        assert np.abs(gradient).max() > 1e-3


@pytest.mark.parametrize("n", SIZES)
def test_derivatives_are_finite_differences(n: int):
    rod, rows = PlanarRod(0.3, n), random_rows(4)
    stations, dstations, poses, dposes = rod.jacobians(rows)
    np.testing.assert_allclose(stations, rod.shapes(rows)[0], rtol=1e-13)
    np.testing.assert_allclose(poses, rod.shapes(rows)[1], rtol=1e-13)
    mu, dmu = rod.stability(rows)
    for i in range(6):
        step = np.eye(6)[i] * 1e-6
        ahead, behind = rod.shapes(rows + step), rod.shapes(rows - step)
        np.testing.assert_allclose(dstations[..., i], (ahead[0] - behind[0]) / 2e-6, atol=1e-8)
        np.testing.assert_allclose(dposes[..., i], (ahead[1] - behind[1]) / 2e-6, atol=1e-8)
        slope = (rod.stability(rows + 1e3 * step)[0] - rod.stability(rows - 1e3 * step)[0]) / 2e-3
        np.testing.assert_allclose(dmu[:, i], slope, rtol=1e-3, atol=1e-3)
    assert (mu > 0).any()


@pytest.mark.parametrize("n", SIZES)
def test_a_rigid_motion_moves_the_shape_and_changes_nothing_else(n: int):
    rod, rows = PlanarRod(0.3, n), random_rows(4)
    moved = rows.copy()
    moved[:, :2], moved[:, 2] = se2.transform(rows[:, :2], np.array([0.2, -0.5]), 0.8), rows[:, 2] + 0.8
    stations, poses = rod.shapes(rows)
    np.testing.assert_allclose(rod.shapes(moved)[0], se2.transform(stations, np.array([0.2, -0.5]), 0.8), atol=1e-12)
    np.testing.assert_allclose(rod.shapes(moved)[1][..., 2], poses[..., 2] + 0.8)
    np.testing.assert_allclose(rod.energy(moved), rod.energy(rows))
    np.testing.assert_allclose(rod.stability(moved)[0], rod.stability(rows)[0])


@pytest.mark.parametrize("n", SIZES)
def test_the_mirror_image_of_an_equilibrium_is_one(n: int):
    rod, rows = PlanarRod(0.3, n), random_rows(4)
    mirrored = rows * [1, -1, -1, 1, -1, -1]
    stations, poses = rod.shapes(rows)
    np.testing.assert_allclose(rod.shapes(mirrored)[0], stations * [1, -1], atol=1e-14)
    np.testing.assert_allclose(rod.shapes(mirrored)[1], poses * [1, -1, -1], atol=1e-14)
    np.testing.assert_allclose(rod.stability(mirrored)[0], rod.stability(rows)[0])


@pytest.mark.parametrize("n", SIZES)
def test_a_rod_taken_from_its_other_end_is_the_same_rod(n: int):
    rod, rows = PlanarRod(0.3, n), random_rows(4)
    reversed_rows = rows * [1, 1, 1, 1, 1, -1] + [0, 0, np.pi, 0, 0, 0]
    stations, poses = rod.shapes(rows)
    np.testing.assert_allclose(rod.shapes(reversed_rows)[0], stations[:, ::-1], atol=1e-14)
    np.testing.assert_allclose(rod.shapes(reversed_rows)[1][..., 2], poses[:, ::-1, 2] + np.pi)
    np.testing.assert_allclose(rod.energy(reversed_rows), rod.energy(rows))
    np.testing.assert_allclose(rod.stability(reversed_rows)[0], rod.stability(rows)[0])


@pytest.mark.parametrize("n", SIZES)
def test_shapes_scale_with_the_length(n: int):
    rows = random_rows(4) * [0, 0, 1, 1, 1, 1]
    np.testing.assert_allclose(PlanarRod(0.5, n).shapes(rows)[0], 2 * PlanarRod(0.25, n).shapes(rows)[0], atol=1e-14)
    np.testing.assert_allclose(PlanarRod(0.5, n).stability(rows)[0], PlanarRod(0.25, n).stability(rows)[0])


@pytest.mark.parametrize("n", SIZES)
def test_at_rest_the_rod_is_straight_without_energy(n: int):
    rod = PlanarRod(0.3, n)
    stations, poses = rod.shapes(np.array([[0.5, 0.4, 0.3, 0, 0, 0]]))
    np.testing.assert_allclose(polyline.length(stations[0]), np.linalg.norm(stations[0, -1] - stations[0, 0]))
    np.testing.assert_array_equal(poses[0, :, 2], [0.3, 0.3])
    assert rod.energy(np.zeros((1, 6)))[0] == 0.0


@pytest.mark.parametrize("n", SIZES)
def test_under_a_moment_alone_the_rod_is_an_arc(n: int):
    """Every bend is m/N, so the energy is m^2/2 and the ends differ in angle by m."""
    rod = PlanarRod(0.3, n)
    q = np.array([[0.5, 0.4, 0.3, 0, 0, 2.5]])
    poses = rod.shapes(q)[1][0]
    np.testing.assert_allclose(poses[1, 2] - poses[0, 2], 2.5)
    np.testing.assert_allclose(rod.energy(q), 2.5**2 / 2)


@pytest.mark.parametrize("n", SIZES)
def test_the_energy_of_a_wound_up_rod_counts_every_turn(n: int):
    q = np.array([[0.5, 0.4, 0.3, 0, 0, 15.0]])
    np.testing.assert_allclose(PlanarRod(0.3, n).energy(q), 15.0**2 / 2)


def dense_margin(rod: PlanarRod, q: np.ndarray) -> float:
    """The margin by its definition, with a dense eigenvalue solver."""
    inner, count = chain_angles(rod, q)[1:-1] - q[2], rod.hinges
    second = 2 * np.eye(count - 1) - np.eye(count - 1, k=1) - np.eye(count - 1, k=-1)
    hessian = count**2 * second + np.diag(q[3] * np.cos(inner) + q[4] * np.sin(inner))
    free = null_space(np.stack([-np.sin(inner), np.cos(inner)]), rcond=1e-8)
    return float(np.linalg.eigvalsh(free.T @ hessian @ free)[0])


@pytest.mark.parametrize("n", SIZES)
def test_the_stability_margin_is_the_least_eigenvalue_of_its_definition(n: int):
    rod = PlanarRod(0.3, n)
    pressed = random_rows(10, seed=4) * [1, 1, 1, 0.5, 0.5, 0.5] - [0, 0, 0, 60, 0, 0]
    rows = np.vstack([random_rows(20, seed=3), pressed, np.zeros(6)])
    margins = rod.stability(rows)[0]
    np.testing.assert_allclose(margins, [dense_margin(rod, q) for q in rows], rtol=1e-6, atol=1e-5)
    assert (margins < 0).any()
    assert (margins > 0).any()


@pytest.mark.parametrize("n", SIZES)
def test_the_margin_is_the_curvature_of_the_energy_under_held_ends(n: int):
    """Moving the links along a held direction v raises the energy by at least mu/(2N) |v|^2."""
    rod, rng = PlanarRod(1.0, n), np.random.default_rng(0)
    q = np.array([0, 0, 0, -12.0, 5.0, 1.0])
    mu = rod.stability(q[None])[0][0]
    inner = chain_angles(rod, q)[1:-1]
    free = null_space(np.stack([-np.sin(inner), np.cos(inner)]))

    def lagrangian(angles: np.ndarray) -> float:
        ends = rod.shapes(q[None])[1][0, :, 2]
        bends = np.diff(np.concatenate([[ends[0]], angles, [ends[1]]]))
        reach = np.array([np.cos(angles).sum(), np.sin(angles).sum()]) / rod.hinges
        return 0.5 * rod.hinges * np.sum(bends**2) - q[3:5] @ reach

    raised = []
    for _ in range(50):
        v = free @ rng.normal(size=free.shape[1])
        v /= np.linalg.norm(v) / 1e-4
        second = lagrangian(inner + v) - 2 * lagrangian(inner) + lagrangian(inner - v)
        raised.append(rod.hinges * second / 1e-8)
    assert min(raised) > mu


@pytest.mark.parametrize("n", SIZES)
def test_a_straight_rod_buckles_under_its_euler_load(n: int):
    """Its margin is 4 N^2 sin^2(pi/N), about 4 pi^2, and falls by the compression."""
    rod = PlanarRod(0.3, n)
    unloaded = 4 * rod.hinges**2 * np.sin(np.pi / rod.hinges) ** 2
    assert unloaded == pytest.approx(STRAIGHT_STABILITY, rel=0.01)
    rows = np.zeros((3, 6))
    rows[:, 3] = [0.0, -20.0, -unloaded]
    np.testing.assert_allclose(rod.stability(rows)[0], [unloaded, unloaded - 20.0, 0.0], atol=1e-5)


@pytest.mark.parametrize(
    ("length", "keypoints"), [(0.0, 13), (-1.0, 13), (float("nan"), 13), (float("inf"), 13), (1.0, 2)]
)
def test_a_rod_that_is_none_is_refused(length: float, keypoints: int):
    with pytest.raises(InputError, match=r"rod length must be positive|at least 3 keypoints"):
        PlanarRod(length, keypoints)


@pytest.mark.wrong_types
def test_coordinates_of_the_wrong_shape_are_refused():
    with pytest.raises(InputError, match=r"shape \(t, 6\), got \(6,\)"):
        PlanarRod(1.0).shapes(np.zeros(6))


def test_coordinates_are_those_of_a_held_rod():
    """Steps, shares of the way and full turns, in sizes that come from the value."""
    rod, (a, b) = PlanarRod(0.3), random_rows(2)
    assert a.shape == rod.units.shape == (rod.dof,)
    np.testing.assert_allclose(rod.retract(a, rod.difference(a, b)), b, atol=1e-14)
    np.testing.assert_allclose(rod.between(a, b, np.array([0.0, 0.25, 1.0])), [a, 0.75 * a + 0.25 * b, b], atol=1e-14)
    poses = rod.end_poses(a[None])[0]
    turned = rod.continued(a, poses + [0, 0, 4 * np.pi])
    np.testing.assert_allclose(rod.end_poses(turned[None])[0], poses + [0, 0, 4 * np.pi], atol=1e-12)
    np.testing.assert_allclose(rod.shapes(turned[None])[0], rod.shapes(a[None])[0], atol=1e-12)


BENT = PlanarRod(0.31, 13, (0.5, -0.4, 0.3, -0.2, 0.8, -0.9, 0.4, 0.3))
"""Stiffer at one end, with a rest curvature that changes sign."""


def test_a_rod_without_differences_is_the_uniform_one():
    rows, uniform, same = random_rows(4), PlanarRod(0.3), PlanarRod(0.3, 13, (0.0,) * 8)
    for found, wanted in zip(same.jacobians(rows), uniform.jacobians(rows), strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-12)
    np.testing.assert_allclose(same.stability(rows)[0], uniform.stability(rows)[0], atol=1e-6)
    np.testing.assert_allclose(same.energy(rows), uniform.energy(rows), atol=1e-9)
    with pytest.raises(InputError, match="no modes or 8 finite ones"):
        PlanarRod(0.3, 13, (1.0,))


def test_stability_of_another_rod_is_the_least_second_change_of_its_energy():
    """Against eigenvalues of the second difference of the energy by the free link angles, the ends held."""
    q = np.array([[0.3, 0.3, 0.2, -5.0, 8.0, 1.5]])
    stations, poses = BENT.shapes(q)
    stiffness, rest = BENT.bending
    links = np.diff(stations[0, 1::2], axis=0)
    angles = np.unwrap(np.arctan2(links[:, 1], links[:, 0]))
    load = np.array([[np.cos(0.2), -np.sin(0.2)], [np.sin(0.2), np.cos(0.2)]]) @ q[0, 3:5]

    def potential(free: np.ndarray) -> float:
        """Bending energy less the work of the load, in units of EI / (L N)."""
        bends = np.diff(np.concatenate([[poses[0, 0, 2]], free, [poses[0, 1, 2]]])) * BENT.hinges - rest
        along = np.column_stack([np.cos(free), np.sin(free)]).sum(0)
        return float(0.5 * stiffness @ bends**2 - load @ along)

    steps = 1e-3 * np.eye(len(angles))
    slope = np.array([potential(angles + step) - potential(angles - step) for step in steps]) / 2e-3
    np.testing.assert_allclose(slope, 0.0, atol=1e-4)
    second = np.array([[potential(angles + a + b) - potential(angles + a - b) - potential(angles - a + b)
                        + potential(angles - a - b) for b in steps] for a in steps]) / 4e-6  # fmt: skip
    null = np.linalg.svd(np.array([-np.sin(angles), np.cos(angles)]))[2][2:]
    margin, rates = BENT.stability(q)
    assert margin[0] == pytest.approx(np.linalg.eigvalsh(null @ second @ null.T)[0], rel=1e-3)
    nudges = 1e-5 * np.eye(6)
    along = [(BENT.stability(q + nudge)[0] - BENT.stability(q - nudge)[0])[0] / 2e-5 for nudge in nudges]
    np.testing.assert_allclose(rates[0], along, rtol=1e-2, atol=1e-3)


def test_energy_of_another_rod_counts_from_rest():
    """Without any load the rod is at rest."""
    assert BENT.energy(np.array([[0.3, 0.3, 0.2, 0.0, 0.0, 0.0]]))[0] == pytest.approx(0.0, abs=1e-12)
    stiffness, rest = BENT.bending
    assert stiffness.max() > 1.3 * stiffness.min()
    assert rest.max() > 0.5 > -0.5 > rest.min()


def test_between_the_grippers_of_another_rod_it_is_found_again():
    q = np.array([[0.3, 0.3, 0.2, -5.0, 8.0, 1.5]])
    stations, poses = BENT.shapes(q)
    found, distance = fit_keypoints(BENT, BENT.at_keypoints(stations)[0])
    np.testing.assert_allclose(found, q[0], atol=1e-6)
    assert distance < 1e-8
    others = BENT.shapes(equilibria_at(BENT, poses[0]))[0]
    assert np.abs(others - stations).max(axis=(1, 2)).min() < 1e-9


def test_a_fit_of_another_rod_goes_there_from_the_uniform_one():
    """Straight from its guess it ends 94 mm off (stacked)."""
    uniform = PlanarRod(0.3)
    wanted = uniform.at_keypoints(uniform.shapes(np.array([[0.3, 0.3, -2.34, -22.52, 9.14, 8.22]]))[0])[0]
    other = PlanarRod(0.3, 13, (1.56, 0.45, -0.66, -0.11, 1.75, -1.4, -0.59, 0.0))
    assert fit_keypoints(other, wanted)[1] < 0.006
