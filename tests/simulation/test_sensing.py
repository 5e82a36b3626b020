"""Sensing and actuation: each effect against what it must do to the bare plant's run."""

from __future__ import annotations

import dataclasses

import numpy as np
import problems
import pytest

from cableway.core.errors import InputError, SimulationError
from cableway.simulation.perturbations.sensing import SensedPlant, SensingConfig
from cableway.simulation.plant import CableSimulator, PlantConfig

TASK = problems.free()
STILL = np.zeros((2, 3))
FAST = PlantConfig(time_step=1 / 240, control_step=1 / 30)
EVERYTHING = SensingConfig(
    keypoint_noise=0.002, frame_rate=30.0, drop_rate=0.2, occlusion_rate=0.2, measurement_delay=0.12, action_delay=0.07
)


def moves(steps: int) -> np.ndarray:
    return np.random.default_rng(4).normal(0, [0.002, 0.002, 0.02], (steps, 2, 3))


def sensed(config: SensingConfig | None = None, plant: PlantConfig | None = None, seed: int = 0) -> SensedPlant:
    return SensedPlant(CableSimulator(TASK, plant), config, seed)


def observed(plant: CableSimulator | SensedPlant, actions: np.ndarray) -> np.ndarray:
    """Keypoints (K+1, n, 2) in all observations, from that of the start on."""
    return np.array([plant.reset().keypoints, *(plant.step(action).keypoints for action in actions)])


def true(plant: CableSimulator | SensedPlant, actions: np.ndarray) -> np.ndarray:
    """The same for the true keypoints."""
    plant.reset()
    rows = [plant.measure().keypoints]
    for action in actions:
        plant.step(action)
        rows.append(plant.measure().keypoints)
    return np.array(rows)


# ---------------------------------------------------------------- nothing by default
@pytest.mark.parametrize("plant", [None, FAST])
def test_by_default_all_is_seen_as_it_is(plant: PlantConfig | None):
    bare, other, actions = CableSimulator(TASK, plant), sensed(plant=plant), moves(12)
    np.testing.assert_array_equal(observed(other, actions), observed(bare, actions))
    last, shown = bare.step(STILL), other.step(STILL)
    np.testing.assert_array_equal(shown.poses, last.poses)
    assert shown.time == last.time
    assert other.control_step == bare.control_step
    assert other.task is TASK


def test_three_steps_of_a_thirtieth_do_what_one_of_a_tenth_does():
    """With the same time step, and the action in three equal parts."""
    slow = CableSimulator(TASK, PlantConfig(time_step=1 / 240, control_step=0.1))
    fast, actions = CableSimulator(TASK, FAST), moves(6)
    np.testing.assert_allclose(
        observed(fast, np.repeat(actions / 3, 3, axis=0))[::3], observed(slow, actions), atol=1e-9
    )
    assert fast.time == pytest.approx(0.6)


# ---------------------------------------------------------------- keypoint noise, lost frames, hidden keypoints
@pytest.fixture(scope="module")
def frames() -> np.ndarray:
    """What 600 frames of a cable at rest are off by."""
    config = SensingConfig(keypoint_noise=0.002, drop_rate=0.25, occlusion_rate=0.4, occluded_share=0.35)
    plant = sensed(config, PlantConfig(time_step=0.02), seed=5)
    return observed(plant, np.tile(STILL, (599, 1, 1))) - plant.measure().keypoints


def lost(frames: np.ndarray) -> np.ndarray:
    return np.asarray(np.isnan(frames).all(axis=(1, 2)))


def test_noise_is_white_and_of_the_size_asked_for(frames: np.ndarray):
    values = frames.reshape(-1, 26)
    values = values[~np.isnan(values).any(axis=1)]
    assert len(values) > 200
    assert abs(values.mean()) < 4 * 0.002 / np.sqrt(values.size)
    assert values.std() == pytest.approx(0.002, rel=4 / np.sqrt(2 * values.size))
    among_coordinates = np.corrcoef(values.T)[np.triu_indices(26, 1)]
    from_frame_to_frame = np.corrcoef(values[:-1].ravel(), values[1:].ravel())[0, 1]
    assert np.abs(among_coordinates).max() < 5 / np.sqrt(len(values))
    assert abs(from_frame_to_frame) < 4 / np.sqrt(values.size)


def test_the_share_of_frames_asked_for_is_lost(frames: np.ndarray):
    blind = lost(frames)
    assert blind.mean() == pytest.approx(0.25, abs=4 * np.sqrt(0.25 * 0.75 / len(blind)))
    assert np.corrcoef(blind[:-1], blind[1:])[0, 1] == pytest.approx(0, abs=4 / np.sqrt(len(blind)))


def test_a_hidden_stretch_is_contiguous_and_as_long_as_asked_for(frames: np.ndarray):
    """At 13 keypoints and a share of 0.35, of 1 to 4 keypoints, each length and each place about as often."""
    hidden = np.isnan(frames[~lost(frames)])
    np.testing.assert_array_equal(hidden[..., 0], hidden[..., 1])
    hidden = hidden[..., 0]
    some = np.asarray(hidden.any(axis=1))
    assert some.mean() == pytest.approx(0.4, abs=4 * np.sqrt(0.4 * 0.6 / len(some)))
    stretches = np.abs(np.diff(np.pad(hidden[some], ((0, 0), (1, 1))).astype(int), axis=1)).sum(axis=1) / 2
    assert (stretches == 1).all()
    lengths = np.bincount(hidden[some].sum(axis=1), minlength=6)[1:] / some.sum()
    np.testing.assert_allclose(lengths, [0.25, 0.25, 0.25, 0.25, 0.0], atol=4 * np.sqrt(0.25 * 0.75 / some.sum()))
    assert hidden.any(axis=0).all(), "every keypoint is hidden at some time"


def test_what_is_not_hidden_is_as_it_would_be():
    actions = moves(30)
    plain, covered = (
        observed(sensed(SensingConfig(keypoint_noise=0.002, occlusion_rate=rate)), actions) for rate in (0.0, 0.5)
    )
    there = ~np.isnan(covered)
    assert not there.all()
    np.testing.assert_array_equal(covered[there], plain[there])


def test_the_truth_and_the_gripper_poses_are_not_touched():
    bare, plant = CableSimulator(TASK), sensed(SensingConfig(keypoint_noise=0.01, drop_rate=0.5, occlusion_rate=0.5))
    for action in moves(10):
        one, other = bare.step(action), plant.step(action)
        np.testing.assert_array_equal(other.poses, one.poses)
        np.testing.assert_array_equal(plant.measure().centreline, bare.measure().centreline)


def test_where_every_frame_is_lost_nothing_is_seen():
    assert np.isnan(observed(sensed(SensingConfig(drop_rate=1.0)), moves(5))).all()


# ---------------------------------------------------------------- delays and rates
@pytest.mark.parametrize("steps", [1, 2, 5])
def test_a_measurement_delay_shifts_what_is_seen_by_just_as_many_steps(steps: int):
    actions = moves(10)
    truth = true(CableSimulator(TASK), actions)
    late = observed(sensed(SensingConfig(measurement_delay=0.1 * steps)), actions)
    np.testing.assert_array_equal(late[steps:], truth[:-steps])
    np.testing.assert_array_equal(late[:steps], np.repeat(truth[:1], steps, axis=0))


@pytest.mark.parametrize("steps", [1, 3])
def test_an_action_delay_shifts_what_is_done_by_just_as_many_steps(steps: int):
    actions = moves(10)
    prompt = true(CableSimulator(TASK), np.concatenate([np.tile(STILL, (steps, 1, 1)), actions[:-steps]]))
    np.testing.assert_array_equal(true(sensed(SensingConfig(action_delay=0.1 * steps)), actions), prompt)


def test_an_action_delayed_by_a_quarter_of_a_step_falls_into_two():
    actions = moves(10)
    before = np.concatenate([STILL[None], actions[:-1]])
    prompt = true(CableSimulator(TASK), 0.75 * actions + 0.25 * before)
    np.testing.assert_allclose(true(sensed(SensingConfig(action_delay=0.025)), actions), prompt, atol=1e-9)


def test_three_frames_in_a_step():
    """Without delay the third is the present; after 20 ms it is the second, a third of a step old."""
    actions = moves(8)
    truth = true(CableSimulator(TASK), actions)
    np.testing.assert_array_equal(observed(sensed(SensingConfig(frame_rate=30.0)), actions), truth)
    late = observed(sensed(SensingConfig(frame_rate=30.0, measurement_delay=0.02)), actions)
    np.testing.assert_allclose(late[1:], truth[:-1] / 3 + truth[1:] * 2 / 3, atol=1e-12)


def test_three_frames_in_a_step_are_rarely_all_lost():
    actions = np.tile(STILL, (400, 1, 1))
    config, quick = SensingConfig(frame_rate=30.0, drop_rate=0.5), PlantConfig(time_step=0.02)
    blind = lost(observed(sensed(config, quick), actions))
    assert blind.mean() == pytest.approx(0.125, abs=4 * np.sqrt(0.125 * 0.875 / len(blind)))


def test_a_frame_in_three_steps():
    actions = moves(12)
    truth = true(CableSimulator(TASK, FAST), actions)
    shown = observed(sensed(SensingConfig(frame_rate=10.0), FAST), actions)
    np.testing.assert_array_equal(shown[::3], truth[::3])
    assert np.isnan(np.delete(shown, np.arange(0, 13, 3), axis=0)).all()


# ---------------------------------------------------------------- seed and state
def test_the_same_seed_gives_the_same_run_and_another_one_another():
    actions = moves(15)
    first = observed(plant := sensed(EVERYTHING, seed=3), actions)
    np.testing.assert_array_equal(observed(plant, actions), first)
    np.testing.assert_array_equal(observed(sensed(EVERYTHING, seed=3), actions), first)
    other = observed(sensed(EVERYTHING, seed=4), actions)
    assert not np.array_equal(other, first, equal_nan=True)


@pytest.mark.parametrize("changes", [{}, {"friction": 0.4, "yield_curvature": 5.0, "drag": 1.0}])
def test_a_restored_state_goes_on_bit_for_bit(changes: dict[str, float]):
    cable = dataclasses.replace(TASK.cable, **changes)
    plant, other = (SensedPlant(CableSimulator(TASK, cable=cable), EVERYTHING, seed=3) for _ in range(2))
    actions = moves(20)
    for action in actions[:8]:
        plant.step(action)
    state = plant.state()
    branch = [plant.step(action).keypoints for action in actions[8:]]
    for again in (plant, other):
        again.restore(state)
        np.testing.assert_array_equal([again.step(action).keypoints for action in actions[8:]], branch)


def test_the_state_of_another_plant_is_refused():
    with pytest.raises(InputError, match="other delays"):
        sensed().restore(sensed(EVERYTHING).state())


# ---------------------------------------------------------------- refusals
def test_a_refused_action_changes_nothing():
    plant, untouched, actions = sensed(EVERYTHING), sensed(EVERYTHING), moves(6)
    np.testing.assert_array_equal(observed(plant, actions[:3]), observed(untouched, actions[:3]))
    with pytest.raises(SimulationError, match="finite"):
        plant.step(np.full((2, 3), np.nan))
    for action in actions[3:]:
        np.testing.assert_array_equal(plant.step(action).keypoints, untouched.step(action).keypoints)


def test_an_action_that_leads_too_far_is_refused_when_it_arrives():
    """And again, until the plant is reset; the grippers stay where they were."""
    plant = sensed(SensingConfig(action_delay=0.1))
    distance = float(np.linalg.norm(np.diff(plant.measure().poses[:, :2], axis=0)))
    outwards = np.array([[-0.01, 0.0, 0.0], [0.01, 0.0, 0.0]])
    for _ in range(round((TASK.cable.length - distance) / 0.02 - 0.5) + 1):
        plant.step(outwards)
    before = plant.measure().poses
    for _ in range(2):
        with pytest.raises(SimulationError, match="farther than the cable is long"):
            plant.step(STILL)
    np.testing.assert_array_equal(plant.measure().poses, before)
    plant.reset()
    plant.step(STILL)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"keypoint_noise": -0.001}, "sensing.keypoint_noise must be from 0 to 1, got -0.001"),
        ({"keypoint_noise": np.nan}, "sensing.keypoint_noise"),
        ({"frame_rate": 0.0}, "sensing.frame_rate must be from 0.1 to 1000"),
        ({"drop_rate": 1.5}, "sensing.drop_rate must be from 0 to 1"),
        ({"occlusion_rate": -1.0}, "sensing.occlusion_rate"),
        ({"occluded_share": 2.0}, "sensing.occluded_share"),
        ({"measurement_delay": np.inf}, "sensing.measurement_delay must be from 0 to 10"),
        ({"action_delay": 11.0}, "sensing.action_delay"),
    ],
)
def test_a_bad_configuration_is_refused(values: dict[str, float], message: str):
    with pytest.raises(InputError, match=message):
        SensingConfig(**values)


def test_a_negative_seed_is_refused():
    with pytest.raises(InputError, match="seed of a plant must not be negative, got -1"):
        sensed(seed=-1)
