"""Configurations from plain data (YAML, JSON), read strictly: the inverse of `cableway.core.provenance.describe`."""

from __future__ import annotations

import math
import types
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from cableway.core.errors import InputError

Config = TypeVar("Config")

PLAIN = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}
"""How messages call the types of plain values."""


def from_mapping(cls: type[Config], content: Any, where: str) -> Config:
    """A configuration dataclass from a mapping of its fields; fields left out keep their defaults.

    Args:
        cls: A dataclass whose fields are booleans, numbers, texts, choices, tuples of them, mappings from texts to
            them, or such dataclasses.
        content: The mapping.
        where: The file and the place in it, for messages.

    Raises:
        InputError: A key is unknown or missing, or a value is of another type or out of range.
    """
    if not isinstance(content, Mapping):
        raise InputError(f"{where} must be a mapping of keys to values, got {content!r}")
    known = {entry.name: entry for entry in fields(cls)}  # pyright: ignore[reportArgumentType]
    for key in content:
        if key not in known:
            raise InputError(f"{where} has an unknown key {key!r}; known: {', '.join(sorted(known))}")
    for name, entry in known.items():
        if name not in content and entry.default is MISSING and entry.default_factory is MISSING:
            raise InputError(f"{where} lacks the key {name!r}")
    hints = get_type_hints(cls)
    values = {key: _value(hints[key], value, f"{where}.{key}") for key, value in content.items()}
    try:
        return cls(**values)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _value(kind: Any, value: Any, where: str) -> Any:
    """`value` as the type `kind`, or an InputError that names the place."""
    origin = get_origin(kind)
    if is_dataclass(kind) and isinstance(kind, type):
        return from_mapping(kind, value, where)
    if origin is Literal:
        if value not in get_args(kind):
            raise InputError(f"{where} must be one of {', '.join(map(str, get_args(kind)))}, got {value!r}")
        return value
    if origin in (Union, types.UnionType):
        return _one_of(get_args(kind), value, where)
    if origin is dict:
        if not isinstance(value, Mapping):
            raise InputError(f"{where} must be a mapping of keys to values, got {value!r}")
        return {str(key): _value(get_args(kind)[1], entry, f"{where}.{key}") for key, entry in value.items()}
    if origin is tuple:
        return _tuple(get_args(kind), value, where)
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not kind or (kind is float and not math.isfinite(value)):
        raise InputError(f"{where} must be {PLAIN.get(kind, kind)}, got {value!r}")
    return value


def _one_of(kinds: tuple[Any, ...], value: Any, where: str) -> Any:
    if value is None and type(None) in kinds:
        return None
    problem = InputError(f"{where} has a value that is not allowed, {value!r}")
    for kind in kinds:
        if kind is not type(None):
            try:
                return _value(kind, value, where)
            except InputError as error:
                problem = error
    raise problem


def _tuple(kinds: tuple[Any, ...], value: Any, where: str) -> tuple[Any, ...]:
    if not isinstance(value, (list, tuple)):
        raise InputError(f"{where} must be a list, got {value!r}")
    if len(kinds) == 2 and kinds[1] is Ellipsis:
        kinds = (kinds[0],) * len(value)
    if len(kinds) != len(value):
        raise InputError(f"{where} must be a list of {len(kinds)} values, got {len(value)}")
    return tuple(_value(kind, entry, f"{where}[{i}]") for i, (kind, entry) in enumerate(zip(kinds, value, strict=True)))
