"""What SIGINT (ctrl-c) and SIGTERM do to a command: it ends in one sentence, whatever it was doing."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from importlib.machinery import ExtensionFileLoader
from types import FrameType
from typing import Any, TypeVar

from cableway.core.errors import CablewayError

T = TypeVar("T")

GRACE = 1.0
"""Time [s] within which what is held must look at `Interrupts.came`; after that, or at a second signal, it is
interrupted all the same. As often it is looked whether something swallowed the interrupt, as a bare `except` does."""


AGAIN = 0.05
"""Time [s] after which it is looked again whether what runs may be interrupted."""

WHOLE = {
    ("multiprocessing.synchronize", "SemLock.__init__"),
    ("multiprocessing.synchronize", "SemLock._cleanup"),
    ("multiprocessing.util", "Finalize.__call__"),
}
"""Modules and functions that make a lock which processes share, or take it away, mostly as the lock is collected: where
an exception comes out of them, it is lost, and the lock is warned of as the process ends."""

CONTINUES = "and the same command continues from there"


def _nothing() -> str:
    return ""


class Interrupted(KeyboardInterrupt):
    """A signal came.

    A class of its own: where a plain `KeyboardInterrupt` passes through `exec`, as in the import of a dataclass, the
    interpreter later ends itself by SIGINT and the exit status is lost.
    """


class Interrupts:
    """Signals to the command that runs now.

    Attributes:
        came: The first signal, 0 where none came. It is set before `Interrupted` is raised, and tells an interrupt from
            an error where a library has turned the one into the other, as extension modules do while they are imported.
        kept: What the command that runs has kept so far and where, in words, "" for nothing.
    """

    def __init__(self) -> None:
        self.came = 0
        self.kept: Callable[[], str] = _nothing
        self._held = self._raises = False

    @property
    def status(self) -> int:
        """The exit status of an interrupted command, as shells have it."""
        return 128 + (self.came or signal.SIGINT)

    @property
    def sentence(self) -> str:
        """What is said of an interrupted command."""
        try:
            kept = self.kept()
        except (CablewayError, OSError):
            kept = ""
        return ("terminated" if self.came == signal.SIGTERM else "interrupted") + (f"; {kept}" if kept else "")

    @contextlib.contextmanager
    def handled(self, last: bool) -> Iterator[None]:
        """Signals that come meanwhile are noted, and raise `Interrupted` in the main thread where `carry_out` is.

        Args:
            last: Whether the process ends afterwards, so that signals from then on mean nothing.
        """
        self.came, self.kept, self._held, self._raises = 0, _nothing, False, False
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        numbers, unraisable = (signal.SIGINT, signal.SIGTERM, *_ALARMS), sys.unraisablehook
        before = {number: signal.signal(number, self._receive) for number in numbers}
        sys.unraisablehook = lambda args: None if self.came else unraisable(args)  # of what was left half done
        try:
            yield
        finally:
            self._held = True
            _set_alarm(0.0)
            for number, handler in before.items():
                signal.signal(number, signal.SIG_IGN if last else handler)
            if not last:
                sys.unraisablehook = unraisable

    def carry_out(self, command: Callable[[], T]) -> T:
        """What a command returns.

        Raises:
            Interrupted: A signal came, before it or meanwhile; one that comes afterwards, nobody would receive.
        """
        try:
            self._raises = True
            if self.came:
                raise Interrupted
            return command()
        finally:
            self._raises = False

    def hold(self) -> None:
        """From now on what runs looks at `came` itself, so that it can end in order."""
        self._held = True

    def release(self) -> None:
        """The end of `hold`.

        Raises:
            Interrupted: A signal came meanwhile.
        """
        self._held = False
        if self.came:
            raise Interrupted

    def _receive(self, number: int, frame: FrameType | None) -> Any:
        if number in _ALARMS:
            if not self.came or _is_handled():
                return
            self._held = False
        held, first = self._held, not self.came
        self.came = self.came or number
        later = bool(_ALARMS) and _breaks(frame)
        if first:
            _set_alarm(AGAIN if later and not held else GRACE)
        if later or (held and first) or not self._raises:
            return
        raise Interrupted


_ALARMS = () if sys.platform == "win32" else (signal.SIGALRM,)


def _set_alarm(seconds: float) -> None:
    """Have an alarm come that often, never where that is 0; Windows has none, so there only a second signal helps."""
    if sys.platform != "win32":
        signal.setitimer(signal.ITIMER_REAL, seconds, seconds)


def _breaks(frame: FrameType | None) -> bool:
    """Whether an exception would break what runs now: an extension module that is loaded may crash where one comes out
    of the Python that it calls, and there is what must be done whole, `WHOLE`.
    """
    while frame is not None:
        place = frame.f_globals.get("__name__"), frame.f_code.co_qualname
        if place in WHOLE or isinstance(frame.f_locals.get("self"), ExtensionFileLoader):
            return True
        frame = frame.f_back
    return False


def _is_handled() -> bool:
    """Whether an interrupt is on its way through an `except`, `finally` or `with`, where things are put in order."""
    error = sys.exc_info()[1]
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


INTERRUPTS = Interrupts()
"""Those of this process."""
