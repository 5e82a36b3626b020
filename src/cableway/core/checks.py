"""Checks that configurations make of themselves."""

from __future__ import annotations

import inspect
import math
import re
import reprlib
from collections.abc import Iterable, Mapping
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


@dataclass(frozen=True)
class Choice:
    """An annotation: a field of a `Checked` takes one of the names of its Literal type.

    Attributes:
        kind: What messages call the field.
    """

    kind: str


Number = TypeVar("Number")
Positive = Annotated[Number, Bounds(0, open=True)]
NotNegative = Annotated[Number, Bounds(0)]
Share = Annotated[float, Bounds(0, 1)]


class Checked:
    """A dataclass that checks its fields against the `Bounds` and `Choice` in their types; None may stay None.

    Raises:
        InputError: A number is out of bounds, or is not a number.
        UnknownNameError: A name is not one of the choices; the message lists them.
    """

    def __post_init__(self) -> None:
        for name, note, kind, optional in _declared(type(self)):
            value, whole = getattr(self, name), kind is int
            if optional and value is None:
                continue
            if isinstance(note, Choice):
                require_choice(note.kind, value, kind)
            elif not note.hold(value, whole):
                raise InputError(f"{section(type(self))}.{name} must be {note.in_words(whole)}, got {value!r}")


@cache
def _declared(checked: type) -> list[tuple[str, Bounds | Choice, Any, bool]]:
    """Fields that are checked: name, against what, type, whether they may be None."""
    found = []
    for name, hint in get_type_hints(checked, include_extras=True).items():
        arms = (hint,) if get_origin(hint) is Annotated else get_args(hint)
        for arm in arms:
            for note in getattr(arm, "__metadata__", ()):
                if isinstance(note, Bounds | Choice):
                    found.append((name, note, arm.__origin__, type(None) in arms))
    return found


def require_type(value: Any, kind: type, what: str) -> None:
    """Check that a value is of a type.

    Raises:
        InputError: It is not; the message begins with `what` and names both types.
    """
    if not isinstance(value, kind):
        got = f"the class {value.__name__} itself" if isinstance(value, type) else shown(value)
        raise InputError(f"{what} must be a {kind.__module__.partition('.')[0]}.{kind.__name__}, got {got}")


def require_call(function: Any, what: str, count: int, beside: str = "") -> None:
    """Check that something can be called with so many arguments.

    Raises:
        InputError: It cannot; the message begins with `what` and has its signature.
    """
    if not callable(function):
        raise InputError(f"{what} must be callable, got {shown(function)}")
    try:
        signature = inspect.signature(function)
    except ValueError:  # compiled code may have none
        return
    try:
        signature.bind(*range(count))
    except TypeError:
        wanted = f"{count} argument{'s'[: count != 1]} {beside}".rstrip()
        raise InputError(f"{what}{signature} must take {wanted}") from None


def require_interface(value: Any, what: str, attributes: Iterable[str], methods: Mapping[str, int]) -> None:
    """Check that an object has attributes, and methods that can be called with so many arguments.

    Args:
        value: Any object.
        what: Says messages what it is to be.
        attributes: Their names; one that raises another error than `AttributeError` is there.
        methods: Number of arguments of each.

    Raises:
        InputError: It is a class instead, something is missing, or a method takes other arguments.
    """
    if isinstance(value, type):
        raise InputError(f"{what} must be an object, got the class {value.__name__} itself")
    kind = type(value).__name__
    lacking = [name for name in attributes if not _has(value, name)]
    lacking += [f"{name}()" for name in methods if not callable(getattr(value, name, None))]
    if lacking:
        raise InputError(f"{what}, of type {kind}, lacks {', '.join(lacking)}")
    for name, count in methods.items():
        require_call(getattr(value, name), f"{kind}.{name}", count, "besides self")


def _has(value: Any, name: str) -> bool:
    try:
        return hasattr(value, name)
    except Exception:  # whoever uses it gets it
        return True


def require_choice(kind: str, value: str, choices: Any) -> None:
    """Check that `value` is one of the names of a Literal type.

    Raises:
        UnknownNameError: It is not; the message lists the names.
    """
    if value not in get_args(choices):
        raise UnknownNameError(kind, value, get_args(choices))
