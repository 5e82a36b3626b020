"""Where compiled kernels are kept between processes: a file for each kernel and signature, in a folder of the user.

The files are pickled, so whoever can write one can run code as the user: `private_folder` keeps others out. A file
begins with the digest of its content; one that is cut short or damaged is compiled anew and replaced. Where nothing can
be written, kernels are compiled in memory.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import secrets
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
from numba.core import config
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.registry import cpu_target
from numba.core.serialize import dumps

from cableway.core.user_cache import PROBLEMS, private_folder, user_folder

DIGEST = hashlib.sha256

DECORATORS = (b"@kernel", b"@inlined")
"""Those of `cableway.core.compiled`, which mark the sources of compiled code."""


@cache
def cache_folder() -> Path:
    """Folder of the compiled kernels, in `NUMBA_CACHE_DIR` or else in the user's cache folder; it need not exist.

    It is named after a digest of all that compiled code depends on: the sources of all kernels, since Numba does not
    notice when a kernel that another one calls changes, the processor, the compiler, the Python, and its `-O`.
    """
    package = Path(__file__).resolve().parents[1]
    texts = (path.read_bytes() for path in sorted(package.rglob("*.py")))
    target: Any = cpu_target.target_context
    made_by = (
        *(numba.__version__, llvmlite.__version__, sys.implementation.cache_tag, sys.flags.optimize),
        *target.codegen().magic_tuple(),
    )
    kernels = b"".join(text for text in texts if any(decorator in text for decorator in DECORATORS))
    digest = DIGEST(repr(made_by).encode() + kernels).hexdigest()[:12]
    chosen: str = getattr(config, "CACHE_DIR")  # noqa: B009 - set by Numba at run time, unknown to type checkers
    return (Path(chosen) if chosen else user_folder()) / f"kernels-{digest}"


@cache
def trusted_folder() -> Path | None:
    """The folder, made where it is missing; None where it is not safe to read or cannot be made."""
    return private_folder(cache_folder())


def keep(name: str, content: bytes) -> None:
    """Write a file whole or not at all; where that fails nothing is written any more."""
    folder = trusted_folder()
    if folder is None or folder in PROBLEMS:
        return
    temporary = folder / f".{name}.{secrets.token_hex(6)}"
    try:
        temporary.write_bytes(content)  # not synced, as a file that is lost in a crash is only compiled again
        os.replace(temporary, folder / name)
    except OSError as error:
        PROBLEMS[folder] = error.strerror or str(error)
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def kept(name: str) -> bytes | None:
    """Content of a file; None where there is none that can be read."""
    folder = trusted_folder()
    try:
        return None if folder is None else (folder / name).read_bytes()
    except OSError:
        return None


def _digest(name: str, content: bytes) -> bytes:
    return DIGEST(name.encode() + content).digest()


class KernelCache(_Cache):
    """The compiled signatures of one kernel; Numba's own cache has no digests, and fails where it cannot write.

    Args:
        function: The kernel.
        loading: Entered while code is loaded.
    """

    def __init__(self, function: Callable[..., Any], loading: Any) -> None:
        self.name, self._loading = f"{function.__module__}.{function.__qualname__}", loading

    @property
    def cache_path(self) -> Any:
        """See Numba."""
        return str(cache_folder())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The code for one signature, or None."""
        with self._loading:
            target_context.refresh()
            name, size = self._file(sig), DIGEST().digest_size
            content = kept(name)
            if content is None or _digest(name, content[size:]) != content[:size]:
                return None
            return CompileResult._rebuild(target_context, *pickle.loads(content[size:]))

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the code for one signature."""
        if not data.library.has_dynamic_globals:  # addresses of this process
            name, content = self._file(sig), dumps(data._reduce())
            keep(name, _digest(name, content) + content)

    def _file(self, signature: Any) -> str:
        return f"{self.name}-{DIGEST(str(signature).encode()).hexdigest()[:16]}.code"

    def enable(self) -> None:
        """Always on."""

    def disable(self) -> None:
        """Always on."""

    def flush(self) -> None:
        """Forget nothing."""
