"""Laws of training: the same every time, whatever interrupts it; it learns; its state file is checked."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from cableway.core.errors import FileFormatError, InputError
from cableway.tang2025.models.checkpoint import METADATA_KEY, read_metadata
from cableway.tang2025.models.dataset import select
from cableway.tang2025.models.evaluation import baselines, evaluate, window_errors
from cableway.tang2025.models.learned import LearnedModel, Normalization
from cableway.tang2025.models.training import TrainingConfig, learning_rate, train

SHORT = TrainingConfig(epochs=3, rollout_epochs=1, rollout_steps=3, batch_size=64, validation_fraction=0.2, seed=5)


class Stop(Exception):
    pass


def weights(model) -> list[np.ndarray]:
    return [np.asarray(leaf) for leaf in jax.tree.leaves(eqx.filter(model, eqx.is_array))]


@pytest.fixture(scope="module")
def whole(small, transitions):
    return train(small, transitions, SHORT)


def test_the_same_seed_gives_the_same_weights_and_another_one_others(whole, small, transitions):
    again = train(small, transitions, SHORT)
    other = train(small, transitions, replace(SHORT, seed=6, epochs=1, rollout_epochs=0))
    assert all(np.array_equal(a, b) for a, b in zip(weights(whole.model), weights(again.model), strict=True))
    assert again.history == whole.history
    assert not all(np.array_equal(a, b) for a, b in zip(weights(whole.model), weights(other.model), strict=True))


@pytest.mark.parametrize("stage", ["epoch 2/3", "epoch 3/3"])
def test_an_interrupted_training_ends_with_the_same_weights(stage, whole, small, transitions, tmp_path):
    state_file = tmp_path / "training.safetensors"

    def interrupt(now: str, fraction: float) -> None:
        if now.startswith(stage):
            raise Stop

    with pytest.raises(Stop):
        train(small, transitions, SHORT, state_file=state_file, progress=interrupt)
    assert state_file.exists()
    resumed = train(small, transitions, SHORT, state_file=state_file)
    assert all(np.array_equal(a, b) for a, b in zip(weights(whole.model), weights(resumed.model), strict=True))
    assert resumed.history == whole.history


def test_the_state_of_another_training_is_refused(small, transitions, tmp_path):
    state_file = tmp_path / "training.safetensors"

    def interrupt(now: str, fraction: float) -> None:
        if now.startswith("epoch 2"):
            raise Stop

    with pytest.raises(Stop):
        train(small, transitions, SHORT, state_file=state_file, progress=interrupt)
    with pytest.raises(InputError, match="belongs to another training \\(other training\\)"):
        train(small, transitions, replace(SHORT, learning_rate=1e-3), state_file=state_file)
    fewer = select(transitions, transitions.episode < 12)
    with pytest.raises(InputError, match="other data"):
        train(small, fewer, SHORT, state_file=state_file)
    whole = state_file.read_bytes()
    state_file.write_bytes(whole[:-100])
    with pytest.raises(FileFormatError, match="not a readable safetensors file"):
        train(small, transitions, SHORT, state_file=state_file)
    state_file.write_bytes(whole)
    for changed in ({"identity": 1000.0}, {"identity": {"model": 1}}, {"history": 3}, {"history": [{"epoch": "one"}]}):
        metadata = json.dumps({**read_metadata(state_file), **changed})
        save_file(load_file(state_file), spoilt := tmp_path / "spoilt.safetensors", metadata={METADATA_KEY: metadata})
        with pytest.raises(FileFormatError, match=f"its metadata.{next(iter(changed))}"):
            train(small, transitions, SHORT, state_file=spoilt)


def test_progress_rises_to_one_and_tells_loss_and_validation_error(small, transitions):
    seen: list[tuple[str, float]] = []
    train(small, transitions, SHORT, progress=lambda stage, fraction: seen.append((stage, fraction)))
    fractions = [fraction for _, fraction in seen]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert "epoch 1/3, loss" in seen[0][0]
    assert "validation" in seen[-1][0]


def test_training_leaves_the_normalisation_alone_and_changes_every_weight(whole, small, transitions):
    normalization = Normalization.fitted(small.framing, whole.training_data)
    start = LearnedModel(small, key=jax.random.key(SHORT.seed), normalization=normalization)
    for before, after in zip(weights(normalization), weights(whole.model.normalization), strict=True):
        assert np.array_equal(before, after)
    frozen = len(weights(normalization))
    changed = [not np.array_equal(a, b) for a, b in zip(weights(start), weights(whole.model), strict=True)]
    assert sum(changed) == len(changed) - frozen


def test_a_small_set_can_be_learned_and_beats_the_baselines(small, transitions):
    config = replace(SHORT, epochs=60, rollout_epochs=0, learning_rate=1e-2)
    result = train(small, transitions, config)
    assert result.history[-1].loss < 0.1 * result.history[0].loss
    table = evaluate({"model": result.model, **baselines()}, result.training_data, horizons=(1, 10))
    for horizon in (0, 1):
        assert table["model"][horizon].median < 0.5 * table["rigid blend"][horizon].median
        assert table["rigid blend"][horizon].median < table["persistence"][horizon].median


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"epochs": 0}, "epochs must be whole and at least 1, got 0"),
        ({"learning_rate": float("nan")}, "learning_rate must be finite and positive, got nan"),
        ({"validation_fraction": 1.0}, "validation_fraction must be between 0 and 1"),
        ({"epochs": 2, "rollout_epochs": 3}, "rollout_epochs must be from 0 to 2, got 3"),
        ({"weight_decay": -1.0}, "weight_decay must be finite and not negative"),
    ],
)
def test_impossible_settings_are_refused(fields, message):
    with pytest.raises(InputError, match=message):
        TrainingConfig(**fields)


def test_the_learning_rate_rises_and_falls_to_zero():
    rates = [learning_rate(SHORT, k / 100) for k in range(101)]
    top = int(np.argmax(rates))
    assert rates[0] == 0
    assert rates[top] == SHORT.learning_rate
    assert top == round(100 * SHORT.warmup)
    assert np.all(np.diff(rates[top:]) < 0)
    assert abs(rates[-1]) < 1e-12


def test_a_rollout_longer_than_every_episode_is_refused(small, transitions):
    with pytest.raises(InputError, match="rollout_steps = 21 or more steps"):
        train(small, transitions, replace(SHORT, rollout_steps=21))


def test_patience_ends_a_training_and_takes_its_best_weights(small, transitions):
    config = replace(SHORT, epochs=30, rollout_epochs=0, learning_rate=0.1, warmup=0.01, patience=2)
    result = train(small, transitions, config)
    errors = [row.validation_error for row in result.history]
    assert len(errors) < 30
    assert int(np.argmin(errors)) == len(errors) - 3
    best = 1e3 * np.mean(window_errors(result.model, result.validation_data, (1,), stride=1).stacked)
    assert best == pytest.approx(min(errors))


def test_a_training_goes_on_from_a_model_and_keeps_its_normalisation(whole, small, transitions):
    few = select(transitions, transitions.episode < 6)
    config = replace(SHORT, epochs=1, rollout_epochs=0, batch_size=16, learning_rate=1e-4)
    tuned = train(small, few, config, start=whole.model)
    assert eqx.tree_equal(tuned.model.normalization, whole.model.normalization)
    moved = [np.abs(a - b).max() for a, b in zip(weights(tuned.model), weights(whole.model), strict=True)]
    assert 0 < max(moved) < 1e-3


def test_more_devices_than_there_are_are_refused(small, transitions):
    with pytest.raises(InputError, match="devices must be at most the 1 that JAX sees, got 2"):
        train(small, transitions, replace(SHORT, devices=2))
    with pytest.raises(InputError, match="batch_size must be a multiple of 3 devices, got 64"):
        replace(SHORT, devices=3)


SHARDED = """
import numpy as np
from dataclasses import replace
from led_cables import quasi_static
from test_training import SHORT, weights
from cableway.tang2025.models.networks import MLPConfig
from cableway.tang2025.models.training import train

data = quasi_static(12, 20, seed=0)
short = replace(SHORT, epochs=2, rollout_epochs=0)
one, two = (train(MLPConfig(hidden=(16,)), data, replace(short, devices=count)).model for count in (1, 2))
assert all(np.allclose(a, b, atol=1e-5) for a, b in zip(weights(one), weights(two)))
assert any(len(leaf.sharding.device_set) == 2 for leaf in (two.network.readout.weight,))
"""


def test_two_devices_learn_what_one_does():
    folder = Path(__file__).parent
    path = os.pathsep.join([str(folder), str(folder.parent), *sys.path])
    environment = {**os.environ, "PYTHONPATH": path, "XLA_FLAGS": "--xla_force_host_platform_device_count=2"}
    done = subprocess.run([sys.executable, "-c", SHARDED], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
