"""Laws of what is drawn of a run whose obstacles are not where its plan has them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from recorded import moved_plan, perfect_rollout

from cableway.core.errors import InputError
from cableway.figures import palette, style
from cableway.figures.moving import MovingScene, captions
from cableway.figures.replanning import change_of, left_of, replanning_figure, stops_of
from cableway.figures.rollout import rollout_figure
from cableway.figures.video import write_video
from cableway.records import Rollout
from cableway.scene.obstacles import Box
from cableway.scene.scene import Scene

FREE, PLAN = moved_plan(rows=61)
BOXES = tuple(Box(center=(0.6, y), size=(0.05, 0.05)) for y in (0.5, 0.6))
TASK = FREE.in_scene(Scene(obstacles=BOXES))
FIRST, AFTER = 10, 21
"""Rows in which the cable stops, and from which there is a new plan."""

PLANT = {"obstacles": [[0.0, 0.0], [-0.1, 0.0]], "pegs": [[0.1, 0.6, 0.02]], "revealed": 1.0}


def stopped(**plant: object) -> Rollout:
    """The plan followed, with a stop of a second in it because something stands in the way."""
    whole = perfect_rollout(TASK, PLAN)
    rows = np.concatenate([np.arange(FIRST), np.full(AFTER - FIRST, FIRST), np.arange(FIRST + 1, whole.steps + 1)])
    names = ("keypoints", "observed", "poses", "centreline", "reference", "clearance", "gripper_clearance")
    status = ["tracking"] * FIRST + ["the way is blocked: stopped"] * (AFTER - FIRST - 1)
    status += ["tracking"] * (len(rows) - AFTER)
    return replace(
        whole,
        **{name: getattr(whole, name)[rows] for name in names},
        times=0.1 * np.arange(len(rows)),
        actions=np.zeros((len(rows) - 1, 2, 3)),
        solve_time=np.zeros(len(rows) - 1),
        status=np.array(status),
        metadata={"outcome": "settled", "recovered": [0.1 * (AFTER - 1)], "plant": {**PLANT, **plant}},
    )


RUN = stopped()


def test_a_change_is_what_differs_from_the_task():
    """Obstacles that stand where the plan has them are none of it, and no time of knowing is never."""
    change = change_of(TASK, RUN)
    assert change is not None
    assert change.kept.obstacles == BOXES[:1]
    assert change.expected.obstacles == BOXES[1:]
    assert [obstacle.vertices.mean(axis=0).tolist() for obstacle in change.actual.obstacles] == [[0.5, 0.6], [0.1, 0.6]]
    assert change.known == 1.0
    assert change_of(TASK, stopped(revealed=None)).known == math.inf  # pyright: ignore[reportOptionalMemberAccess]
    assert change_of(TASK, stopped(obstacles=[], pegs=[])) is None


@pytest.mark.parametrize("obstacles", [[[0.1, 0.0]], [["a", 0], [0, 0]], "ab", [[9.0, 0.0], [0.0, 0.0]], 3])
def test_a_change_that_does_not_fit_the_task_is_said(obstacles: object):
    with pytest.raises(InputError, match="do not fit the task"):
        change_of(TASK, stopped(obstacles=obstacles))


def test_a_stop_lasts_from_where_the_reference_stands_still_to_the_new_plan():
    assert stops_of(RUN) == [(FIRST, AFTER)]
    assert np.array_equal(left_of(PLAN, RUN.reference[FIRST]), PLAN.shapes[FIRST:])


def test_obstacles_are_drawn_where_the_plant_has_them():
    """In the picture of a rollout they are where the cable met them, and dashed where the plan has them."""
    ax = rollout_figure(TASK, RUN, plan=PLAN).axes[0]
    filled, dashed = ax.collections[0], ax.collections[1]
    assert [path.vertices[:-1].mean(axis=0)[0] > 0.55 for path in filled.get_paths()] == [True, False, False]
    assert len(dashed.get_paths()) == 1
    assert dashed.get_facecolor().size == 0, "an outline"  # pyright: ignore[reportAttributeAccessIssue]
    labels = [text.get_text() for text in ax.get_legend().get_texts()]  # pyright: ignore[reportOptionalMemberAccess]
    assert {"obstacle as planned", "plan given up"} <= set(labels)


def test_an_obstacle_is_hatched_until_the_controller_knows_of_it():
    ax = style.new_figure(5, 5).add_axes((0, 0, 1, 1))
    moving = MovingScene(ax, TASK, RUN, PLAN)
    for row, known in ((9, False), (10, True)):
        moving.show(row)
        assert bool(moving._actual.get_hatch()) is not known
        expected = moving._expected.get_facecolor()
        assert (len(expected) == 0) is known
        assert known or np.allclose(expected[0], to_rgba(palette.OBSTACLE))  # pyright: ignore[reportIndexIssue]


def test_the_way_ahead_is_that_of_the_plan_that_is_followed():
    """Before the stop the first plan's, none while the cable waits, then the new one's; the old one fades away."""
    moving = MovingScene(style.new_figure(5, 5).add_axes((0, 0, 1, 1)), TASK, RUN, PLAN)
    assert np.array_equal(moving.ahead(4), PLAN.shapes[4:])
    assert len(moving.ahead(FIRST)) == 0
    assert np.array_equal(moving.ahead(AFTER), RUN.reference[AFTER:])
    assert [len(moving.left(row)) for row in (FIRST - 1, FIRST, AFTER, RUN.steps)] == [0, 51, 51, 0]
    assert len(MovingScene(style.new_figure(5, 5).add_axes((0, 0, 1, 1)), TASK, RUN).left(FIRST)) == 0


def test_captions_say_that_an_obstacle_moved_and_for_a_while_that_there_is_a_new_plan():
    said = captions(TASK, RUN)
    assert said[FIRST] == "tracking"
    assert set(said[FIRST + 1 : AFTER]) == {"obstacle moved: stopped"}
    assert (said[AFTER], said[-1]) == ("replanned", "tracking")
    assert "the way is blocked: stopped" in captions(TASK, stopped(revealed=None)), "nobody knows why"
    assert "new obstacle: stopped" in captions(TASK, stopped(obstacles=[]))


def test_a_replanning_is_drawn_before_and_after_and_its_end():
    figure = replanning_figure(TASK, PLAN, RUN)
    titles = [ax.get_title(loc="left") for ax in figure.axes]
    assert titles == ["1.0 s: obstacle moved", "2.0 s: new plan", f"{RUN.times[-1]:.1f} s: settled"]
    twice = replace(RUN, metadata={**RUN.metadata, "recovered": [2.0, 3.0]})
    assert len(replanning_figure(TASK, PLAN, twice).axes) == 5


def test_the_video_of_a_replanning_is_there(tmp_path: Path):
    write_video(tmp_path / "rollout.mp4", TASK, RUN, plan=PLAN)
    assert (tmp_path / "rollout.mp4").stat().st_size > 10_000
