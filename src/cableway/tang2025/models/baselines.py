"""Models that learn nothing: what a learned model has to beat."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from cableway.tang2025.models.base import DeformationModel
from cableway.tang2025.models.frames import end_motion_blend


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
