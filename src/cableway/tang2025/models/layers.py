"""Layers of the networks: written for one sample, rows are keypoints or grippers.

Each is a handful of matrix products, so that a Jacobian through several steps compiles and runs fast on one core.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from cableway.tang2025.models.frames import Inputs, arc_fractions

POSITION_WAVES = 6
"""Number of cosines cos(pi k s), k = 1, 2, ..., that encode a keypoint's place s along the cable."""

GRIPPERS = 14
"""Numbers that say how both grippers stand and move."""

PLACED = 2 + POSITION_WAVES
"""Numbers in a row of `placed`."""

TOKEN = PLACED + GRIPPERS
"""Numbers in a row of `tokens`."""

NORM_EPSILON = 1e-5
"""Added to the variance in a layer norm, the usual value."""


class Dense(eqx.Module):
    """x W + b for each row x."""

    weight: Float[Array, "inputs outputs"]
    bias: Float[Array, "outputs"]

    def __init__(self, inputs: int, outputs: int, *, key: PRNGKeyArray, scale: float = 1.0) -> None:
        """Normal weights of variance scale^2 / inputs, zero bias."""
        self.weight = scale * jax.random.normal(key, (inputs, outputs)) / jnp.sqrt(inputs)
        self.bias = jnp.zeros(outputs)

    def __call__(self, rows: Float[Array, "k inputs"]) -> Float[Array, "k outputs"]:
        """x W + b."""
        return rows @ self.weight + self.bias[None]


class LayerNorm(eqx.Module):
    """Each row to mean 0 and variance 1, then scaled and shifted per feature."""

    scale: Float[Array, "width"]
    shift: Float[Array, "width"]

    def __init__(self, width: int) -> None:
        self.scale, self.shift = jnp.ones(width), jnp.zeros(width)

    def __call__(self, rows: Float[Array, "k width"]) -> Float[Array, "k width"]:
        """Normalised rows."""
        centred = rows - jnp.mean(rows, axis=-1, keepdims=True)
        variance = jnp.mean(centred**2, axis=-1, keepdims=True)
        return centred * jax.lax.rsqrt(variance + NORM_EPSILON) * self.scale[None] + self.shift[None]


class FeedForward(eqx.Module):
    """Two dense layers with a SiLU between them."""

    inner: Dense
    outer: Dense

    def __init__(self, width: int, expansion: int, *, key: PRNGKeyArray) -> None:
        keys = jax.random.split(key)
        self.inner = Dense(width, expansion * width, key=keys[0])
        self.outer = Dense(expansion * width, width, key=keys[1])

    def __call__(self, rows: Float[Array, "k width"]) -> Float[Array, "k width"]:
        """Each row through both layers."""
        return self.outer(jax.nn.silu(self.inner(rows)))


class Attention(eqx.Module):
    """Multi-head attention: softmax(Q K^T / sqrt(d)) V per head, heads mixed by a dense layer."""

    query: Dense
    key: Dense
    value: Dense
    mix: Dense
    heads: int = eqx.field(static=True)

    def __init__(self, width: int, heads: int, *, key: PRNGKeyArray) -> None:
        keys = jax.random.split(key, 4)
        self.query, self.key, self.value, self.mix = (Dense(width, width, key=k) for k in keys)
        self.heads = heads

    def __call__(
        self, queries: Float[Array, "n width"], keys: Float[Array, "m width"], values: Float[Array, "m width"]
    ) -> Float[Array, "n width"]:
        """One row for each query."""
        q, k, v = (
            self._split(layer(rows)) for layer, rows in ((self.query, queries), (self.key, keys), (self.value, values))
        )
        scores = jnp.einsum("nhd,mhd->hnm", q, k) / jnp.sqrt(q.shape[-1])
        heads = jnp.einsum("hnm,mhd->nhd", jax.nn.softmax(scores, axis=-1), v)
        return self.mix(heads.reshape(len(queries), -1))

    def _split(self, rows: Float[Array, "k width"]) -> Float[Array, "k heads d"]:
        return rows.reshape(len(rows), self.heads, -1)


def placed(inputs: Inputs) -> Float[Array, "n k"]:
    """A row for each keypoint: its position, and cos(pi k s) of its arc fraction s for k = 1 to `POSITION_WAVES`."""
    waves = np.outer(arc_fractions(len(inputs.keypoints)), np.arange(1, POSITION_WAVES + 1))
    return jnp.concatenate([inputs.keypoints, jnp.asarray(np.cos(np.pi * waves), jnp.float32)], axis=1)


def tokens(inputs: Inputs) -> Float[Array, "n k"]:
    """The same, and in each row both grippers."""
    grippers = jnp.concatenate([inputs.poses.ravel(), inputs.motions.ravel()])
    return jnp.concatenate([placed(inputs), jnp.broadcast_to(grippers, (len(inputs.keypoints), GRIPPERS))], axis=1)
