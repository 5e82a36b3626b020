"""Folders for compiled code in the user's cache folder, which only the user can write to."""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path

import platformdirs

PROBLEMS: dict[Path, str] = {}
"""Why compiled code is not kept in a folder."""


def user_folder() -> Path:
    """The folder of cableway in the user's cache folder."""
    return Path(platformdirs.user_cache_dir("cableway", appauthor=False))


def problems() -> tuple[str, ...]:
    """Why compiled code is not kept, in sentences; none where all of it is."""
    return tuple(
        f"Compiled code is not kept: {folder}: {why}. The next command compiles it again."
        for folder, why in PROBLEMS.items()
    )


def private_folder(folder: Path) -> Path | None:
    """A folder that only the user can write to, made where it is missing.

    It may belong to root, as in a container. One of the user's that others can read is made private.

    Returns:
        The folder; None where it cannot be made, belongs to somebody else or others may write to it, which `problems`
        says from then on.
    """
    try:
        if user_folder() in folder.parents:
            _make_private(user_folder())
        _make_private(folder)
    except OSError as error:
        PROBLEMS[folder] = error.strerror or str(error)
        return None
    return folder


def _make_private(folder: Path) -> None:
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if sys.platform == "win32":
        return
    found, user = folder.stat(), os.getuid()
    mode = stat.S_IMODE(found.st_mode)
    if found.st_uid not in (0, user):
        raise OSError(f"it belongs to another user (number {found.st_uid})")
    if found.st_uid == user and mode & 0o077:
        folder.chmod(0o700)
    elif mode & 0o022:
        raise OSError("others may write to it")
