"""Compiled kernels: one decorator, and where the compiled code is kept.

Numba compiles a kernel when it is first called and stores the result on disk. The folder is named after a
digest of all kernel sources, because Numba itself does not notice when a kernel that another one calls changes, and of
the place where they are installed, because Numba keeps what it compiles for each place by itself.
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import platformdirs
from numba.core import config

F = TypeVar("F", bound=Callable[..., Any])


@cache
def cache_folder() -> Path:
    """Folder of the compiled kernels of this installation of the sources, in the user's cache folder."""
    package = Path(__file__).resolve().parents[1]
    texts = (path.read_bytes() for path in sorted(package.rglob("*.py")))
    kernels = b"".join(text for text in texts if b"@kernel" in text)
    digest = hashlib.sha256(str(package).encode() + kernels).hexdigest()[:12]
    return Path(platformdirs.user_cache_dir("cableway", appauthor=False)) / f"numba-{numba.__version__}-{digest}"


def kernel(function: F) -> F:
    """Compile `function` with Numba on first call and keep the result in `cache_folder()`.

    Type checkers that tests wrap around functions are taken off.

    A `NUMBA_CACHE_DIR` set by the user wins. Numba's global configuration is left as it was found.
    """
    before = getattr(config, "CACHE_DIR")  # noqa: B009 - set by Numba at run time, unknown to type checkers
    try:
        if not before:
            config.CACHE_DIR = str(cache_folder())  # pyright: ignore[reportAttributeAccessIssue]
        return cast("F", numba.njit(cache=True, error_model="numpy")(inspect.unwrap(function)))
    finally:
        config.CACHE_DIR = before  # pyright: ignore[reportAttributeAccessIssue]


def is_compiled(part: str) -> bool:
    """Whether an earlier process went through planning or control with these sources, so that its kernels are compiled.

    Compiled files alone prove nothing: loading a task compiles a few kernels, planning many more.
    """
    return _mark(part).is_file()


def mark_compiled(part: str) -> None:
    """Note for later processes that the kernels of a part are compiled; a read-only cache stays as it is."""
    with suppress(OSError):
        cache_folder().mkdir(parents=True, exist_ok=True)
        _mark(part).touch()


def _mark(part: str) -> Path:
    return cache_folder() / f"{part}-is-compiled"
