"""Laws of the open-loop error."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from cableway.core.errors import InputError
from cableway.tang2025.models.base import DeformationModel, Persistence
from cableway.tang2025.models.dataset import select
from cableway.tang2025.models.evaluation import evaluate, window_errors


class ConstantDrift(DeformationModel):
    """Moves every keypoint by the same step."""

    step: float

    def __call__(self, keypoints, poses, action):
        return jnp.full_like(keypoints, self.step)


def test_a_still_cable_and_a_drifting_model_give_a_known_error(transitions):
    still = select(transitions, transitions.episode < 3)
    frozen = np.repeat(still.keypoints[:1], len(still), axis=0)
    still.keypoints[:], still.next_keypoints[:] = frozen, frozen
    errors = window_errors(ConstantDrift(1e-3), still, (2, 4), stride=10).stacked[:, 1]
    errors = errors[np.isfinite(errors)]
    np.testing.assert_allclose(errors, 4e-3 * np.sqrt(26), rtol=1e-4)
    assert len(errors) == 3 * 2


def test_persistence_is_wrong_by_the_distance_that_the_cable_moves(transitions):
    row = evaluate({"still": Persistence()}, transitions, horizons=(10,), stride=20)["still"][0]
    moved = transitions.next_keypoints[9::20] - transitions.keypoints[::20]
    expected = 1e3 * np.linalg.norm(moved.reshape(len(moved), -1), axis=1)
    assert row.count == len(expected)
    np.testing.assert_allclose(
        [row.median, row.mean, row.p95, row.worst],
        [np.median(expected), expected.mean(), np.percentile(expected, 95), expected.max()],
        rtol=1e-4,
    )


def test_horizons_longer_than_every_episode_are_left_out(transitions):
    rows = evaluate({"still": Persistence()}, transitions, horizons=(1, 20, 21))["still"]
    assert [row.horizon for row in rows] == [1, 20]
    with pytest.raises(InputError, match="no episode of the data has 30 or more steps"):
        evaluate({"still": Persistence()}, transitions, horizons=(30,))
