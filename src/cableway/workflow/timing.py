"""The clock of the stages."""

from __future__ import annotations

import time
from collections.abc import Callable


class StageTimer:
    """Measures how long each stage of a computation takes, from what it tells of its progress.

    Args:
        tell: Told the same.
        clock: Seconds.
    """

    def __init__(self, tell: Callable[[str, float], None], clock: Callable[[], float] = time.perf_counter) -> None:
        self._tell, self._clock = tell, clock
        self._last, self._running = clock(), ""
        self.seconds: dict[str, float] = {}

    def __call__(self, stage: str, share: float) -> None:
        """Count the time since the last call to the stage that was running, or else to this one."""
        self._count(self._running or stage)
        self._running = stage if share < 1 else ""
        self._tell(stage, share)

    def stop(self) -> None:
        """Count the time since the last call to the stage that never said that it ended, if there is one."""
        if self._running:
            self._count(self._running)
            self._running = ""

    def _count(self, stage: str) -> None:
        now = self._clock()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now
