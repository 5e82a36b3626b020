"""Recordings of a cable, right ones and what becomes of them: tables, archives, descriptions."""

from __future__ import annotations

import io
import random
from functools import cache
from pathlib import Path

import numpy as np
import yaml

from checks.attack.mutants import NUMBERS, brief, damaged, mutated

TABLE, ARCHIVE, DESCRIPTION = "recording.csv", "recording.npz", "recording.yaml"

ROWS = 40


@cache
def recorded(rollout: Path) -> dict[str, np.ndarray]:
    """The first rows of a run."""
    with np.load(rollout) as file:
        return {name: file[name][:ROWS] for name in ("times", "keypoints", "poses")}


def table(rollout: Path) -> bytes:
    """A recording as CSV, without poses."""
    arrays = recorded(rollout)
    names = ["time", *(f"{axis}{k}" for k in range(arrays["keypoints"].shape[1]) for axis in "xy")]
    rows = np.column_stack([arrays["times"], arrays["keypoints"].reshape(ROWS, -1)]).tolist()
    return "\n".join(",".join(map(str, row)) for row in [names, *rows]).encode()


def archive(arrays: dict[str, np.ndarray]) -> bytes:
    file = io.BytesIO()
    np.savez(file, **arrays)  # pyright: ignore[reportArgumentType]
    return file.getvalue()


def description() -> bytes:
    """One with every key."""
    corners = [[0.0, 0.0], [0.7, 0.0], [0.7, 0.7], [0.0, 0.7]]
    content = {
        "cableway": 1, "file": TABLE, "units": "px", "angles": "deg", "gap": 0.3, "segment": 3.0,
        "calibration": {"pixels": corners, "table": corners}, "cable": {"preset": "usb", "length": 0.3, "keypoints": 9},
    }  # fmt: skip
    return yaml.safe_dump(content).encode()


def table_spoilt(content: bytes, rng: random.Random) -> tuple[bytes, str]:
    """Cells that hold anything, rows that are longer, shorter or no rows; now and then other bytes."""
    if rng.random() < 0.2:
        return damaged(content, rng)
    rows, done = mutated([line.split(",") for line in content.decode().split("\n")], rng)
    lines = [",".join(map(str, row)) if isinstance(row, list) else str(row) for row in rows]
    return "\n".join(lines).encode("utf-8", "surrogatepass"), done


def archive_spoilt(content: bytes, rng: random.Random) -> tuple[bytes, str]:
    """One array that is missing, or of another shape, type or order, or that holds anything; or other bytes."""
    if rng.random() < 0.25:
        return damaged(content, rng)
    with np.load(io.BytesIO(content)) as file:
        arrays = dict(file)
    name, number = rng.choice([*arrays]), rng.choice(NUMBERS)
    array, kind = arrays[name], rng.choice(["missing", "number", "type", "reversed", "flat", "short", "deep", "scaled"])
    if kind == "missing":
        del arrays[name]
    elif kind == "number":
        array = array.astype(object) if not isinstance(number, (int, float)) or abs(number) > 1e300 else array.copy()
        array.flat[rng.randrange(array.size)] = number
        arrays[name] = array
    elif kind == "type":
        arrays[name] = array.astype(rng.choice(["i1", "u8", "f2", "c16", "?", "U9", "O", ">f8", "M8[s]"]))
    else:
        arrays[name] = {
            "reversed": lambda: array[::-1], "flat": lambda: array.ravel(), "short": lambda: array[: rng.randrange(3)],
            "deep": lambda: array[None], "scaled": lambda: array * 10.0 ** rng.randrange(-9, 9),
        }[kind]()  # fmt: skip
    return archive(arrays), f"{name}: {kind} {brief(number) if kind == 'number' else ''}"
