"""The converter keeps what was recorded: order, jumps, angles that turn the short way."""

from __future__ import annotations

import convert_yu2d
import numpy as np
import pytest

from cableway.core.errors import InputError
from cableway.datasets.reading import load_transitions


def recorded(path, dt: float = 0.1) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    arrays = {
        "keypoints": rng.normal(size=(9, 4, 2)),
        "poses": rng.normal(size=(9, 2, 3)),
        "episode": np.array([0, 0, 0, 0, 0, 0, 1, 1, 1]),
        "length": np.array(0.4),
        "dt": np.array(dt),
    }
    arrays["poses"][2, 0, 2], arrays["poses"][3, 0, 2] = 3.1, -3.1
    np.savez(path, **arrays)
    return arrays


def test_transitions_follow_the_recording_and_never_cross_its_jumps(tmp_path):
    arrays = recorded(tmp_path / "yu2d_1.npz")
    assert convert_yu2d.convert(tmp_path / "yu2d_1.npz", tmp_path / "set", stretch=3) == 7
    data = load_transitions(tmp_path / "set")
    rows = np.array([0, 1, 2, 3, 4, 6, 7])
    np.testing.assert_array_equal(data.keypoints, arrays["keypoints"][rows])
    np.testing.assert_array_equal(data.next_keypoints, arrays["keypoints"][rows + 1])
    np.testing.assert_array_equal(data.episode, [0, 0, 0, 1, 1, 2, 2])
    turn = data.actions[2, 0, 2]
    assert turn == pytest.approx(2 * np.pi - 6.2)
    assert data.metadata["config"]["length"] == 0.4


def test_another_time_step_is_refused(tmp_path):
    recorded(tmp_path / "yu2d_1.npz", dt=0.05)
    with pytest.raises(InputError, match=r"dt is 0.05 s, a control step is 0.1 s"):
        convert_yu2d.convert(tmp_path / "yu2d_1.npz", tmp_path / "set", stretch=3)
