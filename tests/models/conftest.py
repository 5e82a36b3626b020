"""Small data sets and models, shared by the tests of the models."""

from __future__ import annotations

import equinox as eqx
import jax
import numpy as np
import pytest

from cableway.models.frames import Framing
from cableway.models.learned import Normalization
from cableway.models.transformer import TransformerConfig, TransformerModel
from cableway.records import Transitions
from cableway.rod.equilibrium import Rod


def quasi_static(episodes: int, steps: int, *, seed: int, length: float = 0.3, keypoints: int = 13) -> Transitions:
    """Transitions of a cable without lag: straight lines in rod coordinates, one for each episode."""
    rng, rod = np.random.default_rng(seed), Rod(length, keypoints)
    parts = []
    for _ in range(episodes):
        start = np.concatenate([rng.uniform(0.2, 0.5, 2), rng.uniform(-3, 3, 1), rng.normal(0, [6, 6, 1.5])])
        change = rng.normal(0, [0.05, 0.05, 0.4, 4, 4, 1])
        q = start + np.linspace(0, 1, steps + 1)[:, None] * change
        stations, poses = rod.shapes(q)
        parts.append((rod.at_keypoints(stations), poses))
    shapes, poses = (np.array(part) for part in zip(*parts, strict=True))
    return Transitions(
        keypoints=shapes[:, :-1].reshape(-1, keypoints, 2),
        poses=poses[:, :-1].reshape(-1, 2, 3),
        actions=np.diff(poses, axis=1).reshape(-1, 2, 3),
        next_keypoints=shapes[:, 1:].reshape(-1, keypoints, 2),
        episode=np.repeat(np.arange(episodes), steps),
    )


def lively(config: TransformerConfig, data: Transitions) -> TransformerModel:
    """A model with random weights whose corrections are as large as the motions themselves."""
    normalization = Normalization.fitted(config.framing, data)
    model = TransformerModel(config, key=jax.random.key(1), normalization=normalization)
    return eqx.tree_at(lambda m: m.readout.weight, model, 10 * model.readout.weight)


@pytest.fixture(scope="session")
def transitions() -> Transitions:
    return quasi_static(24, 20, seed=0)


@pytest.fixture(scope="session")
def sample(transitions: Transitions) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Keypoints, poses and action of one transition."""
    return tuple(
        np.asarray(part[7], np.float32) for part in (transitions.keypoints, transitions.poses, transitions.actions)
    )


@pytest.fixture(scope="session")
def small() -> TransformerConfig:
    return TransformerConfig(width=16, heads=2, encoder_blocks=1)


@pytest.fixture(scope="session")
def model(small: TransformerConfig, transitions: Transitions) -> TransformerModel:
    return lively(small, transitions)


@pytest.fixture(scope="session")
def plain_model(transitions: Transitions) -> TransformerModel:
    return lively(TransformerConfig(width=16, heads=2, encoder_blocks=1, framing=Framing.plain()), transitions)
