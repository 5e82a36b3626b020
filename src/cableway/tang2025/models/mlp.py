"""The multi-layer perceptron; without hidden layers it is the linear model.

Both see all keypoints and both grippers as one list of numbers, so they serve one number of keypoints only.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from cableway.core.errors import InputError
from cableway.tang2025.models.frames import Framing, Inputs
from cableway.tang2025.models.layers import GRIPPERS, Dense
from cableway.tang2025.models.learned import LearnedModel, Normalization, rod_of
from cableway.tang2025.models.viscoelastic import RodParameters


@dataclass(frozen=True, kw_only=True)
class MLPConfig:
    """Sizes of the network and what surrounds it.

    Attributes:
        hidden: Widths of the hidden layers; none of them for the linear model.
        keypoints: The number of keypoints it serves.
        framing: Frame, blend, hard ends, rod.
    """

    hidden: tuple[int, ...] = (128, 128)
    keypoints: int = 13
    framing: Framing = field(default_factory=Framing)

    def __post_init__(self) -> None:
        if any(width < 1 for width in self.hidden):
            raise InputError(f"mlp hidden widths must be at least 1, got {self.hidden!r}")
        if self.keypoints < 3:
            raise InputError(f"mlp keypoints must be at least 3, got {self.keypoints!r}")


class MLPModel(LearnedModel):
    """Dense layers with SiLU between them, from all that is seen to all that moves."""

    config: MLPConfig = eqx.field(static=True)  # pyright: ignore[reportIncompatibleVariableOverride]
    normalization: Normalization
    rod: RodParameters | None
    layers: tuple[Dense, ...]
    readout: Dense

    def __init__(self, config: MLPConfig, *, key: PRNGKeyArray, normalization: Normalization | None = None) -> None:
        """Random weights, and a normalisation that changes nothing unless one is given."""
        keys = jax.random.split(key, len(config.hidden) + 1)
        sizes = (2 * config.keypoints + GRIPPERS, *config.hidden)
        self.config = config  # pyright: ignore[reportIncompatibleVariableOverride]
        self.normalization = Normalization.identity() if normalization is None else normalization
        self.rod = rod_of(config.framing)
        self.layers = tuple(Dense(a, b, key=k) for a, b, k in zip(sizes, sizes[1:], keys[1:], strict=False))
        self.readout = Dense(sizes[-1], 2 * config.keypoints, key=keys[0], scale=0.1)

    def network(self, inputs: Inputs) -> Float[Array, "n 2"]:
        """See `LearnedModel`.

        Raises:
            InputError: The cable has another number of keypoints.
        """
        if len(inputs.keypoints) != self.config.keypoints:
            raise InputError(
                f"this model serves {self.config.keypoints} keypoints only, the cable has {len(inputs.keypoints)}"
            )
        row = jnp.concatenate([part.reshape(1, -1) for part in inputs], axis=1)
        for layer in self.layers:
            row = jax.nn.silu(layer(row))
        return self.readout(row).reshape(-1, 2)
