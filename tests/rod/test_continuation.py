"""Laws of leading a rod: it keeps to its branch, and snaps where theory and a simulated chain say."""

from __future__ import annotations

import numpy as np
import pytest

from cableway.core.errors import InputError
from cableway.geometry.groups import SE2
from cableway.rod.continuation import lead
from cableway.rod.inverse import shape_between
from cableway.rod.planar import PlanarRod
from cableway.scene.cable import Cable
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.simulation.plant import CableSimulator

START = np.array([0.3, 0.3, 0.2, 3.0, 9.0, -1.5])
GOAL = np.array([0.4, 0.35, -0.9, -6.0, 12.0, 1.0])


def arch(rod: PlanarRod, shortening: float) -> np.ndarray:
    """Poses of clamps in line, nearer to each other than the rod is long by a share of its length."""
    return np.array([[0.0, 0.0, 0.0], [rod.length * (1 - shortening), 0.0, 0.0]])


def turned(poses: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """The same with the left one turned by each of `angles`."""
    rows = np.repeat(poses[None], len(angles), axis=0)
    rows[:, 0, 2] = angles
    return rows


def flat_fold() -> float:
    """Angle of one clamp, over the root of the shortening, at which a nearly flat arch that bends away from it snaps.

    Deflection w'''' + k^2 w'' = 0 with w = w' = 0 at 1, w = 0 and w' = 1 at 0, scaled so that the shortening, half the
    integral of w'^2, is 1. The angle, a function of k, is greatest at the fold, on the branch that leaves the buckled
    arch at k = 2 pi (Gomez, Moulton & Vella 2017, "Critical slowing down in purely elastic 'snap-through'
    instabilities", give 1.7818).
    """
    x = np.linspace(0, 1, 2001)
    angles = []
    for k in np.linspace(2 * np.pi + 1e-3, 8.9, 4000):
        rows = [[0, 1, 0, 1], [k, 0, 1, 0], [np.sin(k), np.cos(k), 1, 1], [k * np.cos(k), -k * np.sin(k), 1, 0]]
        sine, cosine, slope, _ = np.linalg.solve(rows, [0, 1, 0, 0])
        steepness = k * (sine * np.cos(k * x) - cosine * np.sin(k * x)) + slope
        angles.append(np.trapezoid(steepness**2 / 2, x) ** -0.5)
    return max(angles)


def test_the_theory_of_flat_arches_has_the_known_fold():
    assert flat_fold() == pytest.approx(1.7818, abs=1e-4)


@pytest.mark.parametrize("shortening", [0.004, 0.001])
def test_an_arch_snaps_where_one_of_its_clamps_turns_too_far(shortening: float):
    """The flatter the arch, the nearer to the theory of flat ones."""
    rod = PlanarRod(1.0, 97)
    poses = turned(arch(rod, shortening), np.linspace(0, 0.3, 61))
    led = lead(rod, shape_between(rod, poses[0], "right"), poses)
    assert led.snap is not None
    assert 0.005 * led.snap / np.sqrt(shortening) == pytest.approx(flat_fold(), rel=5 * shortening + 0.004)
    assert led.stability[-1] < 0.3 * led.stability[0]
    np.testing.assert_allclose(rod.shapes(led.q)[1], poses[: len(led.q)], atol=1e-8)


def test_the_same_arch_turned_the_other_way_does_not_snap():
    rod = PlanarRod(1.0)
    poses = turned(arch(rod, 0.01), np.linspace(0, 0.3, 31))
    led = lead(rod, shape_between(rod, poses[0], "left"), poses)
    assert led.snap is None
    assert len(led.q) == len(poses)


def test_a_line_of_equilibria_is_followed():
    rod = PlanarRod(0.3)
    line = START + np.linspace(0, 1, 12)[:, None] * (GOAL - START)
    led = lead(rod, START, rod.shapes(line)[1])
    assert led.snap is None
    np.testing.assert_allclose(rod.shapes(led.q)[0], rod.shapes(line)[0], atol=1e-8)
    np.testing.assert_allclose(led.stability, rod.stability(line)[0], rtol=1e-6)


def test_where_it_snaps_does_not_depend_on_the_rows():
    rod = PlanarRod(0.3)
    poses = rod.shapes(np.array([START, GOAL]))[1]
    way = poses[0] + np.linspace(0, 1, 41)[:, None, None] * SE2.minus(poses[1], poses[0])
    at_once, by_rows = lead(rod, START, poses), lead(rod, START, way)
    assert at_once.snap is not None
    assert by_rows.snap is not None
    assert by_rows.snap == pytest.approx(40 * at_once.snap, abs=0.01)
    assert len(by_rows.q) == int(by_rows.snap) + 1


def test_the_simulated_cable_follows_until_there_and_then_leaves():
    """Before, it lies where the rod does; ten steps after, far from its last shape."""
    cable = Cable(damping_time=0.05)
    rod, angles = cable.rod, np.linspace(0, 0.4, 101)
    poses = turned(arch(rod, 0.02), angles) + [0.2, 0.35, 0.0]
    led = lead(rod, shape_between(rod, poses[0], "right"), poses)
    assert led.snap is not None
    shapes, last = rod.at_keypoints(rod.shapes(led.q)[0]), int(led.snap)
    task = Task(name="arch", scene=Scene(), cable=cable, start=shapes[0], goal=shapes[1])
    plant = CableSimulator(task)
    observed = np.array([plant.reset().keypoints, *(plant.step(step).keypoints for step in np.diff(poses, axis=0))])
    assert np.abs(observed[: last - 4] - shapes[: last - 4]).max() < 0.002
    assert np.abs(observed[last + 10] - shapes[-1]).max() > 0.03


def test_first_shapes_that_do_not_fit_are_refused():
    rod = PlanarRod(0.3)
    poses = rod.shapes(np.array([START, GOAL]))[1]
    with pytest.raises(InputError, match="not at the first poses"):
        lead(rod, GOAL, poses)
    folded = np.array([0.3, 0.3, 0.0, -80.0, 0.0, 0.0])
    with pytest.raises(InputError, match="not stable"):
        lead(rod, folded, rod.shapes(folded[None])[1])
