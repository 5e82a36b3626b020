"""Collected transitions: the same for any number of workers, within limits, of cables that neither fold nor stretch."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from cableway.errors import InputError, SimulationError
from cableway.geometry import polyline
from cableway.records import Transitions
from cableway.scene.cable import Cable
from cableway.simulation.collection import CollectionConfig, collect
from cableway.simulation.motion import MotionConfig, random_motion

CONFIG = CollectionConfig(transitions=700, seed=3, episode_steps=40)


@pytest.fixture(scope="module")
def data() -> Transitions:
    return collect(CONFIG)


def episodes(data: Transitions):
    breaks = np.flatnonzero(np.diff(data.episode)) + 1
    return [slice(a, b) for a, b in itertools.pairwise([0, *breaks, len(data)])]


def test_same_seed_same_data_whatever_the_number_of_workers(data):
    other = collect(CONFIG, workers=2)
    for name in ("keypoints", "poses", "actions", "next_keypoints", "episode"):
        np.testing.assert_array_equal(getattr(other, name), getattr(data, name))
    assert other.metadata == data.metadata


def test_a_longer_collection_begins_with_the_shorter_one(data):
    short = collect(CollectionConfig(transitions=100, seed=3, episode_steps=40))
    np.testing.assert_array_equal(short.keypoints, data.keypoints[:100])


def test_another_seed_gives_other_data(data):
    other = collect(CollectionConfig(transitions=50, seed=4, episode_steps=40))
    assert np.abs(other.keypoints - data.keypoints[:50]).min(axis=(1, 2)).max() > 1e-3


def test_it_is_what_was_asked_for(data):
    assert len(data) == 700
    assert data.keypoints.shape == (700, 13, 2)
    assert data.metadata["seed"] == 3
    assert data.metadata["config"]["motion"]["max_step"] == 0.0133
    assert "mujoco" in data.metadata["versions"]


def test_transitions_of_an_episode_follow_each_other(data):
    for rows in episodes(data):
        np.testing.assert_array_equal(data.keypoints[rows][1:], data.next_keypoints[rows][:-1])
        np.testing.assert_allclose(data.poses[rows][1:], (data.poses + data.actions)[rows][:-1], atol=1e-14)
    assert len(episodes(data)) >= 700 / CONFIG.episode_steps


def test_grippers_hold_the_ends(data):
    np.testing.assert_allclose(data.keypoints[:, [0, -1]], data.poses[..., :2], atol=1e-4)


def test_actions_use_the_limits_and_keep_them(data):
    step = np.linalg.norm(data.actions[..., :2], axis=-1)
    turn = np.abs(data.actions[..., 2])
    assert step.max() <= 0.0133 + 1e-12
    assert turn.max() <= 0.133 + 1e-12
    assert step.max() > 0.012
    assert turn.max() > 0.12
    assert np.quantile(step, 0.05) < 0.002


def test_grippers_move_together_and_against_each_other(data):
    together, against = data.actions.mean(axis=1), (data.actions[:, 1] - data.actions[:, 0]) / 2
    for motion in (together, against):
        assert np.linalg.norm(motion[:, :2], axis=1).max() > 0.005
        assert np.abs(motion[:, 2]).max() > 0.05


def test_shapes_run_from_near_straight_to_strongly_bent(data):
    chord = np.linalg.norm(data.poses[:, 1, :2] - data.poses[:, 0, :2], axis=1) / 0.3
    assert chord.max() > 0.96
    assert chord.min() < 0.5
    sides = [polyline.signed_area(shape) for shape in data.keypoints]
    assert min(sides) < -0.002
    assert max(sides) > 0.002


def test_no_cable_crosses_itself_stretches_or_jumps(data):
    assert not any(polyline.crosses_itself(shape) for shape in data.next_keypoints)
    jump = np.linalg.norm(data.next_keypoints - data.keypoints, axis=-1)
    assert jump.max() < 4 * 0.0133
    # chords of a curve that turns by up to 20/13 rad within a segment are up to 4% shorter than the curve
    assert np.abs(polyline.length(data.keypoints) / 0.3 - 1).max() < 0.04
    assert np.median(np.abs(polyline.length(data.keypoints) / 0.3 - 1)) < 0.01


def test_episodes_end_before_what_is_not_wanted():
    """With a strict bound some episodes end early, and no row beyond the bound is left."""
    config = CollectionConfig(transitions=200, seed=3, episode_steps=40, sharpest_bend=6.0)
    data = collect(config)
    assert data.metadata["episodes_ended"]["sharp bend"] > 0
    angles = np.diff(data.next_keypoints, axis=1)
    bends = np.diff(np.unwrap(np.arctan2(angles[..., 1], angles[..., 0]), axis=1), axis=1)
    assert np.abs(bends).max() * 12 < 6.0


def test_hopeless_bounds_are_reported():
    with pytest.raises(SimulationError, match="sharp bend"):
        collect(CollectionConfig(transitions=100, episode_steps=2, sharpest_bend=1e-6))


def test_a_motion_stays_among_stable_shapes():
    """Without jitter every gripper pose is that of a stable equilibrium near the last one: chords within bounds."""
    rod, config = Cable().rod, MotionConfig(jitter=0.0)
    for seed in range(5):
        q, poses = random_motion(rod, config, 60, np.random.default_rng(seed))
        np.testing.assert_allclose(rod.shapes(q[None])[1][0], poses[0])
        assert poses.shape == (61, 2, 3)
        assert rod.stability(q[None])[0][0] >= config.least_stability
        chord = np.linalg.norm(poses[:, 1, :2] - poses[:, 0, :2], axis=1)
        assert chord.max() <= 0.971 * rod.length


def test_progress_rises_to_one():
    seen: list[float] = []
    collect(CollectionConfig(transitions=60, episode_steps=20), progress=lambda stage, share: seen.append(share))
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: CollectionConfig(transitions=0), "collection.transitions must be at least 1, got 0"),
        (lambda: CollectionConfig(time_step=0.03), "plant.time_step"),
        (lambda: MotionConfig(max_step=float("nan")), "motion.max_step must be positive and finite, got nan"),
        (lambda: MotionConfig(speed=(0.5, 2.0)), "motion.speed"),
        (lambda: collect(CONFIG, workers=0), "workers must be at least 1, got 0"),
        (lambda: collect(CollectionConfig(motion=MotionConfig(least_stability=500.0))), "no stable shape"),
    ],
)
def test_bad_values_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
