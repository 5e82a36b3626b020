"""The errors cableway raises on purpose.

Every message is one sentence that names the file or argument, the value found and what would be valid.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any


class CablewayError(Exception):
    """Base of every error that cableway raises on purpose."""


class InputError(CablewayError):
    """An argument or a file that the caller gave cannot be used (exit status 2)."""


class TaskError(InputError):
    """A task that contradicts itself: wrong lengths, shapes in collision, grippers too far apart."""


class FileFormatError(InputError):
    """A file that is missing, damaged or of another kind than expected."""


class UnknownNameError(InputError):
    """A name that is not in a fixed list; the message gives the list."""

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        super().__init__(f"unknown {kind} {name!r}; known: {', '.join(sorted(known))}")


class PlanningError(CablewayError):
    """No plan was found (exit status 1).

    Attributes:
        attempt: The closest attempt as an unverified `cableway.records.Attempt`, or None.
    """

    def __init__(self, message: str, attempt: Any = None) -> None:
        super().__init__(message)
        self.attempt = attempt


class SimulationError(CablewayError):
    """The simulated plant cannot go on: an overlap at the start, a slipped grasp, a diverged state."""


class ControlError(CablewayError):
    """A controller could not produce a usable action."""
