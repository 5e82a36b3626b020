"""How far a training has come, in memory and in a file to resume from."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import optax

from cableway.core.errors import FileFormatError, InputError
from cableway.tang2025.models.learned import LearnedModel
from cableway.tang2025.models.tensors import read_metadata, read_tree, write_tree

FORMAT = "cableway-training"


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


def write_state(path: Path, state: TrainingState, identity: dict[str, str]) -> None:
    """Write a state atomically; `identity` says which training it belongs to."""
    metadata: dict[str, Any] = {
        "format": FORMAT,
        "identity": identity,
        "history": [asdict(row) for row in state.history],
    }
    write_tree(path, (state.model, state.best, state.optimizer), metadata)


def read_state(path: Path, like: TrainingState, identity: dict[str, str]) -> TrainingState:
    """The state in a file.

    Raises:
        FileFormatError: The file is damaged or holds something else.
        InputError: It belongs to another training.
    """
    metadata = read_metadata(path)
    if metadata.get("format") != FORMAT:
        raise FileFormatError(f"{path}: not the state of a training")
    found = metadata.get("identity", {})
    other = [name for name in identity if found.get(name) != identity[name]]
    if other:
        raise InputError(f"{path} belongs to another training (other {' and '.join(other)}); remove it to start afresh")
    try:
        history = tuple(EpochRecord(**row) for row in metadata["history"])
    except (KeyError, TypeError):
        raise FileFormatError(f"{path}: its learning curve is damaged") from None
    model, best, optimizer = read_tree(path, (like.model, like.best, like.optimizer))
    return TrainingState(model, best, optimizer, history)
