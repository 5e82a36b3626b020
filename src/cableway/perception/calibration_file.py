"""Calibrations on disk: JSON with the numbers as OpenCV calls them; and poses of a gripper, from which one is made."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from cableway.core.errors import FileFormatError, InputError
from cableway.core.files import write_json
from cableway.core.reading import read_json, read_table
from cableway.perception.calibration import CalibratedCamera

VERSION = 1
KEYS = {"size": (2,), "matrix": (3, 3), "distortion": (5,), "rotation": (3, 3), "translation": (3,)}
"""Shapes of what `CalibratedCamera.from_opencv` takes."""

POSE = ("x", "y", "z", "rx", "ry", "rz")
"""Columns of a pose: place [m] and rotation vector [rad], as controllers of arms show it."""


def save_camera(path: Path | str, camera: CalibratedCamera, **more: Any) -> None:
    """Write a camera, and more plain data for the reader, such as residuals."""
    pinhole = camera.pinhole
    turn = pinhole.pose[:3, :3].T
    matrix = [[pinhole.focal[0], 0.0, pinhole.center[0]], [0.0, pinhole.focal[1], pinhole.center[1]], [0.0, 0.0, 1.0]]
    content = {
        "cableway": VERSION,
        "size": list(pinhole.size),
        "matrix": matrix,
        "distortion": list(camera.distortion),
        "rotation": turn.tolist(),
        "translation": (-turn @ pinhole.pose[:3, 3]).tolist(),
    }
    write_json(Path(path), {**content, **more})


def load_camera(path: Path | str) -> CalibratedCamera:
    """Read a camera that `save_camera` wrote, or that was written by hand; other keys are not read.

    Raises:
        FileFormatError: The file cannot be read, lacks a key, or holds what no camera can.
    """
    content = read_json(path)
    if not isinstance(content, dict) or content.get("cableway") != VERSION:
        raise FileFormatError(f"{path}: must be a calibration with `cableway: {VERSION}`")
    arrays = {}
    for name, shape in KEYS.items():
        try:
            arrays[name] = np.array(content.get(name), float)
        except (TypeError, ValueError):
            arrays[name] = np.empty(0)
        if arrays[name].shape != shape:
            raise FileFormatError(f"{path}: {name} must be {' x '.join(map(str, shape))} numbers")
    width, height = (int(part) for part in arrays.pop("size"))
    try:
        return CalibratedCamera.from_opencv(size=(width, height), **arrays)
    except InputError as error:
        raise FileFormatError(f"{path}: {error}") from None


def load_poses(path: Path | str) -> tuple[list[str], Float[np.ndarray, "k 4 4"]]:
    """Names of pictures and the pose of the gripper in each, from a CSV file with the columns `picture` and `POSE`.

    Raises:
        FileFormatError: The file cannot be read, lacks a column, or holds what is no number.
    """
    rows = read_table(path, ("picture", *POSE))
    try:
        numbers = np.array([row[1:] for row in rows], float).reshape(-1, len(POSE))
    except ValueError as error:
        raise FileFormatError(f"{path}: {error}") from None
    if not len(rows) or not np.isfinite(numbers).all():
        raise FileFormatError(f"{path}: needs rows of finite numbers")
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = Rotation.from_rotvec(numbers[:, 3:]).as_matrix(), numbers[:, :3]
    return [row[0] for row in rows], poses
