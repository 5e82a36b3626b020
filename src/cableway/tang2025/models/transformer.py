"""The transformer deformation model (T-DM) of Tang et al.: DLO encoder, robot encoder, DLO decoder.

Self-attention lets every keypoint see every other. In the decoder's cross-attention the keypoints are the queries,
the gripper poses the keys and the gripper motions the values: each keypoint decides, from where it is and how the
grippers stand, how much of which gripper's motion reaches it.

Note:
    The paper gives no sizes and no position code; `TransformerConfig.paper()` has those of its public code. Layer
    norms come before each block, keypoints carry cosines of their arc length, so their number is not baked in.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from cableway.core.errors import InputError
from cableway.tang2025.models.frames import Framing, Inputs
from cableway.tang2025.models.layers import PLACED, Attention, Dense, FeedForward, LayerNorm, placed
from cableway.tang2025.models.learned import KEYPOINTS, Keypoints, LearnedConfig, Network, Size


@dataclass(frozen=True, kw_only=True)
class TransformerConfig(LearnedConfig):
    """Sizes of the transformer and what surrounds it.

    Attributes:
        width: Numbers a keypoint or gripper is encoded in.
        heads: Attention heads; divides the width.
        encoder_blocks: Self-attention blocks of the DLO encoder.
        decoder_blocks: Cross-attention blocks of the DLO decoder.
        expansion: Width of the layer inside a feed-forward block over `width`.
        keypoints: How many keypoints the network sees; a cable with another number is resampled.
        framing: Frame, blend, hard ends, rod.
    """

    kind: ClassVar[str] = "transformer"
    width: Size = 32
    heads: Size = 4
    encoder_blocks: Size = 2
    decoder_blocks: Size = 1
    expansion: Size = 2
    keypoints: Keypoints = KEYPOINTS
    framing: Framing = field(default_factory=Framing)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.width % self.heads:
            raise InputError(f"transformer.width must be a multiple of its {self.heads} heads, got {self.width!r}")

    def network(self, key: PRNGKeyArray) -> Network:
        """See `LearnedConfig`."""
        return Transformer(self, key=key)

    @classmethod
    def paper(cls) -> TransformerConfig:
        """Sizes of the authors' public code, in plain world coordinates."""
        return cls(width=128, heads=4, encoder_blocks=2, decoder_blocks=1, expansion=4, framing=Framing.plain())


class Block(eqx.Module):
    """Attention among the keypoints, or of the keypoints to the grippers, and two dense layers."""

    attention: Attention
    forward: FeedForward
    norms: tuple[LayerNorm, LayerNorm]

    def __init__(self, config: TransformerConfig, *, key: PRNGKeyArray) -> None:
        keys = jax.random.split(key)
        self.attention = Attention(config.width, config.heads, key=keys[0])
        self.forward = FeedForward(config.width, config.expansion, key=keys[1])
        self.norms = (LayerNorm(config.width), LayerNorm(config.width))

    def __call__(
        self, tokens: Float[Array, "n w"], grippers: tuple[Float[Array, "2 w"], Float[Array, "2 w"]] | None = None
    ) -> Float[Array, "n w"]:
        """Attention, then the dense layers, each added to what came in; `grippers` are keys and values."""
        normed = self.norms[0](tokens)
        tokens = tokens + self.attention(normed, *(grippers or (normed, normed)))
        return tokens + self.forward(self.norms[1](tokens))


class RobotEncoder(eqx.Module):
    """Encodes each gripper's pose and motion, with a one-hot code of its side."""

    pose: tuple[Dense, Dense]
    motion: Dense

    def __init__(self, width: int, *, key: PRNGKeyArray) -> None:
        keys = jax.random.split(key, 3)
        self.pose = (Dense(6, width, key=keys[0]), Dense(width, width, key=keys[1]))
        self.motion = Dense(5, width, key=keys[2])

    def __call__(
        self, poses: Float[Array, "2 4"], motions: Float[Array, "2 3"]
    ) -> tuple[Float[Array, "2 w"], Float[Array, "2 w"]]:
        """Keys from the poses, values from the motions."""
        side = jnp.eye(2, dtype=poses.dtype)
        hidden = jax.nn.silu(self.pose[0](jnp.concatenate([poses, side], axis=1)))
        return self.pose[1](hidden), self.motion(jnp.concatenate([motions, side], axis=1))


class Transformer(Network):
    """DLO encoder, robot encoder and DLO decoder."""

    embedding: Dense
    encoder: tuple[Block, ...]
    robot: RobotEncoder
    decoder: tuple[Block, ...]
    norm: LayerNorm
    readout: Dense

    def __init__(self, config: TransformerConfig, *, key: PRNGKeyArray) -> None:
        encoder_key, decoder_key, robot_key, embedding_key, readout_key = jax.random.split(key, 5)
        self.embedding = Dense(PLACED, config.width, key=embedding_key)
        self.encoder = tuple(Block(config, key=k) for k in jax.random.split(encoder_key, config.encoder_blocks))
        self.robot = RobotEncoder(config.width, key=robot_key)
        self.decoder = tuple(Block(config, key=k) for k in jax.random.split(decoder_key, config.decoder_blocks))
        self.norm = LayerNorm(config.width)
        self.readout = Dense(config.width, 2, key=readout_key, scale=0.1)

    def __call__(self, inputs: Inputs) -> Float[Array, "n 2"]:
        """See `Network`."""
        rows = self.embedding(placed(inputs))
        for block in self.encoder:
            rows = block(rows)
        grippers = self.robot(inputs.poses, inputs.motions)
        for block in self.decoder:
            rows = block(rows, grippers)
        return self.readout(self.norm(rows))
