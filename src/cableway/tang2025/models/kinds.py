"""The kinds of learned models, by the name that configurations and files call them."""

from __future__ import annotations

from typing import Any

from jaxtyping import PRNGKeyArray

from cableway.core.errors import UnknownNameError
from cableway.tang2025.models.conv import ConvConfig, ConvModel
from cableway.tang2025.models.learned import LearnedConfig, LearnedModel, Normalization
from cableway.tang2025.models.mlp import MLPConfig, MLPModel
from cableway.tang2025.models.recurrent import RecurrentConfig, RecurrentModel
from cableway.tang2025.models.rod import RodConfig, RodModel
from cableway.tang2025.models.transformer import TransformerConfig, TransformerModel

KINDS: dict[str, tuple[type[Any], type[Any]]] = {
    "transformer": (TransformerConfig, TransformerModel),
    "conv": (ConvConfig, ConvModel),
    "bilstm": (RecurrentConfig, RecurrentModel),
    "mlp": (MLPConfig, MLPModel),
    "rod": (RodConfig, RodModel),
}
"""Configuration and model of each kind."""


def config_of(kind: str) -> type[Any]:
    """The configuration class of a kind.

    Raises:
        UnknownNameError: There is no such kind.
    """
    if kind not in KINDS:
        raise UnknownNameError("kind of model", kind, KINDS)
    return KINDS[kind][0]


def kind_of(config: LearnedConfig) -> str:
    """The kind that a configuration is of."""
    return next(kind for kind, (configuration, _) in KINDS.items() if type(config) is configuration)


def build(config: LearnedConfig, *, key: PRNGKeyArray, normalization: Normalization | None = None) -> LearnedModel:
    """A model with random weights."""
    return KINDS[kind_of(config)][1](config, key=key, normalization=normalization)
