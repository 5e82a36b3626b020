"""Laws of the transformer model, of its rollout, and of the baselines."""

from __future__ import annotations

import equinox as eqx
import jax
import numpy as np
import pytest

from cableway.core.errors import InputError
from cableway.datasets.transitions import Transitions
from cableway.geometry import se2
from cableway.tang2025.models.base import Persistence, RigidBlend, rollout
from cableway.tang2025.models.dataset import window_starts, windows
from cableway.tang2025.models.frames import Framing
from cableway.tang2025.models.learned import LearnedModel
from cableway.tang2025.models.transformer import TransformerConfig

predict = eqx.filter_jit(lambda model, *sample: model(*sample))


def first_window(data: Transitions, horizon: int = 5):
    part = windows(data, window_starts(data.episode, horizon)[:1], horizon)
    return part.keypoints[0], part.poses[0], part.actions[0]


def test_the_prediction_moves_and_grows_with_the_cable(model, sample):
    keypoints, poses, action = sample
    angle, size, shift = 2.2, 0.6, np.array([0.4, -0.7])
    turn = se2.rotation(angle)
    there = predict(
        model,
        (size * keypoints @ turn.T + shift).astype(np.float32),
        np.column_stack([size * poses[:, :2] @ turn.T + shift, poses[:, 2] + angle]).astype(np.float32),
        np.column_stack([size * action[:, :2] @ turn.T, action[:, 2]]).astype(np.float32),
    )
    here = predict(model, keypoints, poses, action)
    np.testing.assert_allclose(there, size * np.asarray(here) @ turn.T, atol=2e-7 + 1e-4 * np.abs(here).max())


def test_the_plain_model_does_not_move_with_the_cable(plain_model, sample):
    keypoints, poses, action = sample
    shift = np.array([0.2, 0.1], np.float32)
    there = predict(plain_model, keypoints + shift, poses + np.append(shift, np.float32(0)), action)
    assert np.abs(np.asarray(there) - predict(plain_model, keypoints, poses, action)).max() > 1e-4


@pytest.mark.parametrize("blend", [True, False])
def test_the_ends_move_exactly_with_their_grippers(blend, sample):
    config = TransformerConfig(width=16, heads=2, encoder_blocks=1, framing=Framing(blend=blend))
    keypoints, poses, action = sample
    displacement = predict(LearnedModel(config, key=jax.random.key(3)), keypoints, poses, action)
    np.testing.assert_allclose(np.asarray(displacement)[[0, -1]], action[:, :2], atol=1e-6)


def test_without_hard_ends_the_network_moves_the_ends(plain_model, sample):
    displacement = np.asarray(predict(plain_model, *sample))
    assert np.abs(displacement[[0, -1]] - sample[2][:, :2]).max() > 1e-4


@pytest.mark.parametrize("count", [5, 25])
def test_one_model_takes_any_number_of_keypoints(model, sample, count):
    places = np.linspace(0, 12, count)
    keypoints = np.stack([np.interp(places, range(13), sample[0][:, i]) for i in (0, 1)], axis=1)
    displacement = np.asarray(predict(model, keypoints.astype(np.float32), *sample[1:]))
    assert displacement.shape == (count, 2)
    assert np.isfinite(displacement).all()


def test_the_rollout_repeats_the_step(model, transitions):
    keypoints, poses, actions = first_window(transitions)
    shapes = eqx.filter_jit(rollout)(model, keypoints, poses, actions)
    for action, shape in zip(actions, shapes, strict=True):
        keypoints, poses = keypoints + predict(model, keypoints, poses, action), poses + action
        np.testing.assert_allclose(shape, keypoints, atol=1e-6)


def test_the_jacobian_of_a_rollout_matches_finite_differences(model, transitions):
    keypoints, poses, actions = first_window(transitions)
    shapes = jax.jit(lambda a: rollout(model, keypoints, poses, a))
    jacobian = np.asarray(jax.jit(jax.jacfwd(shapes))(actions))
    check_causality(jacobian)
    jacobian = jacobian.reshape(5, 13, 2, 30)
    for k, direction in enumerate(np.eye(30, dtype=np.float32).reshape(30, 5, 2, 3)):
        step = np.float32(2e-3) * direction
        slope = (np.asarray(shapes(actions + step), float) - np.asarray(shapes(actions - step), float)) / 4e-3
        assert np.abs(slope - jacobian[..., k]).max() < 0.01 * np.abs(jacobian[..., k]).max() + 2e-4


def check_causality(jacobian):
    """A later action does not change an earlier shape."""
    for k in range(1, 5):
        assert np.all(jacobian[:k, ..., k, :, :] == 0)
        assert np.abs(jacobian[k, ..., k, :, :]).max() > 0.1


def test_the_prediction_is_smooth_where_the_gripper_angles_differ_by_pi(model):
    arc = np.linspace(0, np.pi, 13, dtype=np.float32)
    keypoints = 0.1 * np.stack([np.sin(arc), 1 - np.cos(arc)], axis=1)
    action = np.full((2, 3), 0.005, np.float32)

    def at(bend: float) -> np.ndarray:
        return np.asarray(predict(model, keypoints, np.array([[0, 0, 0], [0, 0.2, bend]], np.float32), action))

    assert np.abs(at(np.pi + 1e-4) - at(np.pi - 1e-4)).max() < 1e-5
    np.testing.assert_allclose(at(-np.pi), at(np.pi), atol=1e-6)


def test_persistence_and_blend_stand_still_without_action(sample):
    keypoints, poses, action = sample
    for baseline in (Persistence(), RigidBlend()):
        assert np.all(np.asarray(baseline(keypoints, poses, 0 * action)) == 0)
    assert np.all(np.asarray(Persistence()(keypoints, poses, action)) == 0)


def test_the_paper_s_configuration_is_plain_and_wide():
    paper = TransformerConfig.paper()
    assert (paper.width, paper.heads, paper.encoder_blocks, paper.decoder_blocks) == (128, 4, 2, 1)
    assert paper.framing == Framing.plain()
    shapes = eqx.filter_eval_shape(lambda: LearnedModel(paper, key=jax.random.key(0)))
    parameters = sum(leaf.size for leaf in jax.tree.leaves(shapes))
    assert 0.3e6 < parameters < 0.8e6


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"width": 30}, "multiple of its 4 heads, got 30"),
        ({"encoder_blocks": 0}, "encoder_blocks must be from 1 to 1024"),
    ],
)
def test_impossible_sizes_are_refused(fields, message):
    with pytest.raises(InputError, match=message):
        TransformerConfig(**fields)
