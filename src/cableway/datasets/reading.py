"""Read a data set: whole, or as a stream of shuffled batches within bounded memory."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cableway.core.errors import FileFormatError, InputError
from cableway.core.reading import parse_safetensors, read_bytes
from cableway.datasets.manifest import CABLE, COLUMNS, Column, Manifest, Shard, read_manifest
from cableway.datasets.recordings import is_recording, load_recording
from cableway.datasets.transitions import Transitions

BUFFER = 131_072
"""Transitions that are shuffled together by default: 70 MB at 13 keypoints."""


def load_transitions(source: Path | str) -> Transitions:
    """All transitions of a data set or of a recording, in order.

    Args:
        source: The folder of a data set, or the CSV, NPZ or YAML file of a recording; see `load_recording`.

    Raises:
        FileFormatError: The folder holds no complete data set, a shard is missing or damaged, or the recording is not
            what it must be.
        TaskError: The YAML file of the recording says what no recording can have.
    """
    folder = Path(source)
    if is_recording(folder):
        return load_recording(folder)
    manifest = _complete(folder)
    columns = {
        name: np.empty((manifest.transitions, *column.row_shape), column.dtype)
        for name, column in manifest.columns.items()
    }
    start = 0
    for shard in manifest.shards:
        rows = slice(start, start + shard.transitions)
        for name, array in read_shard(folder, shard, manifest.columns).items():
            columns[name][rows] = array
        start = rows.stop
    return _transitions(columns, manifest)


def shuffled_batches(
    folder: Path | str, batch_size: int, *, seed: int = 0, buffer: int = BUFFER
) -> Iterator[Transitions]:
    """Every transition of a data set once, in random batches, with about `buffer` of them in memory.

    Shards are taken in random order; as many as fill the buffer are shuffled together. The order follows from the
    arguments alone; another seed for each epoch gives another order.

    Args:
        folder: The data set.
        batch_size: Transitions in a batch; the last one may have fewer.
        seed: Of the order.
        buffer: Least number of transitions that are shuffled together, where there are so many.

    Raises:
        InputError: `batch_size` or `buffer` is below 1.
        FileFormatError: The folder holds no complete data set, or a shard is missing or damaged.
    """
    for name, value in (("batch_size", batch_size), ("buffer", buffer)):
        if value < 1:
            raise InputError(f"{name} must be at least 1, got {value!r}")
    folder = Path(folder)
    manifest = _complete(folder)
    return _batches(folder, manifest, batch_size, max(buffer, batch_size), np.random.default_rng(seed))


def _batches(
    folder: Path, manifest: Manifest, batch_size: int, buffer: int, rng: np.random.Generator
) -> Iterator[Transitions]:
    held = {name: np.empty((0, *column.row_shape), column.dtype) for name, column in manifest.columns.items()}
    waiting = [held]
    order = [manifest.shards[index] for index in rng.permutation(len(manifest.shards))]
    for position, shard in enumerate(order, start=1):
        waiting.append(read_shard(folder, shard, manifest.columns))
        if sum(len(part["episode"]) for part in waiting) < buffer and position < len(order):
            continue
        held = {name: np.concatenate([part[name] for part in waiting]) for name in manifest.columns}
        waiting.clear()
        shuffled = rng.permutation(len(held["episode"]))
        # what does not fill a batch is shuffled again with what comes next
        left = len(shuffled) % batch_size if position < len(order) else 0
        for start in range(0, len(shuffled) - left, batch_size):
            rows = shuffled[start : start + batch_size]
            yield _transitions({name: array[rows] for name, array in held.items()}, manifest)
        rest = shuffled[len(shuffled) - left :]
        waiting.append({name: array[rest] for name, array in held.items()})


def _transitions(columns: dict[str, np.ndarray], manifest: Manifest) -> Transitions:
    cable = {name.removeprefix(CABLE): array for name, array in columns.items() if name.startswith(CABLE)}
    return Transitions(**{name: columns[name] for name in COLUMNS}, cable=cable, metadata=manifest.metadata)


def read_shard(folder: Path, shard: Shard, columns: dict[str, Column]) -> dict[str, np.ndarray]:
    """The arrays of one shard.

    Raises:
        FileFormatError: The file is missing, or it is not what the manifest says.
    """
    path = folder / shard.file
    try:
        content = read_bytes(path)
    except FileFormatError as error:
        raise FileFormatError(f"{error}; {_REMEDY}") from None
    if hashlib.sha256(content).hexdigest() != shard.sha256:
        raise FileFormatError(f"{path}: damaged: its SHA-256 differs from the manifest's; {_REMEDY}")
    arrays = parse_safetensors(content, str(path))[0]
    found = {name: (str(array.dtype), array.shape) for name, array in arrays.items()}
    stated = {name: (column.dtype, (shard.transitions, *column.row_shape)) for name, column in columns.items()}
    if found != stated:
        raise FileFormatError(f"{path}: its arrays are {found}, but the manifest says {stated}")
    return arrays


_REMEDY = "the command that made the data set makes it again"


def _complete(folder: Path) -> Manifest:
    manifest = read_manifest(folder)
    if not manifest.complete:
        raise FileFormatError(
            f"{folder}: the data set is incomplete, with {manifest.transitions} transitions so far; "
            "the command that started it continues where it stopped"
        )
    total = sum(shard.transitions for shard in manifest.shards)
    if total != manifest.transitions or not total:
        raise FileFormatError(
            f"{folder}: the manifest says {manifest.transitions} transitions, but its shards have {total}"
        )
    return manifest
