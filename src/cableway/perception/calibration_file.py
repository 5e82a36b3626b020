"""Calibrations on disk: JSON with the numbers as OpenCV calls them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cableway.core.errors import FileFormatError, InputError
from cableway.core.files import write_json
from cableway.core.reading import read_json
from cableway.perception.calibration import CalibratedCamera

VERSION = 1
KEYS = {"size": (2,), "matrix": (3, 3), "distortion": (5,), "rotation": (3, 3), "translation": (3,)}
"""Shapes of what `CalibratedCamera.from_opencv` takes."""


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
