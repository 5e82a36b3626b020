"""The interface of every deformation model: how the cable moves when the grippers move."""

from __future__ import annotations

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from cableway.tang2025.models.frames import end_motion_blend


class DeformationModel(eqx.Module):
    """Predicts the displacement of the keypoints in one control step, delta s = f(s, y, a) (Tang et al.).

    A model takes one sample; `jax.vmap` makes it take many, `jax.jacfwd` gives its exact Jacobian.
    """

    @abc.abstractmethod
    def __call__(
        self,
        keypoints: Float[Array, "n 2"],
        poses: Float[Array, "2 3"],
        action: Float[Array, "2 3"],
    ) -> Float[Array, "n 2"]:
        """Displacement [m] of each keypoint in the step.

        Args:
            keypoints: (n, 2) [m] before the step, at equal arc length, left gripper first.
            poses: (2, 3) gripper poses (x, y, theta) [m, m, rad] before the step.
            action: (2, 3) gripper motion (dx, dy, dtheta) [m, m, rad] of the step, in the world frame.
        """


def rollout(
    model: DeformationModel,
    keypoints: Float[Array, "n 2"],
    poses: Float[Array, "2 3"],
    actions: Float[Array, "H 2 3"],
) -> Float[Array, "H n 2"]:
    """Shapes after each of H steps: s_{k+1} = s_k + f(s_k, y_k, a_k) and y_{k+1} = y_k + a_k.

    Args:
        model: The deformation model.
        keypoints: (n, 2) [m] before the first step.
        poses: (2, 3) gripper poses [m, m, rad] before the first step.
        actions: (H, 2, 3) gripper motions [m, m, rad].
    """

    def step(state: tuple[Array, Array], action: Array) -> tuple[tuple[Array, Array], Array]:
        shape, grippers = state
        shape = shape + model(shape, grippers, action)
        return (shape, grippers + action), shape

    start = (jnp.asarray(keypoints, jnp.float32), jnp.asarray(poses, jnp.float32))
    actions = jnp.asarray(actions, jnp.float32)
    if len(actions) == 1:  # a loop would carry derivatives by the parameters through all of the network
        return step(start, actions[0])[1][None]
    return jax.lax.scan(step, start, actions)[1]


class Persistence(DeformationModel):
    """Nothing moves."""

    def __call__(
        self, keypoints: Float[Array, "n 2"], poses: Float[Array, "2 3"], action: Float[Array, "2 3"]
    ) -> Float[Array, "n 2"]:
        """See `DeformationModel`."""
        return jnp.zeros_like(jnp.asarray(keypoints, jnp.float32))


class RigidBlend(DeformationModel):
    """Every keypoint moves by the end-motion blend: the rigid motions of the two grippers, interpolated."""

    def __call__(
        self, keypoints: Float[Array, "n 2"], poses: Float[Array, "2 3"], action: Float[Array, "2 3"]
    ) -> Float[Array, "n 2"]:
        """See `DeformationModel`."""
        return end_motion_blend(jnp.asarray(keypoints), jnp.asarray(poses), jnp.asarray(action))
