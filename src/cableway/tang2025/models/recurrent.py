"""The bidirectional LSTM deformation model (B-DM): what Tang et al. compare the transformer with.

Two layers, each read along the cable from the left and from the right. Grippers and arc length are given to each
keypoint as in the convolutional model.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from cableway.core.errors import InputError
from cableway.tang2025.models.frames import Framing, Inputs
from cableway.tang2025.models.layers import TOKEN, Dense, tokens
from cableway.tang2025.models.learned import LearnedModel, Normalization, rod_of
from cableway.tang2025.models.viscoelastic import RodParameters


@dataclass(frozen=True, kw_only=True)
class RecurrentConfig:
    """Sizes of the network and what surrounds it.

    Attributes:
        width: Numbers that each direction remembers.
        layers: Bidirectional layers.
        framing: Frame, blend, hard ends, rod.
    """

    width: int = 28
    layers: int = 2
    framing: Framing = field(default_factory=Framing)

    def __post_init__(self) -> None:
        for name in ("width", "layers"):
            if getattr(self, name) < 1:
                raise InputError(f"bilstm {name} must be at least 1, got {getattr(self, name)!r}")


class Bidirectional(eqx.Module):
    """An LSTM along the cable and another one back; what both remember at each keypoint."""

    enter: Dense
    repeat: Float[Array, "2 w 4*w"]

    def __init__(self, inputs: int, width: int, *, key: PRNGKeyArray) -> None:
        keys = jax.random.split(key)
        self.enter = Dense(inputs, 8 * width, key=keys[0])
        self.repeat = jax.random.normal(keys[1], (2, width, 4 * width)) / jnp.sqrt(width)

    def __call__(self, rows: Float[Array, "n k"]) -> Float[Array, "n m"]:
        """One row for each keypoint; gates are those of Hochreiter and Schmidhuber with forgetting, biased to keep."""
        entered = self.enter(rows).reshape(len(rows), 2, -1)
        both = jnp.stack([entered[:, 0], entered[::-1, 1]], axis=1)
        start = jnp.zeros(self.repeat.shape[:2], rows.dtype)

        def advance(state: tuple[Array, Array], row: Array) -> tuple[tuple[Array, Array], Array]:
            hidden, cell = state
            forget, admit, show, content = jnp.split(row + jnp.einsum("dw,dwg->dg", hidden, self.repeat), 4, axis=1)
            cell = jax.nn.sigmoid(forget + 1.0) * cell + jax.nn.sigmoid(admit) * jnp.tanh(content)
            hidden = jax.nn.sigmoid(show) * jnp.tanh(cell)
            return (hidden, cell), hidden

        hidden = jax.lax.scan(advance, (start, start), both)[1]
        return jnp.concatenate([hidden[:, 0], hidden[::-1, 1]], axis=1)


class RecurrentModel(LearnedModel):
    """The bidirectional LSTM deformation model."""

    config: RecurrentConfig = eqx.field(static=True)  # pyright: ignore[reportIncompatibleVariableOverride]
    normalization: Normalization
    rod: RodParameters | None
    layers: tuple[Bidirectional, ...]
    readout: Dense

    def __init__(
        self, config: RecurrentConfig, *, key: PRNGKeyArray, normalization: Normalization | None = None
    ) -> None:
        """Random weights, and a normalisation that changes nothing unless one is given."""
        keys = jax.random.split(key, config.layers + 1)
        sizes = [TOKEN, *(2 * config.width for _ in range(config.layers - 1))]
        self.config = config  # pyright: ignore[reportIncompatibleVariableOverride]
        self.normalization = Normalization.identity() if normalization is None else normalization
        self.rod = rod_of(config.framing)
        self.layers = tuple(Bidirectional(size, config.width, key=k) for size, k in zip(sizes, keys[1:], strict=True))
        self.readout = Dense(2 * config.width, 2, key=keys[0], scale=0.1)

    def network(self, inputs: Inputs) -> Float[Array, "n 2"]:
        """See `LearnedModel`."""
        rows = tokens(inputs)
        for layer in self.layers:
            rows = layer(rows)
        return self.readout(rows)
