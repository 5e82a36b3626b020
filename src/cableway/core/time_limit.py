"""A time limit that holds wherever work is done: whoever waits sets it, and long loops ask whether it is over.

A limit is a scope, as in Trio: it holds for what runs below the `with`, in this thread, and no signature in between
names it. Without one, `checkpoint` does nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_EXPIRED: ContextVar[Callable[[], bool]] = ContextVar("expired", default=lambda: False)


class OutOfTime(Exception):
    """The time limit is over."""


@contextmanager
def time_limit(expired: Callable[[], bool] | None) -> Iterator[None]:
    """End what runs below at its next `checkpoint` once `expired` says so, or a limit set further outside is over.

    Args:
        expired: Whether the time is over; None sets no limit of its own.
    """
    outer = _EXPIRED.get()
    token = _EXPIRED.set(outer if expired is None else lambda: outer() or expired())
    try:
        yield
    finally:
        _EXPIRED.reset(token)


def checkpoint() -> None:
    """Go on if there is time.

    Raises:
        OutOfTime: There is none.
    """
    if _EXPIRED.get()():
        raise OutOfTime
