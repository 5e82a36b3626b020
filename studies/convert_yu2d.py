"""Turn the simulated planar cables of Yu et al. into data sets that `cableway train` and `evaluate` read.

    .venv/bin/python studies/convert_yu2d.py FOLDER --out sets/yu2d

FOLDER holds `yu2d_1.npz`, `yu2d_2.npz`, ...: the arrays `keypoints (m, n, 2)` [m], `poses (m, 2, 3)` [m, m, rad] and
`episode (m,)`, rows of one episode following each other in time at `dt` 0.1 s, and `length` [m]. They are the files
`data/train_data/2D/state_*.npy` of "shape_control_DLO_2" (M. Yu et al., MIT licence), rearranged. Each becomes one data
set, named after its length. Episodes are cut into stretches of at most `--stretch` steps, so that there are enough of
them to hold some out; the last step of a stretch is followed by the first one of the next.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

import numpy as np

from cableway.core.errors import InputError
from cableway.core.provenance import versions
from cableway.datasets.manifest import columns_for
from cableway.datasets.writing import Origin, open_writer
from cableway.scene.cable import Cable
from cableway.scene.task import CONTROL_STEP


def convert(source: Path, target: Path, stretch: int) -> int:
    """Write the data set of one file and return its number of transitions."""
    with np.load(source) as file:
        recorded = {name: file[name] for name in ("keypoints", "poses", "episode", "length", "dt")}
    if not np.isclose(recorded["dt"], CONTROL_STEP):
        raise InputError(f"{source}: dt is {recorded['dt']} s, a control step is {CONTROL_STEP} s")
    length, shapes, poses = float(recorded["length"]), recorded["keypoints"], recorded["poses"].astype(float)
    follows = np.flatnonzero(np.diff(recorded["episode"]) == 0)
    arrays = {
        "keypoints": shapes[follows],
        "poses": poses[follows],
        "actions": _motion(poses[follows], poses[follows + 1]),
        "next_keypoints": shapes[follows + 1],
        "episode": _stretches(recorded["episode"][follows], stretch),
    }
    config = {"source": source.name, "length": length, "stretch": stretch}
    origin = Origin(0, config, versions(), columns_for(Cable(length=length, keypoints=shapes.shape[1])))
    with open_writer(target, origin) as writer:
        if writer.shard(0) is None:
            episodes = len(np.unique(arrays["episode"]))
            writer.add(0, 0, Counter(recorded=episodes), arrays)
        writer.finish()
    return len(follows)


def _motion(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Motion of the grippers; angles turn the short way."""
    motion = after - before
    motion[..., 2] -= 2 * np.pi * np.round(motion[..., 2] / (2 * np.pi))
    return motion


def _stretches(episode: np.ndarray, stretch: int) -> np.ndarray:
    """Numbers of the stretches that episodes are cut into."""
    first = np.flatnonzero(np.diff(episode, prepend=episode[0] - 1))
    since = np.arange(len(episode)) - first[np.searchsorted(first, np.arange(len(episode)), side="right") - 1]
    begins = since % stretch == 0
    return np.cumsum(begins) - 1


def main() -> None:
    """Convert every file of the folder."""
    parser = argparse.ArgumentParser(description="Convert the cables of Yu et al.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("runs/yu2d"))
    parser.add_argument("--stretch", type=int, default=60)
    options = parser.parse_args()
    files = sorted(options.folder.glob("yu2d_*.npz"))
    if not files:
        raise SystemExit(f"{options.folder}: no files yu2d_*.npz")
    for file in files:
        with np.load(file) as content:
            name = f"{float(content['length']):g}"
        print(f"{file.name}: {convert(file, options.out / name, options.stretch)} transitions in {options.out / name}")


if __name__ == "__main__":
    main()
