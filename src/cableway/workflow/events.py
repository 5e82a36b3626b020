"""What a run reports while it lasts, for a terminal, a notebook or a browser.

`solve` calls its `on_event` with each event, in order, from the thread it was called in. The callback stops the run by
returning `CANCEL` or raising `Cancelled`; the run then ends at the next report of progress, with what is there.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cableway.core.errors import Cancelled

if TYPE_CHECKING:
    from cableway.tracking import Row
    from cableway.workflow.run import Run
    from cableway.workflow.solve_in_space import SpatialRun

CANCEL = "cancel"
"""Returned by a callback to stop the run."""


@dataclass(frozen=True)
class Progress:
    """A stage goes on.

    Attributes:
        stage: Its name.
        share: How much of it is done, 0 where that is not known yet, 1 at its end.
    """

    stage: str
    share: float


@dataclass(frozen=True)
class Note:
    """Something worth knowing while waiting.

    Attributes:
        text: In a sentence.
    """

    text: str


@dataclass(frozen=True)
class Planned:
    """Planning is over; what follows may take longer.

    Attributes:
        run: So far: the plan and its report, or the closest attempt where no plan was found.
    """

    run: Run | SpatialRun


@dataclass(frozen=True)
class Stepped:
    """The plant has made a control step, or is at the start; each run along a plan begins with a start.

    Attributes:
        row: What the rollout has of it.
    """

    row: Row


@dataclass(frozen=True)
class Finished:
    """The run is over.

    Attributes:
        run: What `solve` or `solve_in_space` returns.
    """

    run: Run | SpatialRun


Event = Progress | Note | Planned | Stepped | Finished
OnEvent = Callable[[Event], Any]

LOGGER = logging.getLogger(__name__)


def _log(event: Event) -> None:
    """Log an event that is not one of many, as those of every control step are."""
    match event:
        case Note(text):
            LOGGER.info("%s", text)
        case Planned(run):
            LOGGER.info("planned: %r", run.plan if run.plan is not None else run.attempt)
            LOGGER.info("stages: %s", ", ".join(f"{name} {seconds:.2f} s" for name, seconds in run.timings.items()))
        case Finished(run):
            LOGGER.info("finished: %r", run.report)
        case Progress() | Stepped():
            pass


class Listener:
    """Passes events on, and remembers a request to stop.

    Args:
        on_event: Called with each event; nothing is where None.

    Attributes:
        cancelled: Whether the callback asked to stop.
        interrupted: Whether the run was interrupted from the keyboard.
    """

    def __init__(self, on_event: OnEvent | None) -> None:
        self._on_event = on_event
        self.cancelled = self.interrupted = False

    def emit(self, event: Event) -> None:
        """Pass an event on."""
        _log(event)
        if self._on_event is None:
            return
        try:
            self.cancelled = self._on_event(event) == CANCEL or self.cancelled
        except Cancelled:
            self.cancelled = True

    def progress(self, stage: str, share: float) -> None:
        """Pass progress on.

        Raises:
            Cancelled: The run is to stop.
        """
        self.emit(Progress(stage, share))
        if self.cancelled:
            raise Cancelled(f"cancelled in the stage {stage!r}")

    def row(self, row: Row) -> None:
        """Pass a row of a rollout on."""
        self.emit(Stepped(row))
