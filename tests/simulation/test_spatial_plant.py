"""The plant in space: the rod's equilibria are its own, it snaps where the rod does, and it follows what leads it."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from cableway.core.errors import SimulationError
from cableway.geometry import rotations
from cableway.geometry.groups import SE3
from cableway.rod.continuation import lead
from cableway.rod.spatial import SpatialRod
from cableway.simulation.spatial_chain import SpatialChain
from cableway.simulation.spatial_plant import SpatialConfig, SpatialPlant
from cableway.simulation.surroundings import CABLE, CONTACT, SURROUNDINGS

ROD = SpatialRod(0.5, 13, 0.4, 18.5)
STIFFNESS = 1e-3
STABLE, UNSTABLE = (*[0.3] * 3, *[1.2] * 3, *[8.0] * 3, *[2.0] * 3), (*[0.3] * 3, *[1.2] * 3, *[25.0] * 6)


def chain(rod: SpatialRod = ROD, links: int = 41) -> SpatialChain:
    density = rod.weight * STIFFNESS / (9.81 * rod.length**3)
    return SpatialChain(
        length=rod.length, radius=0.004, bending_stiffness=STIFFNESS, twist=rod.twist, damping_time=0.1,
        linear_density=density, links=links,
    )  # fmt: skip


def drawn(stable: bool, rod: SpatialRod = ROD) -> np.ndarray:
    """Coordinates that are stable, or that are not."""
    rows = np.random.default_rng(7).normal(0, STABLE if stable else UNSTABLE, (400, 12))
    margins = rod.stability(rows, ceiling=20.0)[0]
    return rows[margins > 5 if stable else (margins < -10) & (np.abs(rows[:, 9]) < 12)]


def firm() -> np.ndarray:
    """Coordinates with a margin of 20 and more."""
    rows = drawn(stable=True)
    return rows[np.argmax(ROD.stability(rows, ceiling=20.0)[0])]


def off(plant: SpatialPlant, q: np.ndarray, rod: SpatialRod = ROD) -> float:
    """Distance [m] of the keypoints from those of coordinates."""
    return float(np.linalg.norm(plant.measure().keypoints - rod.shapes(q[None])[0][0, :: rod.stride], axis=1).max())


def led(plant: SpatialPlant, action: np.ndarray, times: int) -> None:
    for _ in range(times):
        plant.step(action)


def test_stable_shapes_of_a_cable_that_twists_easily_stay_and_others_leave():
    q = firm()
    assert off(SpatialPlant(chain(), ROD, q), q) < 0.001
    q = drawn(stable=False)[0]
    assert off(SpatialPlant(chain(), ROD, q), q) > 0.03


def test_an_arch_twisted_by_one_gripper_snaps_where_the_rod_does():
    rod = replace(ROD, twist=1.0)
    q = drawn(stable=True, rod=rod)[5]
    pose = rod.end_poses(q[None])[0]
    turns = rotations.from_vector(np.linspace(0, 4, 17)[:, None] * [1.0, 0.0, 0.0])
    poses = np.repeat(pose[None], len(turns), axis=0)
    poses[:, 1, 3:] = rotations.product(pose[1, 3:], turns)
    found = lead(rod, q, poses)
    assert found.snap is not None
    last = len(found.q) - 1
    plant = SpatialPlant(chain(rod), rod, found.q[last - 2])
    assert off(plant, found.q[last - 2], rod) < 0.002
    for row in range(last - 2, last + 3):
        plant.step(SE3.minus(poses[row + 1], poses[row]))
    led(plant, np.zeros((2, 6)), 12)
    assert off(plant, found.q[last], rod) > 0.05


def test_it_takes_the_shapes_of_the_rod_that_it_is_led_along():
    q = firm()
    line = ROD.between(q, q + [0.0, 0.02, 0.02, *[0.1] * 3, *[0.8] * 6], np.linspace(0, 1, 30))
    assert ROD.stability(line, ceiling=10.0)[0].min() == 10.0
    _, poses = ROD.shapes(line)
    plant = SpatialPlant(chain(), ROD, line[0], config=SpatialConfig(servo_time=0.0))
    for row in range(len(line) - 1):
        plant.step(SE3.minus(poses[row + 1], poses[row]))
        assert off(plant, line[row + 1]) < 0.002
    np.testing.assert_allclose(SE3.minus(plant.measure().poses, poses[-1]), 0, atol=1e-9)
    assert plant.time == pytest.approx(2.9)


def test_contacts_are_measured_and_a_cable_pulled_too_hard_is_lost():
    q = np.zeros(12)
    q[10] = -4.0  # hanging in a U

    def floor(spec: mujoco.MjSpec) -> None:
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX, pos=[0.0, 0.0, -0.06], size=[0.2, 0.2, 0.02],
            contype=SURROUNDINGS, conaffinity=CABLE, condim=3, **CONTACT,
        )  # fmt: skip

    plant = SpatialPlant(chain(links=21), ROD, q, floor)
    down = np.tile([0.0, 0.0, -0.005, 0.0, 0.0, 0.0], (2, 1))
    measured = [plant.step(down).contact for _ in range(12)]
    assert measured[0] == np.inf
    assert min(measured) < 0
    with pytest.raises(SimulationError, match="finite"):
        plant.step(np.full((2, 6), np.nan))
    apart = np.array([[-0.02, 0.0, 0.0, 0.0, 0.0, 0.0], [0.02, 0.0, 0.0, 0.0, 0.0, 0.0]])
    with pytest.raises(SimulationError, match="pulled too hard"):
        led(plant, apart, 30)
