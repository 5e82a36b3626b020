"""The table plant: what it must agree on with physics, and what it shares with no other plant."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from cableway.core.errors import InputError, SimulationError
from cableway.rod.inverse import equilibria_at
from cableway.rod.planar import PlanarRod
from cableway.scene.files.loading import load_task
from cableway.scene.obstacles import Disc
from cableway.simulation.perturbations.grasp import GraspConfig
from cableway.simulation.perturbations.reading import read_perturbation
from cableway.simulation.table_plant import TableConfig, TablePlant

TASK = load_task("single-obstacle-2")
OPEN = replace(TASK, scene=replace(TASK.scene, obstacles=()))
SMOOTH = TableConfig(friction=0.0, servo_time=0.0)
STILL = np.zeros((2, 3))


def moved(plant: TablePlant, action: np.ndarray, steps: int) -> None:
    for _ in range(steps):
        plant.step(action)


def test_without_friction_it_lies_like_an_elastic_rod() -> None:
    """The elastica of 120 hinges between the same grippers; finer segments come nearer."""
    rod = PlanarRod(TASK.cable.length, 121)
    found = equilibria_at(rod, TASK.cable.rod.shapes(TASK.start_equilibrium[None])[1][0])
    shapes = rod.at_keypoints(rod.shapes(found)[0])[:, ::10]
    fine = min(shapes, key=lambda shape: np.linalg.norm(shape - TASK.start))
    off = []
    for segments in (20, TableConfig().segments):
        plant = TablePlant(OPEN, config=replace(SMOOTH, segments=segments))
        moved(plant, STILL, 10)
        off.append(np.linalg.norm(plant.measure().keypoints - fine, axis=1).mean())
    assert off[1] < 0.001
    assert off[1] < off[0]


def test_it_lies_on_the_table_and_weighs_on_it() -> None:
    plant = TablePlant(OPEN)
    heights = plant._data.xpos[1 : plant.config.segments + 1, 2]
    assert np.abs(heights - TASK.cable.radius).max() < 2e-4
    normal = sum(_force(plant, index)[0] for index in range(plant._data.ncon))
    weight = 9.81 * TASK.cable.linear_density * TASK.cable.length
    assert 0.5 * weight < normal < 1.05 * weight  # the grippers carry the rest


def _force(plant: TablePlant, index: int) -> np.ndarray:
    force = np.zeros(6)
    mujoco.mj_contactForce(plant.model, plant._data, index, force)  # pyright: ignore[reportAttributeAccessIssue]
    return force


def test_sliding_friction_is_that_of_an_elliptic_cone() -> None:
    """Led over the table, most segments rub with a force on the cone of 0.4 along the cable and 0.8 across it."""
    plant = TablePlant(OPEN, config=TableConfig(friction=0.4, across=2.0))
    moved(plant, np.array([[0.004, 0.004, 0.0]] * 2), 10)
    forces = np.array([_force(plant, index)[:3] for index in range(plant._data.ncon)]).reshape(-1, 3)
    forces = forces[forces[:, 0] > 1e-4]
    used = np.hypot(forces[:, 1] / 0.4, forces[:, 2] / 0.8) / forces[:, 0]
    assert (used < 1.01).all()
    assert np.median(used) > 0.95
    assert np.abs(forces[:, 2] / forces[:, 0]).max() > 0.5  # more than along


def test_servos_follow_late_by_their_time_constant() -> None:
    plant = TablePlant(OPEN, config=TableConfig(servo_time=0.08))
    action = np.array([[0.0, 0.004, 0.0]] * 2)
    before = plant.reset().poses
    for step in range(1, 11):
        observed = plant.step(action)
        behind = before + step * action - observed.poses
    np.testing.assert_allclose(behind[:, 1], 0.08 * 0.04, rtol=0.05)


def test_a_grasp_askew_displaces_the_ends_and_not_the_grippers() -> None:
    grasp = GraspConfig(left=(0.003, 0.002, 0.1))
    plant = TablePlant(OPEN, grasp=grasp)
    observed, truth = plant.reset(), plant.measure()
    poses = OPEN.cable.rod.shapes(OPEN.start_equilibrium[None])[1][0]
    np.testing.assert_allclose(observed.poses, poses, atol=1e-9)
    apart = np.linalg.norm(observed.keypoints[0] - observed.poses[0, :2])
    assert apart == pytest.approx(np.hypot(0.003, 0.002), abs=2e-4)
    np.testing.assert_allclose(truth.keypoints[[0, -1]], truth.poses[:, :2], atol=3e-4)


def test_a_cable_led_into_an_obstacle_touches_it_and_hardly_enters() -> None:
    middle = OPEN.start[6]
    away = middle - OPEN.start[[0, -1]].mean(axis=0)
    away /= np.linalg.norm(away)
    disc = Disc(center=tuple((middle + 0.04 * away).tolist()), radius=0.02)
    plant = TablePlant(replace(OPEN, scene=replace(OPEN.scene, obstacles=(disc,))))
    least = np.inf
    for _ in range(10):
        plant.step(np.array([[*0.004 * away, 0.0]] * 2))
        least = min(least, plant.measure().clearance)
    assert -0.001 < least <= 0


@pytest.mark.parametrize("height", [0.001, 0.012, 0.2])
def test_obstacles_are_as_high_as_stated_and_the_lowest_stops_the_cable(height: float) -> None:
    """Led on for 40 mm over where the disc stands, the cable is held up by one lower than its middle, too."""
    middle = OPEN.start[6]
    away = middle - OPEN.start[[0, -1]].mean(axis=0)
    away /= np.linalg.norm(away)
    disc = Disc(center=tuple((middle + 0.04 * away).tolist()), radius=0.02, height=height)
    plant = TablePlant(replace(OPEN, scene=replace(OPEN.scene, obstacles=(disc,))))
    geom, stands = plant.model.geom("obstacle 0"), max(height, 2 * OPEN.cable.radius)
    np.testing.assert_allclose([geom.pos[2], geom.size[1]], [stands / 2, stands / 2])
    least = np.inf
    for _ in range(10):
        plant.step(np.array([[*0.004 * away, 0.0]] * 2))
        least = min(least, plant.measure().clearance)
    assert -0.001 < least <= 0
    assert np.abs(plant._data.xpos[1 : plant.config.segments + 1, 2] - OPEN.cable.radius).max() < 0.002


def test_a_gripper_led_into_a_wall_stands_before_it() -> None:
    """It is a contact; what it was led too far must be taken back first."""
    plant, ahead = TablePlant(OPEN, config=replace(SMOOTH, servo_time=0.05)), np.tile([0.0, -0.012, 0.0], (2, 1))
    side, radius = int(plant.reset().poses[:, 1].argmin()), OPEN.grippers.radius
    least = plant.reset().poses[side, 1]
    moved(plant, ahead, round((least - radius) / 0.012) + 3)
    assert plant.measure().gripper_clearance <= 0
    assert 0 < plant._observe().poses[side, 1] - radius < 0.001
    moved(plant, -ahead, 5)
    assert plant.measure().gripper_clearance > 0


def test_the_same_run_is_the_same_and_a_branch_goes_on_bit_for_bit() -> None:
    plant, action = TablePlant(TASK), np.array([[0.002, 0.001, 0.01]] * 2)
    moved(plant, action, 3)
    state = plant.state()
    moved(plant, action, 3)
    first = plant.measure().keypoints
    plant.restore(state)
    moved(plant, action, 3)
    np.testing.assert_array_equal(plant.measure().keypoints, first)
    plant.reset()
    moved(plant, action, 6)
    np.testing.assert_array_equal(plant.measure().keypoints, first)


def test_what_it_cannot_do_is_an_error_and_leaves_it_as_it_was() -> None:
    plant = TablePlant(OPEN)
    before = plant.measure().keypoints
    for action in (np.full((2, 3), 0.2), np.full((2, 3), np.nan), np.zeros(3)):
        with pytest.raises(SimulationError):
            plant.step(action)
    np.testing.assert_array_equal(plant.measure().keypoints, before)
    span = float(np.linalg.norm(np.subtract(*TASK.start[[0, -1]])))
    with pytest.raises(InputError, match="farther than the cable is long"):
        TablePlant(OPEN, replace(TASK.cable, length=0.9 * span))


def test_it_is_chosen_in_a_plant_file(tmp_path: Path) -> None:
    path = tmp_path / "table.yaml"
    path.write_text("cableway: 1\ncable: {length: 0.31}\ntable: {friction: 0.5, across: 2.0}\n")
    plant = read_perturbation(path, TASK).build(TASK).plant
    assert isinstance(plant, TablePlant)
    assert (plant.config.friction, plant.config.across, plant.cable.length) == (0.5, 2.0, 0.31)
    path.write_text("cableway: 1\ntable: {friction: -1}\n")
    with pytest.raises(InputError, match="friction must be from 0 to 3, got -1"):
        read_perturbation(path, TASK)
