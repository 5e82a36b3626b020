"""Laws of smoothed motions: where they begin and end, how far they are off, and that no limit is exceeded."""

from __future__ import annotations

import numpy as np
import pytest

from cableway.motion.resampling import smoothed

RNG = np.random.default_rng(0)
MOTIONS = [np.cumsum(RNG.normal(size=(count, 2)), axis=0) for count in (2, 3, 9, 40)]


@pytest.mark.parametrize("rows", MOTIONS, ids=len)
@pytest.mark.parametrize("pieces", [1, 3, 50])
def test_differences_are_never_larger_than_those_of_the_rows(rows: np.ndarray, pieces: int):
    """First, second and third ones, each over its power of the time between two rows."""
    at = np.arange(-pieces, pieces * len(rows) + 1) / pieces
    curve = smoothed(rows, at)
    for order in (1, 2, 3):
        asked, allowed = (
            np.linalg.norm(np.diff(np.pad(each, ((3, 3), (0, 0)), mode="edge"), order, axis=0), axis=1).max()
            for each in (curve, rows)
        )
        assert asked * pieces**order <= allowed * (1 + 1e-9)


@pytest.mark.parametrize("rows", MOTIONS, ids=len)
def test_ends_are_kept_and_rows_between_are_a_sixth_of_the_second_difference_off(rows: np.ndarray):
    np.testing.assert_allclose(smoothed(rows, np.array([-1.0, len(rows)])), rows[[0, -1]], atol=1e-12)
    second = np.diff(np.pad(rows, ((1, 1), (0, 0)), mode="edge"), 2, axis=0)
    off = smoothed(rows, np.arange(len(rows), dtype=float)) - rows
    np.testing.assert_allclose(off, second / 6, atol=1e-12)


def test_what_runs_evenly_goes_on_so():
    rows = np.arange(12.0)
    at = np.linspace(2.0, 9.0, 50)
    np.testing.assert_allclose(smoothed(rows, at), at, atol=1e-12)
