"""Laws of the inverse problems: keypoints to rod coordinates, gripper poses to shapes."""

from __future__ import annotations

import numpy as np
import pytest

from cableway.core.errors import InputError
from cableway.geometry import polyline, se2
from cableway.geometry.groups import SE2
from cableway.rod.inverse import equilibria_at, fit_keypoints, shape_between
from cableway.rod.planar import PlanarRod

ARCH = np.array([[0.1, 0.2, 0.9], [0.3, 0.2, -0.9]])


def stable_rows(rod: PlanarRod, count: int, seed: int = 0) -> np.ndarray:
    """Stable shapes that do not cross themselves."""
    rng = np.random.default_rng(seed)
    rows = np.column_stack([rng.uniform(0, 1, (400, 2)), rng.uniform(-3, 3, 400), rng.normal(0, [9, 9, 2], (400, 3))])
    rows = rows[rod.stability(rows)[0] > 10]
    return np.array([q for q in rows if not polyline.crosses_itself(rod.shapes(q[None])[0][0])][:count])


def keypoints_of(rod: PlanarRod, q: np.ndarray) -> np.ndarray:
    return rod.at_keypoints(rod.shapes(q[None])[0])[0]


def same_shape(rod: PlanarRod, q: np.ndarray, other: np.ndarray) -> bool:
    return bool(np.abs(rod.shapes(q[None])[0] - rod.shapes(other[None])[0]).max() < 1e-6 * rod.length)


@pytest.mark.parametrize("n", [5, 10, 13])
def test_fitting_its_own_keypoints_gives_the_rod_back(n: int):
    rod = PlanarRod(0.3, n)
    for q in stable_rows(rod, 12):
        found, distance = fit_keypoints(rod, keypoints_of(rod, q))
        assert distance < 1e-6 * rod.length
        if n > 5:  # five keypoints hardly determine the loads
            np.testing.assert_allclose(found * [1, 1, 0, 1, 1, 1], q * [1, 1, 0, 1, 1, 1], atol=1e-3)
            np.testing.assert_allclose(se2.wrap_angle(found[2] - q[2]), 0, atol=1e-6)


def test_the_fitted_shape_is_the_nearest_one():
    """Of points that no rod takes, moving any coordinate of the answer makes the distance larger."""
    rod = PlanarRod(0.3)
    q = stable_rows(rod, 1)[0]
    points = keypoints_of(rod, q) + np.random.default_rng(1).normal(0, 2e-3, (13, 2))
    found, distance = fit_keypoints(rod, points)
    assert 1e-3 < distance <= np.linalg.norm(points - keypoints_of(rod, q))
    for i, step in enumerate([1e-4, 1e-4, 1e-3, 0.05, 0.05, 0.01]):
        for sign in (-1, 1):
            nearby = keypoints_of(rod, found + sign * step * np.eye(6)[i])
            assert np.linalg.norm(points - nearby) > distance


def test_a_straight_row_of_points_fits_the_unloaded_rod():
    points = np.column_stack([np.linspace(0.1, 0.4, 13), np.full(13, 0.2)])
    found, distance = fit_keypoints(PlanarRod(0.3), points)
    assert distance < 1e-9
    np.testing.assert_allclose(found, [0.25, 0.2, 0, 0, 0, 0], atol=1e-6)


@pytest.mark.parametrize("n", [10, 13])
def test_the_grippers_of_a_stable_shape_allow_that_shape(n: int):
    rod = PlanarRod(0.3, n)
    for q in stable_rows(rod, 4, seed=n):
        poses = rod.shapes(q[None])[1][0]
        found = equilibria_at(rod, poses)
        assert any(same_shape(rod, q, other) for other in found)
        np.testing.assert_allclose(SE2.distance(rod.shapes(found)[1], poses), 0, atol=1e-9)
        assert (rod.stability(found)[0] > 0).all()
        assert (np.diff(rod.energy(found)) >= 0).all()
        assert not any(same_shape(rod, a, b) for i, a in enumerate(found) for b in found[:i])


@pytest.mark.parametrize("bend", ["left", "right"])
def test_the_shape_between_lies_on_its_side_with_the_least_energy(bend: str):
    rod = PlanarRod(0.3)
    chosen = shape_between(rod, ARCH, bend)  # pyright: ignore[reportArgumentType]
    area = polyline.signed_area(rod.shapes(chosen[None])[0][0])
    assert (area > 0) == (bend == "left")
    rivals = [q for q in equilibria_at(rod, ARCH) if polyline.signed_area(rod.shapes(q[None])[0][0]) * area > 0]
    assert rod.energy(chosen[None])[0] == min(rod.energy(np.array(rivals)))


def test_mirrored_grippers_give_the_mirrored_shape():
    rod, mirror = PlanarRod(0.3), np.array([1, -1, -1])
    left, right = shape_between(rod, ARCH, "left"), shape_between(rod, ARCH * mirror, "right")
    np.testing.assert_allclose(rod.shapes(right[None])[0][0], rod.shapes(left[None])[0][0] * [1, -1], atol=1e-9)


def test_moved_grippers_give_the_moved_shape():
    rod, moved = PlanarRod(0.3), ARCH.copy()
    moved[:, :2] = se2.transform(ARCH[:, :2], np.array([0.1, 0.3]), 2.1)
    moved[:, 2] += 2.1
    here, there = shape_between(rod, ARCH, "left"), shape_between(rod, moved, "left")
    wanted = se2.transform(rod.shapes(here[None])[0][0], np.array([0.1, 0.3]), 2.1)
    np.testing.assert_allclose(rod.shapes(there[None])[0][0], wanted, atol=1e-9)


def test_grippers_changed_over_give_the_shape_reversed():
    rod = PlanarRod(0.3)
    changed = ARCH[::-1] + np.array([0, 0, np.pi])
    here, there = shape_between(rod, ARCH, "left"), shape_between(rod, changed, "right")
    np.testing.assert_allclose(rod.shapes(there[None])[0][0], rod.shapes(here[None])[0][0][::-1], atol=1e-9)


def test_full_turns_of_a_gripper_change_nothing():
    rod = PlanarRod(0.3)
    turned = ARCH + np.array([[0, 0, 2 * np.pi], [0, 0, -4 * np.pi]])
    here, there = shape_between(rod, ARCH, "left"), shape_between(rod, turned, "left")
    np.testing.assert_allclose(rod.shapes(there[None])[0], rod.shapes(here[None])[0], atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.0, -1.1])
def test_grippers_as_far_apart_as_the_rod_is_long_allow_the_straight_rod_alone(angle: float):
    rod = PlanarRod(0.3)
    poses = np.array([[0.5, 0.5, angle], [*np.array([0.5, 0.5]) + 0.3 * se2.direction(angle), angle]])
    found = equilibria_at(rod, poses)
    assert len(found) == 1
    across = rod.shapes(found)[0][0] @ se2.direction(angle + np.pi / 2)
    np.testing.assert_allclose(across, across[0], atol=1e-6)
    for bend in ("left", "right"):
        with pytest.raises(InputError, match=f"no stable shape of the cable bends to the {bend}"):
            shape_between(rod, poses, bend)


def test_even_the_first_guesses_are_their_own_mirror_image_and_reverse():
    """With five of them not every shape is found, but the same ones in the mirror and from the other end."""
    rod, rng = PlanarRod(0.3), np.random.default_rng(0)
    for _ in range(6):
        poses = np.array([[0, 0, rng.uniform(-2, 2)], [rng.uniform(0.05, 0.28), 0, rng.uniform(-2, 2)]])
        found = rod.shapes(equilibria_at(rod, poses, starts=5))[0]
        mirrored = rod.shapes(equilibria_at(rod, poses * [1, -1, -1], starts=5))[0]
        turned = rod.shapes(equilibria_at(rod, poses[::-1] + np.array([0, 0, np.pi]), starts=5))[0]
        np.testing.assert_allclose(mirrored * [1, -1], found, atol=1e-9)
        np.testing.assert_allclose(turned[:, ::-1], found, atol=1e-9)


def test_grippers_farther_apart_than_the_rod_is_long_are_refused():
    with pytest.raises(InputError, match=r"310 mm apart, farther than the cable is long \(300 mm\)"):
        equilibria_at(PlanarRod(0.3), np.array([[0.1, 0.1, 0.0], [0.41, 0.1, 0.0]]))
