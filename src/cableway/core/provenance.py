"""Where a result comes from: versions and commit of what made it, and configurations as plain data."""

from __future__ import annotations

import math
import os
import platform
import re
import subprocess
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from importlib import metadata
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from cableway.core.extras import EXTRAS

PACKAGE = "cableway"
NOT_INSTALLED = "not installed"
WITH_CHANGES = " with changes"
"""After a commit from which the source differs."""


def required_versions() -> dict[str, str]:
    """Versions by name: cableway, Python and each package that it requires."""
    found = {PACKAGE: _version(PACKAGE), "python": platform.python_version()}
    return found | {name: _version(name) for name in _requirements()}


def versions() -> dict[str, str]:
    """`required_versions`, and those of its extras' packages that are installed."""
    optional = {name: _version(name) for packages in EXTRAS.values() for name in packages}
    installed = {name: version for name, version in sorted(optional.items()) if version != NOT_INSTALLED}
    return required_versions() | installed


@cache
def _requirements() -> tuple[str, ...]:
    """Names of the required packages, without those of the extras."""
    try:
        lines = metadata.requires(PACKAGE) or []
    except metadata.PackageNotFoundError:
        return ()
    needed = [line for line in lines if "extra ==" not in line]
    return tuple(sorted(re.split(r"[\s<>=!~;\[(]", line, maxsplit=1)[0] for line in needed))


@cache
def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return NOT_INSTALLED


@cache
def commit() -> str | None:
    """The commit of the checkout that cableway runs from, see `commit_of`; None where it is installed elsewhere."""
    return commit_of(Path(__file__).resolve().parents[3])


def commit_of(root: Path) -> str | None:
    """The commit that a checkout is at, and `WITH_CHANGES` where anything below its `src` differs from it.

    Args:
        root: The checkout's folder; None comes back where it is none, or where git does not say.
    """
    if not (root / ".git").exists():
        return None
    found, changed = _git(root, "rev-parse", "HEAD"), _git(root, "status", "--porcelain", "--", "src")
    return found and found + (WITH_CHANGES if changed != "" else "")


def _git(root: Path, *arguments: str) -> str | None:
    """What git prints, None where it fails or there is none."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    command = ["git", "--no-optional-locks", "-C", str(root), *arguments]
    try:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=30.0)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def describe(config: Any) -> Any:
    """A configuration as plain JSON data: dicts, lists, strings, numbers, booleans and None.

    Dataclasses become dicts of their fields, arrays and tuples lists, paths and numbers that are not finite strings.

    >>> describe((1, float("inf"), PurePath("runs/a")))
    [1, 'inf', 'runs/a']

    Raises:
        TypeError: Something in it is not a configuration value.
    """
    if is_dataclass(config) and not isinstance(config, type):
        return {field.name: describe(getattr(config, field.name)) for field in fields(config)}
    if isinstance(config, Mapping):
        return {str(key): describe(value) for key, value in config.items()}
    if isinstance(config, (np.ndarray, np.generic)):
        return describe(config.tolist())
    if isinstance(config, (tuple, list)):
        return [describe(value) for value in config]
    if isinstance(config, Enum):
        return describe(config.value)
    if isinstance(config, PurePath):
        return str(config)
    if isinstance(config, float) and not math.isfinite(config):
        return str(config)
    if config is None or isinstance(config, (bool, int, float, str)):
        return config
    raise TypeError(f"{type(config).__name__} is not a configuration value: {config!r}")
