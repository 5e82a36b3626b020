"""Laws of `--plant FILE`: what the file says happens to the plant and stands in the report; the task is not touched."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import problems
import pytest
from commands import Command

from cableway.core.errors import FileFormatError, InputError
from cableway.records import Rollout
from cableway.scene.cable import Cable
from cableway.scene.files.loading import load_task
from cableway.scene.files.presets import preset_values
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.perturbations.reading import perturbation_text, read_perturbation
from cableway.simulation.perturbations.sensing import SensingConfig
from cableway.simulation.perturbations.variants import named_perturbation
from cableway.simulation.plant import PlantConfig

LAB = """
cableway: 1
cable: {length: 0.308, friction: 0.2, stiffness_profile: [0.8, 1.25]}
sensing: {keypoint_noise: 0.002, drop_rate: 0.2, measurement_delay: 0.1}
"""
LONGER = 0.308
"""[m]; by more than the 2% that a recorded cable may be off."""


@pytest.mark.parametrize("name", ["very-hard", "rough-grasp", "obstacles-moved", "all-faults", "fault-moves"])
def test_a_plant_is_written_as_it_is_read(name: str, tmp_path: Path):
    task = load_task("multi-obstacle-1")
    wanted, path = named_perturbation(name, task), tmp_path / "plant.yaml"
    path.write_text(perturbation_text(wanted))
    assert replace(read_perturbation(path, task), notes=()) == wanted


@pytest.fixture
def write(tmp_path: Path):
    def make(text: str) -> Path:
        path = tmp_path / "lab.yaml"
        path.write_text(text)
        return path

    return make


def test_a_run_on_another_plant_says_so(cableway: Command, moved_file: Path, write):
    """And `check` judges the rollout as the run did, with the length that the cable really has."""
    options = ["--controller", "open-loop", "--no-video", "--time-limit", 300, "--seed", 4, "--plant", write(LAB)]
    done = cableway("run", moved_file, *options, "--out", "there")
    report = json.loads(Path("there/report.json").read_text())
    plant = report["configuration"]["rollout"]["plant"]
    assert report["seed"] == report["configuration"]["rollout"]["seed"] == 4
    assert (plant["cable"]["length"], plant["cable"]["friction"]) == (LONGER, 0.2)
    assert plant["cable"]["stiffness_profile"] == [0.8, 1.25]
    assert plant["sensing"]["keypoint_noise"] == 0.002
    assert plant["sensing"]["occlusion_rate"] == 0.0, "what the file leaves out stands there, too"
    assert any("lab.yaml" in note for note in report["notes"])
    assert load_task("there/task.yaml").cable == load_task(moved_file).cable
    rollout = Rollout.load("there/rollout.npz")
    lost = np.isnan(rollout.observed).all(axis=(1, 2))
    assert 0 < lost.sum() < len(lost)
    assert np.nanmax(np.abs(rollout.observed - rollout.keypoints)) > 0.002
    judged = cableway("check", moved_file, "there/rollout.npz", "--json")
    assert json.loads(judged.out)["checks"] == report["rollout_verdict"]["checks"]
    assert {row["name"]: row["passed"] for row in report["rollout_verdict"]["checks"]}["length error"]
    assert done.status == (0 if report["success"] else 1)


def test_without_a_file_the_plant_is_the_tasks():
    task = problems.moved()
    perturbation = Perturbation()
    assert (perturbation.true_cable(task), perturbation.simulation) == (task.cable, PlantConfig())
    assert perturbation.sensing == SensingConfig()
    assert perturbation.notes == ()
    assert perturbation.true_task(task) is perturbation.known_task(task) is task


def test_what_a_file_leaves_out_stays_as_it_is(write):
    task = problems.task_between(problems.LOW_ARC, problems.MOVED_ARC, radius=0.005, damping_time=0.2)
    perturbation = read_perturbation(write("cableway: 1\ncable: {drag: 2}\nsensing: {frame_rate: 30}"), task)
    assert perturbation.cable == Cable(radius=0.005, damping_time=0.2, drag=2.0)
    assert (perturbation.simulation, perturbation.sensing) == (PlantConfig(), SensingConfig(frame_rate=30.0))


def test_of_a_preset_all_but_the_length_is_taken(write):
    task = problems.moved()
    cable = read_perturbation(write("cableway: 1\ncable: {preset: usb, damping_time: 0.3}"), task).cable
    expected = {**preset_values("usb"), "length": task.cable.length, "damping_time": 0.3}
    assert cable == Cable(preset="usb", **expected)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{}", "cableway must be 1, the format version"),
        ("cableway: 1\nnoise: 1", "unknown section 'noise'; known: cableway, cable, grasp, simulation, sensing"),
        ("cableway: 1\ncable: usb", "cable must be a mapping of keys to values, got 'usb'"),
        ("cableway: 1\ncable: {preset: rope}", r"cable\.preset must be one of .*usb, got 'rope'"),
        ("cableway: 1\ncable: {colour: 1}", "cable.colour is not a known key; known here: length, radius, "),
        ("cableway: 1\ncable: {friction: -1}", r"lab\.yaml: cable\.friction must be not negative, got -1"),
        ("cableway: 1\nsensing: {drop_rate: 2}", "sensing.drop_rate must be from 0 to 1, got 2"),
        ("cableway: 1\nsensing: {drop_rate: often}", "sensing.drop_rate must be a number, got 'often'"),
        ("cableway: 1\nsimulation: {time_step: 0.003}", "must divide the control step"),
        ("cableway: 1\nsimulation: {control_step: 0.05}", "control_step must be 0.1 s, the step of the controllers"),
        ("cableway: 1\npegs: [[330, 330, 15]]", r"center\[0\] must be from -50 to 50 m, got 330.0$"),
        ("cableway: 1\npegs: [[0.35, 0.14, 0.02]]", r"pegs as here, start overlaps obstacles\[0\] \(disc at "),
        ("cableway: 1\narms: stiff", "lab.yaml:2: arms must be one of simulated, exact, got 'stiff'"),
        ("[1", "not valid YAML"),
    ],
)
def test_a_file_that_is_wrong_is_told_so(write, text: str, message: str):
    with pytest.raises(InputError, match=message) as error:
        read_perturbation(write(text), problems.moved())
    assert "lab.yaml" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_that_is_missing_is_told_before_planning(cableway: Command, moved_file: Path):
    done = cableway("run", moved_file, "--plant", "nowhere.yaml")
    assert done.status == 2
    assert "nowhere.yaml: no such file" in done.err
    assert not Path("runs").exists()
    with pytest.raises(FileFormatError):
        read_perturbation(Path("nowhere.yaml"), problems.moved())


def test_a_file_can_displace_start_and_obstacles(write):
    """The controller knows the obstacles where they are, and the start as the task has it."""
    task = load_task("single-obstacle-2")
    count = len(task.scene.obstacles)
    text = f"cableway: 1\nstart: [[0.003, 0, 0.02], [0, 0.003, 0]]\nobstacles: {[[0.0, -0.005]] * count}"
    perturbation = read_perturbation(write(text), task)
    known, true = perturbation.known_task(task), perturbation.true_task(task)
    for before, after in zip(task.scene.obstacles, known.scene.obstacles, strict=True):
        np.testing.assert_allclose(after.vertices, before.vertices + [0.0, -0.005], atol=1e-12)
    assert true.scene == known.scene
    np.testing.assert_array_equal(known.start, task.start)
    np.testing.assert_allclose(true.start[[0, -1]] - task.start[[0, -1]], [[0.003, 0], [0, 0.003]], atol=1e-4)
    plant = perturbation.build(task)
    assert plant.task == known
    np.testing.assert_allclose(plant.reset().keypoints, true.start, atol=1e-4)
    assert perturbation.as_dict(task)["start"] == [[0.003, 0, 0.02], [0, 0.003, 0]]
    with pytest.raises(InputError, match=f"one displacement for each of the task's {count} obstacles"):
        read_perturbation(write(f"cableway: 1\nobstacles: {[[0.0, 0.0]] * (count + 1)}"), task)
