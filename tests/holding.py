"""Which files a command writes to a folder that another one could write to at the same time."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from cableway.core.errors import InputError
from cableway.core.files import only_writer


@contextmanager
def unheld_writes(folder: Path) -> Iterator[list[str]]:
    """Names of the files below a folder that come to their place while nobody holds it."""
    found, replace = [], os.replace

    def watched(source: Path, target: Path) -> None:
        if folder.resolve() in Path(target).resolve().parents and not _is_held(folder):
            found.append(Path(target).name)
        replace(source, target)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("os.replace", watched)
        yield found


def _is_held(folder: Path) -> bool:
    try:
        with only_writer(folder):
            return False
    except InputError:
        return True
