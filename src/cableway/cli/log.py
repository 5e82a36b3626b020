"""`--log FILE`: what a command does, with times, for who looks for what went wrong.

The package logs by `logging` of the standard library, below the name "cableway"; this is the one handler for it, and
for what libraries warn of.
"""

from __future__ import annotations

import json
import logging
import platform
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from cableway.cli.interrupts import INTERRUPTS
from cableway.cli.options import Options
from cableway.core.errors import CablewayError, InputError
from cableway.core.logs import LogFile
from cableway.core.provenance import describe, versions

LOGGER = logging.getLogger(__name__)

_NOWHERE = logging.NullHandler()

LINE = re.compile(rb"\d{4}-\d\d-\d\d [\d:,]{12} INFO cableway\.")
"""How every log begins."""


@contextmanager
def logged(options: Options, arguments: list[str]) -> Iterator[None]:
    """Log what is done meanwhile to the file that the options name, if they do, after what was there before.

    What libraries warn of goes there, too; without a file it goes nowhere, rather than to stderr.

    Raises:
        InputError: The file cannot be written, or is there and is no log.
    """
    root, package = logging.getLogger(), logging.getLogger("cableway")
    if options.log is None:
        root.addHandler(_NOWHERE)
        try:
            yield
        finally:
            root.removeHandler(_NOWHERE)
        return
    handler, level = _opened(options.log), package.level
    root.addHandler(handler)
    package.setLevel(logging.DEBUG)
    try:
        _begin(options, arguments)
        yield
    except BaseException as error:
        _end(error)
        raise
    finally:
        package.setLevel(level)
        root.removeHandler(handler)
        with suppress(OSError):  # what could not be written is tried again
            handler.close()
        if handler.problem:
            from cableway.cli.terminal import Terminal

            Terminal(options).note(f"{options.log}: the log is not whole: {handler.problem}")


def _opened(path: Path) -> LogFile:
    try:
        if path.is_file() and path.stat().st_size:
            with open(path, "rb") as file:
                if not LINE.match(file.read(100)):
                    raise InputError(f"--log {path}: the file exists and is no log of cableway; give another name")
        return LogFile(path)
    except OSError as error:
        raise InputError(f"--log {path}: the file cannot be written: {error.strerror}") from None


def _begin(options: Options, arguments: list[str]) -> None:
    LOGGER.info("cableway %s", " ".join(arguments))
    LOGGER.info("on %s: %s", platform.platform(), ", ".join(f"{name} {each}" for name, each in versions().items()))
    LOGGER.info("options: %s", json.dumps(describe(options)))


def _end(error: BaseException) -> None:
    if INTERRUPTS.came or isinstance(error, KeyboardInterrupt):
        LOGGER.info("interrupted")
    elif isinstance(error, CablewayError | OSError):
        LOGGER.error("%s", error)
    else:
        LOGGER.exception("the command failed")
