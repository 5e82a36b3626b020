"""The plug ahead of the right end, its port, and the tasks that have no room for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cableway.core.errors import TaskError
from cableway.geometry import polyline
from cableway.scene.files.loading import load_task
from cableway.scene.grippers import Plug, Port
from cableway.scene.obstacles import Box, Disc
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.verification.plug import port_obstacles

PLUG, PORT = Plug(length=0.04, width=0.012), Port(position=(0.5, 0.3), angle=0.7, standoff=0.015, depth=0.012)


@pytest.fixture(scope="module")
def insertion() -> Task:
    return load_task("insertion")


def test_the_outline_goes_round_once_in_steps_no_longer_than_asked():
    line = PLUG.body.boundary(0.003)
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    assert steps.max() <= 0.003 + 1e-12
    assert steps.sum() == pytest.approx(2 * (0.04 + 0.012))
    np.testing.assert_array_equal(line[0], line[-1])


def test_the_plug_moves_with_its_rear_as_one():
    poses = np.array([[0.1, 0.2, 0.5], [0.3, -0.1, -2.0]])
    lines = PLUG.body.placed(poses, 0.005)
    for pose, line in zip(poses, lines, strict=True):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        np.testing.assert_allclose(line, PLUG.body.boundary(0.005) @ [[c, s], [-s, c]] + pose[:2], atol=1e-15)


@pytest.mark.parametrize("depth", [-0.015, 0.0, 0.012])
def test_a_plug_that_is_aligned_is_as_deep_as_asked(depth: float):
    alignment = PORT.alignment(PLUG, PORT.pose(PLUG, depth))
    np.testing.assert_allclose([alignment.depth, alignment.lateral, alignment.angle], [depth, 0.0, 0.0], atol=1e-12)


def test_misalignment_is_that_of_the_tip():
    """Turned about its rear by a small angle, the tip moves aside by the length times its sine."""
    alignment = PORT.alignment(PLUG, PORT.pose(PLUG, 0.0) + [0.0, 0.0, 0.05])
    assert alignment.lateral == pytest.approx(0.04 * np.sin(0.05))
    assert alignment.depth == pytest.approx(-0.04 * (1 - np.cos(0.05)))
    assert alignment.angle == pytest.approx(0.05)


def test_the_port_is_in_the_box_behind_it(insertion: Task):
    assert port_obstacles(insertion) == [0]
    assert port_obstacles(replace(insertion, port=None)) == []


def with_obstacle(task: Task, obstacle: Box | Disc) -> Task:
    return replace(task, scene=Scene(task.scene.size, (*task.scene.obstacles, obstacle)))


def test_a_start_needs_room_for_the_plug(insertion: Task):
    x, y, angle = insertion.plug_pose("start")
    ahead = (x + 0.045 * np.cos(angle), y + 0.045 * np.sin(angle))
    with pytest.raises(TaskError, match=r"^start has its plug in obstacles\[6\] \(box at .*\) by 5\.\d mm$"):
        with_obstacle(insertion, Box(center=ahead, size=(0.02, 0.02), angle=float(angle)))


def test_what_is_smaller_than_the_plug_does_not_hide_in_it(insertion: Task):
    x, y, angle = insertion.plug_pose("start")
    pin = Disc(center=(x + 0.02 * np.cos(angle), y + 0.02 * np.sin(angle)), radius=0.002)
    with pytest.raises(TaskError, match=r"^start has its plug in obstacles\[6\] \(disc"):
        with_obstacle(insertion, pin)


def test_a_goal_must_be_before_the_port(insertion: Task):
    assert insertion.port is not None
    port = replace(insertion.port, position=(0.575, 0.48))
    with pytest.raises(TaskError, match=r"^goal must have its right end at \(520, 480\) mm, 0\.00 degrees, "):
        replace(insertion, port=port)
    with pytest.raises(TaskError, match=r"^goal must have its right end at .* 88\.6 degrees off$"):
        replace(insertion, port=Port(position=(0.52, 0.525), angle=np.pi / 2, standoff=0.015, depth=0.01))


def test_the_end_of_the_cable_is_where_the_plug_begins(insertion: Task):
    np.testing.assert_allclose(insertion.plug_pose("goal")[:2], insertion.goal[-1], atol=1e-9)
    stated = replace(insertion, goal_poses=np.array([[0.4, 0.545, -1.6], [0.52, 0.47, 0.01]]))
    assert stated.plug_pose("goal")[2] == 0.01
    assert polyline.length(insertion.goal) < insertion.cable.length
