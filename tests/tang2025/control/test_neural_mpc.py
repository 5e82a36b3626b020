"""Laws of the model predictive controller."""

from __future__ import annotations

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from quasi_static import outward, straight_plan, task_for

from cableway.control.base import Status
from cableway.estimation.rod_filter import EstimatorConfig
from cableway.geometry import convex
from cableway.records import Observation, Plan
from cableway.rod.planar import PlanarRod
from cableway.scene.obstacles import Disc
from cableway.scene.task import Task
from cableway.tang2025.control.mpc_config import MPCConfig
from cableway.tang2025.control.neural_mpc import MPCState, NeuralMPC
from cableway.tang2025.control.prediction import compile_predictor
from cableway.tang2025.models.base import DeformationModel, RigidBlend

PLAN = straight_plan(PlanarRod(0.3))
TASK = task_for(PLAN)
STILL = replace(PLAN, shapes=PLAN.shapes[[0] * 51], poses=PLAN.poses[[0] * 51])
"""The same number of rows, all the same."""


class Shared:
    """Controllers by their settings, each with the state it starts from; compiled once for all tests."""

    def __init__(self) -> None:
        self._known: dict[MPCConfig, tuple[NeuralMPC, MPCState]] = {}

    def __call__(self, plan: Plan = PLAN, task: Task = TASK, **settings: object) -> tuple[NeuralMPC, MPCState]:
        config = MPCConfig(**{"hold": 0.0, **settings})  # pyright: ignore[reportArgumentType]
        controller = NeuralMPC(RigidBlend(), config)
        if not hasattr(self, "_predictor"):
            self._predictor = controller.init(task, plan).problem.predictor
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("cableway.tang2025.control.neural_mpc.compile_predictor", lambda *_: self._predictor)
            return controller, controller.init(task, plan)


@pytest.fixture(scope="module")
def started() -> Shared:
    return Shared()


def at(row: int, plan: Plan = PLAN, shift: np.ndarray | float = 0.0) -> Observation:
    return Observation(0.1 * row, plan.shapes[row] + shift, plan.poses[row])


def test_prediction_is_differentiated_exactly() -> None:
    predictor = compile_predictor(RigidBlend(), 3, 13)
    rng = np.random.default_rng(0)
    actions = rng.normal(size=(3, 2, 3)) * 0.01
    shapes, by_actions = predictor.linearized(PLAN.shapes[0], PLAN.poses[0], actions)
    np.testing.assert_allclose(shapes, predictor.shapes(PLAN.shapes[0], PLAN.poses[0], actions), atol=1e-7)
    for k in range(actions.size):
        nudge = np.zeros(actions.size)
        nudge[k] = 2e-2
        nudge = nudge.reshape(actions.shape)
        both = [predictor.shapes(PLAN.shapes[0], PLAN.poses[0], actions + sign * nudge) for sign in (1, -1)]
        np.testing.assert_allclose(by_actions[..., k], (both[0] - both[1]) / 4e-2, atol=2e-4)


def test_at_rest_on_the_reference_nothing_moves(started: Shared) -> None:
    controller, state = started(STILL)
    for _ in range(3):
        action, state = controller.step(state, at(0))
        np.testing.assert_allclose(action, 0.0, atol=1e-6)
    assert state.status == Status.TRACKING


def test_on_the_plan_the_plans_own_motion_is_sent(started: Shared) -> None:
    controller, state = started()
    for row in range(10):
        action, state = controller.step(state, at(row))
        planned = PLAN.poses[row + 1] - PLAN.poses[row]
        assert np.linalg.norm(action - planned) < 0.3 * np.linalg.norm(planned)


def test_without_feedforward_standing_still_is_preferred(started: Shared) -> None:
    sent = {}
    for feedforward in (True, False):
        controller, state = started(feedforward=feedforward, control_weight=1e7, pose_weight=0.0)
        sent[feedforward] = controller.step(state, at(0))[0]
    planned = PLAN.poses[1] - PLAN.poses[0]
    np.testing.assert_allclose(sent[True], planned, atol=0.02 * np.abs(planned).max())
    np.testing.assert_allclose(sent[False], 0.0, atol=0.02 * np.abs(planned).max())


def test_an_offset_is_led_back(started: Shared) -> None:
    """Everything 5 mm too far right: both grippers go left."""
    controller, state = started(STILL)
    shifted = replace(at(0), keypoints=PLAN.shapes[0] + [0.005, 0.0], poses=PLAN.poses[0] + [0.005, 0.0, 0.0])
    action, _ = controller.step(state, shifted)
    assert (action[:, 0] < -2e-4).all()


def test_the_cable_is_estimated_and_the_estimate_survives_a_new_plan(started: Shared) -> None:
    """A cable 1.5% longer than the task has it; the paper's controller estimates nothing."""
    longer = straight_plan(PlanarRod(0.3045))
    for settings, estimates in (({}, True), ({"estimator": EstimatorConfig.nominal()}, False)):
        controller, state = started(longer, replace(task_for(longer), cable=TASK.cable), **settings)
        for row in range(len(longer.shapes)):
            _, state = controller.step(state, at(row, longer))
        assert bool(state.estimates()) is estimates
        resumed = controller.resume(state, state.task, longer)
        for cable in (state.estimated_cable(), resumed.estimated_cable()):
            assert (cable is not None) is estimates
            if cable is not None:
                assert 0.3025 < cable.length < 0.3065


def test_a_contact_is_noticed(started: Shared) -> None:
    """From row 12 on the middle of the cable is pushed out by 4 mm a row, which no parameter explains."""
    controller, state = started()
    bulge = outward(PLAN.shapes[0]) * np.exp(-(((np.arange(13) - 6) / 2.0) ** 2))[:, None]
    for row in range(40):
        _, state = controller.step(state, at(row, shift=0.004 * max(row - 12, 0) * bulge))
        if state.contact() is not None:
            break
    assert (contact := state.contact()) is not None
    assert contact.direction @ outward(PLAN.shapes[0]) > 0.5


def test_the_offset_learns_what_the_model_gets_wrong(started: Shared) -> None:
    """A cable that drifts by 0.4 mm a step although nothing moves: the offset goes to that drift."""
    controller, state = started(STILL)
    drift = np.zeros((13, 2))
    drift[6, 1] = 0.0004
    for row in range(25):
        _, state = controller.step(state, at(0, shift=row * drift))
    np.testing.assert_allclose(state.offset, drift, atol=0.01 * 0.0004)


def test_a_hidden_keypoint_is_where_the_model_expects_it(started: Shared) -> None:
    """On a moving cable the action hardly changes when three keypoints are hidden."""
    sent = []
    for hidden in (slice(0), slice(5, 8)):
        controller, state = started()
        for row in range(6):
            observation = at(row)
            if row == 5:
                observation.keypoints[hidden] = np.nan
            action, state = controller.step(state, replace(observation, keypoints=observation.keypoints.copy()))
            assert state.status == Status.TRACKING
        sent.append(action)
    np.testing.assert_allclose(sent[1], sent[0], atol=0.1 * np.abs(sent[0]).max())


def test_a_late_frame_is_predicted_forward_by_the_motion_since(started: Shared) -> None:
    """Keypoints 0.2 s late: after some steps about the same is sent as with those of the moment."""
    controller, state = started()
    for row in range(15):
        late = replace(at(row), keypoints=PLAN.shapes[max(row - 2, 0)])
        action, state = controller.step(state, late)
    assert state.tracker.poses.delay == pytest.approx(2.0, abs=0.26)
    planned = PLAN.poses[15] - PLAN.poses[14]
    assert np.linalg.norm(action - planned) < 0.3 * np.linalg.norm(planned)


@pytest.mark.parametrize("settings", [{}, {"profile": "barrier", "obstacle_weight": 0.01, "pieces": 1}])
def test_obstacles_push_away(started: Shared, settings: dict[str, object]) -> None:
    """A disc 1 mm from the middle of a resting cable: the next prediction is farther from it."""
    line = PLAN.shapes[0]
    normal = outward(line)
    centre = line[6] + normal * (TASK.cable.radius + 0.001 + 0.02)
    blocked = task_for(PLAN, (Disc(center=(centre[0], centre[1]), radius=0.02),))
    controller, state = started(STILL, blocked, **settings)
    _, after = controller.step(state, at(0))
    predicted = state.problem.predictor.shapes(line, PLAN.poses[0], after.actions)[0]
    clearances = [convex.signed_distance(shape[6], blocked.scene.world)[0] for shape in (line, predicted)]
    assert clearances[1] > clearances[0] + 1e-4


def test_the_cable_is_not_overstretched(started: Shared) -> None:
    """A reference that asks for grippers 0.36 m apart leads a 0.3 m cable to its limit, not beyond."""
    far = PLAN.poses[[0] * 51].copy()
    direction = far[0, 1, :2] - far[0, 0, :2]
    far[:, 1, :2] = far[:, 0, :2] + 0.36 * direction / np.linalg.norm(direction)
    line = np.linspace(far[0, 0, :2], far[0, 1, :2], 13)
    controller, state = started(replace(STILL, poses=far, shapes=np.repeat(line[None], 51, 0)))
    poses, distance = PLAN.poses[0].copy(), 0.0
    shape = PLAN.shapes[0]
    for _ in range(40):
        action, state = controller.step(state, Observation(0.0, shape, poses))
        poses = poses + action
        shape = np.linspace(poses[0, :2], poses[1, :2], 13)
        distance = max(distance, float(np.linalg.norm(poses[1, :2] - poses[0, :2])))
    assert 0.98 * 0.3 < distance <= 0.995 * 0.3 + 1e-9


def test_the_cost_never_rises_from_the_warm_start(started: Shared) -> None:
    controller, state = started()
    rng = np.random.default_rng(3)
    for row in range(12):
        _, state = controller.step(state, at(row, shift=rng.normal(size=(13, 2)) * 1e-3))
        assert state.solution is not None
        assert state.solution.cost <= state.solution.start_cost
        assert state.solution.iterations <= controller.config.iterations


def test_the_paper_is_a_configuration() -> None:
    config = MPCConfig.paper()
    assert (config.horizon, config.iterations, config.threshold) == (5, 15, 0.005)
    assert (config.tracking_weight, config.obstacle_weight, config.control_weight) == (150.0, 0.01, 1.0)
    assert not config.feedforward
    assert config.profile == "barrier"
    assert config.offset_gain == config.pose_weight == config.span_weight == 0.0


class Broken(DeformationModel):
    """A model whose weights have gone."""

    def __call__(self, keypoints: jnp.ndarray, poses: jnp.ndarray, action: jnp.ndarray) -> jnp.ndarray:
        return jnp.full_like(keypoints, jnp.nan)


def test_a_broken_model_is_reported_and_not_followed() -> None:
    controller = NeuralMPC(Broken(), MPCConfig(hold=0.0))
    action, state = controller.step(controller.init(TASK, PLAN), at(0))
    assert state.status == Status.FAILED
    np.testing.assert_allclose(action, PLAN.poses[1] - PLAN.poses[0], atol=1e-9)


def test_whole_turns_of_the_plans_angles_do_not_matter(started: Shared) -> None:
    turned = PLAN.poses + np.array([0.0, 0.0, 2 * np.pi])
    sent = []
    for plan in (PLAN, replace(PLAN, poses=turned)):
        controller, state = started(plan)
        sent.append(controller.step(state, at(0, shift=1e-3))[0])
    np.testing.assert_allclose(sent[0], sent[1], atol=1e-9)


def test_step_does_not_compile(started: Shared) -> None:
    class Counting(RigidBlend):
        calls: list[int] = eqx.field(static=True)

        def __call__(self, keypoints: jnp.ndarray, poses: jnp.ndarray, action: jnp.ndarray) -> jnp.ndarray:
            self.calls.append(1)
            return super().__call__(keypoints, poses, action)

    calls: list[int] = []
    controller = NeuralMPC(Counting(calls), MPCConfig(hold=0.0))
    state = controller.init(TASK, PLAN)
    traced = len(calls)
    assert traced > 0
    for row in range(3):
        _, state = controller.step(state, at(row))
    assert len(calls) == traced


def test_the_reference_may_wait_for_the_cable(started: Shared) -> None:
    """Where the error is larger than asked for it stands still, but not longer than patience lasts."""
    controller, state = started(waits_above=0.004, patience=3)
    indices = []
    for _ in range(8):
        _, state = controller.step(state, at(0, shift=np.array([0.02, 0.0])))  # 2 cm off: 0.02 sqrt(13) / 13 = 5.5 mm
        indices.append(state.index)
    assert indices == [0, 0, 0, 1, 1, 1, 1, 2]
    _, state = controller.step(state, at(2))
    assert state.index == 3
