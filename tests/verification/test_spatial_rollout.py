"""The judge of rollouts in space sees what a rollout does not say of itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from spatial_problems import ball_task

from cableway.core.errors import InputError
from cableway.judge import judge_in_space
from cableway.outcome import Outcome
from cableway.records import Rollout
from cableway.scene.spatial.grippers import GripperPiece
from cableway.scene.spatial.obstacles import Sphere
from cableway.verification.spatial_rollout import verify_spatial_rollout

pytest.importorskip("coal")

TASK = ball_task()


def rollout(lift: float) -> Rollout:
    """From start to goal in a straight line, and `lift` [m] over it; the ball between is 80 mm in radius."""
    share = np.linspace(0, 1, 60)
    up = np.outer(np.sin(np.pi * share), [0.0, 0.0, lift])
    ends = [(TASK.keypoints(end), TASK.stations(end), TASK.gripper_poses(end)) for end in ("start", "goal")]
    keypoints, lines, poses = (a + share[:, None, None] * (b - a) for a, b in zip(*ends, strict=True))
    poses[..., :3] += up[:, None]
    count = len(share)
    return Rollout(
        times=0.1 * np.arange(count), keypoints=keypoints + up[:, None], observed=keypoints, poses=poses,
        centreline=lines + up[:, None], actions=np.zeros((count - 1, 2, 6)), reference=keypoints,
        solve_time=np.zeros(count - 1), status=np.full(count - 1, "tracking"), clearance=np.ones(count),
        gripper_clearance=np.ones(count),
    )  # fmt: skip


def failed(given: Rollout, **options: bool) -> list[str]:
    return [check.name for check in verify_spatial_rollout(given, TASK, **options).failures()]


def test_a_way_over_the_ball_passes_and_one_through_it_does_not():
    assert failed(rollout(0.2)) == []
    verdict = verify_spatial_rollout(rollout(0.0), TASK)
    (through,) = (check for check in verdict.failures() if check.name == "cable clearance")
    away = np.linalg.norm(rollout(0.0).centreline - [0.4, 0.4, 0.38], axis=2).min()
    assert away - 0.08 - TASK.cable.radius - 1e-3 < through.value < 0  # where it fails first
    assert "obstacles[0]" in through.where


@pytest.mark.parametrize(("above", "found"), [(0.08, []), (0.0, ["gripper body clearance"])])
def test_what_hands_meet_on_the_way_is_judged(above: float, found: list[str]):
    """A small ball in the way of a box on the left gripper, and one above that way."""
    given = rollout(0.2)
    piece = GripperPiece(points=[0.0, 0.0, 0.08] + 0.02 * (np.indices((2, 2, 2)).reshape(3, 8).T - 0.5))
    hands = replace(TASK, grippers=replace(TASK.grippers, body=(piece,)))
    x, y, z = hands.bodies[2].placed(given.poses[30, 0]).mean(axis=0).tolist()
    met = Sphere(center=(x, y, z + above), radius=0.01)
    task = replace(hands, scene=replace(TASK.scene, obstacles=(*TASK.scene.obstacles, met)))
    assert [check.name for check in verify_spatial_rollout(given, task).failures()] == found


def test_ends_grippers_and_limits_are_judged():
    over = rollout(0.2)
    elsewhere = over.keypoints.copy()
    elsewhere[-1] += [0.01, 0.0, 0.0]
    assert failed(replace(over, keypoints=elsewhere)) == ["shape error at the end"]
    begun = over.keypoints.copy()
    begun[0] += [0.0, 0.01, 0.0]
    assert failed(replace(over, keypoints=begun)) == ["distance to start"]
    begun[0, [0, -1]] -= [0.0, 0.01, 0.0]
    assert failed(replace(over, keypoints=begun), same_start=False) == []
    poses = over.poses.copy()
    poses[30:, 0, 0] += 0.02
    assert failed(replace(over, poses=poses)) == ["gripper step"]
    poses = over.poses.copy()
    poses[:, 1, :3] += 0.9 * (poses[:, 0, :3] - poses[:, 1, :3])
    assert "gripper separation" in failed(replace(over, poses=poses))
    poses = over.poses.copy()
    poses[..., 2] -= 0.2 * np.sin(np.pi * np.linspace(0, 1, 60))[:, None] + 0.38
    assert "gripper clearance" in failed(replace(over, poses=poses))


def test_what_becomes_of_a_run_is_judged_by_the_plant_and_by_the_checks():
    over, through = rollout(0.2), rollout(0.0)
    judged = {
        Outcome.SUCCESS: over,
        Outcome.CONTACT: replace(over, clearance=np.where(np.arange(60) == 30, -0.001, 1.0)),
        Outcome.NOT_VERIFIED: through,
        Outcome.MISSED_GOAL: replace(over, keypoints=over.keypoints + [0.02, 0.0, 0.0]),
        Outcome.PLANT_FAILED: replace(over, metadata={"outcome": "plant failed"}),
    }
    for outcome, given in judged.items():
        assert judge_in_space(TASK, given, verify_spatial_rollout(given, TASK))[0] is outcome


def test_a_rollout_of_the_plane_is_refused_and_numbers_that_do_not_go_together_are():
    over = rollout(0.2)
    flat = {name: getattr(over, name)[..., :2] for name in ("keypoints", "observed", "centreline", "reference")}
    planar = replace(over, **flat, poses=over.poses[..., :3], actions=over.actions[..., :3])
    with pytest.raises(InputError, match="in space, the rollout is not"):
        verify_spatial_rollout(planar, TASK)
    with pytest.raises(InputError, match="do not go with"):
        replace(over, poses=over.poses[..., :3])
