"""Checks that the planner's configurations make of themselves."""

from __future__ import annotations

from typing import Any, get_args

from cableway.errors import InputError, UnknownNameError


def require_range(config: object, low: float, high: float, *names: str) -> None:
    """Check that the named fields of a config lie in [low, high].

    Raises:
        InputError: One does not, or is not a number.
    """
    for name in names:
        value: Any = getattr(config, name)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
            raise InputError(f"{type(config).__name__}.{name} must be from {low:g} to {high:g}, got {value!r}")


def require_choice(kind: str, value: str, choices: Any) -> None:
    """Check that `value` is one of the names of a Literal type.

    Raises:
        UnknownNameError: It is not; the message lists the names.
    """
    if value not in get_args(choices):
        raise UnknownNameError(kind, value, get_args(choices))
