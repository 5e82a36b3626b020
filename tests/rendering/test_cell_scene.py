"""Laws of a cell as triangles: everything is seen where it is, and as high as it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from problems import beside_disc

import cableway as cw
from cableway.core.errors import InputError
from cableway.rendering.camera import Camera
from cableway.rendering.cell import ARMS, DISC, GRIPPERS, CellScene, Label, Look
from cableway.rendering.picture import Light, Picture, render
from cableway.robot.branches import ArmMotion, arm_motion
from cableway.robot.cell_kinematics import CellKinematics
from cableway.scene.cell import Way
from cableway.scene.obstacles import Box, Disc
from cableway.scene.scene import Scene
from cableway.tasks.generation import random_task_with_witness

GREY = (0.5, 0.5, 0.5)
LOOK = Look(GREY, GREY, GREY, GREY, (GREY, GREY), (GREY, GREY), GREY)
EYE = 3.0
"""Height of the camera above the table [m]."""


@pytest.fixture(scope="module")
def held() -> tuple[cw.Task, Way, np.ndarray, np.ndarray]:
    """A task in a cell; how it is held, gripper poses and joints along a motion that solves it."""
    task, witness = random_task_with_witness(5000, "cell")
    poses = task.cable.rod.shapes(witness.q)[1]
    assert task.cell is not None
    motion = arm_motion(poses, task, task.cell)
    assert isinstance(motion, ArmMotion)
    return task, motion.way, poses, motion.joints


def above(task: cw.Task) -> Camera:
    """A camera that looks straight down at the middle of the workspace."""
    x, y = task.scene.size
    place = np.array([x / 2, y / 2, EYE])
    return Camera.looking(place, np.array([0.0, 0.0, -1.0]), size=(900, 900), view=0.5)


def seen(task: cw.Task, scene: CellScene, **grippers: np.ndarray) -> Picture:
    return render(scene.mesh(task.start, **grippers), above(task), Light(position=(0, 0, EYE), shadows=0))


def at(picture: Picture, task: cw.Task, x: float, y: float, z: float) -> tuple[int, float]:
    """The label and the height above the table at a point's place in the picture."""
    (u, v), _ = above(task).project(np.array([x, y, z]))
    row, column = round(float(v)), round(float(u))
    return int(picture.label[row, column]), EYE - float(picture.depth[row, column])


def test_posts_cable_and_grippers_are_where_they_are_and_as_high(held: tuple):
    task, way, poses, _ = held
    cable = task.start
    picture = seen(task, CellScene(task, way, LOOK), poses=poses[0])
    for obstacle in task.scene.obstacles:
        x, y = obstacle.vertices.mean(axis=0)
        assert obstacle.height is not None
        assert at(picture, task, x, y, obstacle.height) == (Label.OBSTACLE, pytest.approx(obstacle.height, abs=1e-9))
    radius = task.cable.radius
    label, height = at(picture, task, *cable[len(cable) // 2], 2 * radius)
    assert label == Label.CABLE
    assert height == pytest.approx(2 * radius, abs=0.1 * radius)
    for side, pose in enumerate(poses[0]):
        top = max(piece.heights[1] for piece in task.grippers.pieces)
        assert at(picture, task, *pose[:2], top) == (GRIPPERS[side], pytest.approx(top, abs=1e-9))
    width, height = task.scene.size
    assert at(picture, task, -0.003, height / 2, 0.0)[0] == Label.WALL
    assert at(picture, task, width + 0.02, 0.02, 0.0) == (Label.TABLE, pytest.approx(0.0, abs=1e-9))


@pytest.mark.parametrize("row", [0, -1])
def test_arms_are_where_their_joints_put_them(held: tuple, row: int):
    """What is seen of an arm lies on its capsules."""
    task, way, _, joints = held
    picture = seen(task, CellScene(task, way, LOOK), joints=joints[row])
    eye, links = above(task), CellKinematics(task, way).links(joints[row][None])
    assert task.cell is not None
    for side, (ends, radii) in enumerate(links):
        rows, columns = np.nonzero(picture.label == ARMS[side])
        depth = picture.depth[rows, columns]
        pixels = np.column_stack([columns, rows])
        points = (pixels - eye.center) / eye.focal * depth[:, None]
        places = np.column_stack([points, depth]) @ eye.pose[:3, :3].T + eye.pose[:3, 3]
        count = len(task.cell.models[way.holders[side]].capsules)
        a, b = ends[0, :count, 0], ends[0, :count, 1]
        share = np.einsum("pki,ki->pk", places[:, None] - a, b - a) / ((b - a) ** 2).sum(axis=1)
        off = places[:, None] - a - np.clip(share, 0, 1)[..., None] * (b - a)
        gap = (np.linalg.norm(off, axis=2) - radii[:count]).min(axis=1)
        assert len(places) > 3000
        assert np.abs(gap).max() < 0.002, "facets"


def test_grippers_are_where_the_arms_carry_them(held: tuple):
    task, way, poses, joints = held
    scene = CellScene(task, way, LOOK)
    for row in (0, -1):
        alone, carried = scene.mesh(task.start, poses=poses[row]), scene.mesh(task.start, joints=joints[row])
        for label in GRIPPERS:
            (a, b) = (mesh.corners[mesh.labels == label] for mesh in (alone, carried))
            assert np.abs(a - b).max() < 1e-9
        assert not np.isin(alone.labels, ARMS).any()
    bare = scene.mesh(task.start)
    assert set(bare.labels) == {Label.TABLE, Label.WALL, Label.OBSTACLE, Label.CABLE}


def test_bounds_hold_everything(held: tuple):
    task, way, _, joints = held
    scene = CellScene(task, way, LOOK)
    points = scene.bounds(joints)
    for row in (0, len(joints) // 2, -1):
        corners = scene.mesh(task.start, joints=joints[row]).corners.reshape(-1, 3)
        assert (corners >= points.min(axis=0) - 1e-9).all()
        assert (corners <= points.max(axis=0) + 1e-9).all()


def test_the_table_carries_workspace_and_arms(held: tuple):
    task, way, *_ = held
    assert task.cell is not None
    scene = CellScene(task, way, LOOK)
    top = scene.still.corners[scene.still.labels == Label.TABLE].reshape(-1, 3)
    low, high = top.min(axis=0), top.max(axis=0)
    for arm in task.cell.arms:
        x, y, z = arm.base(task.scene)[:3, 3]
        assert (low[:2] < (x, y)).all()
        assert (high[:2] > (x, y)).all()
        assert high[2] == pytest.approx(z), "a pedestal as high as the base"
    assert (low[:2] < 0).all()
    assert (high[:2] > task.scene.size).all()


def test_without_a_cell_there_are_discs_and_no_arms():
    task = beside_disc()
    picture = seen(task, CellScene(task, None, LOOK), poses=task.gripper_poses("start"))
    for side, (x, y) in enumerate(task.start[[0, -1]]):
        assert at(picture, task, x, y, DISC) == (GRIPPERS[side], pytest.approx(DISC, abs=1e-9))
    assert not np.isin(picture.label, ARMS).any()


def test_a_cable_without_length_is_refused_and_repeated_points_are_not():
    task = beside_disc()
    scene = CellScene(task, None, LOOK)
    once = scene.mesh(task.start).corners
    assert np.array_equal(scene.mesh(np.repeat(task.start, 2, axis=0)).corners, once)
    with pytest.raises(InputError, match="the cable has no length"):
        scene.mesh(np.zeros((5, 2)))


def test_obstacles_of_all_kinds_have_the_area_and_height_that_they_have():
    box = Box(center=(0.2, 0.5), size=(0.1, 0.06), angle=0.4, height=0.03)
    disc = Disc(center=(0.5, 0.5), radius=0.04, height=0.08)
    task = replace(beside_disc(), scene=Scene(obstacles=(box, disc)))
    scene = CellScene(task, None, LOOK)
    corners = scene.still.corners[scene.still.labels == Label.OBSTACLE]
    a, b, c = corners.swapaxes(0, 1)
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    assert volume == pytest.approx(0.1 * 0.06 * 0.03 + np.pi * 0.04**2 * 0.08, rel=0.005)
