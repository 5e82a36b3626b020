"""Tasks in space: what a valid file means, and the message for each kind of mistake."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import cableway as cw
from cableway.core.errors import InputError, TaskError
from cableway.figures.space import SpaceView, spatial_task_figure
from cableway.geometry import rotations
from cableway.scene.files.loading import load_task
from cableway.scene.files.saving import save_task
from cableway.scene.obstacles import Disc
from cableway.scene.spatial.grippers import GripperPiece, SpatialGrippers
from cableway.scene.spatial.obstacles import ConvexMesh, Cuboid, Cylinder, Prism, Sphere
from cableway.scene.spatial.scene import SpatialScene
from cableway.scene.spatial.task import SpatialDraft, SpatialTask
from cableway.scene.spatial.validity import body_clearance

HANGING = [0.3, 0.4, 0.4, 0.0, 0.0, 0.0, -25.0, 0.0, 0.0, 0.0, -5.0, 0.0]
"""A U of a cable of 0.34 m with weight 7 in the plane across y."""

VALID: dict[str, Any] = {
    "cableway": 1,
    "name": "lifted",
    "workspace": {"size": [1.0, 0.8, 0.7]},
    "cable": {"preset": "usb", "length": 0.34},
    "grippers": {"radius": 0.02, "max_speed": 0.15},
    "obstacles": [
        {"type": "box", "center": [0.5, 0.4, 0.1], "size": [0.06, 0.8, 0.2]},
        {"type": "cylinder", "center": [0.7, 0.1, 0.3], "radius": 0.03, "height": 0.2, "axis": [0, 1, 0]},
        {"type": "sphere", "center": [0.3, 0.7, 0.5], "radius": 0.05},
        {"type": "mesh", "points": [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]], "position": [0.8, 0.6, 0]},
        {"type": "prism", "section": {"type": "disc", "center": [0.1, 0.1], "radius": 0.02, "height": 0.15}},
    ],
    "start": {"equilibrium": HANGING},
    "goal": {"equilibrium": [0.75, *HANGING[1:]]},
}


def write(folder: Path, change: Any = None) -> Path:
    content = copy.deepcopy(VALID)
    if change is not None:
        change(content)
    path = folder / "task.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


def complaint(folder: Path, change: Any) -> str:
    with pytest.raises(InputError) as raised:
        load_task(write(folder, change))
    return str(raised.value)


@pytest.fixture(scope="module")
def task(tmp_path_factory: pytest.TempPathFactory) -> SpatialTask:
    found = load_task(write(tmp_path_factory.mktemp("space")))
    assert isinstance(found, SpatialTask)
    return found


# ------------------------------------------------------------------------------------------------ valid files
def test_every_key_reaches_the_task(task: SpatialTask):
    assert task.name == "lifted"
    assert task.cable.weight == pytest.approx(7.1, abs=0.05)
    assert task.grippers == SpatialGrippers(radius=0.02, max_step=0.015)
    box, cylinder, sphere, mesh, prism = task.scene.obstacles
    assert box == Cuboid(center=(0.5, 0.4, 0.1), size=(0.06, 0.8, 0.2))
    assert cylinder == Cylinder(center=(0.7, 0.1, 0.3), radius=0.03, height=0.2, axis=(0.0, 1.0, 0.0))
    assert sphere == Sphere(center=(0.3, 0.7, 0.5), radius=0.05)
    assert isinstance(mesh, ConvexMesh)
    np.testing.assert_allclose(mesh.points.min(axis=0), [0.8, 0.6, 0.0])
    assert prism == Prism(section=Disc(center=(0.1, 0.1), radius=0.02, height=0.15))
    np.testing.assert_array_equal(task.start, HANGING)
    assert task.keypoints("start").shape == (13, 3)


def test_a_saved_task_is_read_back_to_the_last_digit(task: SpatialTask, tmp_path: Path):
    odd = SpatialGrippers(body=(GripperPiece(points=np.array([[0.03, 0, 0.05]]), radius=0.01),))
    turned = Cuboid(center=(0.5, 0.4, 0.1), size=(0.06, 0.3, 0.2), orientation=(0.9, 0.1, 0.3, 0.3))
    scene = SpatialScene(task.scene.size, (turned, *task.scene.obstacles[1:]))
    start = task.start + np.linspace(0, 1e-9, 12)
    for name, each in {
        "same": task,
        "odd": SpatialTask(
            name="odd", scene=scene, cable=task.cable, grippers=odd, start=start, goal=task.goal, description="x: y"
        ),
    }.items():
        save_task(each, tmp_path / f"{name}.yaml")
        assert load_task(tmp_path / f"{name}.yaml") == each


def test_grippers_or_keypoints_with_orientations_mean_the_same_shape(task: SpatialTask, tmp_path: Path):
    """Both are found from the poses and the points of the shape that the twelve numbers give."""
    poses, keypoints = task.gripper_poses("start"), task.keypoints("start")
    for section in (
        {"grippers": poses.tolist()},
        {"grippers": poses.tolist(), "equilibrium": (task.start + 1e-3).tolist()},
        {"keypoints": keypoints.tolist(), "orientations": poses[:, 3:].tolist()},
    ):
        found = load_task(write(tmp_path, lambda content, stated=section: content.update(start=stated)))
        assert isinstance(found, SpatialTask)
        np.testing.assert_allclose(found.keypoints("start"), keypoints, atol=1e-6)


def test_lengths_may_be_in_millimetres(task: SpatialTask, tmp_path: Path):
    def change(content: dict[str, Any]) -> None:
        content.update(units="mm", workspace={"size": [1000, 800, 700]}, obstacles=[], grippers={"radius": 20})
        content["cable"] = {"preset": "usb", "length": 340}
        for end in ("start", "goal"):
            q = content[end]["equilibrium"]
            content[end]["equilibrium"] = [1000 * x for x in q[:3]] + q[3:]

    found = load_task(write(tmp_path, change))
    assert isinstance(found, SpatialTask)
    np.testing.assert_allclose(found.start, task.start)
    assert found.scene.size == task.scene.size


@pytest.mark.parametrize("binary", [True, False])
def test_a_mesh_is_read_from_an_stl_file(tmp_path: Path, binary: bool):
    corners = np.array([[0, 0, 0], [0, 100, 0], [100, 0, 0], [0, 0, 100], [30, 30, 10]], np.float32)  # the last inside
    triangles = corners[[[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2], [4, 0, 1]]]
    if binary:
        rows = b"".join(b"\0" * 12 + triangle.tobytes() + b"\0\0" for triangle in triangles)
        (tmp_path / "part.stl").write_bytes(b"solid".ljust(80) + len(triangles).to_bytes(4, "little") + rows)
    else:
        lines = [f"  vertex {x:g} {y:g} {z:g}" for x, y, z in triangles.reshape(-1, 3)]
        (tmp_path / "part.stl").write_text("solid part\n" + "\n".join(lines) + "\nendsolid\n")
    turned = rotations.from_vector(np.array([0.0, 0.0, np.pi])).tolist()
    mesh = {"type": "mesh", "file": "part.stl", "scale": 1e-3, "position": [0.9, 0.7, 0], "orientation": turned}
    found = load_task(write(tmp_path, lambda content: content.update(obstacles=[mesh])))
    points = found.scene.obstacles[0].points
    assert len(points) == 4
    np.testing.assert_allclose(points.min(axis=0), [0.8, 0.6, 0.0], atol=1e-9)


# ------------------------------------------------------------------------------------------------ mistakes
BAR = [[x, y, z] for x in (-0.2, 0.0) for y in (0.12, 0.14) for z in (-0.01, 0.01)]
"""Corners of a bar beside the cable, to beyond its middle."""

MISTAKES = {
    "unknown key": (lambda c: c.update(plug={}), "plug is not a known key"),
    "no workspace of its own": (lambda c: c.update(workspace={"size": [1, 1, 100.0]}), "size[2] must be from 0.01 to"),
    "unknown obstacle": (lambda c: c["obstacles"].insert(0, {"type": "cube"}), "obstacles[0].type must be one of box,"),
    "a box of the plane": (
        lambda c: c["obstacles"].insert(0, {"type": "box", "center": [0.1, 0.1], "size": [0.1, 0.1, 0.1]}),
        "obstacles[0].center must be [x, y, z], got 2 values",
    ),
    "long axis": (lambda c: c["obstacles"][1].update(axis=[0, 1, 1]), "obstacles[1].axis must have length 1"),
    "flat mesh": (
        lambda c: c["obstacles"][3].update(points=[[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]),
        "obstacles[3].points must not all lie in one plane",
    ),
    "mesh of nothing": (lambda c: c["obstacles"][3].pop("points"), "obstacles[3] must have either points or a file"),
    "missing file": (
        lambda c: c["obstacles"].append({"type": "mesh", "file": "no.stl"}),
        "no.stl: no such file",
    ),
    "outside": (lambda c: c["obstacles"][2].update(center=[0.3, 0.7, 2]), "obstacles[2] (sphere at (300, 700, 2000)"),
    "preset": (lambda c: c["cable"].update(preset="rope"), "cable.preset must be one of cotton,"),
    "grippers' body": (lambda c: c["grippers"].update(body="claw"), "grippers.body must be one of disc,"),
    "no roll": (
        lambda c: c.update(start={"keypoints": [[0, 0, 0]] * 13}),
        "start needs orientations beside keypoints",
    ),
    "too few numbers": (lambda c: c["start"]["equilibrium"].pop(), "start.equilibrium must be twelve numbers"),
    "nothing": (lambda c: c.update(goal={}), "goal must have equilibrium, or grippers"),
    "quaternion": (
        lambda c: c.update(goal={"grippers": [[0.6, 0.4, 0.4, 1, 1, 0, 0], [0.8, 0.4, 0.4, 1, 0, 0, 0]]}),
        "goal.grippers must have length 1",
    ),
    "too far apart": (
        lambda c: c.update(goal={"grippers": [[0.1, 0.4, 0.4, 1, 0, 0, 0], [0.8, 0.4, 0.4, 1, 0, 0, 0]]}),
        "goal.grippers are 700 mm apart, farther than the cable is long (340 mm)",
    ),
    "not that shape": (
        lambda c: c["goal"].update(grippers=[[0.6, 0.6, 0.4, 1, 0, 0, 0], [0.8, 0.6, 0.4, 1, 0, 0, 0]]),
        "goal.equilibrium is not near a shape between the grippers",
    ),
    "cable in a box": (
        lambda c: c["goal"]["equilibrium"].__setitem__(slice(0, 3), [0.5, 0.4, 0.15]),
        "goal overlaps obstacles[0] (box at (500, 400, 100) mm) by",
    ),
    "gripper in a ball": (
        lambda c: c["obstacles"][2].update(center=[0.3 + 0.14, 0.42, 0.45]),
        "start has its right gripper in obstacles[2] (sphere at (440, 420, 450) mm, radius 50 mm) by",
    ),
    "hand in a box": (
        lambda c: c.update(grippers={"radius": 0.02, "body": "2f-85"}) or c["obstacles"].insert(
            0, {"type": "box", "center": [0.4, 0.42, 0.64], "size": [0.1, 0.1, 0.1]}
        ),
        "start has its right gripper in obstacles[0] (box at (400, 420, 640) mm) by",
    ),
    "hands in each other": (
        lambda c: c.update(grippers={"radius": 0.02, "body": [{"points": BAR}]}),
        "start has its left gripper in its right gripper by",
    ),
    "through the table": (lambda c: c["goal"]["equilibrium"].__setitem__(2, -0.01), "goes through the table by"),
    "outside the workspace": (lambda c: c["goal"]["equilibrium"].__setitem__(1, 0.9), "lies outside the workspace of"),
    "unstable": (
        lambda c: c["goal"]["equilibrium"].__setitem__(slice(6, 12), [-60.0, 0, 0, 0, 0, 0]),
        "goal is not a stable shape of the cable",
    ),
    "twisted": (lambda c: c["cable"].update(max_twist=0.1) or c["goal"]["equilibrium"].__setitem__(9, 1.0),
                "more than cable.max_twist"),
    "bent": (lambda c: c["cable"].update(min_bend_radius=0.2), "below cable.min_bend_radius 200 mm"),
    "grippers near": (lambda c: c["grippers"].update(separation=0.33), "apart, less than grippers.separation 330 mm"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", list(MISTAKES))
def test_a_mistake_is_named_with_its_line(mistake: str, tmp_path: Path):
    change, wanted = MISTAKES[mistake]
    said = complaint(tmp_path, change)
    assert said.startswith(f"{tmp_path / 'task.yaml'}:")
    assert wanted in said


def test_a_task_that_no_cable_can_do_can_be_drawn(tmp_path: Path):
    with pytest.raises(TaskError) as raised:
        load_task(write(tmp_path, MISTAKES["cable in a box"][0]))
    draft, faults = raised.value.draft, raised.value.faults
    assert isinstance(draft, SpatialDraft)
    assert spatial_task_figure(draft, faults).get_axes()
    view, at = SpaceView(draft), faults[0].at
    assert at is not None
    seen = view.at(np.array(at))
    assert ((seen >= 0) & (seen <= view.size)).all()


@pytest.mark.parametrize("call", [cw.CableSimulator, lambda path: cw.summarize(path, None, None)])
def test_what_cannot_do_space_says_so_in_one_sentence(call: Any, tmp_path: Path):
    with pytest.raises(InputError, match="the task 'lifted' is in space"):
        call(write(tmp_path))


# ------------------------------------------------------------------------------------------------ bodies
def test_a_pole_through_a_hand_is_found(task: SpatialTask):
    """It goes through two faces and meets no corner or edge."""
    (ball, _, *pieces) = SpatialGrippers(body="2f-85", radius=0.008).bodies
    assert ball.radius == 0.008
    palm = max((piece for piece in pieces if piece.side == 0), key=lambda piece: np.ptp(piece.points[:, 1]))
    middle = palm.points.mean(axis=0) + (0.4, 0.4, 0.4)
    pole = Cylinder(center=tuple(middle.tolist()), radius=0.001, height=0.3, axis=(1.0, 0.0, 0.0))
    pose = np.array([0.4, 0.4, 0.4, 1, 0, 0, 0])
    assert body_clearance(palm, pose, SpatialScene((1, 1, 1), (pole,))) < 0
    aside = Cylinder(center=(middle[0], middle[1] + 0.2, middle[2]), radius=0.001, height=0.3, axis=(1.0, 0.0, 0.0))
    wide = np.ptp(palm.points[:, 1]) / 2
    assert body_clearance(palm, pose, SpatialScene((1, 1, 1), (aside,))) == pytest.approx(0.199 - wide, abs=1e-3)


def test_pieces_lie_outward_of_both_ends():
    piece = GripperPiece(points=np.array([[0.03, 0.0, 0.05]]), radius=0.01)
    left, right = SpatialGrippers(body=(piece,)).bodies[2:]
    assert left.points.tolist() == [[-0.03, 0.0, 0.05]]
    assert right.points.tolist() == [[0.03, 0.0, 0.05]]


def test_a_hand_that_stands_on_the_cable_is_named(task: SpatialTask):
    """The cable is bent to an open ring; a ball reaches from the left gripper to its other half."""
    ring = replace(task, start=np.array([0.3, 0.4, 0.4, *[0.0] * 7, -5.0, 0.0]))
    stations, pose = ring.stations("start"), ring.gripper_poses("start")[0]
    there = stations[round(0.85 * (len(stations) - 1))] - pose[:3]
    there = rotations.rotate(rotations.conjugate(pose[3:]), there) * (-1, 1, 1)
    for aside, named in ((0.0, True), (0.03, False)):
        ball = GripperPiece(points=(there + (0, aside, 0))[None], radius=0.005)
        held = replace(ring.unchecked(), grippers=SpatialGrippers(body=(ball,)))
        assert any("left gripper on the cable" in fault.sentence for fault in held.faults()) == named
