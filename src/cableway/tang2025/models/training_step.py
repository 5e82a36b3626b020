"""One step of training: augmentation, loss, gradient and AdamW, compiled as one.

The loss is the paper's (Tang et al., the mean of ||delta s - f(s, y, a)||^2), in units of the cable's length and of
the root mean square of what the network has to predict, so that it starts near 1 for every model and length.

Note:
    The paper does not take the loss over several steps of the model's own rollout. Mirrored and swapped samples are
    ours too.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, PRNGKeyArray

from cableway.tang2025.models import dataset
from cableway.tang2025.models.base import rollout
from cableway.tang2025.models.dataset import Windows
from cableway.tang2025.models.frames import frame_of
from cableway.tang2025.models.learned import LearnedModel, trainable


class CompiledStep(NamedTuple):
    """An optimiser and one step of it: (model, state, batch, rate, key) to (model, state, loss)."""

    optimizer: optax.GradientTransformation
    update: Callable[..., Any]


@cache
def compiled_step(gradient_norm: float, weight_decay: float, mirror: bool, swap: bool) -> CompiledStep:
    """The optimiser and one compiled step of it, shared by all trainings of a process that it suits."""
    optimizer = optax.chain(optax.clip_by_global_norm(gradient_norm), optax.adamw(1.0, weight_decay=weight_decay))

    @eqx.filter_jit
    def update(model: LearnedModel, state: Any, batch: Windows, rate: Array, key: PRNGKeyArray) -> Any:
        trained, fixed = eqx.partition(model, trainable(model))
        batch = _augmented(batch, mirror, swap, key)
        loss, gradient = jax.value_and_grad(lambda part: _loss(eqx.combine(part, fixed), batch))(trained)
        change, state = optimizer.update(gradient, state, trained)
        trained = jax.tree.map(lambda weight, step: weight + rate * step, trained, change)
        return eqx.combine(trained, fixed), state, loss

    return CompiledStep(optimizer, update)


def _augmented(batch: Windows, mirror: bool, swap: bool, key: PRNGKeyArray) -> Windows:
    """Each sample mirrored, and swapped, with probability one half, where asked for."""
    keys, count = jax.random.split(key), len(batch.keypoints)
    if mirror:
        batch = dataset.mirrored(batch, jax.random.bernoulli(keys[0], shape=(count,)))
    if swap:
        batch = dataset.swapped(batch, jax.random.bernoulli(keys[1], shape=(count,)))
    return batch


def _loss(model: LearnedModel, batch: Windows) -> Float[Array, ""]:
    """Mean square of the error, in units of cable length and of what the network has to predict."""

    def sample(keypoints: Array, poses: Array, actions: Array, targets: Array) -> Array:
        unit = frame_of(model.config.framing, keypoints, poses).unit * model.normalization.output
        return jnp.mean(((rollout(model, keypoints, poses, actions) - targets) / unit) ** 2)

    return jnp.mean(jax.vmap(sample)(*batch))
