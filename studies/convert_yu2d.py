"""Turn the simulated planar cables of Yu et al. into recordings that `cableway evaluate` and `train` read.

    .venv/bin/python studies/convert_yu2d.py FOLDER --out runs/yu2d

FOLDER is `data/train_data/2D` of github.com/Mingrui-Yu/shape_control_DLO_2 (MIT licence; commit a70e16a), of which
`state_1.npy` to `state_5.npy` are read. A row has the length, 10 keypoints in space, position and quaternion of the
left and the right end, then velocities and targets, every 0.1 s; the plane is that of x and y. Each file becomes
`LENGTH.npz` and its description `LENGTH.yaml`. In the first row the cable is straight from the left end to the right
one, which says what angle an end has then; later it has turned by its quaternion. Where a keypoint moves by more than a
tenth of the length in one step, the recording jumps, and another episode begins.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import yaml
from jaxtyping import Float

from cableway.core.errors import FileFormatError

KEYPOINTS = 10
ENDS = 1 + 3 * KEYPOINTS
"""First column of the poses of the ends, each a position and a quaternion x, y, z, w."""

STEP = 0.1
"""[s] from row to row."""

JUMP = 0.1
"""Way of a keypoint in a step, over the length, that no cable of theirs goes; the largest below it is 0.0997."""


def convert(source: Path, folder: Path) -> Path:
    """Write the recording of one file, and return its description.

    Raises:
        FileFormatError: The file holds something else.
    """
    state = np.load(source, allow_pickle=False)
    if state.ndim != 2 or state.shape[1] < ENDS + 14 or not np.isfinite(state).all():
        raise FileFormatError(f"{source}: not rows of at least {ENDS + 14} numbers: {state.dtype}{list(state.shape)}")
    size = float(state[0, 0])
    keypoints = state[:, 1:ENDS].reshape(-1, KEYPOINTS, 3)[..., :2].astype(float)
    way = np.linalg.norm(np.diff(keypoints, axis=0), axis=2).max(axis=1)
    target = folder / f"{size:g}.npz"
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(
        target,
        times=STEP * np.arange(len(state)),
        keypoints=keypoints,
        poses=ends(state[:, ENDS : ENDS + 14].reshape(-1, 2, 7).astype(float)),
        episode=np.cumsum(np.append(0, way > JUMP * size)),
    )
    description = {"cableway": 1, "file": target.name, "cable": {"length": round(size, 6)}}
    target.with_suffix(".yaml").write_text(yaml.safe_dump(description, sort_keys=False))
    return target.with_suffix(".yaml")


def ends(poses: Float[np.ndarray, "m 2 7"]) -> Float[np.ndarray, "m 2 3"]:
    """Poses in the plane [m, m, rad] from positions and quaternions, which turn about the third axis."""
    first, last = poses[0, :, :2]
    turned = 2 * np.arctan2(poses[..., 5], poses[..., 6])
    angles = np.unwrap(turned - turned[0], axis=0) + np.arctan2(*(last - first)[::-1])
    return np.concatenate([poses[..., :2], angles[..., None]], axis=2)


def main() -> None:
    """Convert the five files."""
    parser = argparse.ArgumentParser(description="Convert the cables of Yu et al.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("runs/yu2d"))
    options = parser.parse_args()
    for file in (options.folder / f"state_{k}.npy" for k in range(1, 6)):
        print(f"{file.name}: {convert(file, options.out)}")


if __name__ == "__main__":
    main()
