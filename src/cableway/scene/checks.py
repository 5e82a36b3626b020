"""The numbers of a task: what each measures, between which bounds it is meant, and one wording for all that is wrong.

The bounds are wide: what lies outside them is no cable on a table but a number in another unit, and the message says
which. They keep products of a few numbers, and what planner and simulator make of them, within what floats hold.
"""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Literal, get_type_hints

import numpy as np
from jaxtyping import Float

from cableway.core.checks import shown as shown
from cableway.core.errors import Place, TaskError

LengthUnit = Literal["m", "cm", "mm"]
AngleUnit = Literal["rad", "deg"]

PER_UNIT = {"m": 1.0, "cm": 100.0, "mm": 1000.0, "rad": 1.0, "deg": 180.0 / math.pi}
"""How many of a unit make a metre or a radian."""

UNITS = {"units": ("m", "mm", "cm"), "angles": ("rad", "deg")}
"""What a file may say of them, by the key that says it."""

SPELT = {"m": "metres", "cm": "centimetres", "mm": "millimetres", "rad": "radians", "deg": "degrees"}

LARGEST = 1e6
"""No number of a task is larger, in its unit; beyond it products of a few of them overflow."""


def length_unit(units: str) -> str:
    """The unit of the lengths in a file: its own, or metres in one whose units are pixels."""
    return units if units in UNITS["units"] else "m"


@dataclass(frozen=True)
class Quantity:
    """An annotation: what a number of a task measures, and between which bounds it is meant.

    Attributes:
        unit: As messages write it; "" for a factor.
        least: Smallest value; above zero for what must be positive.
        most: Largest value.
        of_file: Whether the number stands in a task file, which may say what unit it is in.
    """

    unit: str
    least: float = -LARGEST
    most: float = LARGEST
    of_file: bool = False

    def __call__(self, value: Any, place: Place) -> float:
        """`value` as a float within the bounds.

        Raises:
            TaskError: It is no number, not finite or out of bounds; the message asks for the unit it may be meant in.
        """
        try:
            number = float(value + 0.0)  # adding refuses the texts that float() reads
        except OverflowError:
            number = math.inf
        except (TypeError, ValueError):
            raise TaskError(f"must be a number, got {shown(value)}", place) from None
        if self.least <= number <= self.most:
            return number
        signs = "positive" if self.least > 0 else "not negative" if self.least == 0 else ""
        if not math.isfinite(number):
            raise TaskError(f"must be {signs + ' and ' if signs else ''}finite, got {number!r}", place)
        if signs and (number < 0 or number == 0 < self.least):
            raise TaskError(f"must be {signs}, got {number!r}", place)
        bounds = f"from {self.least:g} to {self.most:g} {self.unit}".rstrip()
        raise TaskError(f"must be {bounds}, got {number!r}{self._meant(number)}", place)

    def _meant(self, number: float) -> str:
        """The unit that a number out of bounds seems to be given in, and how a file says so."""
        own = self.unit.partition("/")[0]
        key, units = next(((key, units) for key, units in UNITS.items() if own in units), ("", ()))
        found = [u for u in units if self.of_file and self.least <= number * PER_UNIT[own] / PER_UNIT[u] <= self.most]
        names, keys = (" or ".join(each) for each in ((SPELT[u] for u in found), (f"`{key}: {u}`" for u in found)))
        return f": if that is in {names}, say {keys}" if found else ""

    def read(self, number: float, place: Place, lengths: str, angles: str) -> float:
        """A number of a file in units of its own, in metres and radians.

        What is made of lengths, angles and times alone is converted; forces, masses and factors stay as they are.

        Raises:
            TaskError: It is out of bounds; the message has number and bounds in the file's units.
        """
        quantity, factor = _in_units(self, lengths, angles)
        return quantity(number, place) / factor


@cache
def _in_units(quantity: Quantity, lengths: str, angles: str) -> tuple[Quantity, float]:
    """A quantity in other units, and how many of them make its own."""
    numerator, per, denominator = quantity.unit.partition("/")
    if numerator in ("m", "rad"):
        unit = lengths if numerator == "m" else angles
        factor, unit = PER_UNIT[unit], unit + per + denominator
    elif quantity.unit == "1/m":
        factor, unit = 1 / PER_UNIT[lengths], f"1/{lengths}"
    else:
        factor, unit = 1.0, quantity.unit
    return Quantity(unit, factor * quantity.least, factor * quantity.most, of_file=True), factor


WORKSPACE = Quantity("m", 0.01, 50.0)
"""A side of the workspace."""

COORDINATE = Quantity("m", -50.0, 50.0)
LENGTH = Quantity("m", 0.01, 10.0)
"""Of a cable."""

EXTENT = Quantity("m", 1e-9, 50.0)
"""Of an obstacle."""

ANGLE = Quantity("rad", -12.6, 12.6)
"""Of an obstacle, a port or a gripper: two turns either way, as gripper angles run on."""

Coordinate = Annotated[float, COORDINATE]
Radians = Annotated[float, "an angle", ANGLE]
Point = Annotated[tuple[Coordinate, Coordinate], "[x, y]"]
Extent = Annotated[float, "a length", EXTENT]

XY = (COORDINATE, COORDINATE)
POSE = (COORDINATE, COORDINATE, ANGLE)


@cache
def quantities(kind: type) -> dict[str, Quantity]:
    """The fields of a dataclass that are quantities."""
    hints = get_type_hints(kind, include_extras=True)
    noted = {name: getattr(hint, "__metadata__", ()) for name, hint in hints.items()}
    return {name: note for name, notes in noted.items() for note in notes if isinstance(note, Quantity)}


def check_quantities(record: Any, *outer: str) -> None:
    """Make a float within its bounds of every field of a frozen record that is a quantity; None stays None.

    Raises:
        TaskError: One is not; its place is below `outer`.
    """
    for name, quantity in quantities(type(record)).items():
        value = getattr(record, name)
        if value is not None:
            object.__setattr__(record, name, quantity(value, (*outer, name)))


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


def pair(value: Any, place: Place, quantity: Quantity) -> tuple[float, float]:
    """`value` as two floats.

    Raises:
        TaskError: It is not two numbers, or one of them is not allowed.
    """
    try:
        first, second = value
    except (TypeError, ValueError):
        raise TaskError(f"must be two numbers, got {shown(value)}", place) from None
    return quantity(first, (*place, 0)), quantity(second, (*place, 1))


COUNTS = {2: "two", 3: "three", 4: "four"}


def numbers(value: Any, place: Place, quantities: tuple[Quantity, ...]) -> tuple[float, ...]:
    """`value` as so many floats.

    Raises:
        TaskError: It is not so many numbers, or one of them is not allowed.
    """
    count = len(quantities)
    try:
        entries = tuple(value)
    except TypeError:
        entries = ()
    if len(entries) != count:
        raise TaskError(f"must be {COUNTS.get(count, count)} numbers, got {shown(value)}", place)
    pairs = zip(quantities, entries, strict=True)
    return tuple(quantity(entry, (*place, i)) for i, (quantity, entry) in enumerate(pairs))


def profile(value: Any, place: Place, most: int, quantity: Quantity) -> tuple[float, ...]:
    """`value` as a tuple of 1 to `most` floats.

    Raises:
        TaskError: It is no such list, or one of them is not allowed.
    """
    if not (isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim == 1)):
        raise TaskError(f"must be a list of numbers, got {shown(value)}", place)
    if not 1 <= len(value) <= most:
        raise TaskError(f"must be a list of 1 to {most} numbers, got {len(value)}", place)
    return tuple(quantity(entry, (*place, i)) for i, entry in enumerate(value))


def rows(value: Any, place: Place, columns: tuple[Quantity, ...]) -> Float[np.ndarray, "rows columns"]:
    """A read-only copy of `value` as a C-contiguous array of floats with these columns.

    Raises:
        TaskError: It is no such array, or a number is not allowed in its column.
    """
    count = len(columns)
    try:
        array = np.array(value, dtype=float, order="C")
    except (TypeError, ValueError, OverflowError):
        raise TaskError(f"must be rows of {count} numbers, got {shown(value)}", place) from None
    if array.size == 0:
        array = np.empty((0, count))
    if array.ndim != 2 or array.shape[1] != count:
        raise TaskError(f"must be rows of {count} numbers, got an array of shape {array.shape}", place)
    within = [(quantity.least <= entries) & (entries <= quantity.most)
              for quantity, entries in zip(columns, array.T, strict=True)]  # fmt: skip
    for row, column in np.argwhere(~np.array(within).T):
        columns[column](array[row, column], (*place, int(row), int(column)))
    array.setflags(write=False)
    return array
