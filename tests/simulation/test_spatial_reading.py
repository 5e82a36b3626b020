"""A perturbation of a task in space from a file: what it changes, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from spatial_problems import ball_task

from cableway.core.errors import InputError
from cableway.geometry.groups import SE3
from cableway.scene.spatial.cable import SpatialCable
from cableway.simulation.perturbations.spatial_reading import read_spatial_perturbation, spatial_perturbation_text
from cableway.simulation.spatial_perturbation import SpatialPerturbation
from cableway.simulation.spatial_plant import SpatialConfig

TASK = ball_task()


def read(folder: Path, text: str) -> SpatialPerturbation:
    (folder / "off.yaml").write_text(f"cableway: 1\n{text}\n")
    return read_spatial_perturbation(folder / "off.yaml", TASK)


def test_what_a_file_leaves_out_is_as_in_the_task(tmp_path: Path):
    nothing = read(tmp_path, "")
    assert nothing.cable is None
    assert np.array_equal(nothing.grasps, np.tile(SE3.identity, (2, 1)))
    assert nothing.config == SpatialConfig()


def test_a_file_changes_cable_grasps_and_plant(tmp_path: Path):
    found = read(
        tmp_path,
        "cable: {length: 0.344}\ngrasp: {right: [0.002, 0, 0, 0, 0, 0.06]}\nspatial: {keypoint_noise: 0.001}",
    )
    assert found.cable is not None
    assert (found.cable.length, found.cable.bending_stiffness) == (0.344, TASK.cable.bending_stiffness)
    offsets = SE3.minus(found.grasps, np.tile(SE3.identity, (2, 1)))
    np.testing.assert_allclose(offsets, [6 * [0], [0.002, 0, 0, 0, 0, 0.06]], atol=1e-12)
    assert found.config.keypoint_noise == 0.001


def test_a_preset_keeps_the_tasks_length_and_radius(tmp_path: Path):
    cable = read(tmp_path, "cable: {preset: ethernet}").cable
    assert cable == SpatialCable.of_preset(
        "ethernet", length=TASK.cable.length, keypoints=TASK.cable.keypoints, radius=TASK.cable.radius
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("sensing: {}", "unknown section 'sensing' for a task in space; known: cableway, cable, grasp, spatial, obst"),
        ("cable: {lenght: 1}", "2: cable.lenght is not a known key; did you mean 'length'?"),
        ("cable: {length: -1}", "2: cable.length must be positive, got -1.0"),
        ("cable: {preset: rope}", "cable.preset must be one of cotton, "),
        ("cable: {keypoints: 99}", f"cable.keypoints must be {TASK.cable.keypoints}, as in the task"),
        ("cable: {radius: 0.01}", f"cable.radius must be {TASK.cable.radius}, as in the task"),
        ("grasp: {left: [0, 0, 0]}", "2: grasp.left must be [x, y, z] of at most 0.01 m"),
        ("grasp: {left: [0.008, 0.008, 0, 0, 0, 0]}", "grasp.left must be [x, y, z] of at most 0.01 m"),
        ("obstacles: [[0, 1]]", "2: obstacles[0] must be [x, y, z], got 2 values"),
        ("obstacles: [[0, 0, 0.1], [0, 0, 0]]", "with obstacles as here, obstacles must be one displacement for each"),
        ("obstacles: [[-0.2, 0, 0]]", "with obstacles as here, start overlaps obstacles[0]"),
        ("obstacles: [[9, 0, 0]]", "wholly outside the workspace"),
        ("revealed: -1", "revealed must be finite and not negative, got -1"),
        ("spatial: {links: 3}", "spatial.links must be from 10 to 200, got 3"),
    ],
)
def test_what_is_wrong_is_named_with_its_file(tmp_path: Path, text: str, said: str):
    with pytest.raises(InputError) as caught:
        read(tmp_path, text)
    assert str(caught.value).startswith(str(tmp_path / "off.yaml"))
    assert said in str(caught.value)


def test_obstacles_are_elsewhere_and_known_late(tmp_path: Path):
    found = read(tmp_path, "obstacles: [[0, 0.02, 0.05]]\nrevealed: 2.5")
    assert (found.obstacles, found.revealed) == (((0.0, 0.02, 0.05),), 2.5)
    assert np.allclose(found.true_task(TASK).scene.obstacles[0].solid.centre, (0.4, 0.42, 0.43))
    (tmp_path / "again.yaml").write_text(spatial_perturbation_text(found))
    again = read_spatial_perturbation(tmp_path / "again.yaml", TASK)
    assert (again.obstacles, again.revealed) == (found.obstacles, found.revealed)
    known = found.build(TASK, 0)
    assert known.task == TASK
    for _ in range(25):
        known.step(np.zeros((2, 6)))
    assert known.task == found.true_task(TASK)
