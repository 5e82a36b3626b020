"""The metrics of `cableway.metrics` over the episodes of a method: shares and means, quantiles, differences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cableway.benchmark import statistics
from cableway.benchmark.episode import Result
from cableway.benchmark.statistics import Estimate
from cableway.metrics import Metric


def estimate(metric: Metric, results: Sequence[Result]) -> Estimate | None:
    """Share or mean over episodes with its interval; None where no episode has a value."""
    rows = [(value, result.task) for result in results if (value := metric.value(result)) is not None]
    of = statistics.share if metric.is_share else statistics.mean
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
    return statistics.mean([value for value, _ in rows], [task for _, task in rows])
