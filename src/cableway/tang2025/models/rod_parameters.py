"""The physical parameters of a cable that its motion between two grippers shows."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cableway.rod.planar import hinge_count
from cableway.scene.task import CONTROL_STEP
from cableway.tang2025.models.viscoelastic import Material, rod_step


class RodParameters(eqx.Module):
    """A visco-elastic rod in seven numbers; all are 0 for the nominal, uniform and straight, cable.

    With x from -1 at the left grasp to 1 at the right one, the stiffness is proportional to
    exp(k_1 x + k_2 (x^2 - 1/3)), and the curvature at rest times the length is r_1 x + r_2 (x^2 - 1/3). What is the
    same along the whole cable, a factor on the stiffness or a curvature, moves no cable between clamped ends, so it
    is left out. The length is read from the keypoints in every step.

    Attributes:
        damping: Logarithm of tau over the control step of 0.1 s.
        stiffness: (k_1, k_2).
        rest: (r_1, r_2) [rad].
        grasp: Direction of the cable's ends against the grippers' [rad], left then right.
    """

    damping: Float[Array, ""]
    stiffness: Float[Array, "2"]
    rest: Float[Array, "2"]
    grasp: Float[Array, "2"]

    def __init__(self, damping_time: float = CONTROL_STEP) -> None:
        self.damping = jnp.asarray(np.log(damping_time / CONTROL_STEP), jnp.float32)
        self.stiffness, self.rest, self.grasp = jnp.zeros(2), jnp.zeros(2), jnp.zeros(2)

    def __call__(
        self, keypoints: Float[Array, "n 2"], poses: Float[Array, "2 3"], action: Float[Array, "2 3"]
    ) -> Float[Array, "n 2"]:
        """Displacement [m] of the keypoints in one control step."""
        return rod_step(self.material(hinge_count(len(keypoints))), keypoints, poses, action)

    def material(self, hinges: int) -> Material:
        """The material of a chain."""
        x = np.linspace(-1.0, 1.0, 2 * hinges + 1, dtype=np.float32)[1::2]
        modes = jnp.asarray(np.stack([x, x * x - 1.0 / 3.0]))
        return Material(
            relaxation=jnp.exp(self.damping),
            stiffness=jnp.exp(self.stiffness @ modes),
            rest=self.rest @ modes / hinges,
            grasp=self.grasp,
        )
