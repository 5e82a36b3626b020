"""What a guide hands to the realisation."""

from __future__ import annotations

import numpy as np
import pytest
from quasi_static import straight_plan, task_for

from cableway.core.errors import PlanningError
from cableway.planning.config import PlannerConfig
from cableway.planning.initial_trajectories import Guides
from cableway.scene.cable import Cable


def test_what_is_left_of_a_plan_begins_after_the_row_nearest_to_the_start():
    """The rows behind the cable are not gone through again."""
    old = straight_plan(Cable().rod, steps=40)
    now = task_for(old).resumed_from(old.shapes[25])
    sequence, _ = Guides(now, PlannerConfig(), 0, lambda *_: None, previous=old).make("previous")
    assert np.array_equal(sequence.shapes[1:-1], old.shapes[26:-1])
    assert np.array_equal(sequence.shapes[[0, -1]], [now.start, now.goal])


def test_without_an_earlier_plan_nothing_is_left_of_it():
    now = task_for(straight_plan(Cable().rod))
    with pytest.raises(PlanningError, match="no previous plan"):
        Guides(now, PlannerConfig(), 0, lambda *_: None).make("previous")


def test_keypoints_that_go_straight_are_half_way_at_half_time():
    now = task_for(straight_plan(Cable().rod))
    sequence, paths = Guides(now, PlannerConfig(), 0, lambda *_: None).make("straight")
    np.testing.assert_allclose(sequence.shapes[25], (now.start + now.goal) / 2, atol=1e-12)
    assert np.array_equal(paths.paths, sequence.shapes.swapaxes(0, 1))
