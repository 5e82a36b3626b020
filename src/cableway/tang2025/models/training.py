"""Training a learned model on transitions: AdamW on mini-batches, resumable after every epoch, the same every time.

The loss is the paper's (Tang et al., the mean of ||delta s - f(s, y, a)||^2), in units of the cable's length and of
the root mean square of what the network has to predict, so that it starts near 1 for every model and length.

Note:
    The paper does not take the loss over several steps of the model's own rollout. Mirrored and swapped samples are
    ours too.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Float, PRNGKeyArray

from cableway.core.checks import Bounds, Checked, NotNegative, Positive
from cableway.core.configuration import from_mapping
from cableway.core.errors import FileFormatError, InputError
from cableway.datasets.transitions import Transitions
from cableway.tang2025.models import dataset
from cableway.tang2025.models.base import rollout
from cableway.tang2025.models.checkpoint import read_metadata, read_tree, write_tree
from cableway.tang2025.models.dataset import Windows
from cableway.tang2025.models.evaluation import window_errors
from cableway.tang2025.models.frames import frame_of
from cableway.tang2025.models.learned import LearnedConfig, LearnedModel, Normalization, trainable

Progress = Callable[[str, float], None]

FORMAT = "cableway-training"
"""Marks the state of a training among other safetensors files."""


@dataclass(frozen=True, kw_only=True)
class EpochRecord:
    """One row of the learning curve.

    Attributes:
        epoch: Counted from 1.
        loss: Mean over the epoch.
        validation_error: Mean one-step stacked error [mm] on the held-out episodes after it.
    """

    epoch: int
    loss: float
    validation_error: float


@dataclass(frozen=True, kw_only=True)
class _StateMetadata:
    """What the file of a state says beside its arrays.

    Attributes:
        format: `FORMAT`.
        identity: What makes it this training, by name.
        history: See `TrainingState`.
    """

    format: str
    identity: dict[str, str]
    history: tuple[EpochRecord, ...]


@dataclass(frozen=True)
class TrainingState:
    """State after some epochs. Order of the data and augmentation follow from the seed and the epoch's number.

    Attributes:
        model: The model.
        best: The model after the epoch with the smallest validation error.
        optimizer: State of the optimiser.
        history: One row for each epoch done.
    """

    model: LearnedModel
    best: LearnedModel
    optimizer: optax.OptState
    history: tuple[EpochRecord, ...]


@dataclass(frozen=True, kw_only=True)
class TrainingConfig(Checked):
    """How a model is trained.

    Attributes:
        epochs: Passes over the data.
        rollout_epochs: Number of the last epochs that take the loss over `rollout_steps` steps.
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
        devices: Number of JAX's devices that share each batch; another number rounds sums differently.
        seed: Of weights, split and order.
    """

    epochs: Annotated[int, Bounds(1)] = 40
    rollout_epochs: int = 10
    rollout_steps: Annotated[int, Bounds(1)] = 5
    batch_size: Annotated[int, Bounds(1)] = 256
    learning_rate: Positive[float] = 3e-3
    warmup: float = 0.03
    weight_decay: NotNegative[float] = 1e-4
    gradient_norm: Positive[float] = 1.0
    mirror: bool = True
    swap: bool = True
    validation_fraction: float = 0.1
    patience: Positive[int] | None = None
    devices: Annotated[int, Bounds(1)] = 1
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("warmup", "validation_fraction"):
            if not 0 < getattr(self, name) < 1:
                raise InputError(f"training.{name} must be between 0 and 1, got {getattr(self, name)!r}")
        if not 0 <= self.rollout_epochs <= self.epochs:
            raise InputError(f"training.rollout_epochs must be from 0 to {self.epochs}, got {self.rollout_epochs!r}")
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


@dataclass(frozen=True)
class TrainingResult:
    """A trained model.

    Attributes:
        model: With the weights after the last epoch, or the best ones where there is `patience`.
        history: One row per epoch.
        training_data: The episodes it was trained on.
        validation_data: The held-out episodes.
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
        state_file: Where the state goes after every epoch, and what to resume from if it is there. It stays, for the
            caller to remove once the model is saved.
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
        state = _read_state(state_file, state, identity)
    while len(state.history) < config.epochs and not _waited(state.history, config.patience):
        state = trainer.epoch(state, validation_data, progress)
        if state_file is not None:
            _write_state(state_file, state, identity)
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
        self.everywhere, self.by_sample = _shardings(config.devices)
        self.optimizer, self.update = _compiled_step(
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
            model = LearnedModel(self.model_config, key=jax.random.key(self.config.seed), normalization=normalization)
        return TrainingState(model, model, self.optimizer.init(eqx.filter(model, trainable(model))), ())

    def epoch(self, state: TrainingState, validation: Transitions, progress: Progress | None) -> TrainingState:
        """The state after one more epoch; its order comes from the seed and the epoch's number alone."""
        epoch, horizon = len(state.history), self.config.horizon(len(state.history))
        rng = np.random.default_rng([self.config.seed, epoch])
        key = jax.random.fold_in(jax.random.key(self.config.seed), epoch)
        order, size = rng.permutation(self.starts[epoch]), self._batch_size(epoch)
        model, optimizer_state = eqx.filter_shard((state.model, state.optimizer), self.everywhere)
        done, total = sum(self.steps[:epoch]), 0.0
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
        error = 1e3 * float(np.mean(window_errors(model, validation, (1,), stride=1).stacked))
        record = EpochRecord(epoch=epoch + 1, loss=total / self.steps[epoch], validation_error=error)
        better = all(error < row.validation_error for row in state.history)
        return TrainingState(model, model if better else state.best, optimizer_state, (*state.history, record))

    def _spread(self, batch: Windows) -> Windows:
        """A batch with its samples divided among the devices, where their number allows it."""
        divided = not len(batch.keypoints) % self.config.devices
        return jax.device_put(batch, self.by_sample if divided else self.everywhere)

    def _stage(self, history: tuple[EpochRecord, ...], loss: float) -> str:
        validation = f", validation {history[-1].validation_error:.2f} mm" if history else ""
        return f"epoch {len(history) + 1}/{self.config.epochs}, loss {loss:.3g}{validation}"


def _shardings(count: int) -> tuple[NamedSharding, NamedSharding]:
    """The same on each of the first `count` devices, and divided among them by the first axis."""
    if count > len(jax.devices()):
        raise InputError(f"training devices must be at most the {len(jax.devices())} that JAX sees, got {count}")
    devices = Mesh(np.array(jax.devices()[:count]), ("samples",))
    return NamedSharding(devices, PartitionSpec()), NamedSharding(devices, PartitionSpec("samples"))


def _write_state(path: Path, state: TrainingState, identity: dict[str, str]) -> None:
    """Write a state atomically; `identity` says which training it belongs to."""
    metadata = _StateMetadata(format=FORMAT, identity=identity, history=state.history)
    write_tree(path, (state.model, state.best, state.optimizer), asdict(metadata))


def _read_state(path: Path, like: TrainingState, identity: dict[str, str]) -> TrainingState:
    """The state in a file.

    Raises:
        FileFormatError: The file is damaged or holds something else.
        InputError: It belongs to another training.
    """
    content = read_metadata(path)
    if content.get("format") != FORMAT:
        raise FileFormatError(f"{path}: not the state of a training")
    try:
        metadata = from_mapping(_StateMetadata, content, "its metadata")
    except InputError as error:
        raise FileFormatError(f"{path}: {error}") from None
    other = [name for name in identity if metadata.identity.get(name) != identity[name]]
    if other:
        raise InputError(f"{path} belongs to another training (other {' and '.join(other)}); remove it to start afresh")
    model, best, optimizer = read_tree(path, (like.model, like.best, like.optimizer))
    return TrainingState(model, best, optimizer, metadata.history)


@cache
def _compiled_step(
    gradient_norm: float, weight_decay: float, mirror: bool, swap: bool
) -> tuple[optax.GradientTransformation, Callable[..., Any]]:
    """The optimiser and one compiled step of it, (model, state, batch, rate, key) to (model, state, loss).

    Trainings of a process share what they can.
    """
    optimizer = optax.chain(optax.clip_by_global_norm(gradient_norm), optax.adamw(1.0, weight_decay=weight_decay))

    @eqx.filter_jit
    def update(model: LearnedModel, state: Any, batch: Windows, rate: Array, key: PRNGKeyArray) -> Any:
        trained, fixed = eqx.partition(model, trainable(model))
        batch = _augmented(batch, mirror, swap, key)
        loss, gradient = jax.value_and_grad(lambda part: _loss(eqx.combine(part, fixed), batch))(trained)
        with jax.numpy_dtype_promotion("standard"):  # Optax raises its rates to whole powers
            change, state = optimizer.update(gradient, state, trained)
        trained = jax.tree.map(lambda weight, step: weight + rate * step, trained, change)
        return eqx.combine(trained, fixed), state, loss

    return optimizer, update


def _augmented(batch: Windows, mirror: bool, swap: bool, key: PRNGKeyArray) -> Windows:
    """Each sample mirrored, and swapped, with probability one half, where asked for."""
    keys, count = jax.random.split(key), len(batch.keypoints)
    if mirror:
        batch = dataset.mirrored(batch, jax.random.bernoulli(keys[0], shape=(count,)))
    if swap:
        batch = dataset.swapped(batch, jax.random.bernoulli(keys[1], shape=(count,)))
    return batch


def _loss(model: LearnedModel, batch: Windows) -> Float[Array, ""]:
    """Mean square of the error, in units of cable length and of what the network has to predict."""

    def sample(keypoints: Array, poses: Array, actions: Array, targets: Array) -> Array:
        unit = frame_of(model.config.framing, keypoints, poses).unit * model.normalization.output
        return jnp.mean(((rollout(model, keypoints, poses, actions) - targets) / unit) ** 2)

    return jnp.mean(jax.vmap(sample)(*batch))
