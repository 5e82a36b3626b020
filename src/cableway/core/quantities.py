"""Quantities as people read them: lengths and places in millimetres, angles in degrees, no more digits than they need.

Whatever says a number in a sentence, a report or a picture takes it from here; arrays, files and arguments are in SI
units.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

SHOWN = {
    **{f"m{per}": (f" mm{per}", 1000.0) for per in ("", "/s", "/s²", "/s³")},
    **{f"rad{per}": (f" degrees{per}", math.degrees(1.0)) for per in ("", "/s", "/s²", "/s³")},
    "m²": (" mm²", 1e6),
    "1": ("%", 100.0),
}
"""Unit and factor to it by the SI unit, "1" for a share; others are shown as they are."""

MOST_DECIMALS = 6
"""Of a value that is told from its limit."""

BEYOND = 1e9
"""From here on numbers are nobody's measurement, and written with an exponent."""


def quantity(value: float, unit: str = "m") -> str:
    """A measured value in SI units, to a tenth of a millimetre or degree, finer only below one.

    >>> quantity(0.004824), quantity(0.00033), quantity(-12.357), quantity(0.21, "rad"), quantity(1e300)
    ('4.8 mm', '0.33 mm', '-12357 mm', '12.0 degrees', '1e+303 mm')
    """
    return _text(value, unit, 0)


def limit_text(limit: float, unit: str = "m") -> str:
    """A limit, or a size as it was given, in SI units, without digits that say nothing.

    >>> limit_text(0.002), limit_text(12.3456), limit_text(0.02, "1"), limit_text(20.0, "")
    ('2 mm', '12346 mm', '2%', '20')
    """
    return f"{_limit(limit, unit)}{_shown(unit)[0]}"


def told_apart(value: float, limit: float, unit: str = "m") -> str:
    """A measured value as `quantity` has it, or with as many digits as tell it from a limit beside it.

    >>> told_apart(0.004824, 0.002), told_apart(0.0020004, 0.002)
    ('4.8 mm', '2.0004 mm')
    """
    beside = float(_limit(limit, unit))
    texts = [_text(value, unit, more) for more in range(MOST_DECIMALS)]
    return next((text for text in texts if float(re.split("[ %]", text)[0]) != beside), texts[0])


def estimate_text(value: float, deviation: float, unit: str = "m") -> str:
    """An estimate and its standard deviation, to two digits of that.

    >>> estimate_text(0.2971, 0.0004), estimate_text(0.616, 0.14, "")
    ('297.10 ± 0.40 mm', '0.62 ± 0.14')
    """
    name, factor = _shown(unit)
    decimals = min(max(1 - math.floor(math.log10(max(factor * deviation, 1e-3))), 0), 3)
    return f"{factor * value:.{decimals}f} ± {factor * deviation:.{decimals}f}{name}"


def place(point: Iterable[float]) -> str:
    """Where on the table or in space, from coordinates [m].

    >>> place((0.35, -0.00001)), place((0.2, 0.17346, 0.1))
    ('(350, 0) mm', '(200, 173.5, 100) mm')
    """
    return f"({', '.join(f'{round(1000 * float(each), 1) + 0.0:g}' for each in point)}) mm"


def size_text(size: tuple[float, ...]) -> str:
    """Width and height [m], or the sides of a box.

    >>> size_text((0.7, 0.45))
    '700 x 450 mm'
    """
    return f"{' x '.join(_limit(side, 'm') for side in size)} mm"


def _shown(unit: str) -> tuple[str, float]:
    return SHOWN.get(unit, (f" {unit}".rstrip(), 1.0))


def _limit(limit: float, unit: str) -> str:
    shown = _shown(unit)[1] * float(limit)
    return f"{shown:.0f}" if 1e4 <= abs(shown) < BEYOND else f"{shown:.4g}"


def _text(value: float, unit: str, more: int) -> str:
    """The value with so many digits more than usual."""
    name, factor = _shown(unit)
    shown = factor * float(value)  # which overflows to infinity without a warning
    if unit not in SHOWN or abs(shown) >= BEYOND:
        return f"{shown:.{3 + more}g}{name}"
    decimals = 2 if abs(shown) < 1 else 1 if abs(shown) < 100 else 0
    return f"{shown:.{decimals + more}f}{name}"
