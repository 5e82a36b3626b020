"""The errors cableway raises on purpose.

Every message is one sentence that names the file or argument, the value found and what would be valid.
"""

from __future__ import annotations

import errno
import importlib
import sys
import traceback
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from unicodedata import category


class CablewayError(Exception):
    """Base of every error that cableway raises on purpose."""


def printable(text: str) -> str:
    """A text without what would move a terminal's cursor or colour it: control characters as their escapes.

    >>> print(printable("red " + chr(27) + "[31m"))
    red \\x1b[31m
    """
    return "".join(letter if letter in "\n\t" or category(letter)[0] != "C" else repr(letter)[1:-1] for letter in text)


def raised() -> tuple[type[BaseException], ...]:
    """What code of a user's own may raise: an error, `sys.exit`, or an asyncio task that was cancelled.

    For `except` clauses, which ask only once something was raised: by then asyncio is loaded if it takes part.
    """
    asyncio = sys.modules.get("asyncio.exceptions")
    return (Exception, SystemExit, GeneratorExit, *([] if asyncio is None else [asyncio.CancelledError]))


def said(error: BaseException) -> str:
    """Kind and message of an error, on one line and cut short, and the last line of code not ours that it passed.

    >>> said(ValueError("no such pose")), said(TimeoutError())
    ('ValueError: no such pose', 'TimeoutError')
    """
    try:
        message = " ".join(str(error).split())[:300]
    except raised():  # its text is made by code of the user's, too
        message = ""
    text = f"{type(error).__name__}: {message}" if message else type(error).__name__
    ours = (str(Path(__file__).parents[1]), importlib.__path__[0], "<")
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if not frame.filename.startswith(ours)]
    if not frames or isinstance(error, SyntaxError):
        return text
    return f"{text} ({Path(frames[-1].filename).name}, line {frames[-1].lineno})"


class InputError(CablewayError):
    """An argument or a file that the caller gave cannot be used (exit status 2)."""


Place = tuple[str | int, ...]
"""Keys and indices that lead to a value in a task, such as ("obstacles", 2, "size")."""


def place_text(place: Place) -> str:
    """A place as it is written in messages, long keys cut short.

    >>> place_text(("obstacles", 2, "size")), len(place_text(("a" * 1000,)))
    ('obstacles[2].size', 60)
    """
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step:.60}" for step in place).lstrip(".")


Point = tuple[float, float]
"""A place on the table [m]."""

SpacePoint = tuple[float, float, float]
"""A place in space [m]."""


class TaskError(InputError):
    """A task that contradicts itself: wrong lengths, shapes in collision, grippers too far apart.

    Attributes:
        problem: What is wrong, said of the place: "must be positive, got -1".
        place: Where in the task; empty where no single value is to blame.
        sentence: The message without the file.
        at: Where on the table, or in space [m]; None where it is nowhere in particular.
        draft: What could not be made, as it was to be, for its picture: a `scene.task.Draft`, a
            `scene.spatial.task.SpatialDraft` or a `scene.scene.Scene`, unchecked; None where the values make none.
        faults: All that is wrong with that, this error first.
    """

    def __init__(
        self, problem: str, place: Place = (), source: str = "", *, at: Point | SpacePoint | None = None
    ) -> None:
        self.problem, self.place, self.at = problem, place, at
        self.draft: Any = None
        self.faults: tuple[TaskError, ...] = (self,)
        self.sentence = f"{place_text(place)} {problem}" if place else problem
        super().__init__(f"{source}: {self.sentence}" if source else self.sentence)

    def within(self, *outer: str | int) -> TaskError:
        """The same error seen from farther outside: `outer` goes before the place."""
        return TaskError(self.problem, (*outer, *self.place), at=self.at)

    def found_in(self, source: str) -> TaskError:
        """The same error with the file, and the line if known, before the message."""
        return TaskError(self.problem, self.place, source, at=self.at).of(self.draft, self.faults[1:])

    def of(self, draft: Any, others: Iterable[TaskError] = ()) -> TaskError:
        """This error with what it is about, and what else is wrong with that."""
        self.draft, self.faults = draft, (self, *others)
        return self


class FileFormatError(InputError):
    """A file that is missing, damaged or of another kind than expected."""


class UnknownNameError(InputError):
    """A name that is not in a fixed list; the message gives the list."""

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        super().__init__(f"unknown {kind} {name!r}; known: {', '.join(sorted(known))}")


class MissingExtraError(InputError, ImportError):
    """Packages that only an extra installs are missing; the message says how to install them (exit status 2)."""


FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Numbers of the errors of a disk that is full or fails."""


class StorageError(CablewayError):
    """A result could not be written in full: no space left, a file system that failed (exit status 1)."""


class PlanningError(CablewayError):
    """No plan was found (exit status 1).

    Attributes:
        attempt: The closest attempt as an unverified `cableway.records.Attempt`, or None.
        outcome: Value of a `cableway.outcome.Outcome`: "no plan", "infeasible" where none exists, "timed out".
    """

    def __init__(self, message: str, attempt: Any = None, outcome: str = "no plan") -> None:
        super().__init__(message)
        self.attempt, self.outcome = attempt, outcome


class Cancelled(CablewayError):
    """Raised by a callback that receives progress, to cancel the computation."""


class PlanningInterrupted(PlanningError):
    """The search was interrupted from the keyboard after something had been tried; `attempt` is what came closest."""


class TrackingInterrupted(KeyboardInterrupt):
    """A run was interrupted from the keyboard.

    Attributes:
        rollout: What was tracked until then, as a `cableway.records.Rollout`.
    """

    def __init__(self, rollout: Any) -> None:
        super().__init__("interrupted while tracking")
        self.rollout = rollout


class SimulationError(CablewayError):
    """The simulated plant cannot go on: an overlap at the start, a slipped grasp, a diverged state."""


class PressedError(SimulationError):
    """The cable was pressed too far into something.

    Attributes:
        clearance: The least on the way there [m], below zero.
    """

    def __init__(self, message: str, clearance: float) -> None:
        super().__init__(message)
        self.clearance = clearance


class GraspError(SimulationError):
    """A hand missed the end of the cable, or lost it."""


class ControlError(CablewayError):
    """A controller could not produce a usable action."""
