"""Laws of intervals by resampling."""

from __future__ import annotations

import numpy as np

from cableway.core import bootstrap


def test_quantiles_of_a_resample_are_those_of_its_values():
    """Each value as often as its group was picked, and interpolated as NumPy does: else few values are judged low."""
    rng = np.random.default_rng(3)
    values, groups = rng.normal(size=9), np.array([0, 0, 0, 1, 1, 2, 2, 2, 2])
    picks, shares = rng.integers(3, size=(20, 3)), np.array([0.0, 0.5, 0.95, 1.0])
    found = bootstrap._quantiles(values, groups, picks, shares)
    for each, some in zip(found, picks, strict=True):
        np.testing.assert_allclose(each, np.quantile(np.concatenate([values[groups == k] for k in some]), shares))
