"""Metrics over episodes: shares, means and differences with intervals, and quantiles.

Episodes of the same task are one draw.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from cableway.benchmark.episode import Result
from cableway.core.bootstrap import LEVEL, intervals
from cableway.metrics import Metric


@dataclass(frozen=True)
class Estimate:
    """A figure with its interval.

    Attributes:
        value: The figure.
        low: Lower end of its 95% interval.
        high: Upper end.
        n: Episodes that it was made from.
    """

    value: float
    low: float
    high: float
    n: int


def share(good: Sequence[bool], tasks: Sequence[str]) -> Estimate | None:
    """Share of what is good, with Wilson's interval for as many trials as there are tasks; None of nothing.

    Taking episodes of one task for one trial never makes the interval too narrow.

    >>> share([True] * 100, [str(i) for i in range(100)]).low
    0.963...
    """
    if not good:
        return None
    p, trials, z = float(np.mean(good)), len(set(tasks)), float(norm.ppf(0.5 + LEVEL / 2))
    middle = p + z * z / (2 * trials)
    half = z * math.sqrt(p * (1 - p) / trials + z * z / (4 * trials * trials))
    scale = 1 + z * z / trials
    return Estimate(p, max(0.0, (middle - half) / scale), min(1.0, (middle + half) / scale), len(good))


def mean(values: Sequence[float], tasks: Sequence[str]) -> Estimate | None:
    """Mean with the interval that resampling the tasks gives; None of nothing."""
    if not values:
        return None
    [(low, high)] = intervals(values, tasks)
    return Estimate(float(np.mean(values)), low, high, len(values))


def estimate(metric: Metric, results: Sequence[Result]) -> Estimate | None:
    """Share or mean over episodes with its interval; None where no episode has a value."""
    rows = [(value, result.task) for result in results if (value := metric.value(result)) is not None]
    of = share if metric.is_share else mean
    return of([value for value, _ in rows], [task for _, task in rows])


def quantiles(metric: Metric, results: Sequence[Result]) -> dict[str, float] | None:
    """Median, 95th percentile towards the worse side, and the worst; None where no episode has a value."""
    values = [value for result in results if (value := metric.value(result)) is not None]
    if metric.is_share or not values:
        return None
    ends = (0.5, 0.05, 0.0) if metric.better == "higher" else (0.5, 0.95, 1.0)
    found = np.quantile(values, ends)
    return {name: float(value) for name, value in zip(("median", "p95", "worst"), found, strict=True)}


def difference(metric: Metric, results: Sequence[Result], others: Sequence[Result]) -> Estimate | None:
    """Mean of the differences to other results of the same episodes, with its interval; None where there are none.

    Both must have a value in an episode for it to count.
    """
    known = {(result.suite, result.episode): metric.value(result) for result in others}
    rows = []
    for result in results:
        value, other = metric.value(result), known.get((result.suite, result.episode))
        if value is not None and other is not None:
            rows.append((float(value) - float(other), result.task))
    return mean([value for value, _ in rows], [task for _, task in rows])
