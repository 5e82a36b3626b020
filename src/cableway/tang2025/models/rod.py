"""The rod as a deformation model: physics, and seven parameters to learn."""

from __future__ import annotations

from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from cableway.core.checks import require_positive
from cableway.scene.task import CONTROL_STEP
from cableway.tang2025.models.frames import Framing, Inputs
from cableway.tang2025.models.learned import LearnedModel, Normalization
from cableway.tang2025.models.viscoelastic import RodParameters


@dataclass(frozen=True, kw_only=True)
class RodConfig:
    """Where learning begins.

    Attributes:
        damping_time: tau [s].
    """

    damping_time: float = CONTROL_STEP

    def __post_init__(self) -> None:
        require_positive(self, "damping_time")

    @property
    def framing(self) -> Framing:
        """The rod, which is all there is."""
        return Framing(rod=True)


class RodModel(LearnedModel):
    """The visco-elastic rod of `cableway.tang2025.models.viscoelastic`; takes any number of keypoints."""

    config: RodConfig = eqx.field(static=True)  # pyright: ignore[reportIncompatibleVariableOverride]
    normalization: Normalization
    rod: RodParameters | None

    def __init__(self, config: RodConfig, *, key: PRNGKeyArray, normalization: Normalization | None = None) -> None:
        """The nominal rod; nothing in it is random."""
        self.config = config  # pyright: ignore[reportIncompatibleVariableOverride]
        self.normalization = Normalization.identity() if normalization is None else normalization
        self.rod = RodParameters(config.damping_time)

    def network(self, inputs: Inputs) -> Float[Array, "n 2"]:
        """No correction."""
        return jnp.zeros_like(inputs.keypoints)
