"""Laws of the comparison: figures are those of the errors, spreads those of episodes and of seeds."""

from __future__ import annotations

import numpy as np
import pytest

from cableway.core.errors import InputError
from cableway.tang2025.models.base import Persistence, RigidBlend
from cableway.tang2025.models.dataset import select, window_starts
from cableway.tang2025.models.evaluation import compare, training_groups


def test_the_error_of_standing_still_is_how_far_the_cable_went(transitions):
    curve = compare({"still": [Persistence()]}, transitions, 4, stride=5)["still"]
    assert curve.horizons == (1, 2, 3, 4)
    for horizon in curve.horizons:
        starts = window_starts(transitions.episode, horizon, 5)
        way = transitions.next_keypoints[starts + horizon - 1] - transitions.keypoints[starts]
        stacked = 1e3 * np.linalg.norm(way.reshape(len(starts), -1), axis=1)
        at = curve.at(horizon)
        np.testing.assert_allclose([at["median"], at["mean"]], [np.median(stacked), stacked.mean()], rtol=1e-4)
        np.testing.assert_allclose(at["keypoint_mean"], 1e3 * np.linalg.norm(way, axis=2).mean(), rtol=1e-4)
        assert curve.windows[horizon - 1] == len(starts)
    assert curve.episodes == (24,) * 4
    np.testing.assert_allclose(curve.seeds, (curve.mean, curve.mean))


def test_seeds_are_pooled_and_their_range_is_kept(transitions):
    curves = compare(
        {"both": [Persistence(), RigidBlend()], "still": [Persistence()], "blend": [RigidBlend()]}, transitions, 2
    )
    assert curves["both"].trainings == 2
    np.testing.assert_allclose(curves["both"].seeds, (curves["blend"].mean, curves["still"].mean))
    pooled = 0.5 * (np.array(curves["still"].mean) + curves["blend"].mean)
    np.testing.assert_allclose(curves["both"].mean, pooled, rtol=1e-6)
    low, high = (np.array(edge) for edge in curves["still"].quartiles)
    assert np.all(low < high)


def test_intervals_are_those_of_whole_episodes(transitions):
    """Ten times the windows of each episode say no more; one episode says nothing."""
    curve, dense = (compare({"still": [Persistence()]}, transitions, 2, stride=s)["still"] for s in (10, 1))
    for name in ("median", "mean", "p95"):
        low, high = curve.interval(name, 2)
        assert low <= curve.at(2)[name] <= high
        assert low < high
    widths = [np.subtract(*one.interval("mean", 2)[::-1]) for one in (curve, dense)]
    assert dense.windows[1] > 5 * curve.windows[1]
    assert widths[1] > 0.5 * widths[0]
    blend = compare({"blend": [RigidBlend()]}, transitions, 2)["blend"]
    assert blend.above_blend == (0.0, 0.0) == blend.interval("above_blend", 1)
    np.testing.assert_allclose(curve.above_blend, np.subtract(curve.mean, blend.mean), rtol=1e-6)
    low, high = curve.interval("above_blend", 2)
    assert 0 < low < curve.above_blend[1] < high, "standing still is worse, and by the same windows surely so"
    one = select(transitions, transitions.episode == transitions.episode[0])
    assert compare({"still": [Persistence()]}, one, 2)["still"].interval("mean", 1) == (None, None)


def test_horizons_end_with_the_longest_episode(transitions):
    assert compare({"still": [Persistence()]}, transitions, 50)["still"].horizons[-1] == 20
    with pytest.raises(InputError, match="horizon must be at least 1, got 0"):
        compare({"still": [Persistence()]}, transitions, 0)


def test_models_that_differ_in_their_seed_are_one():
    def card(width: int, seed: int) -> dict:
        return {"kind": "conv", "model": {"width": width}, "training": {"seed": seed}, "data": {"sha256": "a"}}

    cards = {"a": card(8, 0), "b": card(16, 0), "c": card(8, 1)}
    assert training_groups(cards) == {"a": ["a", "c"], "b": ["b"]}
