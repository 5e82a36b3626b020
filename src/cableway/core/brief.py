"""How records show themselves at a prompt and in the output of tests: one line, arrays by their shape."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from importlib import import_module
from typing import Any

import numpy as np

from cableway.core.checks import shown


class Brief:
    """Base of dataclasses, declared with `repr=False`, whose repr is one line."""

    def _facts(self) -> Iterator[str]:
        """What the line says: all fields that are not None, in brief."""
        for entry in fields(self):  # pyright: ignore[reportArgumentType]
            value = getattr(self, entry.name)
            if value is not None:
                yield f"{entry.name} {brief(value)}"

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(self._facts())})"


class Shown(Brief):
    """Base of records that show themselves in a notebook, too, by a picture and a small table."""

    def _repr_html_(self) -> str:
        return notebook().html(self)


def notebook() -> Any:
    """The module that draws records for a notebook; it knows them, and so is imported when the first one is shown."""
    return import_module("cableway.figures.notebook")


def brief(value: Any) -> str:
    """A value on one line: an array by its shape, a mapping by its keys.

    >>> brief(np.zeros((3, 2))), brief({"seed": 7, "planner": {}}), brief(0.25)
    ('(3, 2)', '{seed, planner}', '0.25')
    """
    if isinstance(value, np.ndarray):
        return str(value.shape)
    if isinstance(value, dict):
        return f"{{{', '.join(map(str, value))}}}"
    return shown(value)
