"""Laws of the frames and of the end-motion blend."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from cableway.core.errors import InputError
from cableway.geometry import se2
from cableway.rod.planar import PlanarRod
from cableway.tang2025.models import frames
from cableway.tang2025.models.frames import Framing


def moved(sample, shift, angle, size=1.0):
    """A sample after a rigid motion and a change of size."""
    keypoints, poses, action = (np.asarray(part, float) for part in sample)
    place = lambda points: se2.transform(size * points, np.asarray(shift), angle)  # noqa: E731
    turned = np.column_stack([place(poses[:, :2]), poses[:, 2] + angle])
    motion = np.column_stack([size * action[:, :2] @ se2.rotation(angle).T, action[:, 2]])
    return place(keypoints), turned, motion


def test_the_cable_frame_sees_no_rigid_motion_and_no_size(sample):
    def view(keypoints, poses, action):
        return frames.express(Framing(), frames.cable_frame(keypoints, poses), keypoints, poses, action)

    before = view(*sample)
    after = view(*(np.asarray(part, np.float32) for part in moved(sample, [1.0, -2.0], 2.5, size=0.5)))
    for one, other in zip(before, after, strict=True):
        np.testing.assert_allclose(one, other, atol=5e-6)


def test_the_cable_frame_turns_round_when_the_cable_is_read_from_the_other_end(sample):
    keypoints, poses, _ = sample
    frame = frames.cable_frame(keypoints, poses)
    other = frames.cable_frame(keypoints[::-1], poses[::-1])
    np.testing.assert_allclose(other.axes, -frame.axes, atol=1e-5)
    np.testing.assert_allclose(other.origin, frame.origin, atol=1e-6)


def test_the_cable_frame_stays_defined_where_the_grippers_meet():
    angle = np.linspace(0, 2 * np.pi, 13)
    loop = np.column_stack([np.sin(angle), 1 - np.cos(angle)]).astype(np.float32)
    poses = np.zeros((2, 3), np.float32)
    frame = frames.cable_frame(loop, poses)
    slope = jax.jacfwd(lambda points: frames.cable_frame(points, poses).axes)(loop)
    assert np.abs(np.linalg.norm(frame.axes, axis=0) - 1).max() < 1e-5
    assert np.isfinite(slope).all()
    assert np.abs(slope).max() < 1.0


@pytest.mark.parametrize("turns", [1, -2])
def test_full_turns_of_a_gripper_change_nothing(sample, turns):
    keypoints, poses, action = sample
    wound = poses + np.array([0, 0, 2 * np.pi * turns], np.float32)
    frame = frames.cable_frame(keypoints, poses)
    expressed = [frames.express(Framing(), frame, keypoints, angles, action) for angles in (poses, wound)]
    for one, other in zip(*expressed, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-5)


def test_the_blend_of_equal_rigid_motions_is_that_rigid_motion(sample):
    keypoints, poses, _ = sample
    turn, shift = 0.2, np.array([0.01, -0.02])
    carried = se2.transform(poses[:, :2], shift, turn)
    action = np.column_stack([carried - poses[:, :2], [turn, turn]]).astype(np.float32)
    expected = se2.transform(keypoints, shift, turn) - keypoints
    np.testing.assert_allclose(frames.end_motion_blend(keypoints, poses, action), expected, atol=1e-6)


def test_the_blend_keeps_the_directions_of_the_ends():
    rod = PlanarRod(0.3, 193)
    stations, poses = rod.shapes(np.array([[0.3, 0.3, 0.0, 3.0, 9.0, -1.0]]))
    keypoints = rod.at_keypoints(stations)[0].astype(np.float32)
    action = np.array([[0.02, 0.03, 0.05], [-0.02, -0.03, -0.08]], np.float32)
    after = keypoints + np.asarray(frames.end_motion_blend(keypoints, poses[0].astype(np.float32), action))
    for ends, theta in ((after[1] - after[0], poses[0, 0, 2] + 0.05), (after[-1] - after[-2], poses[0, 1, 2] - 0.08)):
        assert abs(se2.wrap_angle(np.arctan2(ends[1], ends[0]) - theta)) < 0.03


def test_the_correction_leaves_the_ends_alone():
    for framing in (Framing(), Framing(blend=False)):
        assert np.all(frames.correction_window(framing, 13)[[0, -1]] == 0)
    assert np.all(frames.correction_window(Framing.plain(), 13) == 1)


@pytest.mark.wrong_types
def test_an_unknown_frame_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match="unknown frame 'left'; known: cable, world"):
        Framing(frame="left")  # pyright: ignore[reportArgumentType]
