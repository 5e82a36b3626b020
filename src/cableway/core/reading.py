"""Files from anywhere, read strictly: regular files of bounded size, in which nothing is executed.

A FIFO, a device or a folder is refused before it can hang a command; an archive before it fills the memory; JSON where
a key stands twice, a number is not finite or brackets are nested without end.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import stat
import zipfile
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cableway.core.errors import FileFormatError

LARGEST_FILE = 256_000_000
"""Bytes of the largest file that is read, unless its kind has a limit of its own."""

LARGEST_TEXT = 20_000_000
"""Bytes of the largest JSON file; a baseline of 10,000 episodes has a quarter of it."""

MOST_NUMBERS = 16_000_000
"""Array elements in one file: 128 MB in double precision, a rollout of 40 minutes."""

MOST_ARRAYS = 100
"""Arrays in one file; records have about 15."""

DEEPEST = 60
"""Levels of nested lists and mappings; those of a configuration have six."""


def read_bytes(path: Path | str, most: int = LARGEST_FILE) -> bytes:
    """The content of a regular file of at most `most` bytes.

    Raises:
        FileFormatError: It is missing, not a regular file, too large, or cannot be read.
    """
    try:
        with open(path, "rb", opener=_without_waiting) as file:
            found = os.fstat(file.fileno())
            if not stat.S_ISREG(found.st_mode) or found.st_size > most:
                raise FileFormatError(f"{path}: not a regular file of at most {most / 1e6:g} MB")
            return file.read(found.st_size)
    except FileNotFoundError:
        raise FileFormatError(f"{path}: no such file") from None
    except IsADirectoryError:
        raise FileFormatError(f"{path}: is a folder, not a file") from None
    except (OSError, ValueError) as error:
        raise FileFormatError(f"{str(path)!r}: cannot be read: {one_line(_reason(error))}") from None


def _without_waiting(path: str, flags: int) -> int:
    """Opens a FIFO that nobody writes to at once, so that it can be refused."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _reason(error: Exception) -> object:
    return getattr(error, "strerror", None) or error


def one_line(text: object) -> str:
    """A message of a library on one line, cut short where it quotes what it read."""
    return " ".join(str(text).split())[:300]


def read_json(path: Path | str) -> Any:
    """The content of a JSON file; see `parse_json`.

    Raises:
        FileFormatError: The file cannot be read, or is not such JSON.
    """
    return parse_json(read_bytes(path, LARGEST_TEXT), str(path))


def read_table(path: Path | str, columns: Sequence[str]) -> list[tuple[str, ...]]:
    """The values of some columns of a CSV file with their names in its first line; other columns are not read.

    Raises:
        FileFormatError: The file cannot be read, lacks a column, or has a row that is too short.
    """
    reader = csv.DictReader(io.StringIO(read_bytes(path, LARGEST_TEXT).decode(errors="replace")))
    missing = [name for name in columns if name not in (reader.fieldnames or [])]
    if missing:
        raise FileFormatError(f"{path}: there is no column {missing[0]!r}")
    rows = []
    for row in reader:
        if short := [name for name in columns if row[name] is None]:
            raise FileFormatError(f"{path}: line {reader.line_num} has no {short[0]!r}")
        rows.append(tuple(row[name] for name in columns))
    return rows


def parse_json(text: str | bytes, where: str) -> Any:
    """Plain data from JSON in which every key stands once, all numbers are finite and nesting ends.

    Args:
        text: The JSON.
        where: Says in messages where it is from.

    Raises:
        FileFormatError: It is not such JSON.
    """
    try:
        content = json.loads(text, object_pairs_hook=_once, parse_constant=_not_finite, parse_float=_finite)
    except RecursionError:
        raise FileFormatError(f"{where}: not JSON: nested too deeply") from None
    except ValueError as error:  # not JSON, not UTF-8, a number of 5,000 digits
        raise FileFormatError(f"{where}: not JSON: {one_line(error)}") from None
    require_depth(content, where)
    return content


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        twice = Counter(name for name, _ in pairs).most_common(1)[0][0]
        raise ValueError(f"the key {twice!r} stands twice in one object")
    return content


def _not_finite(text: str) -> Any:
    raise ValueError(f"{text} is not a finite number")


def _finite(text: str) -> float:
    value = float(text)
    return value if math.isfinite(value) else _not_finite(text)


def require_depth(content: Any, where: str) -> None:
    """Check that plain data is nested no deeper than `DEEPEST` levels.

    Raises:
        FileFormatError: It is deeper; the message begins with `where`.
    """
    level: list[Any] = [content]
    for _ in range(DEEPEST):
        nested = {id(each): each for each in level if isinstance(each, (dict, list))}  # an alias of YAML counts once
        level = [
            part
            for each in nested.values()
            for part in (each.values() if isinstance(each, dict) else each)
            if isinstance(part, (dict, list))
        ]
        if not level:
            return
    raise FileFormatError(f"{where}: nested deeper than {DEEPEST} levels")


def read_arrays(path: Path | str) -> dict[str, np.ndarray]:
    """All arrays of an `.npz` file, read-only.

    Raises:
        FileFormatError: The file cannot be read, is no archive of plain arrays, or they are too large.
    """
    content = io.BytesIO(read_bytes(path))
    if not zipfile.is_zipfile(content):
        raise FileFormatError(f"{path}: not an .npz archive")
    try:
        with zipfile.ZipFile(content) as archive:
            return _arrays(archive)
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from None
    except Exception as error:  # NumPy, zipfile, zlib and tokenize have a dozen kinds for damaged archives
        raise FileFormatError(f"{path}: a damaged .npz archive ({one_line(error)})") from None


def _arrays(archive: zipfile.ZipFile) -> dict[str, np.ndarray]:
    members = archive.infolist()
    names = [member.filename.removesuffix(".npy") for member in members]
    if len(members) > MOST_ARRAYS or len(set(names)) < len(names):
        raise FileFormatError(f"an archive of at most {MOST_ARRAYS} arrays, each of its own name, is wanted")
    if sum(member.file_size for member in members) > LARGEST_FILE:
        raise FileFormatError(f"its arrays are larger than {LARGEST_FILE / 1e6:g} MB")
    if any(member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for member in members):
        raise FileFormatError("compressed otherwise than an .npz archive is")
    arrays = {name: _array(archive.read(member), name) for name, member in zip(names, members, strict=True)}
    if sum(array.size for array in arrays.values()) > MOST_NUMBERS:
        raise FileFormatError(f"its arrays have more than {MOST_NUMBERS:,} elements")
    return arrays


_HEADERS: dict[tuple[int, int], Callable[[Any], tuple[tuple[int, ...], bool, np.dtype]]] = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def _array(content: bytes, name: str) -> np.ndarray:
    """The array of an `.npy` file whose header promises neither more nor less than there is."""
    file = io.BytesIO(content)
    version = np.lib.format.read_magic(file)
    if version not in _HEADERS:
        raise FileFormatError(f"array {name!r} is of version {version} of the format .npy")
    shape, columns_first, dtype = _HEADERS[version](file)
    if dtype.hasobject:
        raise FileFormatError(f"array {name!r} holds Python objects, which are never read")
    promised, there = math.prod(shape) * dtype.itemsize, len(content) - file.tell()
    if promised != there or math.prod(max(1, size) for size in shape) > MOST_NUMBERS:
        raise FileFormatError(f"array {name!r} is {dtype}{list(shape)}, but has {there} bytes")
    return np.ndarray(shape, dtype, content, file.tell(), order="F" if columns_first else "C")


def parse_safetensors(content: bytes, where: str) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """The arrays, read-only, and the metadata of a safetensors file.

    Args:
        content: The file's.
        where: Says in messages where it is from.

    Raises:
        FileFormatError: It is no such file, or its header is not strict JSON.
    """
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        arrays = load(content)
    except (SafetensorError, ValueError, KeyError, TypeError, OverflowError) as error:
        raise FileFormatError(f"{where}: not a readable safetensors file ({one_line(error)})") from None
    header = parse_json(content[8 : 8 + int.from_bytes(content[:8], "little")], f"{where}: its header")
    return arrays, header.get("__metadata__", {})
