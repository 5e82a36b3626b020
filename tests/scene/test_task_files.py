"""Task files: what a valid one means, and the message for each kind of mistake."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scene_task_files import VALID, at, complaint, row, write

from cableway.core.errors import FileFormatError, InputError, TaskError, UnknownNameError
from cableway.geometry import polyline, se2
from cableway.geometry.groups import SE2
from cableway.rod.planar import PlanarRod
from cableway.scene.cable import Cable
from cableway.scene.files.loading import (
    cable_from_preset,
    catalogue_file,
    load_task,
    task_names,
)
from cableway.scene.files.presets import preset_names
from cableway.scene.obstacles import Box, Disc, Polygon
from cableway.scene.task import Task

PRESETS = ("cotton", "ethernet", "hdmi", "paracord", "rubber", "silicone", "usb")
CATALOGUE = (
    "insertion",
    "maze-1",
    "maze-2",
    "multi-obstacle-1",
    "multi-obstacle-2",
    "multi-obstacle-3",
    "real-maze",
    "real-multi",
    "real-single",
    "single-obstacle-1",
    "single-obstacle-2",
)
ARCH = [[0.2, 0.1, 0.9], [0.4, 0.1, -0.9]]


# ------------------------------------------------------------------------------------------------ valid files
def test_every_key_reaches_the_task(tmp_path: Path):
    task = load_task(write(tmp_path))
    assert (task.name, task.description) == ("spoilt", "Up past three obstacles.")
    assert task.scene.size == (0.7, 0.7)
    assert task.cable == Cable(length=0.3, radius=0.004, keypoints=13)
    assert task.grippers.separation == 0.05
    assert task.scene.obstacles == (
        Box(center=(0.35, 0.35), size=(0.1, 0.06), angle=0.2),
        Polygon(vertices=np.array([[0.1, 0.3], [0.2, 0.3], [0.15, 0.4]])),
        Disc(center=(0.55, 0.35), radius=0.04),
    )
    np.testing.assert_array_equal(task.start, VALID["start"])
    np.testing.assert_array_equal(task.goal, VALID["goal"])
    assert task.plug is not None
    assert task.port is not None
    assert (task.plug.width, task.port.depth) == (0.012, 0.01)
    assert task.start_poses is None


def test_only_version_start_and_goal_must_be_there(tmp_path: Path):
    path = tmp_path / "my first (try).yaml"
    path.write_text(f"cableway: 1\nstart: {row(0.2, 0.1)}\ngoal: {row(0.2, 0.6)}\n")
    task = load_task(path)
    assert task.name == "my first -try-"
    assert task.cable == Cable()
    assert task.scene.obstacles == ()


def test_scalars_are_those_of_yaml_1_2(tmp_path: Path):
    """A number without a dot before its exponent, leading zeros, and words that YAML 1.1 takes for truth values."""
    text = write(tmp_path).read_text()
    text = text.replace("name: spoilt", "name: on").replace("length: 0.3,", "length: 3e-1, keypoints: 013,")
    text = text.replace(", keypoints: 13}", ", friction: +.5}")
    (tmp_path / "task.yaml").write_text(text)
    task = load_task(tmp_path / "task.yaml")
    assert (task.name, task.cable.length, task.cable.keypoints, task.cable.friction) == ("on", 0.3, 13, 0.5)


@pytest.mark.parametrize("name", CATALOGUE)
def test_the_catalogue_loads_under_its_names(name: str):
    task = load_task(name)
    assert task.name == name
    assert task.cable.keypoints == 13
    assert len(task.scene.obstacles) > 0
    assert load_task(catalogue_file(name)) == task


def test_the_catalogue_lists_its_names_and_keeps_its_sources():
    assert task_names() == CATALOGUE
    folder = catalogue_file("maze-1").parent
    assert "BSD-2-Clause" in (folder / "NOTICE").read_text()
    assert all(path.read_text().startswith("#") for path in folder.glob("*.y*ml"))


def test_a_preset_gives_the_cable_and_values_win(tmp_path: Path):
    assert preset_names() == PRESETS
    usb = cable_from_preset("usb")
    assert usb == Cable(
        length=0.34,
        radius=0.004,
        bending_stiffness=5e-3,
        damping_time=0.14,
        linear_density=0.091824,
        friction=0.35,
        preset="usb",
    )
    task = load_task(write(tmp_path, at("cable", {"preset": "usb", "length": 0.3, "friction": 0.1})))
    assert task.cable == cable_from_preset("usb", length=0.3, friction=0.1)
    assert load_task("real-multi").cable == usb
    assert all(cable_from_preset(name).preset == name for name in PRESETS)


@pytest.mark.parametrize("bend", ["left", "right"])
def test_gripper_poses_with_a_side_are_solved_by_the_rod(tmp_path: Path, bend: str):
    poses = np.array(ARCH) + np.array([0, 0.05, 0])
    task = load_task(write(tmp_path, at("start", {"grippers": poses.tolist(), "bend": bend})))
    assert task.start_poses is not None
    np.testing.assert_array_equal(task.start_poses, poses)
    q, distance = task.start_equilibrium, task.equilibrium_distances[0]
    assert distance < 1e-6
    np.testing.assert_allclose(SE2.distance(PlanarRod(0.3).shapes(q[None])[1][0], poses), 0, atol=1e-5)
    assert (polyline.signed_area(task.start) > 0) == (bend == "left")
    assert task.goal_poses is None


def test_gripper_poses_in_the_mirror_give_the_mirrored_shape(tmp_path: Path):
    spoilt = at("obstacles", [])
    shapes = []
    for sign, bend in ((1, "left"), (-1, "right")):
        poses = [[x, 0.35 + sign * (y - 0.1), sign * theta] for x, y, theta in ARCH]

        def change(content: dict[str, Any], poses: Any = poses, bend: str = bend) -> None:
            spoilt(content)
            content["start"] = {"grippers": poses, "bend": bend}

        shapes.append(load_task(write(tmp_path, change)).start)
    np.testing.assert_allclose(shapes[1] - [0, 0.35], (shapes[0] - [0, 0.35]) * [1, -1], atol=1e-9)


def test_few_keypoints_of_a_strongly_bent_rod_are_a_shape(tmp_path: Path):
    """A spline through five of them is not as long as the rod; the rod itself is what they are measured by."""
    rod = PlanarRod(0.3, 5)
    q = np.array([[0.35, 0.2, 0.0, 22.0, 16.0, 1.0]])
    keypoints = rod.at_keypoints(rod.shapes(q)[0])[0]
    assert abs(polyline.length(polyline.spline(keypoints, 6)) / 0.3 - 1) > 0.02

    def change(content: dict[str, Any]) -> None:
        content["cable"]["keypoints"] = 5
        content["obstacles"] = []
        content["start"], content["goal"] = keypoints.tolist(), row(0.2, 0.6)[::3]

    np.testing.assert_array_equal(load_task(write(tmp_path, change)).start, keypoints)


def test_names_and_paths_are_told_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path).rename(tmp_path / "maze-1")
    assert load_task("maze-1").name == "maze-1"
    assert load_task("./maze-1").name == "spoilt"
    assert load_task(Path("maze-1")).name == "spoilt"


# ------------------------------------------------------------------------------------------------ the file itself
def test_a_missing_file(tmp_path: Path):
    assert complaint(tmp_path / "none.yaml") == "none.yaml: no such file"


def test_a_folder(tmp_path: Path):
    (tmp_path / "task.yaml").mkdir()
    assert complaint(tmp_path / "task.yaml") == "task.yaml: is a folder, not a file"


def test_a_name_that_no_file_can_have():
    with pytest.raises(FileFormatError, match=r"no such file|cannot be read"):
        load_task("a\0b.yaml")
    with pytest.raises(FileFormatError, match=r"no such file|cannot be read"):
        load_task("a" * 5000 + ".yaml")


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is unreadable for root")
def test_an_unreadable_file(tmp_path: Path):
    write(tmp_path).chmod(0)
    assert "cannot be read: Permission denied" in complaint(tmp_path / "task.yaml")


def test_a_file_that_is_too_large(tmp_path: Path):
    (tmp_path / "task.yaml").write_bytes(b"#" * 500_001)
    assert complaint(tmp_path / "task.yaml") == "task.yaml: not a regular file of at most 0.5 MB"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "task.yaml: the file is empty, but must be a mapping of keys to values"),
        (b"# nothing yet\n", "task.yaml: the file is empty, but must be a mapping of keys to values"),
        (b"a task", "task.yaml: must be a mapping of keys to values, not a str"),
        (b"- 1\n- 2\n", "task.yaml: must be a mapping of keys to values, not a list"),
        (b"cableway: 1\nstart: [1, 2\n", "task.yaml:3: not valid YAML: expected ',' or ']', but got '<stream end>'"),
        (
            b"cableway: 1\n\tstart: 2\n",
            "task.yaml:2: not valid YAML: found character '\\t' that cannot start any token",
        ),
        (b"name: a\ncableway: 1\nname: b\n", "task.yaml:3: not valid YAML: the key 'name' appears here and in line 1"),
        (b"name: a\n---\nname: b\n", "task.yaml:2: not valid YAML: but found another document"),
        (b"? [1, 2]\n: 3\n", "task.yaml:1: not valid YAML: found unhashable key"),
        (b"name: !!timestamp x\n", "task.yaml: not valid YAML: a value does not match its tag"),
        (b"[" * 500, "task.yaml: not valid YAML: nested too deeply"),
        (b"PK\x03\x04", "task.yaml: not valid YAML: it is not text in UTF-8, or has control characters"),
        (b"name: caf\xe9\n", "task.yaml: not valid YAML: it is not text in UTF-8, or has control characters"),
    ],
)
def test_a_file_that_is_no_yaml_mapping(tmp_path: Path, content: bytes, said: str):
    path = tmp_path / "task.yaml"
    path.write_bytes(content)
    assert complaint(path) == said


def test_a_binary_file(tmp_path: Path):
    path = tmp_path / "task.yaml"
    path.write_bytes(bytes(range(256)))
    assert complaint(path).startswith("task.yaml: not valid YAML: ")


def test_a_tag_constructs_nothing(tmp_path: Path):
    path = tmp_path / "task.yaml"
    path.write_text(f"cableway: !!python/object/apply:pathlib.Path.touch [{tmp_path / 'touched'}]\n")
    assert "could not determine a constructor for the tag" in complaint(path)
    assert not (tmp_path / "touched").exists()


def test_values_that_stand_for_many_others_are_not_written_out(tmp_path: Path):
    lines = ["a: &a [x, x, x, x, x, x, x, x]"]
    lines += [f"{b}: &{b} [{', '.join(['*' + a] * 8)}]" for a, b in zip("abcdefgh", "bcdefghi", strict=True)]
    path = tmp_path / "task.yaml"
    path.write_text("\n".join([*lines, "start: *i", "cableway: 1", "goal: []"]))
    assert complaint(path).startswith("task.yaml:1: a is not a known key")
    path.write_text("\n".join(["obstacles: &r [*r]", "cableway: 1", f"start: {row(0.2, 0.1)}", "goal: []"]))
    assert complaint(path) == "task.yaml: not valid YAML: nested deeper than 60 levels"


# ------------------------------------------------------------------------------------------------ keys and types
TASK_KEYS = (
    "cableway, units, angles, name, description, workspace, cable, grippers, obstacles, start, goal, plug, port, cell"
)
CABLE_KEYS = (
    "length, radius, keypoints, bending_stiffness, stiffness_profile, rest_curvature, yield_curvature, "
    "damping_time, linear_density, friction, drag, min_bend_radius, preset"
)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        # unknown keys, one in each section
        (at("strat", 1), f"task.yaml:52: strat is not a known key; did you mean 'start'? known here: {TASK_KEYS}"),
        (at(7, 1), f"task.yaml:52: 7 is not a known key; known here: {TASK_KEYS}"),
        (at("cable", "lenght", 1), "task.yaml:6: cable.lenght is not a known key; did you mean 'length'? known here: "
         + CABLE_KEYS),
        (at("workspace", "shape", 1), "task.yaml:5: workspace.shape is not a known key; known here: size, "
         "wall_height"),
        (at("grippers", "speed", 1), "task.yaml:8: grippers.speed is not a known key; did you mean 'max_speed'? "
         "known here: radius, max_step, max_turn, separation, body, tilt, max_acceleration, max_turn_acceleration, "
         "max_jerk, max_turn_jerk, max_speed, max_turn_speed"),
        (at("obstacles", 0, "radius", 1), "task.yaml:14: obstacles[0].radius is not a known key; "
         "known here: type, center, size, angle, height"),
        (at("obstacles", 1, "vertexes", 1), "task.yaml:20: obstacles[1].vertexes is not a known key; "
         "did you mean 'vertices'? known here: type, vertices, height"),
        (at("obstacles", 2, "size", 1), "task.yaml:19: obstacles[2].size is not a known key; "
         "known here: type, center, radius, height"),
        (at("goal", {"grippers": ARCH, "side": "left"}), "task.yaml:37: goal.side is not a known key; "
         "known here: grippers, bend, keypoints"),
        (at("plug", "lenght", 1), "task.yaml:50: plug.lenght is not a known key; did you mean 'length'? "
         "known here: length, width"),
        (at("port", "pose", 1), "task.yaml:55: port.pose is not a known key; "
         "known here: position, angle, standoff, depth"),
    ],
)  # fmt: skip
def test_an_unknown_key_is_told_the_known_ones(tmp_path: Path, change: Any, said: str):
    """Line numbers are checked apart, where they can be read off."""
    assert without_line(complaint(write(tmp_path, change))) == without_line(said)


def without_line(text: str) -> str:
    name, _, rest = text.partition(": ")
    assert name.split(":")[1].isdigit()
    return rest


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (at("cableway", ...), "cableway is missing; it must be the format version, 1"),
        (at("start", ...), "start is missing; it must be a list of keypoints [x, y], or a mapping of "
         "grippers and bend"),
        (at("obstacles", 0, "size", ...), "obstacles[0].size is missing; it must be [width, height]"),
        (at("obstacles", 1, "vertices", ...), "obstacles[1].vertices is missing; it must be a list of at least 3 "
         "points [x, y]"),
        (at("obstacles", 2, "radius", ...), "obstacles[2].radius is missing; it must be a length"),
        (at("obstacles", 2, "type", ...), "obstacles[2].type must be one of box, polygon, disc; it is missing"),
        (at("goal", {"bend": "left"}), "goal.grippers is missing; it must be two poses [x, y, theta], left then right"),
        (at("goal", {"grippers": ARCH}), "goal must have either bend or keypoints in addition to grippers"),
        (at("plug", "width", ...), "plug.width is missing; it must be a length"),
        (at("port", "angle", ...), "port.angle is missing; it must be an angle"),
        (at("plug", ...), "port needs a plug"),
    ],
)  # fmt: skip
def test_a_missing_key_is_told_what_it_must_be(tmp_path: Path, change: Any, said: str):
    assert without_line(complaint(write(tmp_path, change))) == said


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (at("cableway", 2), "cableway is 2, but this release reads format version 1"),
        (at("cableway", "1"), "cableway must be the format version, 1, got '1'"),
        (at("cableway", True), "cableway must be the format version, 1, got True"),
        (at("name", 5), "name must be a short text, got 5"),
        (at("name", "../up"), "name must be letters, digits, spaces or any of . _ + -, got '../up'"),
        (at("description", ["a"]), "description must be a text, got ['a']"),
        (at("workspace", [0.7, 0.7]), "workspace must be a mapping, got [0.7, 0.7]"),
        (at("workspace", "size", 0.7), "workspace.size must be [width, height], got 0.7"),
        (at("cable", "length", "0.3 m"), "cable.length must be a length, got '0.3 m'"),
        (at("cable", "length", None), "cable.length must be a length, got nothing"),
        (at("cable", "length", True), "cable.length must be a length, got True"),
        (at("cable", "keypoints", 13.5), "cable.keypoints must be a whole number, got 13.5"),
        (at("cable", "preset", 3), "cable.preset must be the name of a preset, got 3"),
        (at("cable", "stiffness_profile", 2.0), "cable.stiffness_profile must be a list of factors, got 2.0"),
        (at("cable", "stiffness_profile", []), "cable.stiffness_profile must be a list of factors, got 0 values"),
        (at("cable", "rest_curvature", [1, "x"]), "cable.rest_curvature[1] must be a number, got 'x'"),
        (at("cable", "rest_curvature", [float("nan")]), "cable.rest_curvature[0] must be a finite number, got nan"),
        (at("cable", "drag", "much"), "cable.drag must be a number in N s/m^2, got 'much'"),
        (at("obstacles", {}), "obstacles must be a list of obstacles, got {}"),
        (at("obstacles", 1, 7), "obstacles[1] must be a mapping with the key type and those of that type, got 7"),
        (at("obstacles", 0, "type", "cone"), "obstacles[0].type must be one of box, polygon, disc; got 'cone'"),
        (at("obstacles", 0, "type", [1]), "obstacles[0].type must be one of box, polygon, disc; got [1]"),
        (at("obstacles", 0, "size", [0.1]), "obstacles[0].size must be [width, height], got 1 values"),
        (at("obstacles", 0, "size", 1, "a"), "obstacles[0].size[1] must be a length, got 'a'"),
        (at("obstacles", 1, "vertices", 2, 0.1), "obstacles[1].vertices[2] must be two numbers [x, y], got 0.1"),
        (at("start", 5), "start must be a list of keypoints [x, y], or a mapping of grippers and bend, "
         "got 5"),
        (at("start", 3, [0.1, 0.1, 0.0]), "start[3] must be two numbers [x, y], got 3 values"),
        (at("start", 3, 1, "low"), "start[3][1] must be a number, got 'low'"),
        (at("goal", {"grippers": ARCH, "bend": "up"}), "goal.bend must be left or right, got 'up'"),
        (at("goal", {"grippers": ARCH[:1], "bend": "left"}), "goal.grippers must be two poses [x, y, theta], left then "
         "right, got 1 values"),
        (at("goal", {"grippers": [ARCH[0], [0, 1]], "bend": "left"}), "goal.grippers[1] must be three numbers "
         "[x, y, theta], got 2 values"),
        (at("goal", {"grippers": [ARCH[0], [0, 1, "up"]], "bend": "left"}), "goal.grippers[1][2] must be a number, "
         "got 'up'"),
        (at("port", "position", 1, None), "port.position[1] must be a number, got nothing"),
    ],
)  # fmt: skip
def test_a_value_of_the_wrong_type_is_told_what_it_must_be(tmp_path: Path, change: Any, said: str):
    assert without_line(complaint(write(tmp_path, change))) == said


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
@pytest.mark.parametrize(
    ("path", "name"),
    [
        (("cable", "length"), "cable.length"),
        (("grippers", "max_turn"), "grippers.max_turn"),
        (("workspace", "size", 0), "workspace.size[0]"),
        (("obstacles", 0, "angle"), "obstacles[0].angle"),
        (("obstacles", 1, "vertices", 1, 0), "obstacles[1].vertices[1][0]"),
        (("start", 4, 1), "start[4][1]"),
        (("port", "depth"), "port.depth"),
    ],
)
def test_a_number_that_is_not_finite(tmp_path: Path, path: tuple[Any, ...], name: str, value: float):
    assert without_line(complaint(write(tmp_path, at(*path, value)))) == f"{name} must be a finite number, got {value}"


def test_the_first_fault_in_the_file_is_told_but_unknown_keys_before_all(tmp_path: Path):
    def change(content: dict[str, Any]) -> None:
        content["start"][2] = 0.0
        content["cable"]["radius"] = "thick"

    assert "cable.radius must be" in complaint(write(tmp_path, change))

    def worse(content: dict[str, Any]) -> None:
        change(content)
        content["colour"] = "red"

    assert "colour is not a known key" in complaint(write(tmp_path, worse))


def test_lines_are_those_of_the_value(tmp_path: Path):
    path = tmp_path / "task.yaml"
    lines = ["# a comment", "cableway: 1", "cable:", "  length: 0.3", "  radius: thick", "obstacles:"]
    lines += [
        "- type: box",
        "  center: [0.3, 0.3]",
        "  size:",
        "  - 0.1",
        "  - x",
        f"start: {row(0.2, 0.1)}",
        "goal: 3",
    ]
    for line, said in ((5, "cable.radius"), (11, "obstacles[0].size[1]"), (13, "goal")):
        path.write_text("\n".join(lines) + "\n")
        assert complaint(path).startswith(f"task.yaml:{line}: {said} must be")
        lines[line - 1] = {5: "  radius: 0.004", 11: "  - 0.1", 13: f"goal: {row(0.2, 0.6)}"}[line]
    path.write_text("\n".join(lines) + "\n")
    assert load_task(path).name == "task"


# ------------------------------------------------------------------------------------------------ meaning
def bent(angle: float, count: int = 13) -> list[list[float]]:
    """An arc of 0.3 m that turns by `angle` in all, from (0.2, 0.1)."""
    arc = np.linspace(0, 0.3, 2001)
    directions = se2.direction(arc * angle / 0.3)
    points = np.cumsum(directions * 0.3 / 2000, axis=0)
    return (np.array([0.2, 0.1]) + points[:: 2000 // (count - 1)][:count]).tolist()


UNEVEN = [[x + (0.02 if i == 6 else 0.0), y] for i, (x, y) in enumerate(row(0.2, 0.1))]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (at("start", row(0.2, 0.1, 12)), "start has 12 keypoints, not the 13 of cable.keypoints"),
        (at("cable", "keypoints", 25), "start has 13 keypoints, not the 25 of cable.keypoints"),
        (at("goal", []), "goal has 0 keypoints, not the 13 of cable.keypoints"),
        (at("cable", "keypoints", 2), "cable.keypoints must be from 3 to 200, got 2"),
        (at("cable", "length", 0.31), "start is 300 mm long, more than 2% off cable.length 310 mm"),
        (at("cable", "length", 0.29), "start is 300 mm long, more than 2% off cable.length 290 mm"),
        (at("start", UNEVEN), "start is not at equal arc length: keypoints 5 and 6 are 45.0 mm apart along the cable, "
         "not 25 mm"),
        (at("cable", "length", -0.3), "cable.length must be positive, got -0.3"),
        (at("cable", "length", 1e300), "cable.length must be from 0.01 to 10 m, got 1e+300"),
        (at("cable", "radius", 0.1), "cable.radius is 100 mm, too thick for a length of 300 mm: at most a quarter of "
         "it"),
        (at("cable", "friction", -0.1), "cable.friction must be not negative, got -0.1"),
        (at("cable", "drag", -1), "cable.drag must be not negative, got -1.0"),
        (at("cable", "yield_curvature", -1), "cable.yield_curvature must be not negative, got -1.0"),
        (at("cable", "stiffness_profile", [1, 0]), "cable.stiffness_profile[1] must be positive, got 0.0"),
        (at("cable", "stiffness_profile", [1] * 201), "cable.stiffness_profile must be a list of 1 to 200 numbers, "
         "got 201"),
        (at("cable", "rest_curvature", [0, -60]), "cable.rest_curvature[1] must be at most 2 full turns, "
         "41.89 1/m, either way, got -60.0 1/m"),
        (at("cable", "preset", "uzb"), f"cable.preset must be one of {', '.join(PRESETS)}, got 'uzb'"),
        (at("grippers", "max_step", 0), "grippers.max_step must be positive, got 0.0"),
        (at("grippers", "max_acceleration", 0), "grippers.max_acceleration must be positive, got 0.0"),
        (at("grippers", "max_turn_jerk", -1), "grippers.max_turn_jerk must be positive, got -1.0"),
        (at("grippers", "separation", 0.4), "start has its grippers 300 mm apart, less than grippers.separation "
         "400 mm"),
        (at("workspace", "size", [0.7, 0]), "workspace.size[1] must be positive, got 0.0"),
        (at("plug", "length", 0), "plug.length must be positive, got 0.0"),
        (at("port", "depth", -1), "port.depth must be not negative, got -1.0"),
        # obstacles
        (at("obstacles", 0, "size", [0.1, -0.1]), "obstacles[0].size[1] must be positive, got -0.1"),
        (at("obstacles", 0, "size", [0.1, 1e-8]), "obstacles[0].size is degenerate: it gives an area of 0.001 mm², "
         "below 0.01 mm²"),
        (at("obstacles", 2, "radius", 0), "obstacles[2].radius must be positive, got 0.0"),
        (at("obstacles", 2, "radius", 1e-6), "obstacles[2].radius is degenerate: it gives an area of 3.142e-06 mm², "
         "below 0.01 mm²"),
        (at("obstacles", 1, "vertices", [[0.1, 0.3], [0.2, 0.3]]), "obstacles[1].vertices must be at least 3 points, "
         "got 2"),
        (at("obstacles", 1, "vertices", [[0.1, 0.3], [0.2, 0.3], [0.3, 0.3]]), "obstacles[1].vertices is degenerate: "
         "it gives an area of 0 mm², below 0.01 mm²"),
        (at("obstacles", 1, "vertices", [[0.1, 0.3], [0.2, 0.3], [0.2, 0.3], [0.1, 0.4]]), "obstacles[1].vertices "
         "repeats the point 1 as point 2"),
        (at("obstacles", 1, "vertices", [[0.1, 0.3], [0.2, 0.3], [0.13, 0.33], [0.1, 0.4]]), "obstacles[1].vertices "
         "is not convex at point 2; split it into convex parts"),
        (at("obstacles", 1, "vertices", [[0.1, 0.4], [0.13, 0.33], [0.2, 0.3], [0.1, 0.3]]), "obstacles[1].vertices "
         "is not convex at point 1; split it into convex parts"),
        (at("obstacles", 1, "vertices", [[0.15, 0.4], [0.12, 0.3], [0.2, 0.36], [0.1, 0.36], [0.18, 0.3]]),
         "obstacles[1].vertices is not convex, its edges cross; split it into convex parts"),
        (at("obstacles", 0, "center", [0.35, 0.7]), "obstacles[0] (box at (350, 700) mm) reaches outside the "
         "workspace of 700 x 700 mm, by 39.3 mm"),
        (at("obstacles", 2, "center", [0.55, 0.68]), "obstacles[2] (disc at (550, 680) mm) reaches outside the "
         "workspace of 700 x 700 mm, by 20.0 mm"),
        (at("obstacles", 2, "center", [-0.1, 0.3]), "obstacles[2] (disc at (-100, 300) mm) lies wholly outside the "
         "workspace of 700 x 700 mm, by 140 mm"),
        # shapes in the scene
        (at("start", row(0.45, 0.1)), "start[11] at (725, 100) mm lies outside the workspace of 700 x 700 mm"),
        (at("start", row(0.2, 0.002)), "start overlaps the bottom wall by 2.0 mm"),
        (at("goal", row(0.2, 0.3)), "goal overlaps obstacles[1] (polygon at (150, 333.3) mm) by 4.0 mm"),
        (at("goal", row(0.34, 0.392)), "goal overlaps obstacles[2] (disc at (550, 350) mm) by 2.0 mm"),
        (at("grippers", "radius", 0.2), "start has its left gripper in the bottom wall by 100 mm"),
        (at("goal", {"grippers": [[0.4, 0.65, 1.4], [0.6, 0.65, -1.4]], "bend": "left"}),
         "goal keypoint 3 at (432.8, 716.1) mm lies outside the workspace of 700 x 700 mm"),
        # gripper poses
        (at("goal", {"grippers": [[0.1, 0.1, 0], [0.5, 0.1, 0]], "bend": "left"}),
         "goal.grippers are 400 mm apart, farther than the cable is long (300 mm)"),
        (at("goal", {"grippers": [[0.2, 0.6, 0], [0.5, 0.6, 0]], "bend": "left"}),
         "goal.bend asks for a bend to the left, but no stable shape of the cable (300 mm) between these grippers "
         "(300 mm apart) lies on that side: try the other side, other poses, or keypoints"),
        (at("goal", {"grippers": [[0.2, 0.6, 0], [0.5, 0.6, 0.5]], "keypoints": row(0.2, 0.6)}),
         "goal.grippers do not fit the keypoints: the right pose is less than 0.1 mm and 28.6 degrees off that end of "
         "the cable"),
        (at("goal", {"grippers": [[0.2, 0.62, 0], [0.5, 0.6, 0]], "keypoints": row(0.2, 0.6)}),
         "goal.grippers do not fit the keypoints: the left pose is 20.0 mm and 0.00 degrees off that end of the cable"),
        (at("goal", {"grippers": ARCH, "keypoints": [[0.8, 0.1], *row(0.2, 0.6)[1:]]}),
         "goal.keypoints[0] at (800, 100) mm lies outside the workspace of 700 x 700 mm"),
    ],
)  # fmt: skip
def test_a_task_that_contradicts_itself(tmp_path: Path, change: Any, said: str):
    assert without_line(complaint(write(tmp_path, change))) == said


@pytest.mark.parametrize(("height", "depth"), [(0.383, "1.00"), (0.362, "22.0"), (0.3179, "1.9")])
def test_an_overlap_is_as_deep_as_the_cable_must_move(tmp_path: Path, height: float, depth: str):
    def change(content: dict[str, Any]) -> None:
        content["obstacles"] = [{"type": "box", "center": [0.35, 0.35], "size": [0.2, 0.06]}]
        content["goal"] = row(0.3, height)

    said = f"goal overlaps obstacles[0] (box at (350, 350) mm) by {depth} mm"
    assert without_line(complaint(write(tmp_path, change))) == said


def test_a_shape_that_crosses_itself(tmp_path: Path):
    message = complaint(write(tmp_path, at("start", bent(6.6))))
    assert without_line(message) == "start crosses itself"


def test_a_shape_bent_more_sharply_than_the_cable_may(tmp_path: Path):
    """An arc that turns by 3 rad over 0.3 m has a radius of 0.1 m."""

    def change(content: dict[str, Any], allowed: float) -> None:
        content["start"] = bent(3.0)
        content["obstacles"] = []
        content["cable"]["min_bend_radius"] = allowed

    message = complaint(write(tmp_path, lambda content: change(content, 0.11)))
    assert without_line(message).startswith("start bends to a radius of 100 mm")
    assert message.endswith("below cable.min_bend_radius 110 mm")
    assert load_task(write(tmp_path, lambda content: change(content, 0.1))).cable.min_bend_radius == 0.1


def test_shapes_and_obstacles_may_touch_the_walls(tmp_path: Path):
    def change(content: dict[str, Any]) -> None:
        del content["plug"], content["port"]
        content["start"] = row(0.004, 0.004)
        content["obstacles"][0] = {"type": "box", "center": [0.55, 0.6666664], "size": [0.3, 1 / 15]}
        content["goal"] = row(0.1, 0.5)

    assert load_task(write(tmp_path, change)).start[0, 0] == 0.004


def test_an_unknown_task_is_told_the_names():
    with pytest.raises(UnknownNameError, match="unknown task 'maze'; known: insertion, maze-1, "):
        load_task("maze")
    with pytest.raises(UnknownNameError, match="unknown task ''"):
        load_task("")
    with pytest.raises(UnknownNameError, match=r"unknown task '\.\./x'"):
        catalogue_file("../x")


def test_a_file_that_is_named_without_its_ending_is_pointed_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A task of the catalogue comes first."""
    write(tmp_path, at("name", "mine")).rename(tmp_path / "mine.yml")
    (tmp_path / "maze-1.yaml").write_text("no task")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"named 'mine'; for the file that is here, write mine\.yml$"):
        load_task("mine")
    assert load_task("maze-1").name == "maze-1"


def test_an_unknown_preset_is_told_the_names():
    with pytest.raises(UnknownNameError, match="unknown preset 'uzb'; known: cotton, ethernet, hdmi, "):
        cable_from_preset("uzb")


def test_overrides_of_a_preset_are_checked():
    with pytest.raises(TaskError, match=r"cable\.length must be positive"):
        cable_from_preset("usb", length=0)


def test_every_complaint_is_an_input_error():
    assert issubclass(TaskError, InputError)
    assert issubclass(FileFormatError, InputError)
    assert issubclass(UnknownNameError, InputError)


def test_a_task_made_in_python_is_checked_like_one_from_a_file(tmp_path: Path):
    task = load_task(write(tmp_path))
    with pytest.raises(TaskError, match=r"^goal is 300 mm long, more than 2% off cable\.length 500 mm$"):
        Task(
            name="x",
            scene=task.scene,
            cable=Cable(length=0.5, keypoints=13),
            start=np.column_stack([np.linspace(0.1, 0.6, 13), np.full(13, 0.1)]),
            goal=task.goal,
        )
