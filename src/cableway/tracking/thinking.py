"""Where a controller computes: at once, while simulated time stands still, or in a thread, while a robot moves."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import Any, TypeVar

T = TypeVar("T")


class Late(Exception):
    """There is no answer yet."""


class AtOnce:
    """Computes at once, however long it takes."""

    threaded = False

    def answer(self, compute: Callable[[], T], limit: float | None) -> T:
        """What `compute` returns."""
        return compute()

    def begin(self, compute: Callable[[], T]) -> Future[T]:
        """A computation that is over."""
        future: Future[T] = Future()
        _compute(compute, future)
        return future


class InThread:
    """Computes in threads of its own, one computation at a time.

    What takes too long is not ended, as threads cannot be; its answer is dropped, and nothing else is begun until it
    has come.
    """

    threaded = True

    def __init__(self) -> None:
        self._running: Future[Any] | None = None

    def answer(self, compute: Callable[[], T], limit: float | None) -> T:
        """What `compute` returns, if it is there after `limit` [s] of wall time.

        Raises:
            Late: It is not, or what was begun before is not over yet.
        """
        until = None if limit is None else time.monotonic() + limit
        if self._running is not None and not wait([self._running], limit).done:
            raise Late
        self._running = future = self.begin(compute)
        if not wait([future], None if until is None else max(0.0, until - time.monotonic())).done:
            raise Late
        self._running = None
        return future.result()

    def begin(self, compute: Callable[[], T]) -> Future[T]:
        """A computation that goes on by itself; it does not keep the process from ending."""
        future: Future[T] = Future()
        threading.Thread(target=_compute, args=(compute, future), name="cableway controller", daemon=True).start()
        return future


def _compute(compute: Callable[[], Any], future: Future[Any]) -> None:
    try:
        future.set_result(compute())
    except BaseException as error:  # whoever waits for it gets it
        future.set_exception(error)
