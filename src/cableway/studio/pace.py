"""A run that is watched takes the time that it says."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from cableway.core.errors import InputError


class Pace:
    """Waits until the rows of a run are due, in wall time since the first; what is late, as on a robot, stays so.

    Args:
        since: Time [s] of the run before which nothing is waited for.
        wait: Waits for so many seconds, or for less where there is a reason.
    """

    def __init__(self, since: float = 0.0, wait: Callable[[float], Any] = time.sleep) -> None:
        if not since >= 0:
            raise InputError(f"since must not be negative, got {since!r}")
        self._since, self._wait = since, wait
        self._last = 0.0
        self._due: float | None = None

    def keep(self, row_time: float) -> None:
        """Wait until a row is due, given its time [s]."""
        passed, self._last = row_time - self._last, row_time
        now = time.monotonic()
        if self._due is None or passed < 0 or row_time <= self._since:  # another run begins: an insertion
            self._due = now
            return
        self._due += passed
        if self._due > now:
            self._wait(self._due - now)
        else:
            self._due = now
