"""Compiled kernels: the decorator, how many are compiled, and a clock that does not count their compilation.

Numba compiles a kernel when it is first called, with all that it calls; `cableway.core.kernel_cache` keeps the result.
"""

from __future__ import annotations

import inspect
import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, TypeVar, cast

import numba
from numba.core import event
from numba.core.dispatcher import Dispatcher

from cableway.core.kernel_cache import KernelCache, keep, kept, trusted_folder

LOGGER = logging.getLogger(__name__)

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile a function with Numba on first call and keep the result on disk.

    Type checkers that tests wrap around functions are taken off.
    """
    return _compiled(function)


def inlined(function: F) -> F:
    """The same for a function that becomes a part of each kernel that calls it.

    It is for what one or two kernels call: it is compiled with them, rather than by itself and then with them again.
    """
    return _compiled(function, inline="always")


def _compiled(function: F, **options: Any) -> F:
    plain = inspect.unwrap(function)
    compiled: Any = numba.njit(error_model="numpy", **options)(plain)
    if isinstance(compiled, Dispatcher):  # not with NUMBA_DISABLE_JIT
        vars(compiled)["_cache"] = KernelCache(plain, _BUSY)
    return cast("F", compiled)


class _Busy(event.Listener):
    """Counts the time that this process spends compiling and loading, and tells who watches of each kernel compiled."""

    def __init__(self) -> None:
        self.seconds, self._depth, self._since = 0.0, 0, 0.0
        self.watchers: list[Callable[[], Any]] = []
        self._begun: list[float] = []

    def __enter__(self) -> None:
        _listen()
        self._depth += 1
        if self._depth == 1:
            self._since = time.monotonic()

    def __exit__(self, *_: object) -> None:
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.monotonic() - self._since

    def on_start(self, event: Any) -> None:
        """A compilation begins; it may need others."""
        self._begun.append(time.monotonic())
        self.__enter__()

    def on_end(self, event: Any) -> None:
        """A compilation ends."""
        name = getattr((event.data or {}).get("dispatcher"), "__name__", "a kernel")
        LOGGER.debug("compiled %s in %.1f s, with those it calls", name, time.monotonic() - self._begun.pop())
        self.__exit__()
        for watcher in self.watchers:
            watcher()

    def now(self) -> float:
        """Seconds of a clock that stands still meanwhile."""
        return self._since - self.seconds if self._depth else time.monotonic() - self.seconds


_BUSY = _Busy()


@cache
def _listen() -> None:
    event.register("numba:compile", _BUSY)


def clock() -> float:
    """Seconds of a clock that stands still while this process compiles kernels or loads them."""
    return _BUSY.now()


@contextmanager
def watched(watcher: Callable[[], Any]) -> Iterator[None]:
    """Call `watcher` after each function that is compiled meanwhile."""
    _BUSY.watchers.append(watcher)
    try:
        yield
    finally:
        _BUSY.watchers.remove(watcher)


def kernels_below(*roots: Any, without: Any = None) -> tuple[Any, ...]:
    """Kernels and all that they call, but for what becomes a part of those that call it, and `without` one of them."""
    found, left = {}, [each for each in roots if isinstance(each, Dispatcher)]
    while left:
        each = left.pop()
        if id(each) not in found and each is not without:
            found[id(each)] = each
            names, code = each.py_func.__globals__, each.py_func.__code__
            left += [names[name] for name in code.co_names if isinstance(names.get(name), Dispatcher)]
    return tuple(each for each in found.values() if each.targetoptions.get("inline") != "always")


def compiled_among(kernels: tuple[Any, ...]) -> int:
    """How many of the kernels are compiled, by this process or by one that kept them."""
    folder = trusted_folder()
    names = set() if folder is None else {path.name.rpartition("-")[0] for path in folder.glob("*.code")}
    return sum(bool(each.signatures) or each._cache.name in names for each in kernels)


def is_compiled(stage: str) -> bool:
    """Whether an earlier process went through a stage with these sources, so that its kernels are compiled.

    Compiled files alone prove nothing: loading a task compiles a few kernels, planning many more.
    """
    return kept(_mark(stage)) is not None


def mark_compiled(stage: str) -> None:
    """Note for later processes that the kernels of a stage are compiled."""
    if not is_compiled(stage):
        keep(_mark(stage), b"")


def _mark(stage: str) -> str:
    return f"{stage}-is-compiled"
