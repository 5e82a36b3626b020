"""The filter in space: its derivatives, what it finds of cables that differ, and what it cannot explain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from spatial_problems import HANGING, ball_task

from cableway.control.spatial_mpc import SpatialMPC
from cableway.estimation.spatial_filter import NAMES, WEIGHT, SpatialEstimator, SpatialEstimatorConfig
from cableway.geometry.groups import SE3
from cableway.records import Estimate, Plan
from cableway.rod.material import MODES
from cableway.scene.spatial.task import SpatialTask
from cableway.simulation.spatial_perturbation import SpatialPerturbation
from cableway.simulation.spatial_plant import SpatialConfig

TASK = replace(ball_task(), scene=replace(ball_task().scene, obstacles=()))
ROD = replace(TASK.rod, weight=20.0)


def test_predictions_change_with_parameters_as_finite_differences_do():
    estimator = SpatialEstimator(ROD, SpatialEstimatorConfig(), 0.1)
    poses = ROD.end_poses(HANGING[None])[0]
    rng = np.random.default_rng(0)
    theta = np.concatenate([[1.01 * ROD.length, 0.1, 0.2], rng.normal(0, 0.2, MODES), rng.normal(0, 0.003, 12)])
    here = estimator.predict(HANGING, theta, poses)
    assert here.possible
    for k, (name, unit) in enumerate(NAMES.items()):
        moved = [
            estimator.predict(here.q, theta + sign * 1e-5 * np.eye(len(NAMES))[k], poses).keypoints for sign in (1, -1)
        ]
        slope, size = (moved[0] - moved[1]) / 2e-5, 2e-3 if unit == "rad" else 1e-6
        np.testing.assert_allclose(here.by_theta[..., k], slope, atol=size, err_msg=name)


def estimates_of(perturbation: SpatialPerturbation, task: SpatialTask, seed: int = 0) -> Mapping[str, Estimate]:
    """What is estimated of a cable after 3 s of a run."""
    plant, controller = perturbation.build(task, seed), SpatialMPC()
    plan = Plan.of(task.rod, task.start + np.linspace(0, 1, 40)[:, None] * (task.goal - task.start))
    state, seen = controller.init(task, plan), plant.reset()
    for _ in range(30):
        action, state = controller.step(state, seen)
        seen = plant.step(action)
    return state.estimates()


@pytest.mark.parametrize("seed", [1, 2])
def test_length_and_weight_of_a_cable_in_another_simulator_are_found_while_it_rests(seed: int):
    task = replace(TASK, cable=replace(TASK.cable, linear_density=0.12))
    drawn = SpatialPerturbation.drawn(task, seed)
    drawn = replace(drawn, config=replace(drawn.config, links=21))
    assert drawn.cable is not None
    found = estimates_of(drawn, task, seed)
    for name, true in (
        ("length", drawn.cable.length), ("log weight", np.log(drawn.cable.weight / task.cable.weight))
    ):  # fmt: skip
        assert abs(found[name].value - true) < 2.5 * found[name].deviation
    assert found["length"].deviation < 0.5 * found["length"].prior


def test_the_end_at_which_a_cable_is_stiffer_is_found():
    profile = (0.5, 1.0, 1.5)
    start, goal = TASK.start.copy(), TASK.goal.copy()
    for end in (start, goal):
        end[[6, 11]] = -20.0, 3.0
    bent = replace(TASK, start=start, goal=goal)
    found = estimates_of(SpatialPerturbation(config=SpatialConfig(links=21, stiffness_profile=profile)), bent)
    slope = np.log(profile[-1] / profile[0]) / 2
    assert 0.6 < found["stiffness mode 1"].value / slope < 1.1


def test_a_cable_that_no_rod_explains_changes_nothing():
    estimator = SpatialEstimator(ROD, SpatialEstimatorConfig(), 0.1)
    before = estimator.start(HANGING)
    poses = ROD.end_poses(HANGING[None])[0]
    torn = SE3.plus(poses, np.array([[0.0, -0.2, 0, 0, 0, 0], [0, 0.2, 0, 0, 0, 0]]))
    keypoints = ROD.at_keypoints(ROD.shapes(HANGING[None])[0])[0]
    assert estimator.update(before, keypoints, torn, 0.0) is before
    assert before.theta[WEIGHT] == 0.0
