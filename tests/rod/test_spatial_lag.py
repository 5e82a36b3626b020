"""How far a rod in space trails behind: not at all in rigid motion, else as far as a planar or a simulated one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cableway.geometry import rotations
from cableway.geometry.groups import SE3
from cableway.motion.spatial import continuous_poses
from cableway.rod.lag import lag
from cableway.rod.planar import PlanarRod
from cableway.rod.spatial import SpatialRod
from cableway.rod.spatial_lag import frames, matrices, spatial_lag
from cableway.scene.spatial.cable import SpatialCable
from cableway.scene.spatial.scene import SpatialScene
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.task import CONTROL_STEP
from cableway.simulation.spatial_plant import SpatialConfig, SpatialPlant

ROD = SpatialRod(0.5, 13, 0.7, 40.0)
CENTRE = np.array([0.7, 0.7, 0.7, *[0.0] * 9])
HELD = np.array([0.3, 0.3, 0.3, 0.2, -0.1, 0.5, -12.0, 3.0, 6.0, 0.4, 1.5, -2.0])
WAY = np.array([0.02, 0.05, -0.03, 0.2, 0.1, -0.3, 3.0, 1.0, -2.0, 0.3, 0.5, 0.8])


def line(steps: int, rod: SpatialRod = ROD, way: np.ndarray = WAY) -> np.ndarray:
    return rod.retract(np.tile(HELD, (steps + 1, 1)), np.linspace(0, 1, steps + 1)[:, None] * way)


def test_rigid_motion_leaves_nothing_behind():
    """A heavy rod may be carried anywhere, and turned about the vertical."""
    turns = np.linspace(0, 2, 9)[:, None] * [0.0, 0.0, 1.0]
    moved = ROD.retract(np.tile(HELD, (9, 1)), np.column_stack([turns @ np.ones((3, 3)) / 9, turns, np.zeros((9, 6))]))
    assert spatial_lag(ROD, moved).max() < 1e-6


def test_lag_is_speed_times_what_it_is():
    slow, fast = spatial_lag(ROD, line(80)), spatial_lag(ROD, line(40))
    np.testing.assert_allclose(fast, slow[::2] + slow[1::2], rtol=0.03, atol=1e-5)
    assert fast.max() > 1e-4


@pytest.mark.parametrize(("weight", "modes"), [(0.0, ()), (40.0, ()), (160.0, ()), (40.0, (0.8, -0.4))])
def test_equilibria_follow_each_other_as_the_second_derivative_says(weight: float, modes: tuple[float, ...]):
    """H omega is balanced by a change of the force that closes the chain, up to the square of the spacing."""
    rod, step = SpatialRod(0.5, 13, 0.7, weight, modes), 1e-4
    q = rod.retract(np.tile(HELD, (3, 1)), np.array([-step, 0.0, step])[:, None] * WAY)
    carried = frames(rod, q)
    turned = rotations.to_vector(rotations.product(carried[2], rotations.conjugate(carried[0]))) / (2 * step)
    hessian, _, closure = matrices(rod, q[1:2], carried[1:2])
    left, held = (hessian[0] @ turned.ravel())[3:-3], closure[0, 3:-3]
    forced = held @ np.linalg.lstsq(held, left, rcond=None)[0]
    assert np.abs(left - forced).max() < 0.05 * np.abs(left).max()


def test_a_rod_in_a_plane_trails_as_the_planar_one():
    flat, rod = PlanarRod(0.5, 13), SpatialRod(0.5, 13)
    start, way = np.array([0.3, 0.3, 0.2, 3.0, 9.0, -1.5]), np.array([0.1, 0.05, -0.6, -9.0, 0.0, 1.5])
    planar = start + np.linspace(0, 1, 21)[:, None] * way
    q = np.zeros((21, 12))
    q[:, :2], q[:, 5] = planar[:, :2], planar[:, 2]
    q[:, 6:8], q[:, 11] = planar[:, 3:5], planar[:, 5]
    np.testing.assert_allclose(spatial_lag(rod, q), lag(flat, planar), rtol=0.03, atol=1e-5)


def rolling(rod: SpatialRod, steps: int) -> np.ndarray:
    """An arch whose grippers turn as fast about their own axes: it stays, but each hinge bends in other directions."""
    arch = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0, -20.0, 0.0, 0.0, 0.0, 0.0, 4.0])
    q = np.tile(arch, (steps + 1, 1))
    q[:, 3] = np.linspace(0, steps / 30, steps + 1)
    for at in (6, 9):
        back = rotations.conjugate(rotations.from_vector(q[:, 3:6]))
        q[:, at : at + 3] = rotations.rotate(back, arch[at : at + 3])
    np.testing.assert_allclose(rod.shapes(q)[0], np.tile(rod.shapes(q[:1])[0], (steps + 1, 1, 1)), atol=1e-9)
    return q


LIGHT = SpatialCable(length=0.5, twist_ratio=0.7, keypoints=13, linear_density=5e-4)
HEAVY = replace(LIGHT, linear_density=0.015)


@pytest.mark.parametrize("cable", [LIGHT, HEAVY], ids=["an arch that rolls", "a heavy cable that bends and twists"])
def test_the_simulated_cable_trails_as_far(cable: SpatialCable):
    """In the median after a third of the way, when it has built up; what changes, the simulated one changes late."""
    rod, steps = cable.rod, 30
    q = rolling(SpatialRod(0.5, 13, 0.7), steps) if cable is LIGHT else line(steps, rod, 2 * WAY) + CENTRE
    ends = SpatialTask(name="lag", scene=SpatialScene(size=(2.0, 2.0, 2.0)), cable=cable, start=q[0], goal=q[-1])
    plant = SpatialPlant(ends, config=SpatialConfig(servo_time=0.0))
    plant.reset()
    stations, poses = rod.shapes(q)
    poses = continuous_poses(poses)
    observed = np.array([plant.step(action).keypoints for action in SE3.minus(poses[1:], poses[:-1])])
    off = np.linalg.norm(observed - rod.at_keypoints(stations)[1:], axis=2).max(1)
    wanted = spatial_lag(rod, q) * cable.damping_time / CONTROL_STEP
    assert wanted[10:].min() > 0.001
    assert np.median(off[10:]) == pytest.approx(np.median(wanted[10:]), rel=0.1)
