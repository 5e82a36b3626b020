"""What learned models share: framing, normalisation, and the network between them."""

from __future__ import annotations

import abc
from typing import Annotated, ClassVar, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from cableway.core.checks import Bounds, Checked
from cableway.datasets.transitions import Transitions
from cableway.tang2025.models import frames
from cableway.tang2025.models.base import DeformationModel
from cableway.tang2025.models.frames import Framing, Inputs
from cableway.tang2025.models.viscoelastic import RodParameters

SMALLEST_SPREAD = 1e-6
"""Standard deviation below which an input counts as constant and is not divided by it."""

KEYPOINTS = 13
"""Number of keypoints that a network sees unless its configuration says otherwise."""

LARGEST_SIZE = 1024
"""Of anything that is counted in a network; one with more would take minutes to compile."""

Size = Annotated[int, Bounds(1, LARGEST_SIZE)]
Keypoints = Annotated[int, Bounds(3, LARGEST_SIZE)]
"""Fewer than three show no bend."""


class Network(eqx.Module):
    """What a learned model adds to physics or to the end-motion blend."""

    @abc.abstractmethod
    def __call__(self, inputs: Inputs) -> Float[Array, "n 2"]:
        """Normalised correction of each keypoint from normalised inputs."""


class LearnedConfig(Checked, abc.ABC):
    """A learned model's configuration: it makes the network, with random weights."""

    kind: ClassVar[str]
    keypoints: int
    framing: Framing

    @abc.abstractmethod
    def network(self, key: PRNGKeyArray) -> Network:
        """The network."""

    def rod(self) -> RodParameters | None:
        """The nominal rod, where the framing asks for one."""
        return RodParameters() if self.framing.rod else None


class Scaling(eqx.Module):
    """An input's mean and standard deviation, per feature."""

    mean: Float[Array, "*features"]
    spread: Float[Array, "*features"]

    def __call__(self, values: Float[Array, "... *features"]) -> Float[Array, "... *features"]:
        """Values with mean 0 and standard deviation 1 over the training data."""
        mean, spread = (jnp.broadcast_to(part, values.shape) for part in (self.mean, self.spread))
        return (values - mean) / spread

    @classmethod
    def identity(cls, *shape: int) -> Self:
        """No change."""
        return cls(jnp.zeros(shape), jnp.ones(shape))

    @classmethod
    def fitted(cls, values: Float[np.ndarray, "m *features"]) -> Self:
        """Mean and standard deviation over the first axis."""
        mean, spread = values.mean(0), values.std(0)
        spread = np.where(spread < SMALLEST_SPREAD, 1.0, spread)
        return cls(jnp.asarray(mean, jnp.float32), jnp.asarray(spread, jnp.float32))


class Normalization(eqx.Module):
    """Scales of a network's inputs and output in its frame's units; measured, not trained.

    Attributes:
        keypoints: Of (x, y), the same for all keypoints.
        poses: Of each gripper's pose features (2, 4).
        motions: Of (dx, dy, dtheta), the same for both grippers.
        output: Root mean square of what the network has to predict.
    """

    keypoints: Scaling
    poses: Scaling
    motions: Scaling
    output: Float[Array, ""]

    @classmethod
    def identity(cls) -> Self:
        """No change, for a model without data."""
        return cls(Scaling.identity(2), Scaling.identity(2, 4), Scaling.identity(3), jnp.ones(()))

    @classmethod
    def fitted(cls, framing: Framing, data: Transitions) -> Self:
        """Measured on a data set."""
        rod = RodParameters() if framing.rod else None
        inputs, target = jax.jit(jax.vmap(lambda *sample: _network_view(framing, rod, *sample)))(
            *(jnp.asarray(part, jnp.float32) for part in (data.keypoints, data.poses, data.actions)),
            jnp.asarray(data.next_keypoints - data.keypoints, jnp.float32),
        )
        found = [np.asarray(part, float) for part in inputs]
        return cls(
            keypoints=Scaling.fitted(found[0].reshape(-1, 2)),
            poses=Scaling.fitted(found[1]),
            motions=Scaling.fitted(found[2].reshape(-1, 3)),
            output=jnp.asarray(np.sqrt(np.mean(np.asarray(target, float) ** 2)), jnp.float32),
        )

    def __call__(self, inputs: Inputs) -> Inputs:
        """Normalised inputs."""
        return Inputs(self.keypoints(inputs.keypoints), self.poses(inputs.poses), self.motions(inputs.motions))


def _network_view(
    framing: Framing, rod: RodParameters | None, keypoints: Array, poses: Array, action: Array, displacement: Array
) -> tuple[Inputs, Array]:
    """Inputs, and what is left to predict, in the frame's units."""
    frame = frames.frame_of(framing, keypoints, poses)
    left = displacement - _base(framing, rod, keypoints, poses, action)
    return frames.express(framing, frame, keypoints, poses, action), left @ frame.axes / frame.unit


def _base(framing: Framing, rod: RodParameters | None, keypoints: Array, poses: Array, action: Array) -> Array:
    """What the network's output is added to [m]."""
    if rod is not None:
        return rod(keypoints, poses, action)
    return frames.base_displacement(framing, keypoints, poses, action)


class LearnedModel(DeformationModel):
    """A network inside a framing: f = base + window * output * network(normalised inputs)."""

    config: LearnedConfig = eqx.field(static=True)
    normalization: Normalization
    rod: RodParameters | None
    network: Network

    def __init__(self, config: LearnedConfig, *, key: PRNGKeyArray, normalization: Normalization | None = None) -> None:
        """Random weights, and a normalisation that changes nothing unless one is given."""
        self.config = config
        self.normalization = Normalization.identity() if normalization is None else normalization
        self.rod = config.rod()
        self.network = config.network(key)

    @property
    def parameters(self) -> int:
        """Number of trained numbers."""
        return sum(leaf.size for leaf in jax.tree.leaves(eqx.filter(self, trainable(self))))

    @property
    def last_layer(self) -> eqx.Module | None:
        """What reads the correction off the network's last features; None where there is no network."""
        return getattr(self.network, "readout", None)

    def __call__(
        self, keypoints: Float[Array, "n 2"], poses: Float[Array, "2 3"], action: Float[Array, "2 3"]
    ) -> Float[Array, "n 2"]:
        """See `DeformationModel`."""
        framing = self.config.framing
        seen = frames.resampled(keypoints, self.config.keypoints)
        frame = frames.frame_of(framing, seen, poses)
        output = self.network(self.normalization(frames.express(framing, frame, seen, poses, action)))
        output = frames.resampled(output, len(keypoints))
        correction = self.normalization.output * frame.unit * output @ frame.axes.T
        window = jnp.asarray(frames.correction_window(framing, len(keypoints)))[:, None]
        return _base(framing, self.rod, keypoints, poses, action) + window * correction


def trainable(model: LearnedModel) -> LearnedModel:
    """A tree of booleans: which leaves of a model training may change."""
    mask = jax.tree.map(eqx.is_inexact_array, model)
    frozen = jax.tree.map(lambda _: False, model.normalization)
    return eqx.tree_at(lambda tree: tree.normalization, mask, frozen)
