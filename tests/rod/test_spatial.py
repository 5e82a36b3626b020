"""Laws of the rod in space: equilibria, derivatives, stability, and inverse problems."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import null_space
from scipy.special import ellipe, ellipk

from cableway.core.errors import InputError
from cableway.geometry import rotations
from cableway.geometry.groups import SE3
from cableway.rod.continuation import lead
from cableway.rod.inverse import equilibria_at, meet_poses
from cableway.rod.planar import PlanarRod
from cableway.rod.spatial import SpatialRod
from cableway.rod.spatial_inverse import fit_shape, under_weight
from cableway.rod.spatial_stability import second_variation

HEAVY = SpatialRod(0.5, 13, 0.7, 15.0)
FINE = 97
"""Keypoints of a rod with 96 hinges."""


def random_rows(count: int, seed: int = 0) -> np.ndarray:
    """Coordinates of moderately bent and twisted rods anywhere."""
    rng = np.random.default_rng(seed)
    return rng.normal(0, [*[0.3] * 3, *[1.2] * 3, *[8.0] * 3, *[2.0] * 3], (count, 12))


def stable_rows(rod: SpatialRod, count: int, seed: int = 0) -> np.ndarray:
    """Those of them that are stable."""
    rows = random_rows(4 * count, seed)
    return rows[rod.stability(rows)[0] > 5][:count]


def links(rod: SpatialRod, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit tangents and lengths, in those of the rod, of all links, from the stations alone."""
    stations = rod.shapes(q[None])[0][0] / rod.length
    steps = np.diff(np.vstack([stations[:1], stations[1::2], stations[-1:]]), axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    return steps / lengths[:, None], lengths


def energy_of(rod: SpatialRod, t: np.ndarray, lengths: np.ndarray, ends: np.ndarray, near: float) -> float:
    """Bending, twist and weight of a chain between held frames, whatever its shape; the twist is the one nearest to
    `near`."""
    frame, bending = rotations.rotate(ends[0, 3:], np.array([0.0, 1.0, 0.0])), 0.0
    places = (2 * np.arange(rod.hinges) + 1) / rod.hinges - 1
    stiffness = rod.hinges * np.exp(np.polynomial.legendre.legval(places, [0.0, *rod.modes]))
    for stiff, (a, b) in zip(stiffness, pairwise(t), strict=True):
        bending -= 2 * stiff * np.log((1 + a @ b) / 2)
        turn = np.cross(a, b)
        frame = frame * (a @ b) + np.cross(turn, frame) + turn * (turn @ frame) / (1 + a @ b)
    second = rotations.rotate(ends[1, 3:], np.array([0.0, 1.0, 0.0]))
    twist = np.arctan2(second @ np.cross(t[-1], frame), second @ frame)
    twist += 2 * np.pi * np.round((near - twist) / (2 * np.pi))
    corners = np.vstack([np.zeros(3), np.cumsum(lengths[:, None] * t, axis=0)])
    hanging = rod.weight * lengths @ (corners[1:, 2] + corners[:-1, 2]) / 2
    return bending + rod.twist / 2 * twist**2 + hanging


@pytest.mark.parametrize(
    "rod", [SpatialRod(1.0, 3, 0.7, 0.0), SpatialRod(1.0, 4, 1.4, 30.0), SpatialRod(1.0, 4, 0.7, 20.0, (0.6, -0.4))]
)
def test_shapes_are_stationary_and_the_margin_is_the_least_second_change(rod: SpatialRod):
    """Of an energy computed apart, less the load's work, along great circles of the inner links, with the ends and
    their frames held; also where the twist passes full turns."""
    rng, free = np.random.default_rng(0), rod.hinges - 1
    for q in random_rows(2, seed=5) * [*[1] * 9, 3, 1, 1]:
        (t, lengths), ends = links(rod, q), rod.end_poses(q[None])[0]
        force = rotations.rotate(rotations.from_vector(q[3:6]), q[6:9]) - [0, 0, rod.weight * 0.5]  # at the left end
        arrays = np.empty((free, 2, 2)), np.empty((free, 2, 2)), np.empty((free, 2, 3)), np.empty((free, 2))
        second_variation(q, *rod.arrays, *arrays)
        second, closure = dense(rod, *arrays)
        bases = np.moveaxis(arrays[2], 2, 1) * rod.hinges  # (free, 3, 2): how the turns move each tangent

        for _ in range(4):
            v, energies = rng.normal(size=2 * free), []
            for step in (0.0, 1e-3, -1e-3):
                by = step * np.einsum("ikr,ir->ik", bases, v.reshape(-1, 2))
                size, moved = np.linalg.norm(by, axis=1, keepdims=True), t.copy()
                moved[1:-1] = np.cos(size) * t[1:-1] + np.sinc(size / np.pi) * by
                whole = energy_of(rod, moved, lengths, ends, q[9] / rod.twist)
                energies.append(whole - (force + [0, 0, rod.weight]) @ (lengths @ moved))
            here, ahead, behind = energies
            assert (ahead - behind) / 2e-3 == pytest.approx(0, abs=1e-4 * np.linalg.norm(v))
            assert (ahead + behind - 2 * here) / 1e-6 == pytest.approx(v @ second @ v, rel=1e-4)
        held = null_space(closure)
        least = rod.hinges * np.linalg.eigvalsh(held.T @ second @ held)[0]
        assert rod.stability(q[None])[0][0] == pytest.approx(least, abs=1e-4)


def dense(rod: SpatialRod, diagonal, off, closure, twist) -> tuple[np.ndarray, np.ndarray]:
    """The second variation (2 (N - 1), 2 (N - 1)) and the rows (3, 2 (N - 1)) that hold the ends."""
    out = rod.twist * np.outer(twist, twist)
    for i, block in enumerate(diagonal):
        here, after = slice(2 * i, 2 * i + 2), slice(2 * i + 2, 2 * i + 4)
        out[here, here] += block
        if i < len(diagonal) - 1:
            out[here, after] += off[i]
            out[after, here] += off[i].T
    return out, closure.reshape(-1, 3).T


@pytest.mark.parametrize("keypoints", [4, 13])
def test_derivatives_are_finite_differences(keypoints: int):
    rod, rows = SpatialRod(0.5, keypoints, 0.7, 15.0), random_rows(4)
    stations, dstations, _, dposes = rod.jacobians(rows)
    np.testing.assert_array_equal(stations, rod.shapes(rows)[0])
    margins, slopes = rod.stability(rows)
    assert (margins > 0).all()
    for k, unit in enumerate(np.eye(12)):
        ahead, behind = (rod.retract(rows, np.tile(sign * 1e-6 * unit, (4, 1))) for sign in (1, -1))
        moved = (rod.shapes(ahead)[0] - rod.shapes(behind)[0]) / 2e-6
        np.testing.assert_allclose(dstations[..., k], moved, atol=1e-8)
        turned = SE3.minus(rod.end_poses(ahead), rod.end_poses(behind)) / 2e-6
        np.testing.assert_allclose(dposes[..., k], turned, atol=1e-8)
        ahead, behind = (rod.retract(rows, np.tile(sign * 1e-3 * unit, (4, 1))) for sign in (1, -1))
        rise = (rod.stability(ahead)[0] - rod.stability(behind)[0]) / 2e-3
        np.testing.assert_allclose(slopes[:, k], rise, atol=1e-3)


def test_keypoints_are_at_equal_arc_length_and_frames_are_tangent():
    stations, poses = HEAVY.shapes(random_rows(5))
    np.testing.assert_allclose(np.linalg.norm(np.diff(stations, axis=1), axis=2), 0.5 / (2 * HEAVY.hinges), rtol=1e-12)
    keypoints = HEAVY.at_keypoints(stations)
    np.testing.assert_array_equal(keypoints[:, [0, -1]], poses[..., :3])
    first = stations[:, [1, -1]] - stations[:, [0, -2]]
    tangent = rotations.rotate(poses[..., 3:], np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(tangent, first / np.linalg.norm(first, axis=2, keepdims=True), atol=1e-12)


def test_the_plane_is_its_restriction():
    """Planar loads give the planar rod, up to 2 tan(phi/2) = m/N in place of phi = m/N: with the square of 1/N. No
    weightless shape is stabler in space."""
    rng = np.random.default_rng(0)
    for keypoints, near in ((13, 5e-3), (49, 3e-4)):
        flat, rod = PlanarRod(0.5, keypoints), SpatialRod(0.5, keypoints)
        q = rng.normal(0, [0.3, 0.3, 1.5, 7.0, 7.0, 2.0], (6, 6))
        zero = np.zeros(6)
        lifted = np.column_stack([q[:, :2], zero, zero, zero, q[:, 2], q[:, 3:5], zero, zero, zero, q[:, 5]])
        stations, poses = rod.shapes(lifted)
        np.testing.assert_allclose(stations[..., :2], flat.shapes(q)[0], atol=near)
        np.testing.assert_allclose(stations[..., 2], 0, atol=1e-15)
        turned = rotations.rotate(poses[..., 3:], np.array([1.0, 0.0, 0.0]))
        angles = flat.end_poses(q)[..., 2]
        np.testing.assert_allclose(turned[..., 0], np.cos(angles), atol=20 * near)
        np.testing.assert_allclose(rod.energy(lifted), flat.energy(q), rtol=10 * near)
        assert (rod.stability(lifted)[0] < flat.stability(q)[0] + 100 * near).all()


@pytest.mark.parametrize(("keypoints", "near"), [(25, 6e-4), (FINE, 1.5e-4)])
def test_a_planar_arch_is_the_closed_form(keypoints: int, near: float):
    """Clamped in line and pushed together: d/L = 2 (1 - E/K), h/L = k/K."""
    rod, k = SpatialRod(1.0, keypoints), 0.5
    d, height = 2 * (1 - ellipe(k**2) / ellipk(k**2)), k / ellipk(k**2)
    poses = np.array([[0, 0, 0, 1, 0, 0, 0], [1 - d, 0, 0, 1, 0, 0, 0]], float)
    found = equilibria_at(rod, poses, starts=20)
    across = [np.linalg.norm(rod.shapes(q[None])[0][0][:, 1:], axis=1).max() for q in found]
    assert np.abs(np.array(across) - height).min() < near


@pytest.mark.parametrize(("keypoints", "near"), [(25, 2e-3), (FINE, 1.3e-4)])
def test_a_helix_is_the_closed_form(keypoints: int, near: float):
    """Curvature k, torsion T and any twist tau: n = (tau - T)(T t + k b), m = tau t + k b."""
    rod, k, torsion, tau = SpatialRod(1.0, keypoints, 0.7), 5.0, 3.0, 2.0
    force = (tau - torsion) * np.array([torsion, 0.0, k])
    q = np.concatenate([np.zeros(6), force, [tau, 0.0, k]])  # t, the normal and b are the axes
    rate, s = np.hypot(k, torsion), np.linspace(-0.5, 0.5, 2 * rod.hinges + 1)
    axis, normal = np.array([torsion, 0.0, k]) / rate, np.array([0.0, 1.0, 0.0])
    aside = np.cross(axis, normal)
    along = s[:, None] * (torsion / rate) * axis
    round_ = k / rate**2 * ((1 - np.cos(rate * s))[:, None] * normal - np.sin(rate * s)[:, None] * aside)
    np.testing.assert_allclose(rod.shapes(q[None])[0][0], along + round_, atol=near)


@pytest.mark.parametrize(("keypoints", "near"), [(25, 3e-3), (FINE, 2e-4)])
def test_heavy_twisted_shapes_are_solutions_of_the_equations_of_kirchhoff(keypoints: int, near: float):
    """m' = -t x n, n' = gamma e_z, t' = m x t, and frames that turn by m + (1/kappa - 1) tau t, integrated by SciPy."""
    rod = SpatialRod(1.0, keypoints, 0.7, 25.0)

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        t, d, n, m = y[3:6], y[6:9], y[9:12], y[12:]
        turn = m + (1 / rod.twist - 1) * (m @ t) * t
        return np.concatenate([t, np.cross(turn, t), np.cross(turn, d), [0, 0, rod.weight], -np.cross(t, n)])

    for q in stable_rows(rod, 2, seed=1):
        axes = rotations.matrices(rotations.from_vector(q[3:6]))
        start = np.concatenate([q[:3], axes[:, 0], axes[:, 1], axes @ q[6:9], axes @ q[9:]])
        stations, poses = (each[0] for each in rod.shapes(q[None]))
        for end, side in ((-0.5, 0), (0.5, 1)):
            at = np.linspace(0, end, rod.hinges + 1)
            y = solve_ivp(slope, (0, end), start, t_eval=at, rtol=1e-10, atol=1e-12).y
            middle = rod.hinges
            np.testing.assert_allclose(y[:3].T, stations[middle:] if side else stations[middle::-1], atol=near)
            axis = rotations.matrices(poses[side, 3:])
            np.testing.assert_allclose(axis[:, :2], np.column_stack([y[3:6, -1], y[6:9, -1]]), atol=6 * near)


def column_margin(tension: float, weight: float, tau: float) -> float:
    """Least eigenvalue of -v'' + i tau v' + (F + gamma s) v for the turns v of a straight, upright, clamped rod, whose
    integral is zero (Greenhill 1883), in sines."""
    x, k = (np.arange(800) + 0.5) / 800, np.arange(1, 41)[:, None]
    sine, slope = np.sqrt(2) * np.sin(k * np.pi * x), np.sqrt(2) * k * np.pi * np.cos(k * np.pi * x)
    operator = np.diag((k[:, 0] * np.pi) ** 2) + (sine * (tension + weight * (x - 0.5))) @ sine.T / 800
    twisted = operator + 1j * tau * sine @ slope.T / 800
    free = null_space(sine.mean(1)[None])
    return float(np.linalg.eigvalsh(free.T @ twisted @ free)[0])


@pytest.mark.parametrize(
    ("tension", "weight", "tau"), [(0, 0, 8.9868), (0, 0, 3.0), (-20.0, 0, 4.0), (30.0, 60.0, -8.0), (-10, 200.0, 0)]
)
def test_an_upright_twisted_heavy_rod_buckles_as_greenhill_says(tension: float, weight: float, tau: float):
    """Without force and weight at tau = 8.9868, where tan(tau/2) = tau/2."""
    rod = SpatialRod(1.0, FINE, 0.7, weight)
    q = np.array([0, 0, 0, 0, -np.pi / 2, 0, tension, 0, 0, tau, 0, 0])
    wanted = column_margin(tension, weight, tau)
    assert rod.stability(q[None])[0][0] == pytest.approx(wanted, abs=0.1)
    assert (tau == 8.9868) == (abs(wanted) < 0.1)


@pytest.mark.parametrize("twist", [0.5, 1.2])
def test_a_twisted_ring_buckles_as_michell_says(twist: float):
    """At a twist of 2 pi sqrt(3) B/C (Michell 1889). Below, turning about the clamp is for free: margin 0."""
    rod, critical = SpatialRod(1.0, 49, twist), 2 * np.pi * np.sqrt(3)
    margins = []
    for tau in (0.5 * critical, 0.98 * critical, 1.02 * critical):
        q = np.array([0, 0, 0, 0, 0, 0, 0, 0, 2 * np.pi * tau, tau, 0, 2 * np.pi])
        poses = rod.end_poses(q[None])[0]
        poses[1, :3] = poses[0, :3]
        poses[1, 3:] = rotations.product(poses[0, 3:], rotations.from_vector(np.array([tau / twist, 0.0, 0.0])))
        ring = meet_poses(rod, poses, q[None])
        assert len(ring) == 1
        assert ring[0, 9] == pytest.approx(tau, rel=0.02)
        margins.append(rod.stability(ring)[0][0])
    np.testing.assert_allclose(margins[:2], 0, atol=1e-3)
    assert margins[2] < -0.5


def test_a_rigid_motion_changes_the_shape_by_itself_alone():
    """Any where there is no weight, else one about the vertical."""
    for rod, turn in ((SpatialRod(0.5), [0.3, -1.0, 0.5]), (HEAVY, [0.0, 0.0, 2.0])):
        rows, by = random_rows(3), rotations.from_vector(np.array(turn))
        step = np.pad(np.array(turn), (3, 6)) + np.zeros((3, 12))
        moved = rod.retract(rows, step)
        moved[:, :3] = rotations.rotate(by, rows[:, :3]) + [0.1, 0.2, 0.3]
        stations, _ = rod.shapes(rows)
        wanted = rotations.rotate(by, stations) + [0.1, 0.2, 0.3]
        np.testing.assert_allclose(rod.shapes(moved)[0], wanted, atol=1e-12)
        np.testing.assert_allclose(rod.energy(moved), rod.energy(rows), rtol=1e-9)
        np.testing.assert_allclose(rod.stability(moved)[0], rod.stability(rows)[0], rtol=1e-5)


def test_energies_of_shapes_are_those_of_the_chain():
    q = random_rows(1)[0]
    t, lengths = links(HEAVY, q)
    ends = HEAVY.end_poses(q[None])[0]
    wanted = energy_of(HEAVY, t, lengths, ends, q[9] / HEAVY.twist)
    lowest = HEAVY.weight * (ends[0, 2] - ends[:, 2].mean()) / HEAVY.length
    assert HEAVY.energy(q[None])[0] == pytest.approx(wanted + lowest, rel=1e-9)


def test_coordinates_are_those_of_a_held_rod():
    rows = random_rows(40)
    a, b = rows[:20], rows[20:]
    assert HEAVY.dof == a.shape[1] == len(HEAVY.units)
    np.testing.assert_allclose(
        HEAVY.shapes(HEAVY.retract(a, HEAVY.difference(a, b)))[0], HEAVY.shapes(b)[0], atol=1e-12
    )
    np.testing.assert_allclose(HEAVY.shapes(HEAVY.between(a, b, 1.0))[0], HEAVY.shapes(b)[0], atol=1e-12)
    full = a.copy()
    full[:, 3:6] *= 1 - 2 * np.pi / np.linalg.norm(a[:, 3:6], axis=1, keepdims=True)
    np.testing.assert_allclose(HEAVY.shapes(full)[0], HEAVY.shapes(a)[0], atol=1e-12)
    np.testing.assert_allclose([HEAVY.written_near(*each) for each in zip(full, a, strict=True)], a, atol=1e-9)


@pytest.mark.parametrize("weight", [0.0, 50.0])
def test_keypoints_and_orientations_are_fitted_exactly(weight: float):
    rod = SpatialRod(0.5, 13, 0.7, weight)
    for q in stable_rows(rod, 6, seed=2):
        stations, poses = rod.shapes(q[None])
        found, left = fit_shape(rod, rod.at_keypoints(stations)[0], poses[0, :, 3:])
        np.testing.assert_allclose(HEAVY.difference(q, found), 0, atol=1e-6)
        assert left < 1e-9


def test_keypoints_alone_leave_the_roll_open():
    """A rod rolled about itself lies as before, between grippers that are turned: the fit without them keeps it."""
    q = stable_rows(HEAVY, 1)[0]
    rolled, by = q.copy(), rotations.from_vector(np.array([0.8, 0.0, 0.0]))
    rolled[3:6] = rotations.to_vector(rotations.product(rotations.from_vector(q[3:6]), by))
    rolled[6:] = rotations.rotate(rotations.conjugate(by), q[6:].reshape(2, 3)).ravel()
    (stations, poses), (same, turned) = HEAVY.shapes(q[None]), HEAVY.shapes(rolled[None])
    np.testing.assert_allclose(same, stations, atol=1e-12)
    found, left = fit_shape(HEAVY, HEAVY.at_keypoints(stations)[0], guess=rolled)
    assert left < 1e-8
    np.testing.assert_allclose(HEAVY.end_poses(found[None]), turned, atol=1e-6)
    np.testing.assert_allclose(SE3.distance(turned[0], poses[0])[1], 0.8, atol=1e-9)


def test_between_the_grippers_of_a_shape_it_is_found_again():
    q = stable_rows(HEAVY, 2, seed=3)[1]
    stations, poses = HEAVY.shapes(q[None])
    found = equilibria_at(HEAVY, poses[0], starts=60)
    assert len(found) > 1
    assert np.abs(HEAVY.shapes(found)[0] - stations).max(axis=(1, 2)).min() < 1e-8
    assert (np.diff(HEAVY.energy(found)) >= 0).all()
    assert (HEAVY.stability(found)[0] > 0).all()


def test_weight_bends_a_shape_between_the_same_grippers():
    """There and back it is the same; a flat span sags as the beam does, by gamma/384 of its length."""
    q = stable_rows(SpatialRod(0.5, 13, 0.7), 1, seed=3)[0]
    rod, heavy = SpatialRod(0.5, 13, 0.7), SpatialRod(0.5, 13, 0.7, 10.0)
    hanging = under_weight(rod, q, 10.0)
    assert hanging is not None
    np.testing.assert_allclose(heavy.end_poses(hanging[None]), rod.end_poses(q[None]), atol=1e-8)
    back = under_weight(heavy, hanging, 0.0)
    assert back is not None
    np.testing.assert_allclose(rod.shapes(back[None])[0], rod.shapes(q[None])[0], atol=1e-7)
    beam = SpatialRod(1.0, FINE, 0.7, 0.5)
    across = np.array([0, 0, 0, 0, 0, 0, 0, 0, 0, 0, -0.5 / 24, 0])  # half of what is at the clamps
    heights = beam.shapes(across[None])[0][0, :, 2]
    assert heights[0] - heights.min() == pytest.approx(0.5 / 384, rel=0.01)


def test_a_line_of_equilibria_is_followed():
    rows = stable_rows(HEAVY, 2, seed=4)
    line = HEAVY.between(rows[0], HEAVY.between(rows[0], rows[1], 0.15), np.linspace(0, 1, 4))
    led = lead(HEAVY, line[0], HEAVY.end_poses(line))
    assert led.snap is None
    np.testing.assert_allclose(HEAVY.shapes(led.q)[0], HEAVY.shapes(line)[0], atol=1e-8)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((0.0, 13), "rod length must be positive"),
        ((1.0, 2), "at least 3 keypoints"),
        ((1.0, 13, 0.0), "rod twist must be positive"),
        ((1.0, 13, 1.0, -1.0), "rod weight must be finite and not negative"),
    ],
)
def test_a_rod_that_is_none_is_refused(values: tuple, message: str):
    with pytest.raises(InputError, match=message):
        SpatialRod(*values)


@pytest.mark.wrong_types
def test_arrays_of_the_wrong_shape_are_refused():
    with pytest.raises(InputError, match=r"shape \(t, 12\), got \(12,\)"):
        HEAVY.shapes(np.zeros(12))
    with pytest.raises(InputError, match=r"shape \(13, 3\), got \(12, 3\)"):
        fit_shape(HEAVY, np.zeros((12, 3)))
    with pytest.raises(InputError, match=r"must have length 1, got \[1.0, 1.0, 0.0, 0.0\]"):
        fit_shape(HEAVY, np.zeros((13, 3)), np.array([[1.0, 0, 0, 0], [1.0, 1.0, 0, 0]]))
