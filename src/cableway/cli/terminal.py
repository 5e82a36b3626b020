"""What people see: progress with the time left on stderr, results on stdout."""

from __future__ import annotations

import json
import logging
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from rich.console import Console, RenderableType
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from cableway.cli.options import Options
from cableway.core.errors import printable

LOGGER = logging.getLogger(__name__)

SAY_EVERY = 10.0
"""Seconds between two lines on a stage where stderr is no terminal, which shows bars only at the end."""

OnProgress = Callable[[str, float], None]
"""Called with the name of a stage and the share of it that is done."""


class Terminal:
    """Speaks to the person at the terminal as `--quiet` and `--json` ask."""

    def __init__(self, options: Options) -> None:
        self._quiet, self._json = options.quiet, options.json
        self._errors = Console(stderr=True, quiet=options.quiet, highlight=False)

    def note(self, sentence: str) -> None:
        """A sentence on the side."""
        LOGGER.info("%s", sentence)
        self._errors.print(printable(sentence), style="dim", markup=False, soft_wrap=True)

    @contextmanager
    def progress(self) -> Iterator[OnProgress]:
        """A bar for each stage that is reported, which runs back and forth until its share is known.

        Where stderr is no terminal, a line now and then, and the bars at the end.

        One stage runs at a time: the next one ends those before it. What follows a colon in a stage's name may change.
        """
        shown = (
            TextColumn("{task.description}"),
            BarColumn(bar_width=32),
            TextColumn("{task.percentage:>3.0f}%"),
            TimeElapsedColumn(),
            TimeRemainingColumn(compact=True),
        )
        bars: dict[str, TaskID] = {}
        said, logged = time.monotonic(), ""
        display = Progress(*shown, console=self._errors, disable=self._quiet)

        def advance(stage: str, share: float) -> None:
            nonlocal said, logged
            name, _, detail = stage.partition(":")
            if name != logged:
                logged = name
                LOGGER.info("stage: %s", name)
            for other, bar in bars.items():
                if other != name:
                    display.update(bar, total=1.0, completed=1.0)
            if name not in bars:
                display.start()
                bars[name] = display.add_task(name, total=None)
            display.update(bars[name], description=name + detail, completed=share, total=1.0 if share > 0 else None)
            now = time.monotonic()
            if not self._errors.is_terminal and now - said >= SAY_EVERY:
                said = now
                self._errors.print(name + detail + (f" {share:.0%}" if share > 0 else ""), markup=False, soft_wrap=True)

        try:
            yield advance
        finally:
            if bars:
                display.stop()

    def result(self, report: Mapping[str, Any], table: RenderableType) -> None:
        """Print a result on stdout: as JSON, as a table, or not at all."""
        try:
            if self._json:
                print(json.dumps(report, indent=1, allow_nan=False))
            elif not self._quiet:
                # Rich ends the process where the reader has gone, so it only renders.
                console = Console(highlight=False)
                with console.capture() as rendered:
                    console.print(table)
                sys.stdout.write(rendered.get())
            sys.stdout.flush()
        except BrokenPipeError:
            leave_pipe()


class _Rows(Table):
    """A table in which texts from files cannot pose as commands to the terminal."""

    def add_row(self, *cells: RenderableType | None, **options: Any) -> None:
        """See `Table.add_row`."""
        super().add_row(*(Text(printable(each.plain)) if isinstance(each, Text) else each for each in cells), **options)


def pairs(rows: list[tuple[str, str]]) -> Table:
    """A table of names and values."""
    table = _Rows.grid(padding=(0, 2))
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in rows:
        table.add_row(name, Text(value))  # a Text, in which brackets mean nothing special
    return table


def columns(*names: str, caption: str | None = None) -> Table:
    """An empty table with a header; the first column is never broken into lines."""
    table = _Rows(box=None, padding=(0, 2, 0, 0), header_style="bold", caption=caption, caption_justify="left")
    for index, name in enumerate(names):
        table.add_column(name, overflow="fold", no_wrap=index == 0)
    return table


def leave_pipe() -> None:
    """After the reader of stdout has gone: write the rest to nowhere, so that the interpreter ends in peace."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
