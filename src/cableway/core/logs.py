"""The file of a log, which this process and those that it begins add to."""

from __future__ import annotations

import logging
import sys
from pathlib import Path

from cableway.core.errors import printable


class LogFile(logging.FileHandler):
    """Adds records to a file, each on lines of its own, until that fails.

    Attributes:
        problem: Why not everything was written, "" where it was.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, encoding="utf-8")
        self.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s[%(process)d]: %(message)s"))
        self.problem = ""

    def format(self, record: logging.LogRecord) -> str:
        """The record without control characters; what is not its first line is indented."""
        return printable(super().format(record)).replace("\n", "\n    ")

    def handleError(self, record: logging.LogRecord) -> None:
        """Remember why a record could not be written."""
        self.problem = self.problem or str(sys.exc_info()[1])


def log_file() -> str | None:
    """The file that this process logs to, for those that it begins; None where it logs to none."""
    return next((each.baseFilename for each in logging.getLogger().handlers if isinstance(each, LogFile)), None)


def log_to(path: str | None) -> None:
    """In a process that another one began: log to its file, or nowhere, what libraries warn of included."""
    try:
        handler = logging.NullHandler() if path is None else LogFile(Path(path))
    except OSError:  # a log is not worth a worker
        handler = logging.NullHandler()
    logging.getLogger().addHandler(handler)
    if path is not None:
        logging.getLogger("cableway").setLevel(logging.DEBUG)
