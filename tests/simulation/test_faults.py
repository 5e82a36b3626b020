"""Faults between a plant and its controller do what they say, and nothing else."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cableway.core.errors import InputError
from cableway.scene.files.loading import load_task
from cableway.simulation.perturbations.faults import FaultConfig, FaultyPlant
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.perturbations.sensing import SensingConfig

TASK = load_task("single-obstacle-1")
STEP = np.array([[0.004, 0.001, 0.01], [-0.004, 0.001, -0.01]])


def plant(faults: FaultConfig | None = None, **differs: Any) -> Any:
    return Perturbation(faults=faults or FaultConfig(), **differs).build(TASK, seed=3)


def run(faults: FaultConfig, steps: int = 12, action: np.ndarray = STEP) -> tuple[list[Any], list[Any]]:
    """Observations with faults and without."""
    faulty, sound = plant(faults), plant()
    seen, truth = [faulty.reset()], [sound.reset()]
    for _ in range(steps):
        seen.append(faulty.step(action))
        truth.append(sound.step(action))
    return seen, truth


def test_without_faults_there_is_nothing_between() -> None:
    assert not isinstance(plant(), FaultyPlant)


def test_angles_in_another_turn_and_wrapped() -> None:
    seen, truth = run(FaultConfig(turns=(0, 1)), 2)
    assert seen[-1].poses[1, 2] == pytest.approx(truth[-1].poses[1, 2] + 2 * math.pi)
    assert seen[-1].poses[0, 2] == pytest.approx(truth[-1].poses[0, 2])
    for turns in (-2, 3):
        wrapped = FaultyPlant(plant(), FaultConfig(wrapped=True), TASK)._angles(
            np.full((2, 3), 2 * math.pi * turns + 3)
        )
        np.testing.assert_allclose(wrapped[:, 2], 3.0)


def test_a_stalled_gripper_stands_still_and_makes_up_for_it() -> None:
    seen, truth = run(FaultConfig(stalled="right", stall=(0.2, 0.5)), 12)
    right = np.array([row.poses[1] for row in seen])
    np.testing.assert_allclose(right[2:6], right[[2, 2, 2, 2]], atol=2e-4)  # the weld of the simulator gives way
    np.testing.assert_allclose(right[-1], truth[-1].poses[1], atol=1e-3)
    moved = np.linalg.norm(np.diff(right[:, :2], axis=0), axis=1)
    assert moved.max() <= TASK.grippers.max_step + 1e-9


def test_frozen_link_and_camera() -> None:
    seen, truth = run(FaultConfig(frozen_link=(0.3, 0.6)))
    for k in (3, 4, 5):
        assert seen[k] is seen[2]
    np.testing.assert_array_equal(seen[6].poses, truth[6].poses)
    seen, truth = run(FaultConfig(frozen_camera=(0.3, 0.6)))
    for k in (3, 4, 5):
        np.testing.assert_array_equal(seen[k].keypoints, seen[2].keypoints)
        np.testing.assert_array_equal(seen[k].poses, truth[k].poses)
    np.testing.assert_array_equal(seen[6].keypoints, truth[6].keypoints)


def test_messages_repeat_and_the_clock_jumps() -> None:
    seen, _ = run(FaultConfig(repeated=0.5), 30)
    repeats = sum(after is before for before, after in itertools.pairwise(seen))
    assert 5 < repeats < 25
    seen, truth = run(FaultConfig(clock_jump=(0.45, -5.0)))
    offsets = np.array([a.time - b.time for a, b in zip(seen, truth, strict=True)])
    np.testing.assert_allclose(offsets[:5], 0.0)
    np.testing.assert_allclose(offsets[5:], -5.0)


def test_keypoints_are_exchanged_astray_hidden_or_displaced() -> None:
    seen, truth = run(FaultConfig(swapped=1.0))
    off = np.array([(a.keypoints != b.keypoints).any(axis=1).sum() for a, b in zip(seen, truth, strict=True)])
    assert (off == 2).all()
    seen, truth = run(FaultConfig(strays=1.0))
    off = np.array([(a.keypoints != b.keypoints).any(axis=1).sum() for a, b in zip(seen, truth, strict=True)])
    assert (off == 1).all()
    seen, truth = run(FaultConfig(hidden_ends=2), 1)
    assert np.isnan(seen[0].keypoints[[0, 1, -2, -1]]).all()
    np.testing.assert_array_equal(seen[0].keypoints[2:-2], truth[0].keypoints[2:-2])
    seen, truth = run(FaultConfig(bias=(0.003, 0.0, 0.01)), 1)
    middle = np.array(TASK.scene.size) / 2
    wanted = truth[0].keypoints - middle
    turned = wanted @ np.array([[math.cos(0.01), math.sin(0.01)], [-math.sin(0.01), math.cos(0.01)]])
    np.testing.assert_allclose(seen[0].keypoints, middle + turned + [0.003, 0.0], atol=1e-12)


def test_a_peg_is_there_and_known_when_it_is_revealed() -> None:
    peg = (0.05, 0.05, 0.01)
    hidden, late, known = (plant(pegs=(peg,), revealed=when) for when in (None, 0.2, 0.0))
    for each in (hidden, late, known):
        each.reset()
    assert len(hidden.task.scene.obstacles) == len(late.task.scene.obstacles) == len(TASK.scene.obstacles)
    assert len(known.task.scene.obstacles) == len(TASK.scene.obstacles) + 1
    for _ in range(2):
        late.step(STEP)
        hidden.step(STEP)
    assert len(late.task.scene.obstacles) == len(TASK.scene.obstacles) + 1
    assert hidden.task is TASK
    with pytest.raises(InputError, match="pegs must be discs"):
        Perturbation(pegs=((math.nan, 0.0, 0.01),))


def test_late_frames_overtake_none() -> None:
    jittery = plant(sensing=SensingConfig(jitter=0.3, measurement_delay=0.1))
    sound = plant()
    truth = [sound.reset().keypoints]
    shown = [jittery.reset().keypoints]
    for _ in range(40):
        truth.append(sound.step(STEP / 4).keypoints)
        shown.append(jittery.step(STEP / 4).keypoints)
    ages = []
    for now, frame in enumerate(shown):
        if np.isfinite(frame).all():
            taken = [k for k, row in enumerate(truth) if np.array_equal(row, frame)]
            assert taken, "a frame that was never taken"
            ages.append(now - taken[-1])
    assert set(ages[5:]) <= {1, 2, 3, 4}
    assert len(set(ages[5:])) > 1


def test_a_faulty_run_can_be_branched() -> None:
    faults = FaultConfig(stall=(0.2, 0.4), repeated=0.3, swapped=0.5, frozen_camera=(0.5, 0.8))
    one = plant(faults, sensing=SensingConfig(keypoint_noise=0.001))
    one.reset()
    for _ in range(4):
        one.step(STEP)
    state = one.state()
    first = [one.step(STEP) for _ in range(6)]
    one.restore(state)
    for before, again in zip(first, [one.step(STEP) for _ in range(6)], strict=True):
        np.testing.assert_array_equal(before.keypoints, again.keypoints)
        np.testing.assert_array_equal(before.poses, again.poses)
        assert before.time == again.time


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"stall": (2.0, 1.0)}, "faults.stall must be a begin and an end"),
        ({"frozen_link": (-1.0, 1.0)}, "faults.frozen_link must be a begin and an end"),
        ({"bias": (math.nan, 0.0, 0.0)}, "faults.bias must be finite"),
        ({"repeated": 1.5}, "repeated must be from 0 to 1"),
        ({"hidden_ends": -1}, "hidden_ends must be from 0 to 10"),
    ],
)
def test_what_is_no_fault_is_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(FaultConfig(), **values)
