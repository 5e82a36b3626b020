"""Laws of the split, the windows and the symmetries of a data set."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from led_cables import quasi_static

from cableway.core.errors import InputError
from cableway.tang2025.models import dataset
from cableway.tang2025.models.base import RigidBlend
from cableway.tang2025.models.dataset import Windows


def test_the_split_shares_no_episode_and_loses_nothing(transitions):
    train, held = dataset.split_by_episode(transitions, 0.25, seed=3)
    assert not set(train.episode) & set(held.episode)
    assert len(np.unique(held.episode)) == 6
    assert len(train) + len(held) == len(transitions)


def test_the_split_depends_on_its_seed_alone(transitions):
    held = [dataset.split_by_episode(transitions, 0.25, seed)[1].episode for seed in (3, 3, 4)]
    assert np.array_equal(held[0], held[1])
    assert not np.array_equal(held[0], held[2])


def test_a_single_episode_cannot_be_split(transitions):
    one = dataset.select(transitions, transitions.episode == 0)
    with pytest.raises(InputError, match="at least 2 episodes, got 1"):
        dataset.split_by_episode(one, 0.5, 0)


def test_windows_stay_within_their_episode():
    episode = np.array([7, 7, 7, 7, 2, 2, 9])
    assert dataset.window_starts(episode, 2).tolist() == [0, 1, 2, 4]
    assert dataset.window_starts(episode, 1, stride=2).tolist() == [0, 2, 4, 6]
    assert dataset.window_starts(episode, 5).tolist() == []


def test_a_window_follows_the_data(transitions):
    part = dataset.windows(transitions, np.array([22]), 3)
    np.testing.assert_allclose(part.targets[0], transitions.next_keypoints[22:25], atol=1e-7)
    np.testing.assert_allclose(part.poses[0] + part.actions[0].sum(0), transitions.poses[25], atol=1e-6)


@pytest.mark.parametrize("change", [dataset.mirrored, dataset.swapped])
def test_a_symmetry_is_its_own_inverse_and_leaves_the_rest_alone(change, transitions):
    batch = dataset.windows(transitions, np.array([0, 30]), 3)
    marked = jnp.array([True, False])
    once, twice = change(batch, marked), change(change(batch, marked), marked)
    for field in Windows._fields:
        before, after, back = (np.asarray(getattr(part, field)) for part in (batch, once, twice))
        if field == "poses":
            back = back - [0, 0, 2 * np.pi] * (np.abs(back - before) > 1)
        np.testing.assert_allclose(back, before, atol=1e-6)
        np.testing.assert_array_equal(after[1], before[1])
        assert np.abs(after[0] - before[0]).max() > 1e-3


@pytest.mark.parametrize("change", [dataset.mirrored, dataset.swapped])
def test_the_blend_has_both_symmetries(change, transitions):
    """A model that knows no left from right predicts the changed motion for the changed sample."""
    batch = dataset.windows(transitions, np.array([5]), 1)
    changed = change(batch, jnp.array([True]))
    predicted = [
        part.keypoints[0] + RigidBlend()(part.keypoints[0], part.poses[0], part.actions[0, 0])
        for part in (batch, changed)
    ]
    expected = change(batch._replace(targets=predicted[0][None, None]), jnp.array([True])).targets[0, 0]
    np.testing.assert_allclose(predicted[1], expected, atol=1e-6)


def test_the_fingerprint_notices_a_single_bit(transitions):
    other = dataset.select(transitions, np.arange(len(transitions)))
    assert dataset.fingerprint(other) == dataset.fingerprint(transitions)
    other.keypoints[3, 4, 0] = np.nextafter(other.keypoints[3, 4, 0], 1.0)
    assert dataset.fingerprint(other) != dataset.fingerprint(transitions)


def test_joined_sets_keep_their_episodes_apart(transitions):
    both = dataset.joined([transitions, transitions])
    assert len(both) == 2 * len(transitions)
    assert len(np.unique(both.episode)) == 48
    assert len(dataset.window_starts(both.episode, 20)) == 2 * len(dataset.window_starts(transitions.episode, 20))
    assert dataset.joined([transitions]) is transitions


def test_sets_of_other_keypoints_are_not_joined(transitions):
    with pytest.raises(InputError, match="the same number of keypoints, got 10 and 13"):
        dataset.joined([transitions, quasi_static(1, 5, seed=0, keypoints=10)])
