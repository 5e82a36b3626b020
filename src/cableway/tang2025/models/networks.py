"""The networks that Tang et al. compare the transformer with, simpler ones, and none at all; and every kind by name.

The convolutional model (C-DM) and the bidirectional LSTM (B-DM) get the poses and motions of both grippers with each
keypoint, and the cosines of its arc length, as in the transformer, which mark the ends of the cable.

Note:
    The paper gives no sizes; its public code has two residual blocks of kernel 3.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from cableway.core.checks import Positive
from cableway.core.errors import InputError, UnknownNameError
from cableway.scene.task import CONTROL_STEP
from cableway.tang2025.models.frames import Framing, Inputs
from cableway.tang2025.models.layers import GRIPPERS, TOKEN, Dense, LayerNorm, tokens
from cableway.tang2025.models.learned import KEYPOINTS, LARGEST_SIZE, Keypoints, LearnedConfig, Network, Size
from cableway.tang2025.models.transformer import TransformerConfig
from cableway.tang2025.models.viscoelastic import RodParameters


@dataclass(frozen=True, kw_only=True)
class ConvConfig(LearnedConfig):
    """Sizes of the convolutional network and what surrounds it.

    Attributes:
        width: Numbers a keypoint is encoded in.
        blocks: Residual blocks of two convolutions each.
        keypoints: How many keypoints the network sees; a cable with another number is resampled.
        framing: Frame, blend, hard ends, rod.
    """

    kind: ClassVar[str] = "conv"
    width: Size = 48
    blocks: Size = 2
    keypoints: Keypoints = KEYPOINTS
    framing: Framing = field(default_factory=Framing)

    def network(self, key: PRNGKeyArray) -> Network:
        """See `LearnedConfig`."""
        return Convolutional(self, key=key)


class Convolution(eqx.Module):
    """A dense layer on each keypoint and its two neighbours; beyond the ends are zeros."""

    layer: Dense

    def __init__(self, width: int, *, key: PRNGKeyArray) -> None:
        self.layer = Dense(3 * width, width, key=key)

    def __call__(self, rows: Float[Array, "n w"]) -> Float[Array, "n w"]:
        """One row for each keypoint."""
        padded = jnp.pad(rows, ((1, 1), (0, 0)))
        return self.layer(jnp.concatenate([padded[:-2], rows, padded[2:]], axis=1))


class ResidualBlock(eqx.Module):
    """Two convolutions, added to what came in."""

    norm: LayerNorm
    convolutions: tuple[Convolution, Convolution]

    def __init__(self, width: int, *, key: PRNGKeyArray) -> None:
        keys = jax.random.split(key)
        self.norm = LayerNorm(width)
        self.convolutions = (Convolution(width, key=keys[0]), Convolution(width, key=keys[1]))

    def __call__(self, rows: Float[Array, "n w"]) -> Float[Array, "n w"]:
        """Rows, corrected."""
        return rows + self.convolutions[1](jax.nn.silu(self.convolutions[0](self.norm(rows))))


class Convolutional(Network):
    """Residual blocks of convolutions along the cable."""

    embedding: Dense
    blocks: tuple[ResidualBlock, ...]
    norm: LayerNorm
    readout: Dense

    def __init__(self, config: ConvConfig, *, key: PRNGKeyArray) -> None:
        keys = jax.random.split(key, config.blocks + 2)
        self.embedding = Dense(TOKEN, config.width, key=keys[0])
        self.blocks = tuple(ResidualBlock(config.width, key=k) for k in keys[2:])
        self.norm = LayerNorm(config.width)
        self.readout = Dense(config.width, 2, key=keys[1], scale=0.1)

    def __call__(self, inputs: Inputs) -> Float[Array, "n 2"]:
        """See `Network`."""
        rows = self.embedding(tokens(inputs))
        for block in self.blocks:
            rows = block(rows)
        return self.readout(self.norm(rows))


@dataclass(frozen=True, kw_only=True)
class RecurrentConfig(LearnedConfig):
    """Sizes of the bidirectional LSTM and what surrounds it.

    Attributes:
        width: Numbers that each direction remembers.
        layers: Bidirectional layers.
        keypoints: How many keypoints the network sees; a cable with another number is resampled.
        framing: Frame, blend, hard ends, rod.
    """

    kind: ClassVar[str] = "bilstm"
    width: Size = 28
    layers: Size = 2
    keypoints: Keypoints = KEYPOINTS
    framing: Framing = field(default_factory=Framing)

    def network(self, key: PRNGKeyArray) -> Network:
        """See `LearnedConfig`."""
        return Recurrent(self, key=key)


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


class Recurrent(Network):
    """Layers of LSTMs, each read along the cable from the left and from the right."""

    layers: tuple[Bidirectional, ...]
    readout: Dense

    def __init__(self, config: RecurrentConfig, *, key: PRNGKeyArray) -> None:
        keys = jax.random.split(key, config.layers + 1)
        sizes = [TOKEN, *(2 * config.width for _ in range(config.layers - 1))]
        self.layers = tuple(Bidirectional(size, config.width, key=k) for size, k in zip(sizes, keys[1:], strict=True))
        self.readout = Dense(2 * config.width, 2, key=keys[0], scale=0.1)

    def __call__(self, inputs: Inputs) -> Float[Array, "n 2"]:
        """See `Network`."""
        rows = tokens(inputs)
        for layer in self.layers:
            rows = layer(rows)
        return self.readout(rows)


@dataclass(frozen=True, kw_only=True)
class MLPConfig(LearnedConfig):
    """Sizes of the multi-layer perceptron and what surrounds it.

    Attributes:
        hidden: Widths of the hidden layers; none of them for the linear model.
        keypoints: How many keypoints the network sees; a cable with another number is resampled.
        framing: Frame, blend, hard ends, rod.
    """

    kind: ClassVar[str] = "mlp"
    hidden: tuple[int, ...] = (128, 128)
    keypoints: Keypoints = KEYPOINTS
    framing: Framing = field(default_factory=Framing)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not all(1 <= width <= LARGEST_SIZE for width in (len(self.hidden) + 1, *self.hidden)):
            raise InputError(f"mlp.hidden must be fewer than {LARGEST_SIZE} widths, each from 1 to {LARGEST_SIZE}")

    def network(self, key: PRNGKeyArray) -> Network:
        """See `LearnedConfig`."""
        return Perceptron(self, key=key)


class Perceptron(Network):
    """Dense layers with SiLU between them, from all inputs as one list to all displacements; linear without a hidden
    layer."""

    layers: tuple[Dense, ...]
    readout: Dense

    def __init__(self, config: MLPConfig, *, key: PRNGKeyArray) -> None:
        keys = jax.random.split(key, len(config.hidden) + 1)
        sizes = (2 * config.keypoints + GRIPPERS, *config.hidden)
        self.layers = tuple(Dense(a, b, key=k) for a, b, k in zip(sizes, sizes[1:], keys[1:], strict=False))
        self.readout = Dense(sizes[-1], 2 * config.keypoints, key=keys[0], scale=0.1)

    def __call__(self, inputs: Inputs) -> Float[Array, "n 2"]:
        """See `Network`."""
        row = jnp.concatenate([part.reshape(1, -1) for part in inputs], axis=1)
        for layer in self.layers:
            row = jax.nn.silu(layer(row))
        return self.readout(row).reshape(-1, 2)


@dataclass(frozen=True, kw_only=True)
class RodConfig(LearnedConfig):
    """The visco-elastic rod alone: physics, and seven parameters to learn; takes any number of keypoints.

    Attributes:
        damping_time: tau [s] that learning begins with.
    """

    kind: ClassVar[str] = "rod"
    keypoints: ClassVar[int] = KEYPOINTS  # pyright: ignore[reportIncompatibleVariableOverride]
    damping_time: Positive[float] = CONTROL_STEP

    @property
    def framing(self) -> Framing:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The rod, which is all there is."""
        return Framing(rod=True)

    def rod(self) -> RodParameters:
        """See `LearnedConfig`."""
        return RodParameters(self.damping_time)

    def network(self, key: PRNGKeyArray) -> Network:
        """See `LearnedConfig`."""
        return NoNetwork()


class NoNetwork(Network):
    """No correction."""

    def __call__(self, inputs: Inputs) -> Float[Array, "n 2"]:
        """See `Network`."""
        return jnp.zeros_like(inputs.keypoints)


KINDS: dict[str, type[Any]] = {
    config.kind: config for config in (TransformerConfig, ConvConfig, RecurrentConfig, MLPConfig, RodConfig)
}
"""Configuration of each kind, by the name that configurations and files call it."""


def config_of(kind: str) -> type[Any]:
    """The configuration class of a kind.

    Raises:
        UnknownNameError: There is no such kind.
    """
    if kind not in KINDS:
        raise UnknownNameError("kind of model", kind, KINDS)
    return KINDS[kind]
