"""Laws of isolated executors: a call is ended by the processor time it took, and at last by wall time."""

from __future__ import annotations

import time

import pytest

from cableway.core import executors


@pytest.mark.parametrize(
    ("function", "argument"), [(sum, range(10**12)), (time.sleep, 600)], ids=["computing", "hanging"]
)
def test_a_call_that_takes_too_long_is_ended(function, argument):
    with executors.open_executor("local", 1, isolated=True) as pool:
        for _, ended in pool.as_they_end(function, [(argument,)], time_limit=0.5):
            with pytest.raises(TimeoutError):
                ended.result()


def test_time_that_others_take_does_not_count():
    """A second of wall time in which nothing is computed, with a limit of half a second."""
    with executors.open_executor("local", 1, isolated=True) as pool:
        assert [ended.result() for _, ended in pool.as_they_end(time.sleep, [(1.0,)], time_limit=0.5)] == [None]
