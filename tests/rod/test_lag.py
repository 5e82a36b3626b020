"""How far a rod trails behind: not at all in rigid motion, and as far as a simulated one."""

from __future__ import annotations

import numpy as np
import pytest

from cableway.geometry.groups import SE2
from cableway.rod.lag import lag
from cableway.rod.planar import PlanarRod
from cableway.scene.cable import Cable
from cableway.scene.scene import Scene
from cableway.scene.task import CONTROL_STEP, Task
from cableway.simulation.plant import CableSimulator

START = np.array([0.3, 0.3, 0.2, 3.0, 9.0, -1.5])
GOAL = np.array([0.4, 0.35, -0.4, -24.0, 9.0, 1.5])


def line(steps: int) -> np.ndarray:
    return START + np.linspace(0, 1, steps + 1)[:, None] * (GOAL - START)


def test_rigid_motion_leaves_nothing_behind():
    moved = np.repeat(START[None], 8, axis=0)
    moved[:, :2] += np.linspace(0, 0.1, 8)[:, None]
    moved[:, 2] += np.linspace(0, 7.0, 8)
    assert lag(PlanarRod(0.3), moved).max() < 1e-12


def test_lag_is_speed_and_length_times_what_it_is():
    rod = PlanarRod(0.3)
    slow, fast = lag(rod, line(80)), lag(rod, line(40))
    np.testing.assert_allclose(fast, slow[::2] + slow[1::2], rtol=0.02, atol=1e-5)
    scaled = line(40) * [1.5, 1.5, 1, 1, 1, 1]
    np.testing.assert_allclose(lag(PlanarRod(0.45), scaled), 1.5 * fast, rtol=1e-9)


def test_lag_is_the_same_in_the_mirror_and_from_the_other_end():
    rod = PlanarRod(0.3)
    here = lag(rod, line(20))
    np.testing.assert_allclose(lag(rod, line(20) * [1, -1, -1, 1, -1, -1]), here, rtol=1e-9)
    np.testing.assert_allclose(lag(rod, line(20)[::-1])[::-1], here, rtol=1e-6)


def test_a_straight_rod_that_begins_to_bend():
    q = np.zeros((2, 6))
    q[1, 5] = 0.01
    assert 0 < lag(PlanarRod(0.3), q)[0] < 1e-3


@pytest.mark.parametrize("tau", [0.1, 0.2])
def test_the_simulated_cable_trails_as_far(tau: float):
    """After a third of the way, when it has built up."""
    cable, steps = Cable(damping_time=tau), 30
    q = line(steps)
    stations, poses = cable.rod.shapes(q)
    shapes = cable.rod.at_keypoints(stations)
    plant = CableSimulator(Task(name="lag", scene=Scene(), cable=cable, start=shapes[0], goal=shapes[-1]))
    plant.reset()
    observed = np.array([plant.step(step).keypoints for step in SE2.minus(poses[1:], poses[:-1])])
    off = np.linalg.norm(observed - shapes[1:], axis=2).max(1)
    wanted = lag(cable.rod, q) * tau / CONTROL_STEP
    assert wanted[10:].max() > 0.001
    np.testing.assert_allclose(off[10:], wanted[10:], rtol=0.25, atol=2e-4)


def test_a_stiff_half_trails_as_a_chain_of_it_does():
    """Against the explicit equations: K d = -tau K_0 dtheta/dt on the changes that keep the ends in place."""
    rod = PlanarRod(0.3, 13, (0.8, 0.0, 0.0, 0.0, 0.5, -0.5, 0.0, 0.0))
    q = line(40)[:2]
    stations, poses = rod.shapes(q)
    links = np.diff(stations[:, 1::2], axis=1)
    angles = np.column_stack([poses[:, 0, 2], np.arctan2(links[..., 1], links[..., 0]), poses[:, 1, 2]])
    difference = np.diff(np.eye(rod.hinges + 1), axis=0)
    bending = rod.hinges**2 * difference.T @ (rod.bending[0][:, None] * difference)
    middle = q.mean(0)
    along = np.diff(rod.shapes(middle[None])[0][0, 1::2], axis=0) * rod.hinges / rod.length
    c, s = np.cos(middle[2]), np.sin(middle[2])
    load = np.array([[c, -s], [s, c]]) @ middle[3:5]
    null = np.linalg.svd(np.array([-along[:, 1], along[:, 0]]))[2][2:]
    stiffness = bending[1:-1, 1:-1] + np.diag(along @ load)
    moment = -(bending @ (angles[1] - angles[0]))[1:-1]
    behind = null.T @ np.linalg.solve(null @ stiffness @ null.T, null @ moment)
    across = np.column_stack([-along[:, 1], along[:, 0]]) * rod.length / rod.hinges
    wanted = np.linalg.norm(np.cumsum(behind[:, None] * across, axis=0), axis=1).max()
    assert lag(rod, q)[0] == pytest.approx(wanted, rel=1e-4)
    assert lag(PlanarRod(0.3), q)[0] != pytest.approx(wanted, rel=0.05)
