"""Laws of what may be sent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cableway.control.limits import last_filter, span_limit, within_limits
from cableway.geometry.groups import SE2
from cableway.rod.inverse import fit_keypoints, meet_poses
from cableway.scene.clearance import bodies_gap, cable_gap
from cableway.scene.files.loading import load_task
from cableway.scene.gripper_bodies import BodyPart
from cableway.scene.obstacles import Disc
from cableway.scene.scene import Scene
from cableway.scene.task import Grippers
from cableway.tasks.generation import random_task

GRIPPERS = Grippers()
LONGEST = 0.3
actions = arrays(float, (2, 3), elements=st.floats(-10, 10))
poses = arrays(float, (2, 3), elements=st.floats(0, 0.3))


def gap(at: np.ndarray) -> float:
    return float(np.linalg.norm(at[1, :2] - at[0, :2]))


@given(actions, poses)
def test_limits_hold_for_any_action(action: np.ndarray, at: np.ndarray) -> None:
    sent = within_limits(action, at, GRIPPERS, LONGEST)
    assert np.linalg.norm(sent[:, :2], axis=1).max() <= GRIPPERS.max_step
    assert np.abs(sent[:, 2]).max() <= GRIPPERS.max_turn
    assert gap(at + sent) <= max(LONGEST, gap(at)) + 1e-12


@given(arrays(float, (2, 3), elements=st.floats(-0.009, 0.009)))
def test_allowed_actions_are_left_alone(action: np.ndarray) -> None:
    at = np.array([[0.1, 0.1, 0.0], [0.3, 0.2, 0.0]])
    np.testing.assert_allclose(within_limits(action, at, GRIPPERS, LONGEST), action, atol=1e-15)


def test_steps_are_shortened_in_their_own_direction() -> None:
    sent = within_limits(np.full((2, 3), 3.0), np.zeros((2, 3)), GRIPPERS, LONGEST)
    np.testing.assert_allclose(sent[:, 0], GRIPPERS.max_step / np.sqrt(2))
    np.testing.assert_allclose(sent[:, 0], sent[:, 1])


def test_pulling_apart_is_stopped_and_common_motion_kept() -> None:
    at = np.array([[0.0, 0.0, 0.0], [LONGEST, 0.0, 0.0]])
    sent = within_limits(np.array([[-0.004, 0.006, 0.01], [0.004, 0.006, 0.02]]), at, GRIPPERS, LONGEST)
    np.testing.assert_allclose(sent, [[0.0, 0.006, 0.01], [0.0, 0.006, 0.02]], atol=1e-12)


def test_grippers_too_far_apart_may_come_closer() -> None:
    at = np.array([[0.0, 0.0, 0.0], [LONGEST + 0.02, 0.0, 0.0]])
    closing = np.array([[0.004, 0.0, 0.0], [-0.004, 0.0, 0.0]])
    np.testing.assert_allclose(within_limits(closing, at, GRIPPERS, LONGEST), closing)
    np.testing.assert_allclose(within_limits(-closing, at, GRIPPERS, LONGEST), 0.0)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_an_action_that_is_not_finite_is_standing_still(bad: float) -> None:
    action = np.full((2, 3), 0.001)
    action[1, 2] = bad
    np.testing.assert_array_equal(within_limits(action, np.zeros((2, 3)), GRIPPERS, LONGEST), 0.0)


def test_a_plan_may_pull_the_cable_straighter_but_not_tear_it() -> None:
    """The share holds below it and for a plan that no cable of this length allows; in between the plan does."""
    apart = np.array([0.2, 0.2995, 0.31])
    gaps = np.stack([np.zeros((3, 3)), np.column_stack([apart, np.zeros((3, 2))])], axis=1)
    np.testing.assert_allclose(span_limit(gaps, 0.3, 0.99), [0.297, 0.2995, 0.297])


def test_hands_are_not_led_into_each_other_or_into_a_post():
    """Commands that would are cut; the same commands the other way are not."""
    task = next(task for seed in range(9) if (task := random_task(seed, "posts")).grippers.body == "2f-85")
    at = np.array([[0.4, 0.4, np.pi / 2], [0.54, 0.4, np.pi / 2]])
    empty = task.in_scene(replace(task.scene, obstacles=()))
    together = np.array([[0.012, 0.0, 0.0], [-0.012, 0.0, 0.0]])
    cut = last_filter(together, at, empty, 1.0)
    assert np.abs(cut).max() < 0.012
    assert bodies_gap(empty.body_pairs, (at + cut)[None])[0] > 0
    np.testing.assert_array_equal(last_filter(-together, at, empty, 1.0), -together)
    post = task.in_scene(replace(task.scene, obstacles=(Disc(center=(0.33, 0.4), radius=0.005, height=0.2),)))
    assert np.abs(last_filter(-together, at, post, 1.0)[0]).max() < 0.012


def test_a_hand_is_not_led_onto_the_cable():
    """Commands that would lead a bar across the end of a cable onto it are cut; the same commands back are not."""
    outline = np.array([[-0.01, -0.06], [0.01, -0.06], [0.01, 0.06], [-0.01, 0.06]])
    bars = Grippers(body=(BodyPart(outline=outline, heights=(0.002, 0.01)),))
    task, rng = random_task(0, "posts"), np.random.default_rng(2)
    task = replace(task, scene=Scene((0.8, 0.8), (), 0.001), grippers=bars)
    q = task.start_equilibrium + rng.normal(size=(4000, 6)) * [0.0, 0.0, 0.3, 20, 20, 6]
    stations, poses = task.cable.rod.shapes(q)
    near = (np.abs(cable_gap(task.bodies, stations, poses, task.cable) - 0.002) < 0.0015) & (
        bodies_gap(task.body_pairs, poses) > 0.03
    )
    cut = 0
    for lies, at in zip(task.cable.rod.at_keypoints(stations[near])[:20], poses[near], strict=False):
        for turn in (-0.08, 0.08):
            for side in range(2):
                action = np.zeros((2, 3))
                action[side, 2] = turn
                sent = last_filter(action, at, task, 1.0, lies=lies)
                np.testing.assert_array_equal(last_filter(action, at, task, 1.0), action)
                ends = SE2.plus(at, np.array([[[0.0]], [[1.0]]]) * sent)
                q = fit_keypoints(task.cable.rod, lies)[0]
                gaps = []
                for end in ends:
                    q = meet_poses(task.cable.rod, end, q[None])[0]
                    gaps.append(cable_gap(task.bodies, task.cable.rod.shapes(q[None])[0], end[None], task.cable)[0])
                assert gaps[1] > min(gaps[0], 0.0) - 1e-4
                cut += (sent != action).any()
    assert 3 < cut < 77


def test_a_plug_is_kept_out_of_what_is_not_its_port():
    """Its whole outline: the gripper behind it is well clear of the disc."""
    task = load_task("insertion")
    assert task.plug is not None
    at = np.array([[0.2, 0.2, 0.0], [0.3, 0.2, 0.0]])
    disc = Disc(center=(0.3 + task.plug.length + 0.012, 0.2), radius=0.008)
    blocked = task.in_scene(replace(task.scene, obstacles=(disc,)))
    ahead = np.array([[0.0, 0.0, 0.0], [0.012, 0.0, 0.0]])
    assert np.abs(last_filter(ahead, at, blocked, 1.0)).max() < 0.005
    np.testing.assert_array_equal(last_filter(-ahead, at, blocked, 1.0), -ahead)
