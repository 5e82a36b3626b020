"""How a model is trained."""

from __future__ import annotations

import math
from dataclasses import dataclass

from cableway.core.checks import require_at_least, require_not_negative, require_positive
from cableway.core.errors import InputError


@dataclass(frozen=True, kw_only=True)
class TrainingConfig:
    """How a model is trained.

    Attributes:
        epochs: Passes over the data.
        rollout_epochs: How many of them, the last ones, take the loss over `rollout_steps` steps.
        rollout_steps: Steps of the model's own rollout in those epochs.
        batch_size: Transitions per step of the optimiser.
        learning_rate: Of AdamW at its highest, after the warm-up.
        warmup: Fraction of all steps in which the rate rises from 0; it then falls as a cosine.
        weight_decay: Of AdamW.
        gradient_norm: Longer gradients are cut to this norm.
        mirror: Reflect every other sample, by chance.
        swap: Read every other sample from the other end, by chance; right for uniform cables only.
        validation_fraction: Of the episodes, held out.
        patience: Stop after so many epochs without a smaller validation error, and take the weights that had the
            smallest; where None, all epochs are done and the last weights taken.
        devices: Over how many of JAX's devices each batch is spread; the sums of another number of devices are
            rounded otherwise.
        seed: Of weights, split and order.
    """

    epochs: int = 40
    rollout_epochs: int = 10
    rollout_steps: int = 5
    batch_size: int = 256
    learning_rate: float = 3e-3
    warmup: float = 0.03
    weight_decay: float = 1e-4
    gradient_norm: float = 1.0
    mirror: bool = True
    swap: bool = True
    validation_fraction: float = 0.1
    patience: int | None = None
    devices: int = 1
    seed: int = 0

    def __post_init__(self) -> None:
        require_at_least(self, 1, "epochs", "rollout_steps", "batch_size", "devices")
        require_positive(self, "learning_rate", "gradient_norm")
        for name in ("warmup", "validation_fraction"):
            if not 0 < getattr(self, name) < 1:
                raise InputError(f"training.{name} must be between 0 and 1, got {getattr(self, name)!r}")
        if not 0 <= self.rollout_epochs <= self.epochs:
            raise InputError(f"training.rollout_epochs must be from 0 to {self.epochs}, got {self.rollout_epochs!r}")
        require_not_negative(self, "weight_decay")
        if self.patience is not None and self.patience < 1:
            raise InputError(f"training.patience must be at least 1, got {self.patience!r}")
        if self.batch_size % self.devices:
            raise InputError(
                f"training.batch_size must be a multiple of {self.devices} devices, got {self.batch_size!r}"
            )

    def horizon(self, epoch: int) -> int:
        """Steps in the loss of an epoch, counted from 0."""
        return self.rollout_steps if epoch >= self.epochs - self.rollout_epochs else 1


def learning_rate(config: TrainingConfig, fraction: float) -> float:
    """The rate when `fraction` of all steps is done: a linear rise, then half a cosine down to 0."""
    if fraction < config.warmup:
        return config.learning_rate * fraction / config.warmup
    rest = (fraction - config.warmup) / (1.0 - config.warmup)
    return 0.5 * config.learning_rate * (1.0 + math.cos(math.pi * rest))
