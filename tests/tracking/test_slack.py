"""How far apart grippers may go is read off the cable, not off its nominal length."""

from __future__ import annotations

import numpy as np
import pytest

from cableway.records import Observation
from cableway.scene.cable import Cable
from cableway.tracking.slack import LONGEST, RESERVE, TAUT, Slack

NOMINAL = 0.3
CABLE = Cable(length=NOMINAL, keypoints=13)


def arc(length: float, turn: float, keypoints: int = 13) -> Observation:
    """A cable of `length` [m] lying in an arc that turns by `turn` [rad]."""
    angles = turn * np.linspace(-0.5, 0.5, keypoints)
    points = length / turn * np.column_stack([np.sin(angles), 1 - np.cos(angles)])
    poses = np.column_stack([points[[0, -1]], angles[[0, -1]]])
    return Observation(0.0, points, poses)


@pytest.mark.parametrize("length", [1.0, 1.03, 1.08])
def test_a_cable_seen_to_be_longer_may_be_led_farther_apart(length):
    """Up to what is seen less the reserve, and never less than the nominal length."""
    seen = Slack(CABLE).most_span(arc(length * NOMINAL, 1.0))
    assert seen == pytest.approx(max(1.0, length - RESERVE) * NOMINAL, rel=2e-3)


def test_no_cable_is_believed_to_be_much_longer_than_it_should_be():
    assert Slack(CABLE).most_span(arc(1.4 * NOMINAL, 1.0)) == pytest.approx(LONGEST * NOMINAL)


def test_a_cable_seen_to_be_straight_is_not_pulled_farther():
    """Though by its nominal length it had slack."""
    observation = arc(0.95 * NOMINAL, np.sqrt(20 * TAUT))
    span = float(np.linalg.norm(observation.poses[1, :2] - observation.poses[0, :2]))
    assert Slack(CABLE).most_span(observation) == pytest.approx(span)
    assert span < NOMINAL


def test_noise_of_2_mm_does_not_make_a_cable_longer():
    """Of 500 measured cables of nominal length none may be pulled taut, with latency while the grippers go apart."""
    rng = np.random.default_rng(0)
    for _ in range(100):
        slack, most = Slack(CABLE), 0.0
        for turn in np.linspace(2.0, 1.2, 5):
            seen = arc(NOMINAL, turn)
            noisy = seen.keypoints + rng.normal(0, 0.002, seen.keypoints.shape)
            most = slack.most_span(Observation(0.0, noisy, seen.poses))
        assert most < 1.015 * NOMINAL


def test_what_was_seen_before_does_not_let_hidden_cables_be_pulled_farther():
    """Nor do lost messages make a straight cable one of its nominal length."""
    slack = Slack(CABLE)
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
    slack = Slack(CABLE)
    hidden = arc(1.08 * NOMINAL, 1.0)
    hidden.keypoints[5] = np.nan
    assert slack.most_span(hidden) == NOMINAL
    unknown = Observation(0.0, hidden.keypoints, np.full((2, 3), np.nan))
    assert slack.most_span(unknown) == NOMINAL


def test_hidden_ends_are_straight_on_to_the_grippers():
    """The cable has at least that slack, and hardly more where little is hidden."""
    whole = arc(1.08 * NOMINAL, 1.0)
    part = Observation(0.0, whole.keypoints.copy(), whole.poses)
    part.keypoints[[0, 1, -2, -1]] = np.nan
    least, most = Slack(CABLE).most_span(part), Slack(CABLE).most_span(whole)
    assert 0.999 * most < least < most
    straight = arc(0.95 * NOMINAL, 0.05)
    straight.keypoints[[0, 1, -2, -1]] = np.nan
    assert Slack(CABLE).most_span(straight) < 0.96 * NOMINAL


def test_grippers_that_have_gone_on_since_the_frame_do_not_make_hidden_ends_longer():
    """A frame may be some control steps late."""
    slack, seen = Slack(CABLE), arc(0.96 * NOMINAL, 0.3)
    seen.keypoints[[0, 1, -2, -1]] = np.nan
    before = slack.most_span(seen)
    assert slack.most_span(Observation(0.1, seen.keypoints, seen.poses + [[0.0, 0.03, 0.0]])) == before


def test_frames_that_show_less_than_others_do_not_count():
    slack, whole = Slack(CABLE), arc(1.08 * NOMINAL, 1.0)
    before = slack.most_span(whole)
    for shown in (slice(2, 11), slice(0, 5)):
        part = np.full_like(whole.keypoints, np.nan)
        part[shown] = whole.keypoints[shown]
        assert slack.most_span(Observation(0.0, part, whole.poses)) == before
    assert Slack(CABLE).most_span(Observation(0.0, part, whole.poses)) == NOMINAL


def test_keypoints_astray_do_not_make_a_cable_longer():
    slack, astray = Slack(CABLE), arc(NOMINAL, 0.5)
    astray.keypoints[6] = (0.5, 0.5)
    assert [slack.most_span(astray) for _ in range(5)] == [NOMINAL] * 5
