"""Whether grippers and cable can pass at all: never said where they can, with the width where they cannot."""

from __future__ import annotations

import dataclasses

import numpy as np
import problems
import pytest

from cableway.planning.routes.infeasibility import _widest_way, find_blockage
from cableway.scene.obstacles import Box


@pytest.mark.parametrize("name", problems.SOLVABLE)
def test_nothing_is_said_where_there_is_a_plan(name):
    assert find_blockage(problems.SOLVABLE[name]()) is None


@pytest.mark.parametrize(("gap", "blocked"), [(0.0025, True), (0.004, True), (0.012, False), (0.05, False)])
def test_a_gap_too_narrow_for_a_gripper_is_found_with_its_width_and_place(gap, blocked):
    """Grippers are 8 mm wide here; gaps within the grid's precision of that are not judged."""
    found = find_blockage(problems.slit(gap))
    assert (found is not None) == blocked
    if found is not None:
        assert found.thick == pytest.approx(0.008)
        assert found.widest == pytest.approx(gap, abs=0.004)
        assert found.place == pytest.approx([0.3, 0.36], abs=0.02)
        assert "left gripper" in str(found)


def test_a_gap_at_a_wall_is_found_in_the_gap_and_not_elsewhere_along_that_wall():
    """In the open, a way along the wall is no wider than the gap, and as wide as any other."""
    task = problems.task_between(
        problems.LOW_ARC, problems.HIGH_ARC, (Box(center=(0.355, 0.36), size=(0.69, 0.03)),), name="at-a-wall"
    )
    found = find_blockage(task, 0.004)
    assert found is not None
    assert found.place == pytest.approx([0.005, 0.36], abs=0.005)


def test_clearance_counts():
    """A gap that the grippers fit through, though not with the clearance that a plan keeps."""
    task = problems.slit(0.011)
    assert find_blockage(task) is None
    found = find_blockage(task, 0.004)
    assert "16 mm wide from start to goal (8 mm and 4 mm of clearance on either side)" in str(found)


def test_the_place_in_a_closed_wall_is_in_the_wall():
    found = find_blockage(problems.sealed())
    assert found is not None
    assert "closed" in str(found)
    assert found.place[1] == pytest.approx(0.36, abs=0.02)


def test_a_cable_thicker_than_its_grippers_is_named():
    task = problems.slit(0.014)
    cable = dataclasses.replace(task.cable, radius=0.010)
    found = find_blockage(dataclasses.replace(task, cable=cable))
    assert found is not None
    assert "the cable needs a route 20 mm wide" in str(found)


def test_a_node_counts_on_the_widest_way_from_whichever_side_it_is_entered():
    """Of two ways round a closed place, one over a narrow node of higher index than its neighbours, one wider."""
    distance = np.array([[1.0, 0.0, 1.0], [0.5, 0.1, 0.5], [0.0, 0.5, 0.0]])
    for turned, ends in (
        (distance, (0, 2)),
        (distance[::-1], (6, 8)),
        (distance.T, (0, 6)),
        (distance.T[:, ::-1], (2, 8)),
    ):
        path = _widest_way(np.ascontiguousarray(turned), *ends)
        assert turned.ravel()[path].min() == 0.5
