"""Laws of adaptation: it learns what it can see, never from nothing, and takes no change that does not help."""

from __future__ import annotations

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from led_cables import quasi_static

from cableway.core.errors import InputError
from cableway.datasets.transitions import Transitions
from cableway.tang2025.models.adaptation import AdaptationConfig, AdaptationState, _explained, adapt, start_adaptation
from cableway.tang2025.models.base import rollout
from cableway.tang2025.models.dataset import select
from cableway.tang2025.models.evaluation import window_errors
from cableway.tang2025.models.learned import LearnedModel
from cableway.tang2025.models.networks import RodConfig

NOMINAL = LearnedModel(RodConfig(), key=jax.random.key(0))
GRADED = eqx.tree_at(lambda model: model.rod.stiffness, NOMINAL, jnp.array([0.7, -0.2 * 2 / 3]))
TRUE = eqx.tree_at(lambda model: model.rod, GRADED, GRADED.rod.keeping_nothing())
run = eqx.filter_jit(jax.vmap(rollout, in_axes=(None, 0, 0, 0)))


@pytest.fixture(scope="module")
def observed() -> Transitions:
    """A cable with one stiff end, as led in forty-step episodes."""
    led = quasi_static(10, 40, seed=3)
    first = slice(None, None, 40)
    actions = led.actions.reshape(10, 40, 2, 3)
    settled = run(TRUE, led.keypoints[first], led.poses[first], 0 * actions[:, :20])[:, -1]
    shapes = np.concatenate([settled[:, None], run(TRUE, settled, led.poses[first], actions)], axis=1)
    before, after = (shapes[:, part].reshape(-1, 13, 2).astype(float) for part in (slice(-1), slice(1, None)))
    return replace(led, keypoints=before, next_keypoints=after)


def fed(state: AdaptationState, data: Transitions, rows: range) -> AdaptationState:
    for start in range(rows.start, rows.stop, 20):
        state = adapt(state, select(data, np.arange(start, start + 20)))
    return state


def error(state: AdaptationState, data: Transitions) -> float:
    return float(np.mean(window_errors(state.model, select(data, data.episode >= 5), (10,)).stacked))


@pytest.fixture(scope="module")
def adapted(observed: Transitions) -> AdaptationState:
    return fed(start_adaptation(NOMINAL), observed, range(160))


def test_a_stiff_end_is_learned_and_other_motions_are_predicted_better(adapted, observed):
    assert adapted.accepted >= 1
    assert error(adapted, observed) < 0.4 * error(start_adaptation(NOMINAL), observed)
    assert adapted.model.rod.stiffness[0] > 0.3


def fed_spoilt(data: Transitions, count: int, seed: int) -> AdaptationState:
    """Adapted to transitions of which `count` are spoilt by noise of 5 cm and three are lost."""
    rng = np.random.default_rng(seed)
    rows = np.arange(160)
    bad = rng.choice(rows, count, replace=False)
    keypoints, after = data.keypoints[rows].copy(), data.next_keypoints[rows].copy()
    keypoints[bad] += rng.normal(0, 0.05, (count, 13, 2))
    after[bad - 1] = keypoints[bad]
    spoilt = replace(select(data, rows), keypoints=keypoints, next_keypoints=after)
    kept = select(spoilt, np.setdiff1d(rows, [57, 58, 121]))
    state = fed(start_adaptation(NOMINAL), kept, range(0, len(kept) - 20))
    assert np.isfinite(np.asarray(state.model.rod.stiffness)).all()
    return state


@pytest.mark.parametrize("seed", [0, 1])
def test_it_learns_in_spite_of_outliers_and_lost_frames(observed, seed):
    assert error(fed_spoilt(observed, 4, seed), observed) < error(start_adaptation(NOMINAL), observed)


def test_a_spoilt_frame_in_two_does_not_lead_astray(observed):
    assert error(fed_spoilt(observed, 80, 2), observed) <= error(start_adaptation(NOMINAL), observed)


def test_a_still_cable_changes_nothing(adapted, observed):
    shape, pose = observed.keypoints[:1], observed.poses[:1]
    still = Transitions(
        *(np.repeat(part, 200, axis=0) for part in (shape, pose, 0 * pose, shape)), episode=np.full(200, 77)
    )
    after = adapt(adapted, still)
    assert after.model is adapted.model
    assert (after.accepted, after.refused) == (adapted.accepted, adapted.refused)


def test_a_model_that_is_right_already_is_left_alone(observed):
    state = fed(start_adaptation(GRADED), observed, range(100))
    assert state.accepted == 0
    assert eqx.tree_equal(state.model, GRADED)


def test_the_paper_takes_whatever_comes_out(observed):
    """Of a model that is right already, too."""
    state = fed(start_adaptation(GRADED, config=AdaptationConfig.paper()), observed, range(100))
    assert state.accepted >= 1
    assert state.refused == 0
    assert not eqx.tree_equal(state.model, GRADED)


def test_what_does_not_help_is_refused(observed):
    demanding = AdaptationConfig(improvement=0.999)
    state = fed(start_adaptation(NOMINAL, config=demanding), observed, range(100))
    assert state.accepted == 0
    assert state.refused >= 1
    assert state.model is NOMINAL


def test_a_change_that_explains_only_part_is_refused(observed):
    state = fed(start_adaptation(NOMINAL, config=AdaptationConfig(improvement=0.99)), observed, range(160))
    assert (state.accepted, state.refused > 0) == (0, True)
    assert eqx.tree_equal(state.model, NOMINAL)


def test_small_errors_are_left_alone(observed):
    for enough, tried in ((0.0, True), (0.1, False)):
        state = fed(start_adaptation(NOMINAL, config=AdaptationConfig(enough=enough)), observed, range(100))
        assert (state.accepted + state.refused > 0) == tried


def test_the_share_explained_leaves_out_what_was_measured_wrong():
    before = np.array([0.004, 0.005, 0.006, 0.5])
    assert _explained(before, np.array([0.0004, 0.0005, 0.0006, 0.5]), 0.0165) == pytest.approx(0.9)
    assert _explained(before, np.array([0.002, 0.0025, 0.003, 0.5]), 0.0165) == pytest.approx(0.5)
    # three windows better, and a fourth that counts so much worse that nothing is gained
    assert _explained(np.full(4, 0.004), np.array([0.003, 0.003, 0.003, 0.0121]), 0.0121) == 0.0


def test_a_network_has_settings_of_its_own(model):
    assert start_adaptation(NOMINAL).config == AdaptationConfig()
    assert start_adaptation(model).config == AdaptationConfig.for_network() != AdaptationConfig()


def test_the_same_transitions_give_the_same_model(adapted, observed):
    again = fed(start_adaptation(NOMINAL), observed, range(160))
    assert eqx.tree_equal(again.model, adapted.model)


def test_a_network_changes_in_its_last_layer_only(model, observed, transitions):
    state = fed(start_adaptation(model, replay=transitions), observed, range(100))
    assert state.accepted + state.refused >= 1
    same = eqx.tree_at(lambda m: m.network.readout, state.model, model.network.readout)
    assert eqx.tree_equal(same, model)


def test_another_number_of_keypoints_is_refused(adapted):
    with pytest.raises(InputError, match="have 10 keypoints, those before 13"):
        adapt(adapted, quasi_static(1, 20, seed=0, keypoints=10))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"windows": 0}, "windows must be whole and positive"),
        ({"improvement": 1.0}, "improvement must be from 0 to below 1"),
    ],
)
def test_impossible_settings_are_refused(fields, message):
    with pytest.raises(InputError, match=message):
        AdaptationConfig(**fields)
