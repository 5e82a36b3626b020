"""A small data set whose every number says which transition it belongs to."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from cableway.datasets.manifest import columns_for
from cableway.datasets.writing import Origin, open_writer
from cableway.scene.cable import Cable

CABLE = Cable(keypoints=3)
SIZES = (7, 1, 0, 12, 5)
"""Transitions of each shard; one of them has none."""

COLUMNS = columns_for(CABLE, ["friction", "rest_curvature"])
ORIGIN = Origin(7, {"transitions": sum(SIZES), "motion": {"jitter": 0.2}}, {"cableway": "0"}, COLUMNS)


def rows(shard: int) -> dict[str, np.ndarray]:
    """Arrays of one shard; every number in them is that of its row in the whole set."""
    first, count = sum(SIZES[:shard]), SIZES[shard]
    index = np.arange(first, first + count, dtype=float)
    shapes = {name: (count, *column.row_shape) for name, column in ORIGIN.columns.items()}
    return {
        name: np.broadcast_to(index.reshape(-1, *[1] * (len(shape) - 1)), shape) if name != "episode"
        else np.full(count, 2 * shard)
        for name, shape in shapes.items()
    }  # fmt: skip


def write_set(folder: Path, shards: range, *, finish: bool = True) -> None:
    with open_writer(folder, ORIGIN) as writer:
        for number in shards:
            writer.add(number, 2 * number, Counter(complete=2), rows(number))
        if finish:
            writer.finish()
