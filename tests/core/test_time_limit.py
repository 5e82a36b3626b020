"""A time limit ends what runs below it at the next checkpoint, and nothing else."""

from __future__ import annotations

import threading

import pytest

from cableway.core.time_limit import OutOfTime, checkpoint, time_limit


def is_over() -> bool:
    try:
        checkpoint()
    except OutOfTime:
        return True
    return False


def test_without_a_limit_there_is_time():
    assert not is_over()
    with time_limit(None):
        assert not is_over()


def test_a_limit_ends_with_its_scope():
    with pytest.raises(OutOfTime), time_limit(lambda: True):
        checkpoint()
    assert not is_over()


@pytest.mark.parametrize("outer", [False, True])
@pytest.mark.parametrize("inner", [False, True])
def test_the_first_of_nested_limits_counts(outer: bool, inner: bool):
    with time_limit(lambda: outer):
        with time_limit(lambda: inner):
            assert is_over() == (outer or inner)
        with time_limit(None):
            assert is_over() == outer


def test_a_limit_is_of_its_own_thread():
    found: list[bool] = []
    with time_limit(lambda: True):
        other = threading.Thread(target=lambda: found.append(is_over()))
        other.start()
        other.join()
    assert found == [False]
