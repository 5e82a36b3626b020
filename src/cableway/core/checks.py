"""Checks that configurations make of themselves."""

from __future__ import annotations

import math
import re
import reprlib
from collections.abc import Callable
from dataclasses import fields
from numbers import Integral, Real
from typing import Any, get_args

from cableway.core.errors import InputError, UnknownNameError

_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxlist, _SHORT.maxdict = 2, 4, 4
_SHORT.maxstring = _SHORT.maxlong = _SHORT.maxother = 60


def shown(value: Any) -> str:
    """A value as messages show it: on one line and cut short.

    >>> shown(list(range(1000)))
    '[0, 1, 2, 3, ...]'
    """
    return " ".join(_SHORT.repr(value).split())


def section(kind: type) -> str:
    """What a configuration is called in messages.

    >>> section(type("PathSetConfig", (), {}))
    'path_set'
    >>> section(type("RRTConnectConfig", (), {}))
    'rrt_connect'
    """
    return re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", kind.__name__.removesuffix("Config")).lower()


def number_fields(config: Any) -> tuple[str, ...]:
    """Names of the fields of a config that are declared as numbers."""
    return tuple(entry.name for entry in fields(config) if entry.type in ("float", "int", float, int))


def require_positive(config: object, *names: str) -> None:
    """Check that the named fields of a config are positive and finite.

    Raises:
        InputError: One is not, or is not a number.
    """
    _require(config, names, lambda value: 0 < value < math.inf, "{} and positive")


def require_not_negative(config: object, *names: str) -> None:
    """Check that the named fields of a config are finite and not negative.

    Raises:
        InputError: One is not, or is not a number.
    """
    _require(config, names, lambda value: 0 <= value < math.inf, "{} and not negative")


def require_at_least(config: object, least: float, *names: str) -> None:
    """Check that the named fields of a config are finite and not below a number.

    Raises:
        InputError: One is not, or is not a number.
    """
    _require(config, names, lambda value: least <= value < math.inf, f"{{}} and at least {least:g}")


def require_range(config: object, low: float, high: float, *names: str) -> None:
    """Check that the named fields of a config lie in [low, high].

    Raises:
        InputError: One does not, or is not a number.
    """
    _require(config, names, lambda value: low <= value <= high, f"from {low:g} to {high:g}")


def require_choice(kind: str, value: str, choices: Any) -> None:
    """Check that `value` is one of the names of a Literal type.

    Raises:
        UnknownNameError: It is not; the message lists the names.
    """
    if value not in get_args(choices):
        raise UnknownNameError(kind, value, get_args(choices))


def _require(config: Any, names: tuple[str, ...], holds: Callable[[Any], bool], what: str) -> None:
    declared = {entry.name: entry.type for entry in fields(config)}
    for name in names:
        value, whole = getattr(config, name), declared[name] in ("int", int)
        if isinstance(value, bool) or not isinstance(value, Integral if whole else Real) or not holds(value):
            wanted = what.format("whole" if whole else "finite")
            raise InputError(f"{section(type(config))}.{name} must be {wanted}, got {value!r}")
