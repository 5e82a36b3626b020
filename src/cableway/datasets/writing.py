"""Write a data set shard by shard, so that what is listed is complete on disk, and go on after an interruption."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import save

from cableway.core.errors import FileFormatError, InputError, StorageError
from cableway.core.files import only_writer, write_bytes
from cableway.datasets.manifest import FORMAT, MANIFEST, VERSION, Column, Manifest, Shard, read_manifest, write_manifest
from cableway.datasets.reading import read_shard

METADATA_KEY = "cableway"
"""The one key of a shard's metadata; with several, their order and so the file's bytes would be random."""


@dataclass(frozen=True)
class Origin:
    """What a data set is made from: equal origins give equal bytes.

    Attributes:
        seed: Of everything random.
        config: The resolved configuration, as plain data.
        versions: Of cableway, Python and the packages that cableway requires.
        columns: The arrays, by name.
    """

    seed: int
    config: dict[str, Any]
    versions: dict[str, str]
    columns: dict[str, Column]


@contextmanager
def open_writer(folder: Path, origin: Origin) -> Iterator[DatasetWriter]:
    """A writer that goes on with what the folder holds already; while it is open no other one gets the folder.

    Listed shards are read in full: one that is missing or damaged no longer counts.

    Raises:
        InputError: The folder holds a data set of another origin, or another process is writing to it.
        FileFormatError: Its manifest is damaged.
    """
    with only_writer(folder):
        kept = _sound_shards(folder, origin) if (folder / MANIFEST).exists() else []
        for leftover in [*folder.glob(".shard-*"), *folder.glob(f".{MANIFEST}.*")]:
            leftover.unlink()
        yield DatasetWriter(folder, origin, kept)


class DatasetWriter:
    """Adds shards to a data set; see `open_writer`."""

    def __init__(self, folder: Path, origin: Origin, shards: list[Shard]) -> None:
        self._folder, self._origin = folder, origin
        self._shards = {shard.first_episode: shard for shard in shards}

    def shard(self, first_episode: int) -> Shard | None:
        """The shard that begins with that episode, if it is complete."""
        return self._shards.get(first_episode)

    def add(self, number: int, first_episode: int, ended: Mapping[str, int], arrays: Mapping[str, np.ndarray]) -> Shard:
        """Write a shard to disk, then list it in the manifest.

        Args:
            number: Of the shard, for its file's name.
            first_episode: Number of its first episode.
            ended: How often its episodes ended for which reason.
            arrays: The columns.

        Raises:
            StorageError: It cannot be written; what was complete before is so still.
        """
        episodes = sum(ended.values())
        about = {"format": FORMAT, "version": VERSION, "first_episode": first_episode, "episodes": episodes}
        content = save(
            {name: np.ascontiguousarray(arrays[name], column.dtype) for name, column in self._origin.columns.items()},
            metadata={METADATA_KEY: json.dumps(about)},
        )
        shard = Shard(
            file=f"shard-{number:06d}.safetensors",
            sha256=hashlib.sha256(content).hexdigest(),
            first_episode=first_episode,
            episodes=episodes,
            transitions=len(arrays["episode"]),
            ended=dict(sorted(ended.items())),
        )
        with self._storing():
            write_bytes(self._folder / shard.file, content)
            write_manifest(self._folder, self._manifest({**self._shards, first_episode: shard}, complete=False))
        self._shards[first_episode] = shard
        return shard

    def finish(self) -> Manifest:
        """Say in the manifest that the data set is complete.

        Raises:
            StorageError: It cannot be written.
        """
        manifest = self._manifest(self._shards, complete=True)
        with self._storing():
            write_manifest(self._folder, manifest)
        return manifest

    def _manifest(self, shards: Mapping[int, Shard], *, complete: bool) -> Manifest:
        listed = [shards[first] for first in sorted(shards)]
        return Manifest(
            complete=complete,
            transitions=sum(shard.transitions for shard in listed),
            shards=listed,
            **vars(self._origin),
        )

    @contextmanager
    def _storing(self) -> Iterator[None]:
        try:
            yield
        except StorageError as error:
            raise StorageError(
                f"{error}, after {len(self._shards)} complete shards, which are kept; "
                "once there is space, the same command continues from there"
            ) from None


def _sound_shards(folder: Path, origin: Origin) -> list[Shard]:
    manifest = read_manifest(folder)
    for name in ("seed", "config", "versions", "columns"):
        found, wanted = getattr(manifest, name), getattr(origin, name)
        if name == "versions":  # a manifest may name packages of extras, too, which its bytes do not depend on
            found = {package: found.get(package) for package in wanted}
        if found != wanted:
            raise InputError(
                f"{folder}: contains a data set with another {_difference(name, found, wanted)}; "
                "use another folder, or remove this one"
            )
    return [shard for shard in manifest.shards if _is_sound(folder, shard, origin)]


def _difference(name: str, found: Any, wanted: Any) -> str:
    """Where two values differ first, such as "config.motion.jitter: 0.2, not 0.1"."""
    if isinstance(found, dict) and isinstance(wanted, dict):
        key = min(key for key in found.keys() | wanted.keys() if found.get(key) != wanted.get(key))
        return _difference(f"{name}.{key}", found.get(key), wanted.get(key))
    return f"{name}: {found!r}, not {wanted!r}"


def _is_sound(folder: Path, shard: Shard, origin: Origin) -> bool:
    try:
        read_shard(folder, shard, origin.columns)
    except FileFormatError:
        return False
    return True
