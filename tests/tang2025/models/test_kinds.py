"""What holds for every kind of learned model."""

from __future__ import annotations

from dataclasses import replace

import equinox as eqx
import jax
import numpy as np
import pytest
from led_cables import quasi_static

from cableway.core.errors import InputError
from cableway.tang2025.models.checkpoint import load_model, save_model
from cableway.tang2025.models.frames import Framing
from cableway.tang2025.models.learned import LearnedModel, Normalization
from cableway.tang2025.models.networks import KINDS, ConvConfig, MLPConfig, RecurrentConfig, RodConfig
from cableway.tang2025.models.transformer import TransformerConfig

CONFIGS = {
    "transformer": TransformerConfig(width=8, heads=2, encoder_blocks=1),
    "conv": ConvConfig(width=8, blocks=1),
    "bilstm": RecurrentConfig(width=8, layers=2),
    "mlp": MLPConfig(hidden=(16,)),
    "linear": MLPConfig(hidden=()),
    "rod": RodConfig(),
    "conv on a rod": ConvConfig(width=8, blocks=1, framing=Framing(rod=True)),
}
NETWORKS = [name for name in CONFIGS if name not in ("rod", "conv on a rod")]

predict = eqx.filter_jit(lambda model, *sample: model(*sample))


def made(config, data):
    return LearnedModel(config, key=jax.random.key(2), normalization=Normalization.fitted(config.framing, data))


@pytest.mark.parametrize("name", CONFIGS)
def test_the_ends_move_with_the_grippers_and_the_file_holds_it_all(name, transitions, sample, tmp_path):
    model = made(CONFIGS[name], transitions)
    displacement = np.asarray(predict(model, *sample))
    assert displacement.shape == (13, 2)
    np.testing.assert_allclose(displacement[[0, -1]], sample[2][:, :2], atol=1e-5)
    save_model(tmp_path / "m.safetensors", model, {})
    assert eqx.tree_equal(load_model(tmp_path / "m.safetensors"), model)


@pytest.mark.parametrize("name", NETWORKS)
def test_a_network_that_is_not_told_the_angles_does_not_depend_on_them(name, transitions, sample):
    keypoints, poses, action = sample
    turned = poses + np.array([0, 0, 0.7], np.float32)
    for angles in (True, False):
        config = replace(CONFIGS[name], framing=replace(Framing.plain(), angles=angles))
        model = made(config, transitions)
        change = np.abs(np.asarray(predict(model, keypoints, turned, action)) - predict(model, *sample)).max()
        assert (change > 1e-6) == angles


@pytest.mark.parametrize("name", CONFIGS)
@pytest.mark.parametrize("keypoints", [10, 25])
def test_a_prediction_does_not_depend_on_the_number_of_keypoints(name, keypoints, transitions):
    model = made(CONFIGS[name], transitions)
    other = quasi_static(2, 20, seed=0, keypoints=keypoints)
    few, many = (
        np.asarray(predict(model, *(np.float32(part[7]) for part in (data.keypoints, data.poses, data.actions))))
        for data in (other, transitions)
    )
    np.testing.assert_allclose(few[:: (keypoints - 1) // 3], many[::4], atol=0.02 * np.abs(many).max())


def test_the_linear_model_is_linear_in_the_motion(transitions, sample):
    keypoints, poses, action = sample
    config = MLPConfig(hidden=(), framing=Framing.plain())
    model = made(config, transitions)
    none, once, twice = (np.asarray(predict(model, keypoints, poses, k * action)) for k in (0, 1, 2))
    np.testing.assert_allclose(twice - once, once - none, atol=1e-6)
    assert np.abs(once - none).max() > 1e-5


def test_every_kind_has_a_test_and_knows_its_name():
    assert {config.kind for config in CONFIGS.values()} == set(KINDS)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ConvConfig(blocks=0), "conv.blocks must be from 1 to 1024, got 0"),
        (lambda: RecurrentConfig(width=0), "recurrent.width must be from 1 to 1024, got 0"),
        (lambda: MLPConfig(hidden=(4, 0)), "mlp.hidden must be fewer than 1024 widths, each from 1 to 1024"),
        (lambda: MLPConfig(keypoints=2), "mlp.keypoints must be from 3 to 1024, got 2"),
        (lambda: ConvConfig(keypoints=2), "conv.keypoints must be from 3 to 1024, got 2"),
        (lambda: RecurrentConfig(keypoints=2), "recurrent.keypoints must be from 3 to 1024, got 2"),
        (lambda: TransformerConfig(keypoints=2), "transformer.keypoints must be from 3 to 1024, got 2"),
        (lambda: RodConfig(damping_time=0.0), "rod.damping_time must be finite and positive, got 0.0"),
    ],
)
def test_impossible_sizes_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
