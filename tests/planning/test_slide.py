"""The sliding initial trajectory keeps the cable's length and leads from start to goal."""

from __future__ import annotations

import numpy as np
import problems
import pytest

from cableway.core.errors import PlanningError
from cableway.geometry import polyline
from cableway.planning.config import PivotConfig
from cableway.planning.routes.homotopy import different_routes, motion_class, signature
from cableway.planning.slide import slide
from cableway.scene.obstacles import Disc


@pytest.mark.parametrize("leading", ["head", "tail"])
@pytest.mark.parametrize("name", problems.SOLVABLE)
def test_goes_from_start_to_goal_at_full_length(name, leading):
    """The ends are the task's; keypoints come no closer along the curve than a segment less what a bend cuts short."""
    task = problems.SOLVABLE[name]()
    shapes = slide(task, leading, PivotConfig())
    assert np.array_equal(shapes[0], task.start)
    assert np.array_equal(shapes[-1], task.goal)
    longest = polyline.length(shapes).max()
    assert 0.95 * task.cable.length < longest < 1.01 * task.cable.length


def test_the_leading_end_leads():
    """Early on, the right end has moved farther with the head leading, the left end with the tail leading."""
    task = problems.doorway()
    for leading, first in (("head", -1), ("tail", 0)):
        shapes = slide(task, leading, PivotConfig())
        goals = task.goal[[0, -1]].mean(0)
        early = shapes[len(shapes) // 4]
        assert np.linalg.norm(early[first] - goals) < np.linalg.norm(early[-1 - first] - goals)


@pytest.mark.parametrize("leading", ["head", "tail"])
def test_keeps_the_class_of_a_route(leading):
    """Below both discs, between them and above both, where a slide without a route goes only one of these ways."""
    discs = (Disc(center=(0.2, 0.36), radius=0.05), Disc(center=(0.45, 0.36), radius=0.05))
    task = problems.task_between(problems.LOW_ARC, problems.HIGH_ARC, discs, name="two-islands")
    routes = list(different_routes(task, PivotConfig(), 0, 5))
    classes = [signature(task.scene, route) for route in routes]
    slides = [slide(task, leading, PivotConfig(), route=route) for route in routes]
    assert [motion_class(task, shapes) for shapes in slides] == classes
    assert len(set(classes)) == 3


def test_no_way_is_an_error():
    """A wall without a door leaves no path."""
    with pytest.raises(PlanningError):
        slide(problems.sealed(), "head", PivotConfig())
