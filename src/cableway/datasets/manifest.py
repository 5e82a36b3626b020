"""The manifest of a data set: what made it, which shards it has and what is in them."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cableway.core.checks import Checked, NotNegative, Positive
from cableway.core.configuration import from_mapping
from cableway.core.errors import FileFormatError, InputError
from cableway.core.files import write_json
from cableway.core.provenance import describe
from cableway.core.reading import LARGEST_FILE, read_json
from cableway.scene.cable import Cable

FORMAT = "cableway-transitions"
VERSION = 1
"""Version of the format; readers refuse others."""

MANIFEST = "manifest.json"

COLUMNS: dict[str, tuple[Literal["float64", "int64"], str, tuple[str | int, ...]]] = {
    "keypoints": ("float64", "m", ("n", 2)),
    "poses": ("float64", "m, m, rad", (2, 3)),
    "actions": ("float64", "m, m, rad", (2, 3)),
    "next_keypoints": ("float64", "m", ("n", 2)),
    "episode": ("int64", "", ()),
}
"""Element type, unit and shape of a row of each array, n standing for the number of keypoints."""

CABLE = "cable."
"""How the names of the arrays begin that hold the cable of each transition, where it is not the same throughout."""

CABLE_UNITS = {
    "length": "m",
    "radius": "m",
    "bending_stiffness": "N m^2",
    "stiffness_profile": "",
    "rest_curvature": "1/m",
    "yield_curvature": "1/m",
    "damping_time": "s",
    "linear_density": "kg/m",
    "friction": "",
    "drag": "N s/m^2",
    "min_bend_radius": "m",
}
"""Unit of each field of a cable that can be drawn."""


@dataclass(frozen=True, kw_only=True)
class Column(Checked):
    """One array that every shard has.

    Attributes:
        dtype: NumPy's name of the element type.
        unit: Of the last axis.
        row_shape: Shape of the part that belongs to one transition.

    Raises:
        InputError: A size is below 1.
    """

    dtype: Literal["float64", "int64"]
    unit: str
    row_shape: list[int]

    def __post_init__(self) -> None:
        super().__post_init__()
        if any(size < 1 for size in self.row_shape):
            raise InputError(f"row_shape must have sizes of at least 1, got {self.row_shape!r}")

    @property
    def row_bytes(self) -> int:
        """What one transition takes."""
        return math.prod(self.row_shape) * np.dtype(self.dtype).itemsize


@dataclass(frozen=True, kw_only=True)
class Shard(Checked):
    """One file of a data set.

    Attributes:
        file: Name in the folder.
        sha256: Of the file, in hexadecimal.
        first_episode: Number of its first episode.
        episodes: How many were simulated for it; some may have given no transition.
        transitions: Rows of its arrays.
        ended: How often episodes ended for which reason.

    Raises:
        InputError: The name or the checksum is none of a shard, or a number is negative.
    """

    file: str
    sha256: str
    first_episode: NotNegative[int]
    episodes: Positive[int]
    transitions: NotNegative[int]
    ended: dict[str, int]

    def __post_init__(self) -> None:
        super().__post_init__()
        if not re.fullmatch(r"shard-\d{6,}\.safetensors", self.file):
            raise InputError(f"shard.file must be shard-NUMBER.safetensors, got {self.file!r}")
        if not re.fullmatch(r"[0-9a-f]{64}", self.sha256):
            raise InputError(f"shard.sha256 must be 64 hexadecimal digits, got {self.sha256!r}")


@dataclass(frozen=True, kw_only=True)
class Manifest(Checked):
    """What `manifest.json` holds.

    Attributes:
        format: Kind of data set.
        version: Of the format.
        complete: Whether all shards are there.
        transitions: Rows of all listed shards together.
        seed: Of everything random.
        config: The resolved configuration of the collection.
        versions: Of cableway, Python and the packages that cableway requires.
        columns: The arrays, by name.
        shards: In order of their episodes.

    Raises:
        InputError: A number is negative.
    """

    format: Literal["cableway-transitions"] = FORMAT
    version: Literal[1] = VERSION
    complete: bool
    transitions: NotNegative[int]
    seed: NotNegative[int]
    config: dict[str, Any]
    versions: dict[str, str]
    columns: dict[str, Column]
    shards: list[Shard]

    @property
    def episodes_ended(self) -> dict[str, int]:
        """How often episodes ended for which reason."""
        total: Counter[str] = Counter()
        for shard in self.shards:
            total.update(shard.ended)
        return dict(sorted(total.items()))

    @property
    def metadata(self) -> dict[str, Any]:
        """What goes with the transitions once they are in memory."""
        return {
            "seed": self.seed, "config": self.config, "versions": self.versions, "episodes_ended": self.episodes_ended,
        }  # fmt: skip


def columns_for(cable: Cable, drawn: Iterable[str] = ()) -> dict[str, Column]:
    """The arrays of a data set of cables like this one, of which the `drawn` fields differ."""
    columns = {
        name: Column(
            dtype=dtype, unit=unit, row_shape=[cable.keypoints if size == "n" else int(size) for size in shape]
        )
        for name, (dtype, unit, shape) in COLUMNS.items()
    }
    for name in drawn:
        row_shape = list(np.shape(getattr(cable, name)))
        columns[CABLE + name] = Column(dtype="float64", unit=CABLE_UNITS[name], row_shape=row_shape)
    return columns


def read_manifest(folder: Path) -> Manifest:
    """The manifest of the data set in a folder.

    Raises:
        FileFormatError: There is none, or it is damaged or of another version.
    """
    path = folder / MANIFEST
    if not path.exists():
        raise FileFormatError(
            f"{folder}: not a data set; one is a folder with {MANIFEST}, or a recording ending in .csv, .npz or .yaml"
        )
    try:
        manifest = from_mapping(Manifest, read_json(path), f"{path}: manifest")
    except InputError as error:
        raise FileFormatError(str(error)) from None
    known = COLUMNS.keys() | {CABLE + name for name in CABLE_UNITS}
    if not COLUMNS.keys() <= manifest.columns.keys() <= known:
        raise FileFormatError(
            f"{path}: columns must be {', '.join(COLUMNS)}, and {CABLE}... for fields of the cable, "
            f"got {', '.join(manifest.columns)}"
        )
    row, files = sum(column.row_bytes for column in manifest.columns.values()), set[str]()
    for shard in manifest.shards:
        if shard.transitions * row > LARGEST_FILE or shard.file in files:
            raise FileFormatError(
                f"{path}: {shard.file} is listed twice, or with more than the {LARGEST_FILE // row} transitions "
                f"that a file of {LARGEST_FILE / 1e6:g} MB holds"
            )
        files.add(shard.file)
    return manifest


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write a manifest, all of it or nothing."""
    write_json(folder / MANIFEST, describe(manifest))
