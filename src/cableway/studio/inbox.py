"""What a page is to do, one after the other in a thread of its own."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Any

from cableway.core.errors import CablewayError, said

LOGGER = logging.getLogger(__name__)

IDLE = 3600.0
"""Time [s] after which it is looked again whether there is something to do, though nobody said so."""


class Inbox:
    """Does what is posted, in order.

    Args:
        on_error: Told in a sentence what could not be done.
    """

    def __init__(self, on_error: Callable[[str], Any]) -> None:
        self._on_error = on_error
        self._waiting: dict[Any, tuple[float, Callable[[], Any]]] = {}
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def post(self, do: Callable[[], Any], *, key: str = "", delay: float = 0.0) -> None:
        """Have something done.

        Args:
            do: Called without arguments.
            key: What it says the whole of, as where a slider stands: it takes the place of what waits under the same
                key. "" for a step from where things are, as an undo: each is done.
            delay: Time [s] to wait for something newer, as while a number is typed.
        """
        with self._changed:
            key = key or object()  # pyright: ignore[reportAssignmentType]
            if delay or key not in self._waiting:
                self._waiting.pop(key, None)
            self._waiting[key] = (time.monotonic() + delay, do)
            self._changed.notify()

    def close(self) -> None:
        """Do nothing any more."""
        with self._changed:
            self._closed = True
            self._changed.notify()

    def _next(self) -> Callable[[], Any] | None:
        with self._changed:
            while not self._closed:
                now = time.monotonic()
                due = next((key for key, (when, _) in self._waiting.items() if when <= now), None)
                if due is not None:
                    return self._waiting.pop(due)[1]
                soon = min((when for when, _ in self._waiting.values()), default=now + IDLE)
                self._changed.wait(soon - now)
        return None

    def _work(self) -> None:
        while (do := self._next()) is not None:
            try:
                do()
            except CablewayError as error:
                self._on_error(str(error))
            except Exception as error:
                if not self._closed:
                    LOGGER.exception("what a page was to do failed")
                    self._on_error(f"an error of cableway's own: {said(error)}")
