"""Intervals hold what they should as often as they say."""

from __future__ import annotations

import numpy as np
import pytest

from cableway.benchmark import statistics

NAMES = [str(k) for k in range(200)]


def test_nothing_has_no_figure():
    assert statistics.share([], []) is None
    assert statistics.mean([], []) is None


def test_a_perfect_share_is_not_certain():
    """By the rule of three about 3/n is left below one; Wilson's interval leaves a little more."""
    found = statistics.share([True] * 100, NAMES[:100])
    assert found is not None
    assert found.value == found.high == 1.0
    assert 1 - found.low == pytest.approx(3.7 / 100, abs=2e-3)


def test_episodes_of_the_same_task_count_once():
    one = statistics.share([True, False] * 10, NAMES[:20])
    many = statistics.share([True, False] * 100, [name for name in NAMES[:20] for _ in range(10)])
    assert one is not None
    assert many is not None
    assert (one.low, one.high) == pytest.approx((many.low, many.high))
    assert (one.n, many.n) == (20, 200)


@pytest.mark.parametrize("true", [0.5, 0.95])
def test_the_interval_of_a_share_covers_the_truth(true: float):
    rng, covered = np.random.default_rng(0), 0
    for _ in range(400):
        found = statistics.share(list(rng.random(60) < true), NAMES[:60])
        assert found is not None
        covered += found.low <= true <= found.high
    assert covered / 400 > 0.92


def test_the_interval_of_a_mean_covers_the_truth_of_clustered_values():
    rng, covered = np.random.default_rng(1), 0
    tasks = [name for name in NAMES[:40] for _ in range(3)]
    for _ in range(200):
        values = np.repeat(rng.normal(5.0, 1.0, 40), 3) + rng.normal(0.0, 0.1, 120)
        found = statistics.mean(list(values), tasks)
        assert found is not None
        assert found.value == pytest.approx(values.mean())
        covered += found.low <= 5.0 <= found.high
    assert 0.88 < covered / 200 < 0.99
