"""The rows of a recording as they stand in its file, CSV or NPZ, with what a message calls each of their numbers."""

from __future__ import annotations

import csv
import io
import re
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from cableway.core.checks import shown
from cableway.core.errors import FileFormatError
from cableway.core.reading import LARGEST_TEXT, one_line, read_arrays, read_bytes
from cableway.scene.cable import KEYPOINTS

LARGEST = 1e12
"""No number of a recording is larger: neither a time [s], be it in nanoseconds by mistake, nor a place."""

TIME, EPISODE = "time", "episode"
POSES = tuple(f"{side}_{name}" for side in ("left", "right") for name in ("x", "y", "theta"))
"""Columns of the gripper poses."""

Place = Callable[..., str]
"""What a message calls a number, from the name of its array and its indices."""


@dataclass(frozen=True)
class Rows:
    """A recording before anything is made of it.

    Attributes:
        times: (m,) [s], later in every row of an episode than in the one before.
        keypoints: (m, n, 2) in the file's units; NaN where there is none.
        poses: (m, 2, 3) likewise, or None.
        episode: (m,) number of the episode.
        unread: Names of what else is in the file.
        place: What messages call a number.
    """

    times: Float[np.ndarray, "m"]
    keypoints: Float[np.ndarray, "m n 2"]
    poses: Float[np.ndarray, "m 2 3"] | None
    episode: Float[np.ndarray, "m"]
    unread: tuple[str, ...]
    place: Place


def read_rows(path: Path) -> Rows:
    """The rows of a CSV or NPZ file.

    Raises:
        FileFormatError: It cannot be read, lacks something, or holds something that no recording can.
    """
    arrays, place = _from_csv(path) if path.suffix.lower() == ".csv" else _from_npz(path)
    count = len(arrays["times"])
    unread = tuple(sorted(arrays.keys() - {"times", "keypoints", "poses", "episode"}))
    episode = arrays.get("episode", np.zeros(count))
    for name, values in {**arrays, "episode": episode}.items():
        if name not in unread:
            _require_numbers(path, name, values, place)
    for k in np.flatnonzero(np.isnan(arrays["keypoints"]).any(axis=2).all(axis=0))[:1]:
        raise FileFormatError(f"{path}: keypoint {k} is seen in no row; leave it out")
    for row in np.flatnonzero((np.diff(arrays["times"]) <= 0) & (np.diff(episode) == 0)):
        before, after = arrays["times"][row : row + 2].tolist()
        raise FileFormatError(
            f"{path}: {place('times', row + 1)} is {after!r} s, not after the {before!r} s of the row before"
        )
    seen = {name: _whole(arrays[name]) for name in ("keypoints", "poses") if name in arrays}
    return Rows(arrays["times"], seen["keypoints"], seen.get("poses"), episode, unread, place)


def _whole(array: Float[np.ndarray, "m k c"]) -> Float[np.ndarray, "m k c"]:
    """The same with no point or pose known in part."""
    return np.where(np.isnan(array).any(axis=2, keepdims=True), np.nan, array)


def _require_numbers(path: Path, name: str, array: np.ndarray, place: Place) -> None:
    """Finite numbers, and NaN only where something may be missing."""
    wrong = ~(np.abs(array) <= LARGEST)
    if name in ("keypoints", "poses"):
        wrong &= ~np.isnan(array)
    for index in np.argwhere(wrong)[:1]:
        value = float(array[tuple(index)])
        got = "nothing" if np.isnan(value) else repr(value)
        raise FileFormatError(f"{path}: {place(name, *index)} must be a number of at most {LARGEST:g}, got {got}")


def _require_count(path: Path, keypoints: int, rows: int) -> None:
    least, most = KEYPOINTS
    if not least <= keypoints <= most or rows < 2:
        raise FileFormatError(
            f"{path}: a recording has at least 2 rows of {least} to {most} keypoints, got {rows} of {keypoints}"
        )


# ------------------------------------------------------------------------------------------------ NPZ
def _from_npz(path: Path) -> tuple[dict[str, np.ndarray], Place]:
    arrays = dict(read_arrays(path))
    lacking = [name for name in ("times", "keypoints") if name not in arrays]
    if lacking:
        raise FileFormatError(f"{path}: a recording has the arrays times and keypoints; it has {_listed(arrays)}")
    times, keypoints = arrays["times"], arrays["keypoints"]
    rows, count = (*times.shape, 0)[0], keypoints.shape[1] if keypoints.ndim == 3 else 0
    shapes = {"times": (rows,), "keypoints": (rows, count, 2), "poses": (rows, 2, 3), "episode": (rows,)}
    texts = {"times": "(m,)", "keypoints": "(m, n, 2)", "poses": "(m, 2, 3)", "episode": "(m,)"}
    for name, shape in shapes.items():
        if name not in arrays:
            continue
        array = arrays[name]
        if array.shape != shape or array.dtype.kind not in "iuf":
            raise FileFormatError(
                f"{path}: array {name!r} must be numbers of shape {texts[name]} with m = {rows}, "
                f"got {array.dtype}{list(array.shape)}"
            )
        arrays[name] = array.astype(float)
    _require_count(path, count, rows)
    return arrays, lambda name, *index: f"{name}[{', '.join(map(str, index))}]"


def _listed(names: Iterable[str]) -> str:
    """Names in a message, cut short."""
    return shown(sorted(names)) if names else "none"


# ------------------------------------------------------------------------------------------------ CSV
def _from_csv(path: Path) -> tuple[dict[str, np.ndarray], Place]:
    lines = _lines(path)
    number, first = next(lines, (0, ""))
    if not number:
        raise FileFormatError(
            f"{path}: the file is empty, but must have a line of column names and a line for each row"
        )
    names = _cells(path, number, first)
    at, columns = {name: k for k, name in enumerate(names)}, _columns(path, names)
    read = [at[column] for each in columns.values() for column in each]
    numbers, values = array("q"), array("d")
    for number, line in lines:
        cells = _cells(path, number, line)
        if len(cells) != len(names):
            raise FileFormatError(f"{path}: line {number}: must have {len(names)} values, got {len(cells)}")
        numbers.append(number)
        values.extend(_number(cells[k], path, number, names[k]) for k in read)
    count = len(columns["keypoints"]) // 2
    _require_count(path, count, len(numbers))
    shapes = {"times": (-1,), "keypoints": (-1, count, 2), "poses": (-1, 2, 3), "episode": (-1,)}
    parts = np.split(np.array(values).reshape(len(numbers), -1), np.cumsum([len(each) for each in columns.values()]), 1)
    arrays = {name: part.reshape(shapes[name]) for name, part in zip(columns, parts, strict=False)}
    known = {column for each in columns.values() for column in each}
    arrays |= {name: np.empty(0) for name in names if name not in known}

    def place(name: str, row: int, *index: int) -> str:
        column = columns[name][int(np.ravel_multi_index(index, shapes[name][1:])) if index else 0]
        return f"line {numbers[row]}: {column}"

    return arrays, place


def _columns(path: Path, names: list[str]) -> dict[str, list[str]]:
    """Names of the columns of each array, in order."""
    known, most = set(names), KEYPOINTS[1]
    if len(known) < len(names):
        twice = next(name for name, count in Counter(names).items() if count > 1)
        raise FileFormatError(f"{path}: the column {shown(twice)} stands twice")
    coordinates = {name for name in names if re.fullmatch(r"[xy]\d+", name)}
    pairs = [f"{axis}{k}" for k in range(min(most, (len(coordinates) + 1) // 2)) for axis in "xy"]
    lacking = [name for name in (TIME, *pairs) if name not in known]
    strange = sorted(coordinates.difference(pairs))
    if lacking or strange or not pairs:
        said = (
            f"{lacking[0]!r} is missing"
            if lacking
            else f"{shown(strange)} are too many"
            if strange
            else "none is there"
        )
        raise FileFormatError(
            f"{path}: a recording has the columns {TIME}, x0, y0, x1, y1, ... along the cable, of at most {most} "
            f"keypoints; {said}; it has {_listed(names)}"
        )
    given = [name for name in POSES if name in known]
    if given and len(given) < len(POSES):
        raise FileFormatError(
            f"{path}: of the columns {', '.join(POSES)} there must be all or none, got {_listed(given)}"
        )
    columns = {"times": [TIME], "keypoints": pairs, "poses": given, "episode": [EPISODE] if EPISODE in known else []}
    return {name: each for name, each in columns.items() if each}


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """The lines that are neither empty nor comments, with their numbers."""
    try:
        text = read_bytes(path, LARGEST_TEXT).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise FileFormatError(f"{path}: not text in UTF-8") from None
    for number, line in enumerate(io.StringIO(text, newline=None), start=1):
        if line.strip() and line[0] != "#":
            yield number, line


def _cells(path: Path, number: int, line: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line], strict=True))]
    except csv.Error as error:
        raise FileFormatError(f"{path}: line {number}: not comma-separated values: {one_line(error)}") from None


def _number(cell: str, path: Path, line: int, column: str) -> float:
    """The number in a cell; NaN in an empty one."""
    try:
        return float(cell or "nan")
    except ValueError:
        raise FileFormatError(f"{path}: line {line}: {column} must be a number or empty, got {shown(cell)}") from None
