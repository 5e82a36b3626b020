"""What configurations accept."""

from __future__ import annotations

from dataclasses import dataclass, make_dataclass

import numpy as np
import pytest

from cableway.core.checks import number_fields, require_at_least, require_not_negative, require_positive, require_range
from cableway.core.errors import InputError


@dataclass
class SomethingConfig:
    """With a number of each kind, and one that may be missing."""

    count: int = 1
    length: float = 1.0
    limit: float | None = None


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf, "1", True, None])
def test_a_length_that_is_none_is_refused(value: object) -> None:
    with pytest.raises(InputError, match=r"something\.length must be finite and positive, got "):
        require_positive(SomethingConfig(length=value), "length")  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("value", [0, -1, 1.5, np.nan, "1", True])
def test_a_count_that_is_none_is_refused(value: object) -> None:
    with pytest.raises(InputError, match=r"something\.count must be whole and positive, got "):
        require_positive(SomethingConfig(count=value), "count")  # pyright: ignore[reportArgumentType]


def test_bounds_themselves_are_taken() -> None:
    config = SomethingConfig(count=0, length=np.float64(0.0))
    require_not_negative(config, *number_fields(config))
    require_range(SomethingConfig(length=0.5), 0.5, 0.5, "length")
    require_at_least(SomethingConfig(count=int(np.int64(2))), 2, "count")
    with pytest.raises(InputError, match=r"something\.count must be whole and at least 3, got 2"):
        require_at_least(SomethingConfig(count=2), 3, "count")
    with pytest.raises(InputError, match=r"something\.length must be from 0 to 1, got 1\.5"):
        require_range(SomethingConfig(length=1.5), 0, 1, "length")


def test_a_class_without_deferred_annotations_is_checked_too() -> None:
    made = make_dataclass("PlainConfig", [("count", int, 1), ("length", float, 1.0), ("name", str, "")])
    assert number_fields(made()) == ("count", "length")
    with pytest.raises(InputError, match=r"plain\.count must be whole and positive, got 1\.5"):
        require_positive(made(count=1.5), "count")


def test_number_fields_are_those_that_are_always_numbers() -> None:
    assert number_fields(SomethingConfig()) == ("count", "length")
