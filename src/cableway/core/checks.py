"""Checks that configurations make of themselves."""

from __future__ import annotations

import math
import re
import reprlib
from dataclasses import dataclass
from functools import cache
from numbers import Integral, Real
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

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


@dataclass(frozen=True)
class Bounds:
    """An annotation: the numbers that a field of a `Checked` accepts, all of them finite.

    Attributes:
        least: The smallest.
        most: The largest.
        open: Whether `least` itself is refused.
    """

    least: float
    most: float = math.inf
    open: bool = False

    def hold(self, value: Any, whole: bool) -> bool:
        """Whether a value is such a number, and whole where it has to be."""
        if isinstance(value, bool) or not isinstance(value, Integral if whole else Real):
            return False
        number: Any = value
        return self.least <= number <= self.most and number < math.inf and not (self.open and number == self.least)

    def in_words(self, whole: bool) -> str:
        """What messages say that a number must be."""
        if self.most < math.inf:
            return f"from {self.least:g} to {self.most:g}"
        bound = "positive" if self.open else f"at least {self.least:g}" if self.least else "not negative"
        return f"{'whole' if whole else 'finite'} and {bound}"


Number = TypeVar("Number")
Positive = Annotated[Number, Bounds(0, open=True)]
NotNegative = Annotated[Number, Bounds(0)]
Share = Annotated[float, Bounds(0, 1)]


class Checked:
    """A dataclass that checks its numbers against the `Bounds` in the types of its fields; None may stay None.

    Raises:
        InputError: One is out of bounds, or is not a number.
    """

    def __post_init__(self) -> None:
        for name, whole, bounds, optional in _bounded(type(self)):
            value = getattr(self, name)
            if not (optional and value is None) and not bounds.hold(value, whole):
                raise InputError(f"{section(type(self))}.{name} must be {bounds.in_words(whole)}, got {value!r}")


@cache
def _bounded(kind: type) -> list[tuple[str, bool, Bounds, bool]]:
    """Fields with bounds: name, whether they are whole, bounds, whether they may be None."""
    found = []
    for name, hint in get_type_hints(kind, include_extras=True).items():
        arms = (hint,) if get_origin(hint) is Annotated else get_args(hint)
        for arm in arms:
            for note in getattr(arm, "__metadata__", ()):
                if isinstance(note, Bounds):
                    found.append((name, arm.__origin__ is int, note, type(None) in arms))
    return found


def require_choice(kind: str, value: str, choices: Any) -> None:
    """Check that `value` is one of the names of a Literal type.

    Raises:
        UnknownNameError: It is not; the message lists the names.
    """
    if value not in get_args(choices):
        raise UnknownNameError(kind, value, get_args(choices))
