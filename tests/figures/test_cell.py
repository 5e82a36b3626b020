"""Laws of the pictures of a cell: both arms in view throughout, obstacles where they are, the same file each time."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from recorded import perfect_rollout

import cableway as cw
from cableway.core.errors import InputError
from cableway.figures import video
from cableway.figures.cell import cell_figure
from cableway.figures.perspective import CellView
from cableway.figures.style import figure_png
from cableway.figures.video import write_video
from cableway.records import Plan, Rollout
from cableway.robot.branches import ArmMotion, arm_motion
from cableway.tasks.generation import random_task_with_witness

SIZE = (240, 160)


@pytest.fixture(scope="module")
def planned() -> tuple[cw.Task, Plan]:
    """A task in a cell, and ten rows of a motion that solves it, with joints."""
    task, witness = random_task_with_witness(5000, "cell")
    assert task.cell is not None
    plan = Plan.of(task.cable.rod, witness.q[np.linspace(0, len(witness.q) - 1, 10).astype(int)])
    motion = arm_motion(plan.poses, task, task.cell, made=True)
    assert isinstance(motion, ArmMotion)
    return task, replace(plan, joints=motion.joints, metadata={"arms": motion.way.described()})


@pytest.fixture(scope="module")
def tracked(planned: tuple[cw.Task, Plan]) -> Rollout:
    task, plan = planned
    rollout = perfect_rollout(task, plan)
    return replace(rollout, joints=plan.joints, metadata={**rollout.metadata, **plan.metadata})


def test_the_arms_are_in_view_from_the_first_row_to_the_last(planned: tuple[cw.Task, Plan]):
    task, plan = planned
    view = CellView(task, plan, SIZE)
    pictures = [view.image(row) for row in (0, plan.steps // 2, plan.steps)]
    for picture in pictures:
        assert picture.shape == (SIZE[1], SIZE[0], 3)
        edge = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
        assert (edge == 255).all(), "nothing is cut off"
        assert (picture.min(axis=2) < 250).mean() > 0.3
    for a, b in pairwise(pictures):
        assert (np.abs(a.astype(int) - b).max(axis=2) > 30).mean() > 0.02, "they move"


def test_the_figure_has_both_views_at_start_half_way_and_end(planned: tuple[cw.Task, Plan], tracked: Rollout):
    task, plan = planned
    for record in (plan, tracked):
        figure = cell_figure(task, record)
        assert figure is not None
        perspective, above = figure.axes[:3], figure.axes[3:]
        assert len(above) == 3
        assert [ax.get_title(loc="left") for ax in perspective] == ["0.0 s", "0.4 s", "0.9 s"]
        pictures = [np.asarray(ax.images[0].get_array()) for ax in perspective]
        view = CellView(task, record, pictures[0].shape[1::-1])
        for picture, row in zip(pictures, (0, 4, 9), strict=True):
            assert np.array_equal(picture, view.image(row))
        assert figure_png(figure) == figure_png(cell_figure(task, record))  # pyright: ignore[reportArgumentType]


def test_without_a_cell_or_joints_there_is_no_such_figure(planned: tuple[cw.Task, Plan]):
    task, plan = planned
    assert cell_figure(replace(task, cell=None), plan) is None
    assert cell_figure(task, replace(plan, joints=None)) is None
    assert cell_figure(task, replace(plan, metadata={})) is None
    with pytest.raises(InputError, match="has no cell, or the record has no joints"):
        CellView(task, replace(plan, joints=None), SIZE)
    with pytest.raises(InputError, match="the record has 2 keypoints, the task 13"):
        cell_figure(task, replace(plan, shapes=plan.shapes[:, :2]))
    with pytest.raises(InputError, match="the record has 7 joints of each arm, the arms have 6"):
        cell_figure(task, replace(plan, joints=np.zeros((10, 2, 7))))


def test_a_rollout_is_shown_with_obstacles_where_they_were(planned: tuple[cw.Task, Plan], tracked: Rollout):
    task, _ = planned
    by = [[0.0, 0.02], *[[0.0, 0.0]] * (len(task.scene.obstacles) - 1)]
    moved = replace(tracked, metadata={**tracked.metadata, "plant": {"obstacles": by}})
    assert task.as_recorded(tracked.metadata) is task
    assert task.as_recorded(moved.metadata).scene == task.scene.changed([tuple(row) for row in by])
    assert not np.array_equal(CellView(task, moved, SIZE).image(0), CellView(task, tracked, SIZE).image(0))


def test_a_video_of_a_cell_shows_it_in_perspective(planned: tuple[cw.Task, Plan], tracked: Rollout, tmp_path: Path):
    task, plan = planned
    stage = video._Stage(task, tracked, None, plan)
    stage.title(1)
    left, bottom, width, height = (round(video.INCH * part) for part in video.CELL.perspective or ())
    view = CellView(task, tracked, (width, height))
    for row in (3, tracked.steps):
        frame = stage.frame(row)[..., :3]
        shown = frame[video.SIZE[1] - bottom - height : video.SIZE[1] - bottom, left : left + width]
        assert (np.abs(shown.astype(int) - view.image(row)).max(axis=2) < 3).mean() > 0.97
    write_video(tmp_path / "rollout.mp4", task, tracked, plan=plan)
    assert (tmp_path / "rollout.mp4").read_bytes()[4:8] == b"ftyp"
