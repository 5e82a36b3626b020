"""Intervals by resampling: of figures of values that come in groups, each of which is one draw."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

LEVEL = 0.95
"""Of all intervals."""

RESAMPLES = 2000

AT_ONCE = 4_000_000
"""Weights of values in memory."""

Interval = tuple[float, float]


def intervals(
    values: Sequence[float] | Float[np.ndarray, "n"],
    groups: Sequence[object] | np.ndarray,
    shares: Sequence[float] = (),
) -> list[Interval]:
    """Intervals of the mean and of quantiles of some values, by resampling their groups (Efron 1979, percentiles).

    With a single group they have no width, and say nothing.

    >>> intervals([1.0, 1.0, 3.0, 3.0], ["a", "a", "b", "b"], [0.5])
    [(1.0, 3.0), (1.0, 3.0)]

    Args:
        values: One or more.
        groups: That of each value.
        shares: Of the quantiles, from 0 to 1.

    Returns:
        Lower and upper end for the mean, then for each share.
    """
    values = np.asarray(values, float)
    index = np.unique(np.asarray(groups), return_inverse=True)[1]
    sums, counts = np.bincount(index, values), np.bincount(index)
    picks = np.random.default_rng(0).integers(len(sums), size=(RESAMPLES, len(sums)))
    found = [sums[picks].sum(axis=1) / counts[picks].sum(axis=1)]
    if shares:
        found += list(_quantiles(values, index, picks, np.asarray(shares)).T)
    ends = [np.quantile(figures, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2]) for figures in found]
    return [(float(low), float(high)) for low, high in ends]


def _quantiles(
    values: Float[np.ndarray, "n"], index: np.ndarray, picks: np.ndarray, shares: Float[np.ndarray, "s"]
) -> Float[np.ndarray, "r s"]:
    """Quantiles of the values in each resample, a value counting as often as its group was picked."""
    order, groups = np.argsort(values), picks.shape[1]
    rows = max(1, AT_ONCE // len(values))
    found = []
    for start in range(0, len(picks), rows):
        some = picks[start : start + rows]
        weights = np.stack([np.bincount(each, minlength=groups) for each in some])
        below = np.cumsum(weights[:, index[order]], axis=1)
        places = [np.sum(below < share * below[:, -1:], axis=1) for share in shares]
        found.append(values[order][np.stack(places, axis=1)])
    return np.concatenate(found)
