"""The plant in space: the rod's equilibria are its own, it snaps where the rod does, and it follows what leads it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cableway.core.errors import SimulationError
from cableway.geometry import rotations
from cableway.geometry.groups import SE3
from cableway.rod.continuation import lead
from cableway.scene.obstacles import Box
from cableway.scene.spatial.cable import SpatialCable
from cableway.scene.spatial.grippers import GripperPiece, SpatialGrippers
from cableway.scene.spatial.obstacles import ConvexMesh, Cuboid, Cylinder, Prism, SpatialObstacle, Sphere
from cableway.scene.spatial.scene import SpatialScene
from cableway.scene.spatial.task import SpatialTask
from cableway.simulation.spatial_plant import SpatialConfig, SpatialPlant, nearest_start

CABLE = SpatialCable(length=0.5, twist_ratio=0.4, linear_density=0.01508, keypoints=13)
MIDDLE = np.array([1.0, 1.0, 1.0, *[0.0] * 9])
HANGING = MIDDLE + [0.0, 0.0, 0.0, *[0.0] * 7, -4.0, 0.0]


def task(q: np.ndarray, cable: SpatialCable = CABLE, *obstacles: SpatialObstacle) -> SpatialTask:
    """In the middle of a large room."""
    scene = SpatialScene(size=(2.0, 2.0, 2.0), obstacles=obstacles)
    return SpatialTask(name="room", scene=scene, cable=cable, start=q, goal=q)


def drawn(cable: SpatialCable = CABLE) -> np.ndarray:
    """Coordinates of stable shapes about the middle."""
    spread = [*[0.3] * 3, *[1.2] * 3, *[8.0] * 3, *[2.0] * 3]
    rows = MIDDLE + np.random.default_rng(7).normal(0, spread, (400, 12))
    return rows[cable.rod.stability(rows, ceiling=20.0)[0] > 5]


def firm() -> np.ndarray:
    """Coordinates with a margin of 20 and more."""
    rows = drawn()
    return rows[np.argmax(CABLE.rod.stability(rows, ceiling=20.0)[0])]


def off(plant: SpatialPlant, q: np.ndarray) -> float:
    """Distance [m] of the keypoints from those of coordinates."""
    rod = plant.cable.rod
    return float(np.linalg.norm(plant.measure().keypoints - rod.at_keypoints(rod.shapes(q[None])[0])[0], axis=1).max())


def led(plant: SpatialPlant, action: np.ndarray, times: int) -> None:
    for _ in range(times):
        plant.step(action)


def test_a_cable_that_twists_easily_stays_in_the_shape_of_its_rod():
    q = firm()
    assert off(SpatialPlant(task(q)), q) < 0.001


def test_another_cable_held_askew_comes_to_rest_in_its_own_shape():
    q, longer = firm(), replace(CABLE, length=0.51)
    askew = np.tile([0.003, 0.0, 0.0, np.cos(0.05), 0.0, np.sin(0.05), 0.0], (2, 1))
    plant = SpatialPlant(task(q), longer, askew)
    ends = SE3.compose(task(q).gripper_poses("start"), askew)
    assert off(plant, nearest_start(task(q), longer, ends)) < 0.001
    assert off(plant, q) > 0.003


def test_an_arch_twisted_by_one_gripper_snaps_where_the_rod_does():
    cable = replace(CABLE, twist_ratio=1.0)
    rod, q = cable.rod, drawn(cable)[5]
    pose = rod.end_poses(q[None])[0]
    turns = rotations.from_vector(np.linspace(0, 4, 17)[:, None] * [1.0, 0.0, 0.0])
    poses = np.repeat(pose[None], len(turns), axis=0)
    poses[:, 1, 3:] = rotations.product(pose[1, 3:], turns)
    found = lead(rod, q, poses)
    assert found.snap is not None
    last = len(found.q) - 1
    plant = SpatialPlant(task(found.q[last - 2], cable))
    assert off(plant, found.q[last - 2]) < 0.002
    for row in range(last - 2, last + 3):
        plant.step(SE3.minus(poses[row + 1], poses[row]))
    led(plant, np.zeros((2, 6)), 12)
    assert off(plant, found.q[last]) > 0.05


def test_it_takes_the_shapes_of_the_rod_that_it_is_led_along():
    q = firm()
    line = CABLE.rod.between(q, q + [0.0, 0.02, 0.02, *[0.1] * 3, *[0.8] * 6], np.linspace(0, 1, 30))
    assert CABLE.rod.stability(line, ceiling=10.0)[0].min() == 10.0
    poses = CABLE.rod.end_poses(line)
    plant = SpatialPlant(task(line[0]), config=SpatialConfig(servo_time=0.0))
    for row in range(len(line) - 1):
        plant.step(SE3.minus(poses[row + 1], poses[row]))
        assert off(plant, line[row + 1]) < 0.002
    np.testing.assert_allclose(SE3.minus(plant.measure().poses, poses[-1]), 0, atol=1e-9)
    assert plant.time == pytest.approx(2.9)


OBSTACLES = {
    "box": Cuboid(center=(1.0, 1.0, 0.93), size=(0.1, 0.1, 0.1)),
    "cylinder": Cylinder(center=(1.0, 1.0, 0.93), radius=0.05, height=0.2, axis=(0.0, 1.0, 0.0)),
    "sphere": Sphere(center=(1.0, 1.0, 0.93), radius=0.05),
    "mesh": ConvexMesh(points=[[0.95, 0.95, 0.98], [1.05, 0.95, 0.98], [1.0, 1.05, 0.98], [1.0, 1.0, 0.8]]),
    "prism": Prism(section=Box(center=(1.0, 1.0), size=(0.1, 0.1), height=0.98)),
}


@pytest.mark.parametrize("kind", OBSTACLES)
def test_a_cable_lowered_onto_an_obstacle_touches_it_at_its_height(kind: str):
    """It hangs in a U, 16 mm above what is 980 mm high, and comes down by 5 mm a step."""
    plant = SpatialPlant(task(HANGING, CABLE, OBSTACLES[kind]), config=SpatialConfig(links=21, servo_time=0.0))
    down = np.tile([0.0, 0.0, -0.005, 0.0, 0.0, 0.0], (2, 1))
    left = [plant.measure().clearance]
    for _ in range(6):
        plant.step(down)
        left.append(plant.measure().clearance)
    np.testing.assert_allclose(left[:3], [0.016, 0.011, 0.006], atol=0.001)
    assert -0.001 < left[-1] < 0


def test_what_cannot_be_is_refused_and_a_cable_pulled_too_hard_is_lost():
    plant = SpatialPlant(task(HANGING), config=SpatialConfig(links=21))
    with pytest.raises(SimulationError, match="finite"):
        plant.step(np.full((2, 6), np.nan))
    apart = np.array([[-0.02, 0.0, 0.0, 0.0, 0.0, 0.0], [0.02, 0.0, 0.0, 0.0, 0.0, 0.0]])
    with pytest.raises(SimulationError, match="pulled too hard"):
        led(plant, apart, 30)
    with pytest.raises(SimulationError, match="no stable shape"):
        SpatialPlant(task(HANGING), replace(CABLE, length=0.2))


def test_grippers_are_measured_and_a_cable_that_touches_at_the_start_is_refused():
    post = Sphere(center=(0.75, 1.0, 1.3), radius=0.02)
    plant = SpatialPlant(task(HANGING, CABLE, post), config=SpatialConfig(links=21))
    away = np.linalg.norm(plant.measure().poses[:, :3] - post.center, axis=1).min()
    assert plant.measure().gripper_clearance == pytest.approx(away - post.radius - plant.task.grippers.radius)
    with pytest.raises(SimulationError, match="the cable touches something at the start"):
        SpatialPlant(
            task(HANGING, CABLE, OBSTACLES["box"]), replace(CABLE, radius=0.022), config=SpatialConfig(links=21)
        )


def test_what_is_seen_is_late_and_noisy_as_said():
    seen = SpatialConfig(links=21, keypoint_noise=0.001, measurement_delay=2)
    plant, up = SpatialPlant(task(HANGING), config=seen, seed=3), np.tile([0.0, 0.0, 0.01, 0.0, 0.0, 0.0], (2, 1))
    first, true = plant.reset(), [plant.measure().keypoints]
    for _ in range(3):
        last = plant.step(up)
        true.append(plant.measure().keypoints)
    assert (first.taken, last.taken, last.time) == (0.0, pytest.approx(0.1), pytest.approx(0.3))
    assert 0.0005 < (last.keypoints - true[1]).std() < 0.0015
    with pytest.raises(SimulationError, match="one run"):
        plant.reset()


# ------------------------------------------------------------------------------------------------ hands
OPEN, FLAT = (MIDDLE + [*[0.0] * 10, moment, 0.0] for moment in (-3.0, -1.0))
"""Cables that hang less, so that hands do not meet."""

PLATE = GripperPiece(points=[[x, y, z] for x in (-0.17, -0.13) for y in (0.02, 0.03) for z in (-0.05, 0.12)])
"""Beside the cable, 13 to 17 cm from its end."""


def test_a_hand_that_rolls_into_the_cable_meets_it_and_pushes_it_aside():
    still = {}
    for name, body, turn in (("into", (PLATE,), 0.1), ("away", (PLATE,), -0.1), ("without", None, 0.1)):
        held = replace(task(OPEN), grippers=SpatialGrippers(body=body))
        plant = SpatialPlant(held)
        action = np.zeros((2, 6))
        action[0, 3:] = turn * rotations.rotate(held.gripper_poses("start")[0, 3:], np.array([1.0, 0, 0]))
        led(plant, action, 6)
        still[name] = plant.measure()
    assert abs(still["into"].clearance) < 0.001
    assert still["away"].clearance > 0.1
    assert still["without"].clearance > 0.1
    aside = np.linalg.norm(still["into"].keypoints - still["without"].keypoints, axis=1)
    assert aside.max() > 0.005


def test_the_clearance_of_hands_is_measured_exactly():
    box = Cuboid(center=(1.25, 1.0, 1.35), size=(0.2, 0.2, 0.1))
    held = replace(task(FLAT, CABLE, box), grippers=SpatialGrippers(body="2f-85"))
    plant = SpatialPlant(held, config=SpatialConfig(servo_time=0.0))
    led(plant, np.zeros((2, 6)), 1)
    kept = held.kept("start")["gripper_clearance"]
    assert 0 < kept < 0.15
    assert plant.measure().gripper_clearance == pytest.approx(kept, abs=1e-4)
