"""A task file in units of its own means the same task, and a number in the wrong unit is told which one it is in."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scene_task_files import VALID, Change, at, complaint, row, write

from cableway.scene.cable import Cable
from cableway.scene.files.loading import load_task
from cableway.scene.files.presets import preset_values
from cableway.scene.files.saving import save_task
from cableway.scene.grippers import Grippers
from cableway.scene.task import Task

ARCH = [[0.2, 0.55, 0.7], [0.45, 0.55, -0.7]]
"""Gripper poses between which the cable bends to the left."""

FULL: dict[str, Any] = VALID | {
    "cable": {
        "length": 0.3, "radius": 0.004, "bending_stiffness": 2e-3, "stiffness_profile": [1.0, 2.0],
        "rest_curvature": [0.0, 1.5], "yield_curvature": 30.0, "damping_time": 0.2, "linear_density": 0.05,
        "friction": 0.1, "drag": 0.5, "min_bend_radius": 0.01,
    },
    "grippers": {
        "radius": 0.004, "max_step": 0.012, "max_turn": 0.1, "separation": 0.05, "max_acceleration": 0.4,
        "max_turn_acceleration": 4.0, "max_jerk": 5.0, "max_turn_jerk": 40.0,
    },
    "start": {"grippers": [[0.2, 0.1, 0.1], [0.5, 0.1, -0.1]], "keypoints": row(0.2, 0.1)},
    "goal": {"grippers": ARCH, "bend": "left"},
}  # fmt: skip
"""A file with every key, its plug left out so that the goal need not be before a port."""
del FULL["plug"], FULL["port"]


def rescaled(content: dict[str, Any], per_metre: float, per_radian: float) -> dict[str, Any]:
    """The same file with lengths and angles in other units, key by key and apart from the schema."""
    new = copy.deepcopy(content)

    def times(section: dict[str, Any], factor: float, *names: str) -> None:
        for name in names:
            if name in section:
                section[name] = (np.array(section[name], float) * factor).tolist()

    times(new["workspace"], per_metre, "size")
    times(new["cable"], per_metre, "length", "radius", "min_bend_radius")
    times(new["cable"], 1 / per_metre, "rest_curvature", "yield_curvature")
    times(new["grippers"], per_metre, "radius", "max_step", "separation", "max_acceleration", "max_jerk")
    times(new["grippers"], per_radian, "max_turn", "max_turn_acceleration", "max_turn_jerk")
    for obstacle in new["obstacles"]:
        times(obstacle, per_metre, "center", "size", "radius", "vertices")
        times(obstacle, per_radian, "angle")
    for end in ("start", "goal"):
        shape = new[end]
        if isinstance(shape, dict):
            times(shape, per_metre, "keypoints")
            factors = np.array([per_metre, per_metre, per_radian])
            shape["grippers"] = (np.array(shape["grippers"]) * factors).tolist()
        else:
            times(new, per_metre, end)
    if "port" in new:
        times(new["plug"], per_metre, "length", "width")
        times(new["port"], per_metre, "position", "standoff", "depth")
        times(new["port"], per_radian, "angle")
    return new


def flat(value: Any) -> list[Any]:
    """All numbers and texts of a task, in one order."""
    if isinstance(value, np.ndarray):
        return value.ravel().tolist()
    if isinstance(value, (tuple, list)):
        return [leaf for entry in value for leaf in flat(entry)]
    return flat(list(vars(value).values())) if hasattr(value, "__dict__") else [value]


def load(folder: Path, content: dict[str, Any]) -> Task:
    path = folder / "task.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return load_task(path)


@pytest.mark.parametrize(("units", "per_metre"), [("m", 1.0), ("cm", 100.0), ("mm", 1000.0)])
@pytest.mark.parametrize(("angles", "per_radian"), [("rad", 1.0), ("deg", 180 / math.pi)])
@pytest.mark.parametrize("content", [FULL, VALID], ids=["every key", "plug and port"])
def test_units_change_the_file_but_not_the_task(
    tmp_path: Path, content: dict[str, Any], units: str, per_metre: float, angles: str, per_radian: float
):
    """Lengths, speeds, accelerations, jerks, curvatures and angles scale; stiffness, density, drag and time do not."""
    written = rescaled(content, per_metre, per_radian) | {"units": units, "angles": angles}
    expected, found = load(tmp_path, content), load(tmp_path, written)
    for part in ("scene", "cable", "grippers", "start", "goal", "plug", "port", "start_poses", "goal_poses"):
        one, other = flat(getattr(expected, part)), flat(getattr(found, part))
        for a, b in zip(one, other, strict=True):
            assert a == b or a == pytest.approx(b, rel=1e-9, abs=1e-9), part


def test_a_round_number_of_millimetres_is_the_same_number_of_metres_as_written(tmp_path: Path):
    """Conversion rounds once, so that 301 mm is 0.301 m and not its neighbour."""
    for number in (301, 29, 57, 1999):
        length = {"units": "mm", "cable": {"length": 300, "min_bend_radius": number}}
        content = rescaled(VALID, 1000.0, 1.0) | length
        assert load(tmp_path, content).cable.min_bend_radius == float(f"{number}e-3")


def test_saved_tasks_are_in_metres_and_radians(tmp_path: Path):
    task = load(tmp_path, rescaled(FULL, 1000.0, 180 / math.pi) | {"units": "mm", "angles": "deg"})
    save_task(task, tmp_path / "saved.yaml")
    assert "units" not in (tmp_path / "saved.yaml").read_text()
    assert load_task(tmp_path / "saved.yaml") == task


def test_a_preset_keeps_its_size_in_a_file_in_millimetres(tmp_path: Path):
    content = {"cableway": 1, "units": "mm", "workspace": {"size": [700, 700]}, "cable": {"preset": "usb"}}
    values = preset_values("usb")
    span = 800 * values["length"]
    ends = [[[50, y, 0.8], [50 + span, y, -0.8]] for y in (150, 400)]
    content["start"], content["goal"] = ({"grippers": poses, "bend": "left"} for poses in ends)
    assert load(tmp_path, content).cable == Cable(**values, preset="usb")


def test_speeds_stand_for_steps_of_a_tenth_of_a_second(tmp_path: Path):
    at_speed = load_task(write(tmp_path, at("grippers", {"max_speed": 0.2, "max_turn_speed": 1.5})))
    assert at_speed.grippers == Grippers(max_step=0.1 * 0.2, max_turn=0.1 * 1.5)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (at("units", "furlong"), "units must be m, cm or mm, got 'furlong'"),
        (at("angles", "gon"), "angles must be rad or deg, got 'gon'"),
        (at("grippers", "max_speed", 0.1), "grippers.max_speed and grippers.max_step say the same twice: "
         "give one of them"),
        (at("grippers", "max_turn_speed", 1), "grippers.max_turn_speed and grippers.max_turn say the same twice: "
         "give one of them"),
        (at("grippers", {"max_speed": 200}), "grippers.max_speed must be from 0.0001 to 10 m/s, got 200.0: if "
         "that is in millimetres or centimetres, say `units: mm` or `units: cm`"),
        # lengths
        (at("workspace", "size", [700, 700]), "workspace.size[0] must be from 0.01 to 50 m, got 700.0: if that is in "
         "millimetres or centimetres, say `units: mm` or `units: cm`"),
        (at("cable", "length", 600), "cable.length must be from 0.01 to 10 m, got 600.0: if that is in millimetres or "
         "centimetres, say `units: mm` or `units: cm`"),
        (at("cable", "length", 3000), "cable.length must be from 0.01 to 10 m, got 3000.0: if that is in millimetres, "
         "say `units: mm`"),
        (at("cable", {"length": 600}), "cable.length must be from 0.01 to 10 m, got 600.0: if that is in millimetres "
         "or centimetres, say `units: mm` or `units: cm`"),
        (at("cable", "radius", 4), "cable.radius must be from 5e-05 to 0.1 m, got 4.0: if that is in millimetres or "
         "centimetres, say `units: mm` or `units: cm`"),
        (at("cable", "radius", 1e-7), "cable.radius must be from 5e-05 to 0.1 m, got 1e-07"),
        (at("obstacles", 0, "center", [350, 300]), "obstacles[0].center[0] must be from -50 to 50 m, got 350.0: if "
         "that is in millimetres or centimetres, say `units: mm` or `units: cm`"),
        (at("obstacles", 1, "vertices", 0, [100, 300]), "obstacles[1].vertices[0][0] must be from -50 to 50 m, got "
         "100.0: if that is in millimetres or centimetres, say `units: mm` or `units: cm`"),
        (at("start", 3, [275, 100]), "start[3][0] must be from -50 to 50 m, got 275.0: if that is in millimetres or "
         "centimetres, say `units: mm` or `units: cm`"),
        (at("grippers", "max_step", 20), "grippers.max_step must be from 1e-05 to 1 m, got 20.0: if that is in "
         "millimetres or centimetres, say `units: mm` or `units: cm`"),
        (at("plug", "length", 1e6), "plug.length must be from 0.0001 to 1 m, got 1000000.0"),
        (at("port", "depth", 1e6), "port.depth must be from 0 to 1 m, got 1000000.0"),
        # angles
        (at("obstacles", 0, "angle", 45), "obstacles[0].angle must be from -12.6 to 12.6 rad, got 45.0: if that is in "
         "degrees, say `angles: deg`"),
        (at("goal", {"grippers": [[0.2, 0.55, 40], [0.45, 0.55, -40]], "bend": "left"}), "goal.grippers[0][2] must be "
         "from -12.6 to 12.6 rad, got 40.0: if that is in degrees, say `angles: deg`"),
        (at("port", "angle", -90), "port.angle must be from -12.6 to 12.6 rad, got -90.0: if that is in degrees, say "
         "`angles: deg`"),
        (at("grippers", "max_turn", 7.6), "grippers.max_turn must be from 0.0001 to 3.14159 rad, got 7.6: if that is "
         "in degrees, say `angles: deg`"),
        # what no cable is made of
        (at("cable", "linear_density", 1e-12), "cable.linear_density must be from 1e-05 to 100 kg/m, got 1e-12"),
        (at("cable", "bending_stiffness", 1e6), "cable.bending_stiffness must be from 1e-08 to 1000 N m^2, got "
         "1000000.0"),
        (at("cable", "damping_time", 1e-9), "cable.damping_time must be from 0.001 to 100 s, got 1e-09"),
        (at("cable", "friction", 400), "cable.friction must be from 0 to 10, got 400.0"),
        (at("cable", "stiffness_profile", [1, 1e9]), "cable.stiffness_profile[1] must be from 0.001 to 1000, got "
         "1000000000.0"),
    ],
)  # fmt: skip
def test_a_number_that_no_task_means_is_told_the_bounds_and_the_likely_unit(tmp_path: Path, change: Change, said: str):
    name, _, rest = complaint(write(tmp_path, change)).partition(": ")
    assert name.removeprefix("task.yaml:").isdigit()
    assert rest == said


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (at("workspace", "size", [0.7, 700]), "workspace.size[0] must be from 10 to 50000 mm, got 0.7: if that is in "
         "metres, say `units: m`"),
        (at("obstacles", 2, "radius", -40), "obstacles[2].radius must be positive, got -40.0"),
        (at("grippers", {"max_speed": 20000}), "grippers.max_speed must be from 0.1 to 10000 mm/s, got 20000.0"),
        (at("port", "angle", 1000), "port.angle must be from -721.927 to 721.927 deg, got 1000.0"),
        (at("cable", "yield_curvature", 200), "cable.yield_curvature must be from 0 to 100 1/mm, got 200.0"),
    ],
)  # fmt: skip
def test_a_number_of_a_file_is_quoted_as_it_stands_there(tmp_path: Path, change: Change, said: str):
    """With its bounds in the file's own units."""
    content = rescaled(VALID, 1000.0, 180 / math.pi) | {"units": "mm", "angles": "deg"}
    change(content)
    (tmp_path / "task.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    assert complaint(tmp_path / "task.yaml").partition(": ")[2] == said


@pytest.mark.parametrize(("units", "per_metre"), [("m", 1.0), ("cm", 100.0), ("mm", 1000.0)])
def test_what_is_said_of_a_task_does_not_depend_on_the_units_of_its_file(tmp_path: Path, units: str, per_metre: float):
    """Places and distances are in millimetres, so that they are the same for a file and the one that a run writes."""
    content = copy.deepcopy(VALID)
    at("goal", row(0.34, 0.392))(content)
    (tmp_path / "task.yaml").write_text(yaml.safe_dump(rescaled(content, per_metre, 1.0) | {"units": units}))
    said = "goal overlaps obstacles[2] (disc at (550, 350) mm) by 2.0 mm"
    assert complaint(tmp_path / "task.yaml").partition(": ")[2] == said
