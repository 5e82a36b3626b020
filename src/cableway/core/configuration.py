"""Dataclasses from plain data (YAML, JSON), read strictly: the inverse of `cableway.core.provenance.describe`.

A field's type says what may stand there; `Annotated[float, "a length in metres"]` says it in the words of messages, and
a number in the annotation is the least length of a list.
"""

from __future__ import annotations

import difflib
import sys
import types
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from typing import Annotated, Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from cableway.core.checks import shown
from cableway.core.errors import InputError, Place, place_text

Config = TypeVar("Config")

LARGEST_WHOLE = 2**63
"""Whole numbers are below this, as those of arrays and random generators."""

PLAIN = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}
"""How messages call the types of plain values."""


@dataclass(frozen=True)
class Tagged:
    """An annotation: a mapping whose key `type` says which dataclass the other keys are of."""

    kinds: Mapping[str, type]


@dataclass(frozen=True)
class Fault:
    """What is wrong with plain data.

    Attributes:
        problem: Said of the place: "must be a number, got 'x'".
        place: Where.
        unknown: Whether it is a key that is not known.
    """

    problem: str
    place: Place
    unknown: bool = False


def from_mapping(cls: type[Config], content: Any, where: str) -> Config:
    """A configuration dataclass from a mapping of its fields; fields left out keep their defaults.

    Args:
        cls: A dataclass whose fields are booleans, numbers, texts, choices, lists or tuples of them, mappings from
            texts to them, or such dataclasses.
        content: The mapping.
        where: The file and the place in it, for messages.

    Raises:
        InputError: A key is unknown or missing, or a value is of another type or out of range.
    """
    for fault in faults(cls, content):
        place = place_text(fault.place)
        raise InputError(f"{where}{'.' if place else ''}{place} {fault.problem}")
    try:
        return _built(cls, content)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def faults(kind: Any, content: Any, place: Place = (), wanted: str = "") -> Iterator[Fault]:
    """What keeps plain data from being of a type.

    Args:
        kind: The type.
        content: The data.
        place: Where it stands.
        wanted: What messages say it must be; from the type where empty.
    """
    kind, wanted, least, tagged = _unwrapped(kind, wanted)
    origin = get_origin(kind)
    if tagged is not None:
        yield from _faults_of_tagged(tagged, content, place, wanted)
    elif is_dataclass(kind):
        yield from _faults_of_mapping(cast("type", kind), content, place, wanted)
    elif origin in (Union, types.UnionType):
        yield from _faults_of_union(get_args(kind), content, place, wanted)
    elif origin in (list, tuple):
        yield from _faults_of_list(kind, content, place, wanted, least)
    elif origin is dict:
        if not isinstance(content, Mapping):
            yield _must_be(wanted, content, place)
        else:
            for key, entry in content.items():
                yield from faults(get_args(kind)[1], entry, (*place, str(key)))
    elif origin is Literal:
        if content not in get_args(kind):
            yield _must_be(wanted, content, place)
    elif kind is float and isinstance(content, (int, float)) and not isinstance(content, bool):
        if not abs(content) <= sys.float_info.max:
            yield _must_be("a finite number", content, place)
    elif kind is not Any and type(content) is not kind:
        yield _must_be(wanted, content, place)
    elif kind is int and not abs(content) < LARGEST_WHOLE:
        yield _must_be("a whole number of at most 19 digits", content, place)


def changed(
    kind: Any, content: Any, change: Callable[[float, tuple[Any, ...], Place], float], place: Place = ()
) -> Any:
    """Plain data without faults with each number changed.

    Args:
        kind: Its type.
        content: The data.
        change: Gives the new number for one, for the annotations of its type, and for its place.
        place: Where the data stands.
    """
    notes = getattr(kind, "__metadata__", ())
    kind, _, _, tagged = _unwrapped(kind, "")
    if get_origin(kind) in (Union, types.UnionType):
        arms = (arm for arm in get_args(kind) if not any(faults(arm, content)))
        return changed(Annotated[(next(arms), *notes)] if notes else next(arms), content, change, place)
    if tagged is not None:
        kind = tagged.kinds[content["type"]]
    if is_dataclass(kind):
        hints = _hints(kind)
        return {key: changed(hints.get(key, Any), value, change, (*place, key)) for key, value in content.items()}
    if isinstance(content, (list, tuple)):
        kinds = _entry_kinds(kind, len(content))
        pairs = zip(kinds, content, strict=True)
        return [changed(entry, value, change, (*place, i)) for i, (entry, value) in enumerate(pairs)]
    return change(content, notes, place) if kind is float else content


def _unwrapped(kind: Any, wanted: str) -> tuple[Any, str, int, Tagged | None]:
    """A type without its annotations; what it is in words, the least length of its list, its tagged kinds."""
    notes: tuple[Any, ...] = ()
    if get_origin(kind) is Annotated:
        kind, *rest = get_args(kind)
        notes = tuple(rest)
    for note in notes:
        wanted = wanted or (note if isinstance(note, str) else "")
    least = next((note for note in notes if isinstance(note, int)), 0)
    return kind, wanted or _in_words(kind), least, next((note for note in notes if isinstance(note, Tagged)), None)


def _in_words(kind: Any) -> str:
    origin = get_origin(kind)
    if origin is Literal:
        return f"one of {', '.join(map(str, get_args(kind)))}"
    if origin in (list, tuple):
        return "a list" if origin is list or Ellipsis in get_args(kind) else f"a list of {len(get_args(kind))} values"
    if origin in (Union, types.UnionType):
        return " or ".join(_unwrapped(arm, "")[1] for arm in get_args(kind) if arm is not type(None))
    return PLAIN.get(kind, "a mapping of keys to values")


def _must_be(wanted: str, content: Any, place: Place) -> Fault:
    return Fault(f"must be {wanted}, got {'nothing' if content is None else shown(content)}", place)


def _faults_of_mapping(
    cls: type, content: Any, place: Place, wanted: str, extra: Iterable[str] = ()
) -> Iterator[Fault]:
    if not isinstance(content, Mapping):
        yield _must_be(wanted, content, place)
        return
    hints = _hints(cls)
    known = [*extra, *(entry.name for entry in fields(cls))]
    for key in content:
        if key not in known:
            close = difflib.get_close_matches(str(key), known, n=1)
            hint = f"did you mean {close[0]!r}? " if close else ""
            problem = f"is not a known key; {hint}known here: {', '.join(known)}"
            yield Fault(problem, (*place, str(key)), unknown=True)
    for entry in fields(cls):
        if entry.name in content:
            yield from faults(hints[entry.name], content[entry.name], (*place, entry.name))
        elif entry.default is MISSING and entry.default_factory is MISSING:
            yield Fault(f"is missing; it must be {_unwrapped(hints[entry.name], '')[1]}", (*place, entry.name))


def _faults_of_tagged(tagged: Tagged, content: Any, place: Place, wanted: str) -> Iterator[Fault]:
    if not isinstance(content, Mapping):
        yield _must_be(wanted, content, place)
        return
    tag = content.get("type")
    if isinstance(tag, str) and tag in tagged.kinds:
        rest = {key: value for key, value in content.items() if key != "type"}
        yield from _faults_of_mapping(tagged.kinds[tag], rest, place, wanted, ("type",))
    else:
        found = f"got {shown(tag)}" if "type" in content else "it is missing"
        yield Fault(f"must be one of {', '.join(tagged.kinds)}; {found}", (*place, "type"))


def _faults_of_union(kinds: tuple[Any, ...], content: Any, place: Place, wanted: str) -> Iterator[Fault]:
    """Those of the one type that the data seems to be meant for."""
    if content is None and type(None) in kinds:
        return
    arms = [arm for arm in kinds if arm is not type(None)]
    found = [list(faults(arm, content, place, wanted)) for arm in arms]
    if all(found):
        meant = [i for i, arm in enumerate(arms) if _is_meant(arm, content)]
        yield from found[meant[0]] if meant else [_must_be(wanted, content, place)]


def _is_meant(kind: Any, content: Any) -> bool:
    origin = get_origin(kind)
    if is_dataclass(kind) or origin is dict:
        return isinstance(content, Mapping)
    if origin in (list, tuple):
        return isinstance(content, (list, tuple))
    return isinstance(content, (int, float)) if kind is float else False


def _faults_of_list(kind: Any, content: Any, place: Place, wanted: str, least: int) -> Iterator[Fault]:
    if not isinstance(content, (list, tuple)):
        yield _must_be(wanted, content, place)
        return
    kinds = _entry_kinds(kind, len(content))
    if len(kinds) != len(content) or len(content) < least:
        yield Fault(f"must be {wanted}, got {len(content)} values", place)
        return
    for i, (entry_kind, entry) in enumerate(zip(kinds, content, strict=True)):
        yield from faults(entry_kind, entry, (*place, i))


@cache
def _hints(cls: type) -> dict[str, Any]:
    """Types of the fields of a dataclass, with their annotations."""
    return get_type_hints(cls, include_extras=True)


def _entry_kinds(kind: Any, count: int) -> tuple[Any, ...]:
    """Types of the entries of a list of `count`."""
    given = get_args(kind)
    if get_origin(kind) is list or (len(given) == 2 and given[1] is Ellipsis):
        return (given[0],) * count
    return given


def _built(cls: type[Config], content: Mapping[str, Any]) -> Config:
    """The dataclass of data without faults."""
    hints = get_type_hints(cls)
    return cls(**{key: _value(hints[key], value) for key, value in content.items()})


def _value(kind: Any, content: Any) -> Any:
    origin = get_origin(kind)
    if origin in (Union, types.UnionType):
        kind = next(arm for arm in get_args(kind) if not any(faults(arm, content)))
        return None if content is None else _value(kind, content)
    if is_dataclass(kind):
        return _built(cast("type", kind), content)
    if origin is dict:
        return {str(key): _value(get_args(kind)[1], entry) for key, entry in content.items()}
    if origin in (list, tuple):
        kinds = _entry_kinds(kind, len(content))
        return origin(_value(entry_kind, entry) for entry_kind, entry in zip(kinds, content, strict=True))
    return float(content) if kind is float else content
