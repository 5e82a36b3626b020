"""What an initial trajectory hands to the projection."""

from __future__ import annotations

import numpy as np
import pytest
from quasi_static import straight_plan, task_for

from cableway.core.errors import PlanningError
from cableway.planning.config import PlannerConfig
from cableway.planning.initial_trajectories import InitialTrajectories
from cableway.scene.cable import Cable


def test_what_is_left_of_a_plan_begins_after_the_row_nearest_to_the_start():
    """The rows behind the cable are not gone through again."""
    old = straight_plan(Cable().rod, steps=40)
    now = task_for(old).resumed_from(old.shapes[25])
    initial = InitialTrajectories(now, PlannerConfig(), previous=old).make("previous")
    assert np.array_equal(initial.shapes[1:-1], old.shapes[26:-1])
    assert np.array_equal(initial.shapes[[0, -1]], [now.start, now.goal])


def test_without_an_earlier_plan_nothing_is_left_of_it():
    now = task_for(straight_plan(Cable().rod))
    with pytest.raises(PlanningError, match="no previous plan"):
        InitialTrajectories(now, PlannerConfig()).make("previous")


def test_keypoints_that_go_straight_are_half_way_at_half_time():
    now = task_for(straight_plan(Cable().rod))
    initial = InitialTrajectories(now, PlannerConfig()).make("straight")
    np.testing.assert_allclose(initial.shapes[25], (now.start + now.goal) / 2, atol=1e-12)
    assert initial.stages is None
