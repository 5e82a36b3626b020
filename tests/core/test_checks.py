"""What configurations accept."""

from __future__ import annotations

from dataclasses import dataclass, make_dataclass
from typing import Annotated

import numpy as np
import pytest

from cableway.core.checks import Bounds, Checked, NotNegative, Positive, require_interface
from cableway.core.errors import InputError


@dataclass
class SomethingConfig(Checked):
    """With a number of each kind, and one that may be missing."""

    count: Positive[int] = 1
    length: Positive[float] = 1.0
    limit: Positive[float] | None = None


@dataclass
class OtherConfig(Checked):
    """With other bounds."""

    count: NotNegative[int] = 1
    length: NotNegative[float] = 1.0
    several: Annotated[int, Bounds(2)] = 2
    share: Annotated[float, Bounds(0, 1)] = 0.5
    half: Annotated[float, Bounds(0.5, 0.5)] = 0.5


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf, "1", True, None])
def test_a_length_that_is_none_is_refused(value: object) -> None:
    with pytest.raises(InputError, match=r"something\.length must be finite and positive, got "):
        SomethingConfig(length=value)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("value", [0, -1, 1.5, np.nan, "1", True])
def test_a_count_that_is_none_is_refused(value: object) -> None:
    with pytest.raises(InputError, match=r"something\.count must be whole and positive, got "):
        SomethingConfig(count=value)  # pyright: ignore[reportArgumentType]


def test_bounds_themselves_are_taken() -> None:
    OtherConfig(count=0, length=np.float64(0.0), several=int(np.int64(2)), half=0.5)
    OtherConfig(share=0.0), OtherConfig(share=1.0)
    with pytest.raises(InputError, match=r"other\.several must be whole and at least 2, got 1"):
        OtherConfig(several=1)
    with pytest.raises(InputError, match=r"other\.share must be from 0 to 1, got 1\.5"):
        OtherConfig(share=1.5)
    with pytest.raises(InputError, match=r"other\.length must be finite and not negative, got inf"):
        OtherConfig(length=np.inf)


def test_a_class_without_deferred_annotations_is_checked_too() -> None:
    fields = [("count", Positive[int], 1), ("length", Positive[float], 1.0), ("name", str, "")]
    made = make_dataclass("PlainConfig", fields, bases=(Checked,))
    assert made().count == 1
    with pytest.raises(InputError, match=r"plain\.count must be whole and positive, got 1\.5"):
        made(count=1.5)


def test_only_a_number_that_may_be_missing_may_be_none() -> None:
    assert SomethingConfig(limit=None).limit is None
    with pytest.raises(InputError, match=r"something\.limit must be finite and positive, got 0"):
        SomethingConfig(limit=0.0)


def test_an_object_of_another_kind_is_refused_with_what_it_lacks() -> None:
    class Driver:
        @property
        def task(self) -> str:
            raise OSError("not connected")

        def send(self) -> None: ...

    require_interface(Driver(), "the robot", ["task"], {"send": 0})
    for given, methods, said in (
        (Driver, {}, "the robot must be an object, got the class Driver itself"),
        (Driver(), {"stop": 0}, r"the robot, of type Driver, lacks stop\(\)"),
        (Driver(), {"send": 1}, r"Driver\.send\(\) .*must take 1 argument besides self"),
    ):
        with pytest.raises(InputError, match=said):
            require_interface(given, "the robot", ["task"], methods)
