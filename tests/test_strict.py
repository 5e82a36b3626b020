"""Laws of the strict tests: what does not fit is found in every call, also after calls that fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pytest
from jaxtyping import Float, TypeCheckError
from strict import strictly

from cableway.geometry import polyline

ROW, SQUARE = np.zeros(3), np.zeros((3, 3))


@strictly
def product(a: Float[np.ndarray, "m n"], b: Float[np.ndarray, "n"], result: Any = None) -> Float[np.ndarray, "m"]:
    return a @ b if result is None else result


def refused(function: Any, *args: Any, **kwargs: Any) -> bool:
    with pytest.raises(TypeCheckError):
        function(*args, **kwargs)
    return True


def test_the_package_is_checked():
    assert polyline.length(np.array([[0.0, 0.0], [3.0, 4.0]])) == 5.0
    assert refused(polyline.length, ROW)
    assert polyline.length(np.array([[0.0, 0.0], [3.0, 4.0]])) == 5.0
    assert refused(polyline.length, [[0.0, 0.0], [3.0, 4.0]])


@pytest.mark.parametrize(
    "wrong",
    [
        (ROW, ROW),
        (SQUARE, SQUARE),
        (SQUARE, ROW[:2]),
        (SQUARE, ROW.astype(int)),
        (SQUARE.tolist(), ROW),
        (SQUARE, None),
    ],
)
def test_arguments_that_do_not_fit_are_refused_before_and_after_those_that_do(wrong: tuple[Any, Any]):
    for _ in range(2):
        assert refused(product, *wrong)
        assert refused(product, a=wrong[0], b=wrong[1])
        assert (product(SQUARE, ROW) == ROW).all()
        assert (product(a=SQUARE, b=ROW) == ROW).all()


def test_a_result_that_does_not_fit_is_refused_though_the_arguments_are_as_before():
    """It has to fit the arguments' shapes; and the function has run only once."""
    runs = []

    @strictly
    def repeated(a: Float[np.ndarray, "m"], results: Any) -> Float[np.ndarray, "m"]:
        runs.append(len(results))
        return results.pop()

    for result in (ROW, ROW):
        repeated(ROW, [result])
    for result in (ROW[:2], SQUARE, None):
        assert refused(repeated, ROW, [result])
    assert repeated(ROW, [ROW]) is ROW
    assert runs == [1] * 6


def test_values_that_are_named_are_looked_at():
    @strictly
    def turned(side: Literal["left", "right"], times: Literal[1, 2] = 1) -> None: ...

    for _ in range(2):
        turned("left", 2)
        turned("right")
        assert refused(turned, "up")
        assert refused(turned, "left", 3)


@pytest.mark.parametrize("items", [[0.0, "a"], (0.0, "a"), {"a": 0.0, "b": None}], ids=["list", "tuple", "dict"])
def test_items_that_do_not_fit_are_found_by_chance_in_any_call(items: Any):
    """Whichever was drawn before; and a dictionary's first."""

    @strictly
    def total(of: Sequence[float] | dict[str, float]) -> None: ...

    if isinstance(items, dict):
        total(items)
        assert refused(total, dict(reversed(items.items())))
        return
    for _ in range(5):
        for _ in range(200):
            try:
                total(items)
            except TypeCheckError:
                break
        else:
            pytest.fail("drawn 200 times, and the second of two items never")


def test_records_are_checked_also_those_that_inherit():
    @strictly
    @dataclass
    class Held:
        at: Float[np.ndarray, "2"]

    @strictly
    @dataclass
    class Turned(Held):
        angle: float

    @strictly
    class Named(Held):
        pass

    for _ in range(2):
        Held(ROW[:2]), Named(ROW[:2]), Turned(ROW[:2], 1.0)
        assert refused(Held, ROW)
        assert refused(Named, ROW)
        assert refused(Turned, ROW, 1.0)
        assert refused(Turned, ROW[:2], "north")


@pytest.mark.wrong_types
def test_what_passed_unchecked_is_not_remembered():
    assert polyline.length.__wrapped__ is not None
    import jaxtyping

    @strictly
    def scaled(by: float) -> float:
        return by

    assert scaled("twice") == "twice"  # pyright: ignore[reportArgumentType]
    jaxtyping.config.update("jaxtyping_disable", False)
    assert refused(scaled, "twice")
