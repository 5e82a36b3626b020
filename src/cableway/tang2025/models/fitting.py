"""Fit a few parameters of a model to windows: robust, drawn towards where they were, by Gauss-Newton steps."""

from __future__ import annotations

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from cableway.tang2025.models.base import rollout
from cableway.tang2025.models.dataset import Windows
from cableway.tang2025.models.frames import frame_of
from cableway.tang2025.models.learned import LearnedModel

LEAST_NOISE = 2e-3
"""Root mean square of the residuals, in lengths of the cable, below which they are not trusted further."""

ROD_SPREAD = (0.35, 0.5, 0.5 * 2 / 3, 0.4, 0.4 * 2 / 3, 0.05, 0.05)
"""How far the parameters of a rod may be from the first ones: damping, stiffness, rest, grasp. The second modes have
spreads of 0.5 and 0.4 as factors of x^2 - 1/3 = 2/3 P_2."""

WEIGHT_SPREAD = 0.1
"""The same for the weights of a last layer, as a share of their root mean square."""


@dataclass(frozen=True, kw_only=True)
class Fit:
    """How parameters are fitted.

    Attributes:
        iterations: Gauss-Newton steps.
        outlier: Windows with residuals above so many times the median count less, in inverse proportion; above the
            square of it, not at all.
    """

    iterations: int = 3
    outlier: float = 3.0


def adaptable(model: LearnedModel) -> LearnedModel:
    """A tree of booleans: the parameters of the rod where there is one, else the last layer of the network."""
    nothing = jax.tree.map(lambda _: False, model)
    if model.rod is not None:
        return eqx.tree_at(lambda tree: tree.rod, nothing, jax.tree.map(lambda _: True, model.rod))
    return eqx.tree_at(lambda tree: tree.last_layer, nothing, jax.tree.map(lambda _: True, model.last_layer))


def parameters_of(model: LearnedModel) -> Float[Array, "p"]:
    """The parameters that may change, as one list."""
    return ravel_pytree(eqx.filter(model, adaptable(model)))[0]


def with_parameters(model: LearnedModel, values: Float[Array, "p"]) -> LearnedModel:
    """The model with other parameters."""
    part, rest = eqx.partition(model, adaptable(model))
    return eqx.combine(ravel_pytree(part)[1](values), rest)


def fit(model: LearnedModel, batch: Windows, first: Float[np.ndarray, "p"], config: Fit) -> LearnedModel:
    """The model with parameters that predict the windows best.

    Minimises the mean squared residual of each window over its variance plus the squared distance to `first` over its
    own. A window counts once, however many numbers it has: what a model cannot describe errs alike in all of them.

    Args:
        model: Where to begin.
        batch: Windows.
        first: Where the parameters are drawn to.
        config: How.
    """
    values = np.asarray(parameters_of(model), float)
    spread = np.array(ROD_SPREAD) if model.rod is not None else WEIGHT_SPREAD * np.sqrt(np.mean(first**2) + 1e-12)
    pull = np.broadcast_to(1.0 / np.square(spread), values.shape)
    for _ in range(config.iterations):
        matrix, right, variance = _normal_equations(model, jnp.asarray(values, jnp.float32), batch, config.outlier)
        noise = max(float(variance), LEAST_NOISE**2) * batch.targets[0].size
        system = np.asarray(matrix, float) / noise + np.diag(pull)
        values = values - np.linalg.solve(system, np.asarray(right, float) / noise + pull * (values - first))
    return with_parameters(model, jnp.asarray(values, jnp.float32))


@eqx.filter_jit
def _normal_equations(
    model: LearnedModel, values: Float[Array, "p"], batch: Windows, outlier: float
) -> tuple[Float[Array, "p p"], Float[Array, "p"], Float[Array, ""]]:
    """J' W J, J' W r and the variance of the residuals r, in lengths of the cable."""

    def residuals(values: Array) -> Float[Array, "k r"]:
        changed = with_parameters(model, values)

        def window(keypoints: Array, poses: Array, actions: Array, targets: Array) -> Array:
            left = rollout(changed, keypoints, poses, actions) - targets
            return (left / frame_of(model.config.framing, keypoints, poses).unit).ravel()

        return jax.vmap(window)(*batch)

    missed, slopes = residuals(values), jax.jacfwd(residuals)(values)
    size = jnp.sqrt(jnp.mean(missed**2, axis=1))
    sound = jnp.isfinite(size) & jnp.all(jnp.isfinite(slopes), axis=(1, 2))
    typical = jnp.nanmedian(jnp.where(sound, size, jnp.nan))
    # a window that is far out has lost its shape, and its slopes with it
    sound = sound & (size <= outlier**2 * typical)
    missed, slopes = jnp.where(sound[:, None], missed, 0.0), jnp.where(sound[:, None, None], slopes, 0.0)
    weight = jnp.minimum(1.0, outlier * typical / (jnp.where(sound, size, 1.0) + 1e-12))
    matrix = jnp.einsum("k,krp,krq->pq", weight, slopes, slopes)
    return matrix, jnp.einsum("k,krp,kr->p", weight, slopes, missed), typical**2
