"""Small data sets and models, shared by the tests of the models."""

from __future__ import annotations

import equinox as eqx
import jax
import numpy as np
import pytest
from led_cables import quasi_static

from cableway.datasets.transitions import Transitions
from cableway.tang2025.models.frames import Framing
from cableway.tang2025.models.learned import LearnedModel, Normalization
from cableway.tang2025.models.transformer import TransformerConfig


def lively(config: TransformerConfig, data: Transitions) -> LearnedModel:
    """A model with random weights whose corrections are as large as the motions themselves."""
    normalization = Normalization.fitted(config.framing, data)
    model = LearnedModel(config, key=jax.random.key(1), normalization=normalization)
    return eqx.tree_at(lambda m: m.network.readout.weight, model, 10 * model.network.readout.weight)


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
def model(small: TransformerConfig, transitions: Transitions) -> LearnedModel:
    return lively(small, transitions)


@pytest.fixture(scope="session")
def plain_model(transitions: Transitions) -> LearnedModel:
    return lively(TransformerConfig(width=16, heads=2, encoder_blocks=1, framing=Framing.plain()), transitions)
