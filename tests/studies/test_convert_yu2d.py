"""The converter keeps what was recorded: places, angles that run on, jumps."""

from __future__ import annotations

import convert_yu2d
import numpy as np
import pytest

from cableway.core.errors import InputError
from cableway.datasets.reading import load_transitions


def test_transitions_follow_the_recording_and_never_cross_its_jumps(tmp_path):
    """Ends that turn past half a turn, a cable along y, and a jump of half of its length after six rows."""
    turns = np.linspace(0, 0.4, 9)[:, None] * [9.0, -1.0]
    along = np.linspace(0, 0.4, convert_yu2d.KEYPOINTS)[:, None] * [0.0, 1.0]
    keypoints = along + 0.01 * np.arange(9)[:, None, None] + np.where(np.arange(9) > 5, 0.2, 0.0)[:, None, None]
    state = np.zeros((9, 117), np.float32)
    state[:, 0] = 0.4
    state[:, 1:31] = np.concatenate([keypoints, np.full((9, 10, 1), 0.3)], axis=2).reshape(9, 30)
    for side, column in enumerate((31, 38)):
        state[:, column : column + 2] = keypoints[:, -side]
        state[:, column + 5], state[:, column + 6] = np.sin(turns[:, side] / 2), np.cos(turns[:, side] / 2)
    np.save(tmp_path / "state_1.npy", state)
    data = load_transitions(convert_yu2d.convert(tmp_path / "state_1.npy", tmp_path / "set"))
    kept = np.array([0, 1, 2, 3, 4, 6, 7])
    np.testing.assert_allclose(data.keypoints, keypoints[kept], atol=1e-6)
    np.testing.assert_allclose(data.next_keypoints, keypoints[kept + 1], atol=1e-6)
    np.testing.assert_array_equal(data.episode, [0, 0, 0, 0, 0, 1, 1])
    np.testing.assert_allclose(data.actions[..., 2], np.diff(turns, axis=0)[kept], atol=1e-6)
    np.testing.assert_allclose(np.sin(data.poses[..., 2]), np.sin(np.pi / 2 + turns[kept]), atol=1e-6)
    assert data.metadata["config"]["cable"]["length"] == pytest.approx(0.4)


def test_another_file_is_refused(tmp_path):
    np.save(tmp_path / "state_1.npy", np.zeros((3, 20)))
    with pytest.raises(InputError, match="not rows of at least 45 numbers"):
        convert_yu2d.convert(tmp_path / "state_1.npy", tmp_path / "set")
