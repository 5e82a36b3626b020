"""Compiled kernels: one decorator, and where the compiled code is kept.

Numba compiles a kernel when it is first called and stores the result on disk. The folder is named after a
digest of all kernel sources, because Numba itself does not notice when a kernel that another one calls changes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
import platformdirs

F = TypeVar("F", bound=Callable[..., Any])


@cache
def cache_folder() -> Path:
    """Folder of the compiled kernels of this version of the sources, in the user's cache folder."""
    package = Path(__file__).resolve().parents[1]
    sources = sorted(path for folder in ("geometry", "rod", "planning") for path in (package / folder).glob("*.py"))
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:12]
    return Path(platformdirs.user_cache_dir("cableway", appauthor=False)) / f"numba-{numba.__version__}-{digest}"


def kernel(function: F) -> F:
    """Compile `function` with Numba on first call and keep the result in `cache_folder()`.

    A `NUMBA_CACHE_DIR` set by the user wins. Numba's global configuration is left as it was found.
    """
    before = numba.config.CACHE_DIR
    if not before:
        numba.config.CACHE_DIR = str(cache_folder())
    try:
        return numba.njit(cache=True, error_model="numpy")(function)
    finally:
        numba.config.CACHE_DIR = before


def is_compiled() -> bool:
    """Whether an earlier process has left compiled kernels for these sources."""
    return cache_folder().is_dir() and any(cache_folder().rglob("*.nbi"))
