"""Checks on the numbers of a task, with one wording for all of them."""

from __future__ import annotations

import math
import operator
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float

from cableway.core.checks import shown as shown
from cableway.core.errors import Place, TaskError

Metres = Annotated[float, "a length in metres"]
Radians = Annotated[float, "an angle in radians"]
Point = Annotated[tuple[float, float], "[x, y] in metres"]

LARGEST = 1e6
"""No number of a task is larger, in its unit; beyond it products of a few of them overflow."""


def real(value: Any, place: Place, *, positive: bool = False, minimum: float = -LARGEST) -> float:
    """`value` as a float.

    Raises:
        TaskError: It is no number, not finite, too large, below `minimum`, or not positive where it must be.
    """
    try:
        number = float(value + 0.0)  # adding refuses the texts that float() reads
    except OverflowError:
        number = math.inf
    except (TypeError, ValueError):
        raise TaskError(f"must be a number, got {shown(value)}", place) from None
    wanted = "positive" if positive else "not negative" if minimum == 0.0 else ""
    if not math.isfinite(number):
        raise TaskError(f"must be {wanted + ' and ' if wanted else ''}finite, got {number!r}", place)
    if number < minimum or (positive and number <= 0):
        raise TaskError(f"must be {wanted or f'at least {minimum:g}'}, got {number!r}", place)
    if number > LARGEST:
        raise TaskError(f"must be at most {LARGEST:g}, got {number!r}", place)
    return number


def integer(value: Any, place: Place, minimum: int, maximum: int) -> int:
    """`value` as an int from `minimum` to `maximum`.

    Raises:
        TaskError: It is no whole number, or out of range.
    """
    try:
        number = operator.index(value)
    except TypeError:
        raise TaskError(f"must be a whole number, got {shown(value)}", place) from None
    if not minimum <= number <= maximum:
        raise TaskError(f"must be from {minimum} to {maximum}, got {number}", place)
    return number


def pair(value: Any, place: Place, *, positive: bool = False) -> tuple[float, float]:
    """`value` as two floats.

    Raises:
        TaskError: It is not two numbers, or one of them is not allowed.
    """
    try:
        first, second = value
    except (TypeError, ValueError):
        raise TaskError(f"must be two numbers, got {shown(value)}", place) from None
    return real(first, (*place, 0), positive=positive), real(second, (*place, 1), positive=positive)


def reals(value: Any, place: Place, most: int, *, positive: bool = False) -> tuple[float, ...]:
    """`value` as a tuple of 1 to `most` floats.

    Raises:
        TaskError: It is no such list, or one of them is not allowed.
    """
    if not (isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim == 1)):
        raise TaskError(f"must be a list of numbers, got {shown(value)}", place)
    if not 1 <= len(value) <= most:
        raise TaskError(f"must be a list of 1 to {most} numbers, got {len(value)}", place)
    return tuple(real(entry, (*place, i), positive=positive) for i, entry in enumerate(value))


def array(value: Any, place: Place, columns: int) -> Float[np.ndarray, "rows columns"]:
    """A copy of `value` as a C-contiguous array of finite floats with `columns` columns.

    Raises:
        TaskError: It is no such array.
    """
    try:
        rows = np.array(value, dtype=float, order="C")
    except (TypeError, ValueError, OverflowError):
        raise TaskError(f"must be rows of {columns} numbers, got {shown(value)}", place) from None
    if rows.size == 0:
        rows = np.empty((0, columns))
    if rows.ndim != 2 or rows.shape[1] != columns:
        raise TaskError(f"must be rows of {columns} numbers, got an array of shape {rows.shape}", place)
    wrong = np.argwhere(~(np.abs(rows) <= LARGEST))
    if len(wrong):
        row, column = (int(i) for i in wrong[0])
        real(rows[row, column], (*place, row, column))
    return rows
