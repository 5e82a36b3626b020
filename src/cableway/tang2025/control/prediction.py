"""The model's rollout over the horizon and its derivative by the actions, compiled once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from cableway.tang2025.models.base import DeformationModel, rollout


@dataclass(frozen=True)
class Predictor:
    """Predicts the shapes that a sequence of actions makes.

    Attributes:
        horizon: H, number of actions.
    """

    horizon: int
    _weights: list[jax.Array]
    _shapes: Callable[..., jax.Array]
    _linearized: Callable[..., tuple[jax.Array, ...]]

    def of(self, model: DeformationModel) -> Predictor:
        """The same for a model that differs from the compiled one in its weights alone."""
        return replace(self, _weights=jax.tree.leaves(eqx.filter(model, eqx.is_array)))

    def shapes(
        self,
        keypoints: Float[np.ndarray, "n 2"],
        poses: Float[np.ndarray, "2 3"],
        actions: Float[np.ndarray, "H 2 3"],
    ) -> Float[np.ndarray, "H n 2"]:
        """Keypoints [m] after each action."""
        return np.asarray(self._shapes(self._weights, *_single(keypoints, poses, actions)), float)

    def linearized(
        self,
        keypoints: Float[np.ndarray, "n 2"],
        poses: Float[np.ndarray, "2 3"],
        actions: Float[np.ndarray, "H 2 3"],
    ) -> tuple[Float[np.ndarray, "H n 2"], Float[np.ndarray, "H n 2 a"]]:
        """Keypoints [m] after each action, and their derivative by all a = 6 H numbers of the actions."""
        shapes, by_shape, by_poses, by_action = (
            np.asarray(array, float) for array in self._linearized(self._weights, *_single(keypoints, poses, actions))
        )
        count, points = shapes.shape[:2]
        jacobian = np.zeros((count, 2 * points, count, 6))
        before = np.zeros((2 * points, count, 6))
        for k in range(count):
            after = np.tensordot(by_shape[k], before, axes=1)
            after[:, :k] += by_poses[k][:, None]  # the poses before step k are the sum of the actions before it
            after[:, k] += by_action[k]
            jacobian[k] = before = after
        return shapes, jacobian.reshape(count, points, 2, 6 * count)


def compile_predictor(model: DeformationModel, horizon: int, keypoints: int) -> Predictor:
    """Compile the rollout of `model` for `horizon` actions and a cable of `keypoints` points."""
    arrays, rest = eqx.partition(model, eqx.is_array)
    # A flat list, because JAX would take a model apart anew at every call.
    weights, structure = jax.tree.flatten(arrays)

    def shapes(weights: list[jax.Array], keypoints: jax.Array, poses: jax.Array, actions: jax.Array) -> jax.Array:
        return rollout(eqx.combine(jax.tree.unflatten(structure, weights), rest), keypoints, poses, actions)

    def linearized(
        weights: list[jax.Array], keypoints: jax.Array, poses: jax.Array, actions: jax.Array
    ) -> tuple[jax.Array, ...]:
        """The shape after each step, and its derivative by shape, poses and action of that step alone.

        Backwards, because a shape has fewer numbers than shape, poses and actions together.
        """
        model = eqx.combine(jax.tree.unflatten(structure, weights), rest)

        def after(keypoints: jax.Array, poses: jax.Array, action: jax.Array) -> tuple[jax.Array, jax.Array]:
            shape = keypoints + model(keypoints, poses, action)
            return shape, shape

        def step(state: tuple[jax.Array, jax.Array], action: jax.Array) -> Any:
            jacobians, shape = jax.jacrev(after, argnums=(0, 1, 2), has_aux=True)(*state, action)
            rows = shape.size
            return (shape, state[1] + action), (shape, *(jacobian.reshape(rows, -1) for jacobian in jacobians))

        return jax.lax.scan(step, (keypoints, poses), actions)[1]

    example = _single(np.zeros((keypoints, 2)), np.zeros((2, 3)), np.zeros((horizon, 2, 3)))
    compiled = [jax.jit(function) for function in (shapes, linearized)]
    for function in compiled:
        jax.block_until_ready(function(weights, *example))
    return Predictor(horizon, weights, *compiled)


def _single(*arrays: np.ndarray) -> tuple[np.ndarray, ...]:
    return tuple(np.asarray(array, np.float32) for array in arrays)
