"""Collected transitions: the same for any number of workers, within limits, of cables that neither fold nor stretch."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cableway.core.errors import InputError, SimulationError
from cableway.datasets.reading import load_transitions
from cableway.datasets.transitions import Transitions
from cableway.geometry import polyline
from cableway.rod.inverse import equilibria_at
from cableway.scene.cable import Cable
from cableway.scene.files.loading import cable_from_preset, load_task
from cableway.scene.files.presets import preset_ranges
from cableway.simulation.chain import Chain
from cableway.simulation.collection import collect
from cableway.simulation.episodes import CollectionConfig
from cableway.simulation.random_motion import MotionConfig, random_motion
from cableway.simulation.shapes import kinds_of

CONFIG = CollectionConfig(transitions=700, seed=3, episode_steps=40)


Collect = Callable[..., Transitions]


@pytest.fixture(scope="module")
def collected(tmp_path_factory: pytest.TempPathFactory) -> Collect:
    """Collects into a folder of its own and reads the data set."""

    def make(config: CollectionConfig, **options: Any) -> Transitions:
        folder = tmp_path_factory.mktemp("set")
        collect(config, folder, **options)
        return load_transitions(folder)

    return make


@pytest.fixture(scope="module")
def data(collected: Collect) -> Transitions:
    return collected(CONFIG)


def episodes(data: Transitions):
    breaks = np.flatnonzero(np.diff(data.episode)) + 1
    return [slice(a, b) for a, b in itertools.pairwise([0, *breaks, len(data)])]


def test_a_longer_collection_begins_with_the_shorter_one(data, collected):
    short = collected(CollectionConfig(transitions=100, seed=3, episode_steps=40))
    np.testing.assert_array_equal(short.keypoints, data.keypoints[:100])


def test_another_seed_gives_other_data(data, collected):
    other = collected(CollectionConfig(transitions=50, seed=4, episode_steps=40))
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
    span = np.linalg.norm(data.poses[:, 1, :2] - data.poses[:, 0, :2], axis=1) / 0.3
    assert span.max() > 0.96
    assert span.min() < 0.5
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


def test_episodes_end_before_what_is_not_wanted(collected):
    """With a strict bound some episodes end early, and no row beyond the bound is left."""
    config = CollectionConfig(transitions=200, seed=3, episode_steps=40, sharpest_bend=6.0)
    data = collected(config)
    assert data.metadata["episodes_ended"]["sharp bend"] > 0
    angles = np.diff(data.next_keypoints, axis=1)
    bends = np.diff(np.unwrap(np.arctan2(angles[..., 1], angles[..., 0]), axis=1), axis=1)
    assert np.abs(bends).max() * 12 < 6.0


def test_hopeless_bounds_are_reported(tmp_path):
    with pytest.raises(SimulationError, match="sharp bend"):
        collect(CollectionConfig(transitions=100, episode_steps=2, sharpest_bend=1e-6), tmp_path)


def test_kinds_look_as_they_are_called():
    """An arc and its mirror image, an S, a straight line and almost one; what lies between has no name."""
    rod = Cable().rod
    for q, kinds in (
        ([0, 0, 0, -5, 0, 3], {"any", "bend"}),
        ([0, 0, 0, -5, 0, -3], {"any", "bend"}),
        ([0, 0, 0, 0, 20, 0], {"any", "s-shape"}),
        ([0, 0, 0, 0, 0, 0], {"any", "near-straight"}),
        ([0, 0, 0, 0, 0, 0.9], {"any", "near-straight"}),
        ([0, 0, 0, -20, 0, 3], {"any"}),
    ):
        assert kinds_of(rod, np.array(q, float)) == kinds, q


@pytest.mark.parametrize("kind", ["bend", "s-shape", "near-straight"])
def test_shapes_are_of_the_kind_asked_for(kind):
    """At the start and, in a motion with nothing added, wherever the grippers rest."""
    rod, config = Cable().rod, MotionConfig(jitter=0.0, kinds=(kind,))
    rng, rests = np.random.default_rng(1), 0
    for _ in range(2):
        start, poses = random_motion(rod, config, 60, rng)
        assert kind in kinds_of(rod, start)
        still = np.flatnonzero((np.diff(poses, axis=0) == 0).all(axis=(1, 2)))
        for rest in np.unique(poses[still], axis=0):
            assert any(kind in kinds_of(rod, q) for q in equilibria_at(rod, rest))
            rests += 1
    assert rests > 1


def test_near_obstacles_it_comes_close_but_never_touches(collected):
    """In the scene of a task: most motions come within the greatest clearance, no row has contact."""
    config = CollectionConfig(transitions=400, seed=1, episode_steps=40, task="multi-obstacle-1")
    data, scene = collected(config), load_task("multi-obstacle-1").scene
    clearance = scene.clearance(data.next_keypoints, config.cable.radius)
    assert clearance.min() > -1e-3, "keypoints are joined by straight lines here, a millimetre off the cable"
    nearest = [clearance[rows].min() for rows in episodes(data)]
    assert np.mean(np.array(nearest) < config.motion.clearance[1]) > 0.7
    described = data.metadata["config"]["scene"]["obstacles"]
    assert len(described) == len(scene.obstacles)
    open_space = collected(CollectionConfig(transitions=400, seed=1, episode_steps=40))
    assert scene.clearance(open_space.next_keypoints, config.cable.radius).min() < -0.02


RANGES = {"damping_time": (0.05, 0.4), "rest_curvature": (-2.0, 2.0), "length": (0.2, 0.4)}


@pytest.fixture(scope="module")
def various(collected: Collect) -> Transitions:
    return collected(CollectionConfig(transitions=200, seed=5, episode_steps=25, ranges=RANGES))


def test_cables_drawn_from_ranges_are_told_with_their_transitions(various):
    """Within the ranges, the same throughout an episode, others in others; a length is that of the keypoints."""
    assert various.cable.keys() == RANGES.keys()
    assert various.metadata["config"]["ranges"] == {name: list(limits) for name, limits in RANGES.items()}
    for name, values in various.cable.items():
        assert RANGES[name][0] <= values.min() <= values.max() <= RANGES[name][1]
        assert len(np.unique(values, axis=0)) == len(np.unique(various.episode)) >= 8
        assert all(len(np.unique(values[rows], axis=0)) == 1 for rows in episodes(various))
    assert np.abs(polyline.length(various.keypoints) / various.cable["length"] - 1).max() < 0.04


def test_a_cable_moves_as_the_one_it_is_told_to_be(various):
    """Led along the same poses the cable of that episode goes the same way, one that lags differently does not."""
    for rows in episodes(various)[:3]:
        drawn = {name: values[rows][0] for name, values in various.cable.items()}
        cable = Cable(**{**drawn, "rest_curvature": tuple(drawn["rest_curvature"])})
        rod, poses = cable.rod, np.concatenate([various.poses[rows], (various.poses + various.actions)[rows][-1:]])
        starts = equilibria_at(rod, poses[0])
        nearest = np.abs(rod.shapes(starts)[0][:, ::4] - various.keypoints[rows][0]).max(axis=(1, 2)).argmin()
        fine = poses[:-1, None] + np.arange(1, 21)[:, None, None] / 20 * np.diff(poses, axis=0)[:, None]
        errors = []
        for led in (cable, replace(cable, damping_time=0.5 * cable.damping_time)):
            chain = Chain(led, None, 0.005)
            chain.place(starts[nearest])
            after = chain.keypoints(chain.polylines(chain.advance(fine.reshape(-1, 2, 3))[19::20]))
            errors.append(np.abs(after - various.next_keypoints[rows]).max())
        assert errors[0] < 1e-9
        assert errors[1] > 1e-5


def test_ranges_may_be_those_of_the_preset(collected):
    config = CollectionConfig(transitions=30, episode_steps=10, cable=cable_from_preset("usb"), ranges="preset")
    assert config.ranges == preset_ranges("usb")
    data = collected(config)
    assert data.cable["stiffness_profile"].shape == (30, 3)
    assert data.metadata["config"]["cable"]["preset"] == "usb"


def test_a_motion_stays_among_stable_shapes():
    """Without jitter every gripper pose is that of a stable equilibrium near the last one: chords within bounds."""
    rod, config = Cable().rod, MotionConfig(jitter=0.0)
    for seed in range(5):
        q, poses = random_motion(rod, config, 60, np.random.default_rng(seed))
        np.testing.assert_allclose(rod.shapes(q[None])[1][0], poses[0])
        assert poses.shape == (61, 2, 3)
        assert rod.stability(q[None])[0][0] >= config.least_stability
        span = np.linalg.norm(poses[:, 1, :2] - poses[:, 0, :2], axis=1)
        assert span.max() <= 0.971 * rod.length


def test_progress_rises_to_one(collected):
    seen: list[float] = []
    collected(CollectionConfig(transitions=60, episode_steps=20), progress=lambda stage, share: seen.append(share))
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


def moved(config: MotionConfig) -> object:
    return random_motion(Cable().rod, config, 5, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: CollectionConfig(transitions=0), "collection.transitions must be whole and positive, got 0"),
        (lambda: CollectionConfig(time_step=0.03), "plant.time_step"),
        (lambda: CollectionConfig(ranges={"colour": (0.0, 1.0)}), "there is no range for 'colour'; known: length"),
        (lambda: CollectionConfig(ranges={"friction": (1.0, 0.0)}), "ranges.friction must be two ascending numbers"),
        (lambda: CollectionConfig(ranges="preset"), "unknown preset 'None'"),
        (lambda: MotionConfig(max_step=float("nan")), "motion.max_step must be finite and positive, got nan"),
        (lambda: MotionConfig(speed=(0.5, 2.0)), "motion.speed"),
        (lambda: collect(CONFIG, "nowhere", workers=0), "workers must be at least 1, got 0"),
        (lambda: moved(MotionConfig(least_stability=500.0)), "no stable shape"),
        (lambda: moved(MotionConfig(load_spread=(0, 0, 0), kinds=("s-shape",))), "no shape of kind 's-shape'"),
        (lambda: MotionConfig(kinds=()), "motion.kinds must be some of any, bend"),
        (lambda: MotionConfig(clearance=(0.04, 0.01)), "motion.clearance must be two ascending distances"),
    ],
)
def test_bad_values_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
