"""Files written whole or not at all, and records that save to them."""

from __future__ import annotations

import errno
import json
import os
import re
import secrets
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import fields
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from cableway.core.errors import FULL, FileFormatError, InputError, StorageError
from cableway.core.reading import parse_json, read_arrays

LARGEST = 1e6
"""No number in the file of a record is larger, in its unit, as in that of a task."""


def write_atomically(path: Path, write: Any) -> None:
    """Call `write(file)` on a temporary file beside `path`, then move it there: all of it or nothing.

    What it leaves is on disk, not in a cache: it outlasts a crash of the machine.

    Args:
        path: Where the content goes; its folder is made if missing.
        write: Called with a binary file object.

    Raises:
        StorageError: There is no room for it, or the file system failed.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(6)}")  # known before it exists, so that it goes again
    try:
        with open(temporary, "xb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
        _sync_folder(path.parent)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        if error.errno not in FULL:
            raise
        raise StorageError(f"{path}: cannot be written: {error.strerror}") from None
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


@contextmanager
def only_writer(folder: Path) -> Iterator[None]:
    """Hold a folder for this process; the system lets go of it when the process ends, however it ends.

    It is made if missing, and removed again where nothing was written to it. Where the file system knows no locks,
    nothing is held.

    Raises:
        InputError: Another process writes to it.
    """
    made = [each for each in (folder, *folder.parents) if not each.exists()]
    handle = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = _open_to_lock(folder)
        if not _lock(handle):
            raise InputError(f"{folder}: another process is writing to this folder")
        yield
    finally:
        if handle is not None:
            os.close(handle)
        with suppress(OSError):  # something is in it
            for each in made:
                each.rmdir()


def _open_to_lock(folder: Path) -> int:
    """A handle to lock a folder by; Windows opens no folders, and so gets a file that goes with the handle."""
    if sys.platform == "win32":
        return os.open(folder / ".writing", os.O_RDWR | os.O_CREAT | os.O_TEMPORARY)
    return os.open(folder, os.O_RDONLY)


def _lock(handle: int) -> bool:
    """Lock a handle for this process; whether no other one has it."""
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    except OSError as error:
        if error.errno not in (errno.ENOSYS, errno.ENOTSUP, errno.ENOLCK):
            raise
    return True


def _sync_folder(folder: Path) -> None:
    if sys.platform == "win32":  # where folders cannot be opened
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_bytes(path: Path, content: bytes) -> None:
    """Write what is in memory atomically; see `write_atomically`."""
    write_atomically(path, lambda file: file.write(content))


def write_text(path: Path, text: str) -> None:
    """Write a text in UTF-8 atomically; see `write_atomically`."""
    write_bytes(path, text.encode())


def write_json(path: Path, content: Any) -> None:
    """Write indented JSON atomically; not-a-number is refused."""
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


class ArrayRecord:
    """Base of the records that save to `.npz`. Subclasses are frozen dataclasses."""

    kind: ClassVar[str]

    def save(self, path: Path | str) -> None:
        """Write the record to an `.npz` file, atomically."""
        write_atomically(Path(path), lambda file: np.savez_compressed(file, **self.to_arrays()))

    def to_arrays(self) -> dict[str, Any]:
        """What goes into the file, by name: all fields that are not None."""
        arrays: dict[str, Any] = {}
        for entry in fields(self):  # pyright: ignore[reportArgumentType]
            value = getattr(self, entry.name)
            if value is not None and entry.init:
                arrays[entry.name] = json.dumps(value) if isinstance(value, dict) else value
        return arrays

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Read a file that `save` wrote.

        Raises:
            FileFormatError: The file is missing, damaged or holds another kind of record.
        """
        return cls.from_arrays(read_arrays(path), str(path))

    @classmethod
    def from_arrays(cls, arrays: dict[str, np.ndarray], source: str) -> Self:
        """The record from the arrays of a file; `source` names it in errors."""
        values: dict[str, Any] = {}
        for entry in fields(cls):  # pyright: ignore[reportArgumentType]
            if not entry.init or (entry.name not in arrays and entry.default is None):
                continue
            if entry.name not in arrays:
                raise FileFormatError(f"{source}: not a {cls.kind} file: there is no array {entry.name!r}")
            value = arrays[entry.name]
            values[entry.name] = _metadata(value, source) if entry.name == "metadata" else value
        try:
            numbers = {name: _numbers(name, value) for name, value in values.items() if _is_number(value)}
            return cls(**values | numbers)
        except InputError as error:
            raise FileFormatError(f"{source}: {error}") from None
        except (TypeError, IndexError, ValueError) as error:
            raise FileFormatError(f"{source}: not the arrays of a {cls.kind} file ({error})") from None


def _is_number(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "fiu"


def _numbers(name: str, array: np.ndarray) -> np.ndarray:
    """Real numbers of any kind and size as float64: differences of unsigned ones wrap, Shapely has no long doubles."""
    with np.errstate(over="ignore"):
        numbers = array.astype(np.float64)
    large = np.isfinite(array) & ~(np.abs(numbers) <= LARGEST)
    if large.any():
        raise InputError(f"{name} holds {array[large][0]!s}; numbers of a record are at most {LARGEST:g}")
    return numbers


def _metadata(value: np.ndarray, source: str) -> dict[str, Any]:
    content = parse_json(str(value), f"{source}: metadata")
    if not isinstance(content, dict):
        raise FileFormatError(f"{source}: metadata is not a JSON object")
    return content


def check_shapes(record: Any) -> None:
    """Check that the arrays of a record are real numbers of the shapes that its annotations state.

    Raises:
        InputError: One is not; a letter must stand for the same number throughout the record.
    """
    sizes: dict[str, int] = {}
    for entry in fields(record):
        stated = re.fullmatch(r"Float\[np\.ndarray, '(.*)'\]( \| None)?", str(entry.type))
        value = getattr(record, entry.name)
        if stated is None or (value is None and stated[2]):
            continue
        axes = stated[1].split()
        if not (isinstance(value, np.ndarray) and value.dtype.kind in "fiu"):
            raise InputError(f"{entry.name} is not an array of numbers")
        fits = value.ndim == len(axes) and all(
            _is_size(axis, size, sizes) for axis, size in zip(axes, value.shape, strict=True)
        )
        known = ", ".join(f"{letter} = {size}" for letter, size in sizes.items())
        if not fits:
            raise InputError(
                f"{entry.name} has shape {value.shape}, not ({', '.join(axes)}) with {known or 'any sizes'}"
            )


def _is_size(axis: str, size: int, sizes: dict[str, int]) -> bool:
    """Whether an axis such as "T+1" or "2" may have this size; a letter met for the first time gets its value."""
    letter, _, more = axis.partition("+")
    if letter.isdigit():
        return size == int(letter)
    counted = size - int(more or 0)
    return counted == sizes.setdefault(letter, counted)
