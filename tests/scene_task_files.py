"""A small valid task file to be spoilt, shared by the tests of the scene."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cableway.core.errors import CablewayError
from cableway.scene.files.loading import load_task

STEP = 0.025


def row(x: float, y: float, count: int = 13) -> list[list[float]]:
    """A straight cable to the right from (x, y)."""
    return np.column_stack([x + STEP * np.arange(count), np.full(count, y)]).round(6).tolist()


VALID: dict[str, Any] = {
    "cableway": 1,
    "name": "spoilt",
    "description": "Up past three obstacles.",
    "workspace": {"size": [0.7, 0.7]},
    "cable": {"length": 0.3, "radius": 0.004, "keypoints": 13},
    "grippers": {"radius": 0.004, "max_step": 0.0133, "max_turn": 0.133, "separation": 0.05},
    "obstacles": [
        {"type": "box", "center": [0.35, 0.35], "size": [0.1, 0.06], "angle": 0.2},
        {"type": "polygon", "vertices": [[0.1, 0.3], [0.2, 0.3], [0.15, 0.4]]},
        {"type": "disc", "center": [0.55, 0.35], "radius": 0.04},
    ],
    "start": row(0.2, 0.1),
    "goal": row(0.2, 0.6),
    "plug": {"length": 0.04, "width": 0.012},
    "port": {"position": [0.6, 0.6], "angle": 0.0, "standoff": 0.06, "depth": 0.01},
}

Change = Callable[[dict[str, Any]], Any]


def at(*path: Any) -> Change:
    """Put the last of `path` at the place that the others lead to; an Ellipsis takes the place away."""
    *outer, key, value = path

    def change(content: dict[str, Any]) -> None:
        for step in outer:
            content = content[step]
        if value is ...:
            del content[key]
        else:
            content[key] = value

    return change


def write(folder: Path, change: Change | None = None) -> Path:
    """The valid task, changed, as a file."""
    content = copy.deepcopy(VALID)
    if change is not None:
        change(content)
    path = folder / "task.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False, default_flow_style=None))
    return path


def complaint(path: Path) -> str:
    """What loading says is wrong, without the folder."""
    try:
        load_task(path)
    except CablewayError as error:
        return str(error).replace(f"{path.parent}/", "")
    raise AssertionError("the file was read without complaint")
