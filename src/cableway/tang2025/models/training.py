"""Training a learned model on transitions: AdamW on mini-batches, resumable after every epoch, the same every time."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from cableway.core.errors import InputError
from cableway.records import Transitions
from cableway.tang2025.models import dataset
from cableway.tang2025.models.dataset import Windows
from cableway.tang2025.models.evaluation import open_loop_errors
from cableway.tang2025.models.kinds import build
from cableway.tang2025.models.learned import LearnedConfig, LearnedModel, Normalization, trainable
from cableway.tang2025.models.training_config import TrainingConfig, learning_rate
from cableway.tang2025.models.training_state import EpochRecord, TrainingState, read_state, write_state
from cableway.tang2025.models.training_step import compiled_step

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class TrainingResult:
    """A trained model.

    Attributes:
        model: With the weights after the last epoch, or the best ones where there is `patience`.
        history: One row per epoch.
        training_data: The episodes it was trained on.
        validation_data: The episodes it has not seen.
    """

    model: LearnedModel
    history: tuple[EpochRecord, ...]
    training_data: Transitions
    validation_data: Transitions


def train(
    model_config: LearnedConfig,
    data: Transitions,
    config: TrainingConfig,
    *,
    start: LearnedModel | None = None,
    state_file: Path | None = None,
    progress: Progress | None = None,
) -> TrainingResult:
    """Train a model; interrupted and called again with the same arguments, it ends with the same weights.

    Args:
        model_config: Which model.
        data: Transitions of at least two episodes.
        config: How.
        start: A model of this configuration to go on from, with its normalisation; random weights where None.
        state_file: Where the state goes after every epoch, and what to resume from if it is there. It is removed
            at the end.
        progress: Called after every step with the stage, in words with loss and validation error, and the fraction
            done.

    Raises:
        InputError: The data are too few, `state_file` belongs to another training, there are fewer devices than
            asked for, or the training diverged.
        FileFormatError: `state_file` is damaged.
    """
    training_data, validation_data = dataset.split_by_episode(data, config.validation_fraction, config.seed)
    trainer = _Trainer(model_config, training_data, config)
    identity = {"model": repr(model_config), "training": repr(config), "data": dataset.fingerprint(data)}
    if start is not None:
        identity["start"] = _weights_fingerprint(start)
    state = trainer.start(start)
    if state_file is not None and state_file.exists():
        state = read_state(state_file, state, identity)
    while len(state.history) < config.epochs and not _waited(state.history, config.patience):
        state = trainer.epoch(state, validation_data, progress)
        if state_file is not None:
            write_state(state_file, state, identity)
    if state_file is not None:
        state_file.unlink(missing_ok=True)
    model = state.model if config.patience is None else state.best
    return TrainingResult(model, state.history, training_data, validation_data)


def _waited(history: tuple[EpochRecord, ...], patience: int | None) -> bool:
    """Whether the validation error has not fallen for so many epochs."""
    if patience is None or not history:
        return False
    best = min(range(len(history)), key=lambda epoch: history[epoch].validation_error)
    return len(history) - 1 - best >= patience


def _weights_fingerprint(model: LearnedModel) -> str:
    """SHA-256 of a model's arrays, in hexadecimal."""
    digest = hashlib.sha256()
    for leaf in jax.tree.leaves(eqx.filter(model, eqx.is_array)):
        digest.update(np.asarray(leaf).tobytes())
    return digest.hexdigest()


class _Trainer:
    """What stays the same throughout a training; the state is passed through."""

    def __init__(self, model_config: LearnedConfig, data: Transitions, config: TrainingConfig) -> None:
        self.config, self.data, self.model_config = config, data, model_config
        horizons = [config.horizon(epoch) for epoch in range(config.epochs)]
        by_horizon = {horizon: dataset.window_starts(data.episode, horizon) for horizon in set(horizons)}
        if not all(len(starts) for starts in by_horizon.values()):
            raise InputError(f"no training episode has rollout_steps = {config.rollout_steps} or more steps")
        self.starts = [by_horizon[horizon] for horizon in horizons]
        self.steps = [self._steps(epoch) for epoch in range(config.epochs)]
        self.devices = _devices(config.devices)
        self.optimizer, self.update = compiled_step(
            config.gradient_norm, config.weight_decay, config.mirror, config.swap
        )

    def _batch_size(self, epoch: int) -> int:
        return min(self.config.batch_size, self._samples(epoch))

    def _samples(self, epoch: int) -> int:
        """Windows of an epoch: as many as cover the data once."""
        return max(1, len(self.starts[epoch]) // self.config.horizon(epoch))

    def _steps(self, epoch: int) -> int:
        return self._samples(epoch) // self._batch_size(epoch)

    def start(self, model: LearnedModel | None) -> TrainingState:
        """Random weights and the normalisation of the data, unless there is a model to go on from."""
        if model is None:
            normalization = Normalization.fitted(self.model_config.framing, self.data)
            model = build(self.model_config, key=jax.random.key(self.config.seed), normalization=normalization)
        return TrainingState(model, model, self.optimizer.init(eqx.filter(model, trainable(model))), ())

    def epoch(self, state: TrainingState, validation: Transitions, progress: Progress | None) -> TrainingState:
        """The state after one more epoch; its order comes from the seed and the epoch's number alone."""
        epoch, horizon = len(state.history), self.config.horizon(len(state.history))
        rng = np.random.default_rng([self.config.seed, epoch])
        key = jax.random.fold_in(jax.random.key(self.config.seed), epoch)
        order, size = rng.permutation(self.starts[epoch]), self._batch_size(epoch)
        model, optimizer_state, total = *self._everywhere(state.model, state.optimizer), 0.0
        done = sum(self.steps[:epoch])
        for step in range(self.steps[epoch]):
            batch = self._spread(dataset.windows(self.data, order[step * size : (step + 1) * size], horizon))
            rate = jnp.asarray(learning_rate(self.config, (done + step) / sum(self.steps)), jnp.float32)
            model, optimizer_state, loss = self.update(
                model, optimizer_state, batch, rate, jax.random.fold_in(key, step)
            )
            total += float(loss)
            if progress is not None:
                progress(self._stage(state.history, total / (step + 1)), (done + step + 1) / sum(self.steps))
        if not np.isfinite(total):
            raise InputError(f"training diverged in epoch {epoch + 1}; a lower learning_rate is needed")
        error = 1e3 * float(np.mean(open_loop_errors(model, validation, (1,), stride=1)[1]))
        record = EpochRecord(epoch=epoch + 1, loss=total / self.steps[epoch], validation_error=error)
        better = all(error < row.validation_error for row in state.history)
        return TrainingState(model, model if better else state.best, optimizer_state, (*state.history, record))

    def _spread(self, batch: Windows) -> Windows:
        """A batch with its samples shared out among the devices."""
        if self.devices is None or len(batch.keypoints) % self.config.devices:
            return batch
        return jax.device_put(batch, NamedSharding(self.devices, PartitionSpec("samples")))

    def _everywhere(self, model: LearnedModel, optimizer: Any) -> tuple[LearnedModel, Any]:
        """Weights and state of the optimiser on every device."""
        if self.devices is None:
            return model, optimizer
        return eqx.filter_shard((model, optimizer), NamedSharding(self.devices, PartitionSpec()))

    def _stage(self, history: tuple[EpochRecord, ...], loss: float) -> str:
        validation = f", validation {history[-1].validation_error:.2f} mm" if history else ""
        return f"epoch {len(history) + 1}/{self.config.epochs}, loss {loss:.3g}{validation}"


def _devices(count: int) -> Mesh | None:
    """The first `count` devices; None for one."""
    if count == 1:
        return None
    if count > len(jax.devices()):
        raise InputError(f"training devices must be at most the {len(jax.devices())} that JAX sees, got {count}")
    return Mesh(np.array(jax.devices()[:count]), ("samples",))
