"""The plan by time."""

from __future__ import annotations

import numpy as np
import pytest
from quasi_static import straight_plan, task_for

from cableway.control.reference import PlanReference, reference_for
from cableway.core.errors import InputError
from cableway.motion.interpolation import rows_at
from cableway.records import Plan
from cableway.rod.planar import PlanarRod
from cableway.scene.cable import Cable

ROD = PlanarRod(0.3)
PLAN = straight_plan(ROD, steps=40)


def test_holds_then_follows_then_stays() -> None:
    reference = PlanReference(PLAN, hold=0.5)
    np.testing.assert_array_equal(reference.rows(0, 7), [0, 0, 0, 0, 0, 0, 1])
    np.testing.assert_array_equal(reference.rows(43, 5), [38, 39, 40, 40, 40])
    np.testing.assert_array_equal(reference.shape(5), PLAN.shapes[0])
    np.testing.assert_array_equal(reference.shape(1000), PLAN.shapes[-1])


def test_actions_lead_from_pose_to_pose() -> None:
    reference = PlanReference(PLAN, hold=0.3)
    actions, poses = reference.actions(0, 50), reference.poses(0, 50)
    np.testing.assert_allclose(PLAN.poses[0] + np.cumsum(actions, axis=0), poses, atol=1e-12)
    np.testing.assert_array_equal(reference.shapes(2, 2), PLAN.shapes[:2])


def test_a_slower_pace_leads_through_the_same_shapes() -> None:
    """At half of it twice as many rows, every second one the plan's, the others half-way between."""
    reference = PlanReference(PLAN)
    rows = reference.rows(10.0, 5, rate=0.5)
    np.testing.assert_array_equal(rows, [10.0, 10.5, 11.0, 11.5, 12.0])
    shapes = rows_at(PLAN.shapes, rows)
    np.testing.assert_array_equal(shapes[::2], PLAN.shapes[10:13])
    np.testing.assert_allclose(shapes[1::2], (PLAN.shapes[10:12] + PLAN.shapes[11:13]) / 2, atol=1e-15)
    np.testing.assert_array_equal(rows_at(PLAN.poses, reference.rows(39.5, 3))[1:], PLAN.poses[[-1, -1]])


def test_progress_is_monotone_from_0_to_1() -> None:
    reference = PlanReference(PLAN, hold=0.3)
    progress = [reference.progress(step) for step in range(60)]
    assert progress[0] == 0.0
    assert progress[42] < 1.0
    assert progress[43] == progress[59] == 1.0
    assert np.all(np.diff(progress) >= 0)
    np.testing.assert_allclose(np.array(progress) * PLAN.steps, reference.rows(0, 60), atol=1e-9)


def test_a_plan_for_another_number_of_keypoints_is_refused() -> None:
    other: Plan = straight_plan(PlanarRod(0.3, 10))
    with pytest.raises(InputError, match="the plan has 10 keypoints, but task 'straight' has 13"):
        reference_for(task_for(PLAN), other, 0.0)


def test_the_number_of_keypoints_is_free() -> None:
    plan = straight_plan(PlanarRod(0.3, 10))
    assert reference_for(task_for(plan, cable=Cable(keypoints=10)), plan, 0.0).shape(0).shape == (10, 2)


@pytest.mark.parametrize("hold", [-0.1, np.nan, np.inf])
def test_a_hold_that_is_no_duration_is_refused(hold: float) -> None:
    with pytest.raises(InputError, match="hold must be finite and not negative"):
        PlanReference(PLAN, hold)
