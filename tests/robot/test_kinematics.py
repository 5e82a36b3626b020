"""Kinematics of the UR5e: the inverse against the forward one, both against the judge's own, capsules against Coal."""

import coal
import numpy as np
import pytest

from cableway.robot.kinematics import BRANCHES, branch_joints, branch_motion, flange_poses, gripper_poses, link_frames
from cableway.robot.links import Capsules, arm_clearances, arms_gaps
from cableway.scene.arm_models import UR5E, Capsule
from cableway.scene.cell import TOOLS
from cableway.scene.gripper_bodies import AXIS, OPENINGS, gripper_body, open_hand
from cableway.verification.arms import _exponentials, _homes

LENGTHS = np.array(UR5E.lengths)
CAPSULES = Capsules.of(UR5E, TOOLS["2f-85"])
EMPTY = (
    np.zeros((0, 1, 2)),
    np.zeros(0, np.int64),
    np.zeros(0),
    np.array([9.0, 9.0]),
    np.zeros((0, 4)),
    np.array([-np.inf]),
)


def frames_at(joints: np.ndarray, base: np.ndarray | None = None) -> np.ndarray:
    frames = np.empty((7, 3, 4))
    link_frames(LENGTHS, np.eye(4) if base is None else base, joints, frames)
    return frames


def test_every_branch_leads_to_the_pose_and_one_of_them_is_where_it_came_from():
    rng, found = np.random.default_rng(0), np.empty(6)
    for joints in rng.uniform(-np.pi, np.pi, (300, 6)):
        flange, same = frames_at(joints)[6], []
        for branch in range(BRANCHES):
            margin = branch_joints(LENGTHS, flange, branch, found)
            if margin < 0.01:
                continue
            np.testing.assert_allclose(frames_at(found)[6], flange, atol=1e-9)
            same.append(np.abs(np.angle(np.exp(1j * (found - joints)))).max() < 1e-6)
        singular = min(abs(np.sin(joints[2])), abs(np.sin(joints[4]))) < 0.02
        assert sum(same) == 1 or singular or not same or margin < 0.01


def test_the_branches_of_a_pose_are_eight_different_ones():
    flange, found = frames_at(np.array([0.3, -1.4, 1.7, -1.9, -1.5, 0.4]))[6], np.empty(6)
    every = []
    for branch in range(BRANCHES):
        if branch_joints(LENGTHS, flange, branch, found) > 0:
            every.append(found.round(6).copy())
    assert len({tuple(each) for each in every}) == len(every) >= 4


def test_a_pose_out_of_reach_has_no_branch():
    flange = flange_poses(np.array([[1.2, 0.0, 0.0]]), 0.161, 0.004, 0)
    assert all(branch_joints(LENGTHS, flange[0], branch, np.empty(6)) < 0 for branch in range(BRANCHES))


def test_a_motion_is_followed_as_far_as_it_is_reached():
    x = np.linspace(0.3, 1.4, 60)
    flanges = flange_poses(np.column_stack([x, 0 * x, 0 * x]), 0.161, 0.004, 0)
    reached = [branch_motion(LENGTHS, flanges, branch, 0.05, np.empty((60, 6))) for branch in range(BRANCHES)]
    assert 10 < max(reached) < 60
    assert 0.6 < x[max(reached)] < 1.0


def test_the_judges_kinematics_are_the_same():
    joints = np.random.default_rng(1).uniform(-4, 4, (50, 6))
    moves = [np.tile(np.eye(4), (50, 1, 1)), *_exponentials(UR5E, joints)]
    for row, each in enumerate(joints):
        own = frames_at(each)
        for frame, home in enumerate(_homes(UR5E)):
            np.testing.assert_allclose((moves[frame][row] @ home)[:3], own[frame], atol=1e-12)


@pytest.mark.parametrize("turn", [0, 1])
def test_a_tool_points_down_at_the_gripper(turn: int):
    poses = np.array([[0.2, 0.3, 0.5], [0.1, -0.4, -2.8]])
    flanges = flange_poses(poses, 0.161, 0.004, turn)
    np.testing.assert_allclose(gripper_poses(flanges, 0.161, turn), poses, atol=1e-12)
    tips = flanges @ np.array([0, 0, 0.161, 1])
    np.testing.assert_allclose(tips[:, :3], np.column_stack([poses[:, :2], [0.004, 0.004]]), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(flanges[:, :3, :3]), 1.0)


def test_distances_of_two_arms_are_those_of_coal():
    rng = np.random.default_rng(2)
    bases = [np.eye(4), np.eye(4)]
    bases[1][0, 3] = 0.7
    joints = rng.uniform(-2, 2, (2, 20, 6))
    placed = [np.empty((20, len(CAPSULES.frame), 2, 3)) for _ in range(2)]
    for arm in range(2):
        arm_clearances(LENGTHS, bases[arm], joints[arm], CAPSULES, EMPTY, placed[arm])
    gaps = arms_gaps(placed[0], CAPSULES, placed[1], CAPSULES)
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    for row in range(20):
        least = np.inf
        for i in range(len(CAPSULES.frame)):
            for j in range(len(CAPSULES.frame)):
                if i < CAPSULES.hand or j < CAPSULES.hand:
                    result.clear()
                    one, other = (shape(placed[arm][row, k], CAPSULES.radius[k]) for arm, k in ((0, i), (1, j)))
                    least = min(least, coal.distance(*one, *other, request, result))
        assert gaps[row] == pytest.approx(least, abs=1e-6) or max(gaps[row], least) < 0  # depths are measured otherwise


def shape(ends: np.ndarray, radius: float):
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    z = along / length
    x = np.cross(z, [1.0, 0, 0] if abs(z[0]) < 0.9 else [0, 1.0, 0])
    x /= np.linalg.norm(x)
    turn = np.column_stack([x, np.cross(z, x), z])
    return coal.Capsule(radius, length), coal.Transform3s(turn, ends.mean(axis=0))


def test_a_link_below_the_table_or_in_a_tall_obstacle_is_found():
    flat = np.zeros((1, 6))  # stretched out along -x, the wrist 0.06 m below the shoulder
    placed, high = np.empty((1, len(CAPSULES.frame), 2, 3)), np.eye(4)
    high[2, 3] = 0.3
    free = arm_clearances(LENGTHS, high, flat, CAPSULES, EMPTY, placed)[0]
    lowest = 0.1625 - 0.0997 - 0.054  # of the second wrist, with the base on the table
    assert arm_clearances(LENGTHS, np.eye(4), flat, CAPSULES, EMPTY, placed)[0] == pytest.approx(lowest, abs=1e-9)
    place = (np.array([[[-0.6, -0.05]]]), np.array([1]), np.array([0.05]), np.array([9.0, 9.0]))
    box = np.array([[-0.65, -0.1, -0.55, 0.0]])
    tall, low = ((*place, box, np.array([height, -np.inf])) for height in (0.5, 0.1))
    assert arm_clearances(LENGTHS, high, flat, CAPSULES, tall, placed)[0] < -0.02
    assert arm_clearances(LENGTHS, high, flat, CAPSULES, low, placed)[0] == pytest.approx(free)


def test_the_clearance_of_an_arm_from_itself_is_that_of_coal():
    joints, high = np.random.default_rng(3).uniform(-2.6, 2.6, (40, 6)), np.eye(4)
    high[2, 3] = 3.0  # the table is far
    placed = np.empty((40, len(CAPSULES.frame), 2, 3))
    found = arm_clearances(LENGTHS, high, joints, CAPSULES, EMPTY, placed)
    request, result, touching = coal.DistanceRequest(), coal.DistanceResult(), 0
    for row in range(40):
        least = np.inf
        for i, frame in enumerate(CAPSULES.frame):
            for j in np.flatnonzero(CAPSULES.frame <= frame - 3):
                result.clear()
                one, other = (shape(placed[row, k], CAPSULES.radius[k]) for k in (i, j))
                least = min(least, coal.distance(*one, *other, request, result))
        touching += least < 0
        assert found[row] == pytest.approx(least, abs=1e-6) or max(found[row], least) < 0
    assert 0 < touching < 40


@pytest.mark.parametrize("opening", [None, *OPENINGS])
def test_the_capsules_of_the_hand_e_hold_its_outlines_but_for_the_tips(opening: float | None):
    """But for 3 mm, by which corners of the open carriages stand out; nothing of them is there."""
    tool, parts = TOOLS["hand-e"], gripper_body("hand-e") if opening is None else open_hand("hand-e", opening)
    tool = tool if opening is None else tool.opened(opening)
    for part in parts:
        for height in part.heights:
            down = tool.reach + AXIS - height  # from the flange
            if down <= tool.reach - 0.02:
                outside = [
                    min(beyond(np.array([*corner, down]), each) for each in tool.capsules) for corner in part.outline
                ]
                assert max(outside) < 0.003


def beyond(point: np.ndarray, capsule: Capsule) -> float:
    """Distance of a point from a capsule, in its frame."""
    start, along = np.array(capsule.start), np.subtract(capsule.end, capsule.start)
    nearest = start + np.clip((point - start) @ along / (along @ along), 0, 1) * along
    return float(np.linalg.norm(point - nearest)) - capsule.radius
