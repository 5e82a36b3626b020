"""Laws of intervals by resampling groups."""

from __future__ import annotations

import numpy as np

from cableway.core.bootstrap import RESAMPLES, intervals


def test_quantiles_are_those_of_the_resampled_values():
    rng = np.random.default_rng(3)
    groups = np.repeat(np.arange(12), rng.integers(1, 9, 12))
    values = rng.exponential(size=len(groups)) + groups
    picks = np.random.default_rng(0).integers(12, size=(RESAMPLES, 12))
    found = []
    for each in picks:
        drawn = np.concatenate([values[groups == group] for group in each])
        found.append([drawn.mean(), *np.quantile(drawn, [0.5, 0.95], method="inverted_cdf")])
    expected = np.quantile(found, [0.025, 0.975], axis=0).T
    np.testing.assert_allclose(intervals(values, groups, [0.5, 0.95]), expected)


def test_what_a_group_repeats_counts_once():
    values = np.random.default_rng(1).normal(size=30)
    once, often = (intervals(np.repeat(values, n), np.repeat(np.arange(30), n), [0.5]) for n in (1, 8))
    np.testing.assert_allclose(once[0], often[0])
    np.testing.assert_allclose(once[1], often[1])


def test_intervals_of_the_mean_cover_it():
    """About 95 times of a hundred where a group shares half of its variance; windows taken for draws would not."""
    rng = np.random.default_rng(5)
    groups, covered, naively = np.repeat(np.arange(40), 6), 0, 0
    for _ in range(60):
        values = rng.normal(size=40)[groups] + rng.normal(size=240)
        [(low, high)], [(close, far)] = intervals(values, groups), intervals(values, np.arange(240))
        covered += low <= 0 <= high
        naively += close <= 0 <= far
    assert covered >= 52
    assert naively < covered
