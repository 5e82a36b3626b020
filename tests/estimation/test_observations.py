"""What estimators make of an observation's time and confidence where they are given."""

from __future__ import annotations

import numpy as np
import pytest

from cableway.estimation.gripper_tracker import NOMINAL_GRASPS, GripperTracker
from cableway.estimation.rod_filter import EstimatorConfig, RodEstimator
from cableway.records import Observation, RodParameters
from cableway.rod.inverse import shape_between
from cableway.rod.material import GRASPS, LENGTH
from cableway.rod.planar import PlanarRod
from cableway.scene.cable import Cable

ROD, CABLE = PlanarRod(0.3), Cable()
POSES = np.array([[0.2, 0.3, 0.5], [0.42, 0.3, -0.5]])
Q = shape_between(ROD, POSES, "left")
SHAPE = ROD.at_keypoints(ROD.shapes(Q[None])[0])[0]


def test_a_time_that_is_known_is_used_and_not_estimated():
    """Grippers that move 1 cm in each control step: a frame of 0.15 s ago shows them 1.5 cm behind."""
    tracker = GripperTracker.at_rest(POSES, 13)
    for step in range(3):
        moved = POSES + [0.01 * step, 0.0, 0.0]
        tracker = tracker.updated(Observation(0.1 * step, SHAPE, moved, taken=0.1 * step - 0.15), NOMINAL_GRASPS, CABLE)
    assert tracker.poses.delay == pytest.approx(1.5)
    np.testing.assert_allclose(tracker.at_frame[:, 0], POSES[:, 0] + 0.005)


def test_keypoints_without_confidence_are_not_seen():
    confidence = np.ones(13)
    confidence[4] = 0.0
    observation = Observation(0.0, SHAPE, POSES, confidence=confidence)
    tracker = GripperTracker.at_rest(POSES, 13).updated(observation, NOMINAL_GRASPS, CABLE)
    assert np.isnan(tracker.keypoints[4]).all()
    assert np.isfinite(np.delete(tracker.keypoints, 4, axis=0)).all()


def test_confidence_scales_how_much_keypoints_count():
    """Full confidence changes nothing; with a little of it the same difference moves the estimate less."""
    estimator = RodEstimator(ROD, EstimatorConfig(), 0.1)
    measured = SHAPE + 0.002 * np.sin(np.arange(26)).reshape(13, 2)
    start = estimator.start(Q)
    plain, full, little = (
        estimator.update(start, measured, POSES, 0.0, confidence).theta - start.theta
        for confidence in (None, np.ones(13), np.full(13, 0.01))
    )
    np.testing.assert_array_equal(plain, full)
    assert 0 < np.linalg.norm(little[1:]) < np.linalg.norm(plain[1:])


def test_what_a_tracker_knows_of_the_rod_takes_the_place_of_a_correction():
    """What the estimator takes as known stays so."""
    measured = SHAPE + 0.002 * np.sin(np.arange(26)).reshape(13, 2)
    theta, deviations = RodEstimator(ROD, EstimatorConfig(), 0.1).start(Q).theta, np.full(15, 1e-3)
    theta[LENGTH] += 0.004
    rod = RodParameters(theta, np.diag(deviations**2))
    for config, kept in ((EstimatorConfig(), ()), (EstimatorConfig(grasp=0.0, grasp_turn=0.0), np.arange(15)[GRASPS])):
        estimator = RodEstimator(ROD, config, 0.1)
        start = estimator.start(Q)
        after = estimator.update(start, measured, POSES, 0.0, rod=rod)
        np.testing.assert_array_equal(after.theta, theta)
        expected = np.where(np.isin(np.arange(15), kept), 0.0, deviations)
        np.testing.assert_allclose([each.deviation for each in estimator.estimates(after).values()], expected)
        assert after.updates == 1
        assert np.abs(after.offset).max() > 1e-4


def test_what_a_tracker_knows_counts_for_its_frame_alone():
    rod = RodParameters(np.ones(15), np.eye(15))
    tracker = GripperTracker.at_rest(POSES, 13).updated(Observation(0.0, SHAPE, POSES, rod=rod), NOMINAL_GRASPS, CABLE)
    assert tracker.rod is rod
    assert tracker.predicted().rod is None
    assert tracker.updated(Observation(0.1, SHAPE, POSES), NOMINAL_GRASPS, CABLE).rod is None
