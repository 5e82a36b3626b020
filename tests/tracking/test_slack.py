"""How far apart grippers may go is read off the cable, not off its nominal length."""

from __future__ import annotations

import numpy as np
import pytest

from cableway.records import Observation
from cableway.tracking.slack import LONGEST, RESERVE, TAUT, Slack

NOMINAL = 0.3


def arc(length: float, turn: float, keypoints: int = 13) -> Observation:
    """A cable of `length` [m] lying in an arc that turns by `turn` [rad]."""
    angles = turn * np.linspace(-0.5, 0.5, keypoints)
    points = length / turn * np.column_stack([np.sin(angles), 1 - np.cos(angles)])
    poses = np.column_stack([points[[0, -1]], angles[[0, -1]]])
    return Observation(0.0, points, poses)


@pytest.mark.parametrize("length", [1.0, 1.03, 1.08])
def test_a_cable_seen_to_be_longer_may_be_led_farther_apart(length):
    """Up to what is seen less the reserve, and never less than the nominal length."""
    seen = Slack(NOMINAL).most_span(arc(length * NOMINAL, 1.0))
    assert seen == pytest.approx(max(1.0, length - RESERVE) * NOMINAL, rel=2e-3)


def test_no_cable_is_believed_to_be_much_longer_than_it_should_be():
    assert Slack(NOMINAL).most_span(arc(1.4 * NOMINAL, 1.0)) == pytest.approx(LONGEST * NOMINAL)


def test_a_cable_seen_to_be_straight_is_not_pulled_farther():
    """Though by its nominal length it had slack."""
    observation = arc(0.95 * NOMINAL, np.sqrt(20 * TAUT))
    span = float(np.linalg.norm(observation.poses[1, :2] - observation.poses[0, :2]))
    assert Slack(NOMINAL).most_span(observation) == pytest.approx(span)
    assert span < NOMINAL


def test_noise_of_2_mm_does_not_make_a_cable_longer():
    """Of 500 measured cables of nominal length none may be pulled taut, with latency while the grippers go apart."""
    rng = np.random.default_rng(0)
    for _ in range(100):
        slack, most = Slack(NOMINAL), 0.0
        for turn in np.linspace(2.0, 1.2, 5):
            seen = arc(NOMINAL, turn)
            noisy = seen.keypoints + rng.normal(0, 0.002, seen.keypoints.shape)
            most = slack.most_span(Observation(0.0, noisy, seen.poses))
        assert most < 1.015 * NOMINAL


def test_what_was_seen_before_does_not_let_hidden_cables_be_pulled_farther():
    """Nor do lost messages make a straight cable one of its nominal length."""
    slack = Slack(NOMINAL)
    before = slack.most_span(arc(NOMINAL, 1.0))
    for turn in (0.9, 0.8, 0.7, 0.6, 0.5, 0.4):
        hidden = arc(1.05 * NOMINAL, turn)
        hidden.keypoints[5] = np.nan
        assert slack.most_span(hidden) == before
    straight = arc(0.95 * NOMINAL, 0.05)
    taut = [slack.most_span(straight) for _ in range(5)][-1]
    assert taut < 0.96 * NOMINAL
    assert slack.most_span(Observation(0.0, straight.keypoints, np.full((2, 3), np.nan))) == taut


def test_what_is_not_seen_changes_nothing():
    slack = Slack(NOMINAL)
    hidden = arc(1.08 * NOMINAL, 1.0)
    hidden.keypoints[5] = np.nan
    assert slack.most_span(hidden) == NOMINAL
    unknown = Observation(0.0, hidden.keypoints, np.full((2, 3), np.nan))
    assert slack.most_span(unknown) == NOMINAL
