"""Cables of more than half a metre: a warning where they swing, and feedback that does not drive the swing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cableway.rod.planar import PlanarRod
from cableway.scene.cable import Cable
from cableway.scene.obstacles import Box, Disc, Polygon
from cableway.scene.task import Task
from cableway.tasks.generation import random_task
from cableway.workflow.events import Note
from cableway.workflow.run import SolveOptions
from cableway.workflow.solve import solve


def scaled(task: Task, by: float) -> Task:
    """The task with everything but grippers and radius so many times as large."""
    obstacles = []
    for each in task.scene.obstacles:
        if isinstance(each, Polygon):
            obstacles.append(replace(each, vertices=by * each.vertices))
        elif isinstance(each, Disc):
            obstacles.append(replace(each, center=tuple(np.multiply(each.center, by)), radius=by * each.radius))
        else:
            assert isinstance(each, Box)
            sizes = {name: tuple(np.multiply(getattr(each, name), by)) for name in ("center", "size")}
            obstacles.append(replace(each, **sizes))
    return replace(
        task,
        scene=replace(task.scene, size=tuple(np.multiply(task.scene.size, by)), obstacles=tuple(obstacles)),
        cable=replace(task.cable, length=by * task.cable.length),
        start=by * task.start, goal=by * task.goal, start_poses=None, goal_poses=None,
    )  # fmt: skip


def test_the_frequency_is_that_of_a_clamped_beam() -> None:
    """With the smallest root of cos(x) cosh(x) = 1 found here."""
    low, high = 4.0, 5.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if np.cos(middle) * np.cosh(middle) < 1 else (low, middle)
    cable = Cable(length=1.2, bending_stiffness=2e-3, linear_density=0.05)
    wanted = low**2 / (2 * np.pi) * np.sqrt(2e-3 / (0.05 * 1.2**4))
    assert cable.frequency == pytest.approx(wanted, rel=1e-3)


def test_a_long_rod_has_more_hinges_whatever_its_keypoints() -> None:
    assert [PlanarRod(length, 13).hinges for length in (0.15, 0.3, 0.5, 0.6, 1.2, 2.0)] == [24, 24, 24, 36, 48, 48]
    assert PlanarRod(1.2, 25).hinges == 48
    assert PlanarRod(2.0, 25).hinges == 48


def test_a_cable_that_swings_is_led_to_its_goal_and_named() -> None:
    notes = []
    done = solve(
        scaled(random_task(301, "clutter"), 4.0),
        SolveOptions(),
        on_event=lambda event: notes.append(event.text) if isinstance(event, Note) else None,
    )
    assert done.success
    assert done.rollout is not None
    assert done.rollout.metadata["recovered"] == []
    assert np.linalg.norm(done.rollout.keypoints - done.rollout.reference, axis=2).max() < 0.012
    assert any("first bending mode is at 0.45 Hz" in note for note in notes)
    assert any("first bending mode is at 0.45 Hz" in note for note in done.report.notes)
