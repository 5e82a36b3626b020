"""What a page tells, in the order in which it does."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Any


def in_order(hear: Callable[[Any], Any]) -> Callable[[Any], Coroutine[Any, Any, None]]:
    """A callback that viser calls with events as they come.

    Functions that are none of asyncio's it hands to threads, and which of them is first is open.
    """

    async def heard(event: Any) -> None:
        hear(event)

    return heard
