"""A model that is adapted while it leads sees every frame once, and only whole ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from quasi_static import straight_plan, task_for

from cableway.core.errors import InputError
from cableway.records import Observation
from cableway.rod.planar import PlanarRod
from cableway.tang2025.control.learning import Learning
from cableway.tang2025.control.mpc_config import MPCConfig
from cableway.tang2025.control.neural_mpc import NeuralMPC
from cableway.tang2025.control.prediction import compile_predictor
from cableway.tang2025.models.adaptation import AdaptationConfig, parameters_of, start_adaptation, with_parameters
from cableway.tang2025.models.base import RigidBlend
from cableway.tang2025.models.checkpoint import load_model
from cableway.tang2025.models.learned import LearnedModel

PLAN = straight_plan(PlanarRod(0.3))
TASK = task_for(PLAN)


@pytest.fixture(scope="module")
def model() -> LearnedModel:
    found = load_model("linear")
    assert isinstance(found, LearnedModel)
    return found


def fed(learning: Learning, hidden: tuple[int, ...] = ()) -> Learning:
    for row in range(41):
        shape = PLAN.shapes[row].copy()
        if row in hidden:
            shape[3] = np.nan
        learning = learning.seeing((shape, PLAN.poses[row]))
    return learning


def test_every_step_between_two_frames_is_learned_from_once(model: LearnedModel):
    recent = fed(Learning(start_adaptation(model), every=20)).state.recent
    assert recent is not None
    np.testing.assert_allclose(recent.keypoints, PLAN.shapes[:40])
    np.testing.assert_allclose(recent.next_keypoints, PLAN.shapes[1:41])
    np.testing.assert_allclose(recent.poses + recent.actions, PLAN.poses[1:41])


def test_a_frame_that_is_partly_hidden_is_left_out_on_both_sides(model: LearnedModel):
    recent = fed(Learning(start_adaptation(model), every=20), hidden=(7, 20)).state.recent
    assert recent is not None
    assert len(recent) == 40 - 4
    assert np.isfinite(recent.keypoints).all()
    assert np.isfinite(recent.next_keypoints).all()


def test_a_predictor_takes_other_weights(model: LearnedModel):
    changed = with_parameters(model, 2.0 * parameters_of(model))
    compiled = compile_predictor(model, 2, 13)
    motions = np.full((2, 2, 3), 0.005)
    other = compiled.of(changed).shapes(PLAN.shapes[0], PLAN.poses[0], motions)
    anew = compile_predictor(changed, 2, 13).shapes(PLAN.shapes[0], PLAN.poses[0], motions)
    np.testing.assert_allclose(other, anew, atol=1e-6)
    assert np.abs(other - compiled.shapes(PLAN.shapes[0], PLAN.poses[0], motions)).max() > 1e-4


def test_a_wrong_model_is_changed_while_it_leads(model: LearnedModel):
    """The cable is as the model has it; the one in use has a last layer half as strong."""
    wrong = with_parameters(model, 0.5 * parameters_of(model))
    config = MPCConfig(hold=0.0, adapt_every=20)
    controller = NeuralMPC(wrong, config, AdaptationConfig(enough=0.0, improvement=0.0, windows=16, held_windows=3))
    truth = compile_predictor(model, 1, 13)
    state, keypoints, poses = controller.init(TASK, PLAN), PLAN.shapes[0], PLAN.poses[0]
    assert set(state.estimates()) == {"model changes taken", "model changes refused"}
    rng = np.random.default_rng(0)
    for step in range(130):
        _, state = controller.step(state, Observation(0.1 * step, keypoints, poses))
        action = rng.normal(0, [0.004, 0.004, 0.04], (2, 3)) if step % 10 == 0 else action
        keypoints, poses = truth.shapes(keypoints, poses, action[None])[0], poses + action
        state = replace(state, tracker=state.tracker.commanding(action))
    assert state.estimates()["model changes taken"].value >= 1
    resumed = controller.resume(state, TASK, PLAN)
    assert resumed.estimates() == state.estimates()
    motions = np.full((config.horizon, 2, 3), 0.005)
    before, after = (one.problem.predictor.shapes(PLAN.shapes[0], PLAN.poses[0], motions) for one in (state, resumed))
    np.testing.assert_array_equal(after, before)


def test_what_was_not_learned_cannot_be_adapted():
    with pytest.raises(InputError, match="adapt_every must be 0 for a RigidBlend"):
        NeuralMPC(RigidBlend(), MPCConfig(adapt_every=5))
