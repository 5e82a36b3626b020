"""When the pictures of a simulated plant are taken, and of which state: also between control steps."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from typing import Generic, Protocol, TypeVar

import numpy as np

from cableway.tracking.photographer import EyesConfig

ROUNDING = 1e-9
"""[s]."""


class Timed(Protocol):
    """Something that was so at a time."""

    @property
    def time(self) -> float:
        """[s]."""
        ...


S = TypeVar("S", bound=Timed)


class Shutter(Generic[S]):
    """Takes pictures at a rate of its own.

    Args:
        config: The cameras: frame rate, latency, share of the pictures that are lost.
        control_step: Time [s] between two states.
        between: The state at a time, given the one before, the one after, and which share of the way it is.
    """

    def __init__(self, config: EyesConfig, control_step: float, between: Callable[[S, S, float, float], S]) -> None:
        self._config, self._step, self._between = config, control_step, between
        self._states: deque[S] = deque()
        self._frame = 0

    @property
    def last(self) -> S | None:
        """The state that was noted last."""
        return self._states[-1] if self._states else None

    def note(self, state: S) -> None:
        """What is so now."""
        self._states.append(state)
        while len(self._states) > 2 and self._states[1].time < state.time - self._config.latency - self._step:
            self._states.popleft()

    def taken(self, now: float, rng: np.random.Generator) -> Iterator[S]:
        """The states of the pictures that have come since, oldest first; the first picture of all is never lost, nor
        late."""
        config = self._config
        while (time := self._frame / config.frame_rate) <= now - (config.latency if now else 0.0) + ROUNDING:
            first = not self._frame
            self._frame += 1
            lost = rng.random() < config.drop_rate
            if first or not lost:
                yield self.at(time)

    def at(self, time: float) -> S:
        """The state at a time, between two that are known."""
        states = list(self._states)
        after = next((k for k, state in enumerate(states) if state.time >= time - ROUNDING), len(states) - 1)
        b, a = states[after], states[max(after - 1, 0)]
        share = 1.0 if b.time <= a.time else min(max((time - a.time) / (b.time - a.time), 0.0), 1.0)
        return self._between(a, b, share, time)
