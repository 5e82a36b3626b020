"""The convolutional deformation model (C-DM): what Tang et al. compare the transformer with.

Every keypoint sees its neighbours, and both grippers as they are: their poses and motions are given to each keypoint.

Note:
    The paper gives no sizes; its public code has two residual blocks of kernel 3. Keypoints carry cosines of their
    arc length, as in the transformer, so that the ends of the cable tell themselves apart from its middle.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from cableway.core.errors import InputError
from cableway.tang2025.models.frames import Framing, Inputs
from cableway.tang2025.models.layers import TOKEN, Dense, LayerNorm, tokens
from cableway.tang2025.models.learned import LearnedModel, Normalization, rod_of
from cableway.tang2025.models.viscoelastic import RodParameters


@dataclass(frozen=True, kw_only=True)
class ConvConfig:
    """Sizes of the network and what surrounds it.

    Attributes:
        width: Numbers a keypoint is encoded in.
        blocks: Residual blocks of two convolutions each.
        framing: Frame, blend, hard ends, rod.
    """

    width: int = 48
    blocks: int = 2
    framing: Framing = field(default_factory=Framing)

    def __post_init__(self) -> None:
        for name in ("width", "blocks"):
            if getattr(self, name) < 1:
                raise InputError(f"conv {name} must be at least 1, got {getattr(self, name)!r}")


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


class ConvModel(LearnedModel):
    """The convolutional deformation model; takes any number of keypoints."""

    config: ConvConfig = eqx.field(static=True)  # pyright: ignore[reportIncompatibleVariableOverride]
    normalization: Normalization
    rod: RodParameters | None
    embedding: Dense
    blocks: tuple[ResidualBlock, ...]
    norm: LayerNorm
    readout: Dense

    def __init__(self, config: ConvConfig, *, key: PRNGKeyArray, normalization: Normalization | None = None) -> None:
        """Random weights, and a normalisation that changes nothing unless one is given."""
        keys = jax.random.split(key, config.blocks + 2)
        self.config = config  # pyright: ignore[reportIncompatibleVariableOverride]
        self.normalization = Normalization.identity() if normalization is None else normalization
        self.rod = rod_of(config.framing)
        self.embedding = Dense(TOKEN, config.width, key=keys[0])
        self.blocks = tuple(ResidualBlock(config.width, key=k) for k in keys[2:])
        self.norm = LayerNorm(config.width)
        self.readout = Dense(config.width, 2, key=keys[1], scale=0.1)

    def network(self, inputs: Inputs) -> Float[Array, "n 2"]:
        """See `LearnedModel`."""
        rows = self.embedding(tokens(inputs))
        for block in self.blocks:
            rows = block(rows)
        return self.readout(self.norm(rows))
