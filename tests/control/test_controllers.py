"""What holds for every controller, whatever it is shown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
import pytest
from quasi_static import straight_plan, task_for

from cableway.control.base import Controller, Status
from cableway.control.jacobian import JacobianConfig, JacobianFeedback
from cableway.control.open_loop import OpenLoop, OpenLoopConfig
from cableway.control.rod_mpc import RodMPC, RodMPCConfig
from cableway.core.errors import InputError
from cableway.records import Observation
from cableway.rod.planar import PlanarRod
from cableway.tang2025.control.mpc_config import MPCConfig
from cableway.tang2025.control.neural_mpc import NeuralMPC
from cableway.tang2025.models.base import RigidBlend

PLAN = straight_plan(PlanarRod(0.3))
TASK = task_for(PLAN)
MAKERS: dict[str, Callable[[], Controller[Any]]] = {
    "neural": lambda: NeuralMPC(RigidBlend(), MPCConfig(hold=0.0)),
    "paper": lambda: NeuralMPC(RigidBlend(), MPCConfig.paper()),
    "rod": lambda: RodMPC(RodMPCConfig(hold=0.0)),
    "rod jacobian": lambda: JacobianFeedback(JacobianConfig(hold=0.0)),
    "broyden": lambda: JacobianFeedback(replace(JacobianConfig.broyden(), hold=0.0)),
    "open loop": lambda: OpenLoop(OpenLoopConfig(hold=0.0)),
}
FEEDBACK = [name for name in MAKERS if name != "open loop"]
GRIPPERS = TASK.grippers


@pytest.fixture(scope="module")
def started() -> Callable[[str], tuple[Controller[Any], Any]]:
    """Controllers by name with the state they start from, made once."""
    known: dict[str, tuple[Controller[Any], Any]] = {}

    def start(name: str) -> tuple[Controller[Any], Any]:
        if name not in known:
            controller = MAKERS[name]()
            known[name] = controller, controller.init(TASK, PLAN)
        return known[name]

    return start


def at(row: int, shift: np.ndarray | float = 0.0) -> Observation:
    return Observation(0.1 * row, PLAN.shapes[row] + shift, PLAN.poses[row].copy())


def only(keypoint: int, value: float) -> np.ndarray:
    return np.where(np.arange(26).reshape(13, 2) // 2 == keypoint, value, 0.0)


WITHOUT_POSES = {
    "nothing": None,
    "poses missing": Observation(0.0, PLAN.shapes[0], np.full((2, 3), np.nan)),
    "huge": Observation(0.0, np.full((13, 2), 1e300), np.full((2, 3), 1e300)),
    "infinite": Observation(np.inf, np.full((13, 2), np.inf), np.full((2, 3), -np.inf)),
    "empty": Observation(0.0, np.empty((0, 2)), np.empty((0, 3))),
}
WITHOUT_KEYPOINTS = {
    "keypoints missing": Observation(0.0, np.full((13, 2), np.nan), PLAN.poses[0]),
    "cable elsewhere": at(0, shift=0.4),
    "too few": Observation(0.0, PLAN.shapes[0][:7], PLAN.poses[0]),
    "few plausible": at(0, shift=np.where(np.arange(26).reshape(13, 2) > 10, 0.4, 0.0)),
}
PARTLY = {"one missing": at(0, shift=only(4, np.nan)), "one jumped": at(0, shift=only(4, 0.2))}


@pytest.mark.wrong_types
@pytest.mark.parametrize("name", FEEDBACK)
@pytest.mark.parametrize("what", [*WITHOUT_POSES, *WITHOUT_KEYPOINTS])
def test_what_shows_nothing_is_led_through_for_a_while_then_the_grippers_stop(
    started: Callable[[str], Any], name: str, what: str
) -> None:
    controller, state = started(name)
    hostile = {**WITHOUT_POSES, **WITHOUT_KEYPOINTS}[what]
    statuses = []
    for _ in range(12):
        action, state = controller.step(state, hostile)
        statuses.append(state.status)
        if state.status == Status.STOPPED:
            np.testing.assert_array_equal(action, 0.0)
        elif not name.startswith("paper"):
            assert np.linalg.norm(action[:, :2]) < 3 * np.linalg.norm(np.diff(PLAN.poses[:2, :, :2], axis=0)) + 1e-3
    moving = statuses.count(Status.UNSEEN)
    assert 1 <= moving <= 10
    assert statuses == [Status.UNSEEN] * moving + [Status.STOPPED] * (12 - moving)
    waiting = state.progress
    _, state = controller.step(state, hostile)
    assert state.progress == waiting
    action, state = controller.step(state, at(2))
    assert state.status == Status.TRACKING
    assert np.linalg.norm(action) > 0


@pytest.mark.parametrize("name", ["neural", "rod"])
@pytest.mark.parametrize("what", PARTLY)
def test_one_rejected_keypoint_does_not_matter(started: Callable[[str], Any], name: str, what: str) -> None:
    controller, state = started(name)
    _, state = controller.step(state, at(0))
    clean, _ = controller.step(state, at(0))
    action, after = controller.step(state, PARTLY[what])
    assert after.status == Status.TRACKING
    np.testing.assert_allclose(action, clean, atol=0.05 * np.abs(clean).max())


@pytest.mark.parametrize("name", MAKERS)
def test_limits_hold_whatever_is_observed(started: Callable[[str], Any], name: str) -> None:
    controller, state = started(name)
    rng = np.random.default_rng(4)
    hostile = [*WITHOUT_POSES.values(), *WITHOUT_KEYPOINTS.values(), *PARTLY.values()]
    frozen = at(0)
    for row in range(200):
        kind = rng.integers(7)
        if kind == 0:
            observation = hostile[rng.integers(len(hostile))]
        elif kind == 1:
            offset = rng.normal(size=2) * 10.0 ** rng.integers(-3, 3)
            poses = PLAN.poses[row % 51] + [*offset, rng.normal() * 10]
            observation = Observation(0.0, PLAN.shapes[row % 51] + offset, poses)
        elif kind == 2:
            observation = frozen
        elif kind == 3:
            observation = Observation(0.0, PLAN.shapes[row % 51][::-1], PLAN.poses[row % 51][::-1])
        elif kind == 4:
            observation = at(max(row % 51 - rng.integers(20), 0))
        else:
            observation = at(row % 51, shift=rng.normal(size=(13, 2)) * 10.0 ** rng.integers(-4, -1))
        action, state = controller.step(state, observation)
        assert np.isfinite(action).all()
        assert np.linalg.norm(action[:, :2], axis=1).max() <= GRIPPERS.max_step
        assert np.abs(action[:, 2]).max() <= GRIPPERS.max_turn
        assert state.status in set(Status)
        assert np.isfinite(state.reference).all()
        assert 0 <= state.progress <= 1


@pytest.mark.parametrize("name", FEEDBACK)
def test_the_same_observations_give_the_same_actions(started: Callable[[str], Any], name: str) -> None:
    runs = []
    for _ in range(2):
        controller, state = started(name)
        runs.append([])
        for row in range(4):
            action, state = controller.step(state, at(row, shift=1e-3))
            runs[-1].append(action)
    np.testing.assert_array_equal(runs[0], runs[1])


@pytest.mark.parametrize("name", MAKERS)
def test_task_and_plan_must_fit(name: str) -> None:
    with pytest.raises(InputError, match="the plan has 10 keypoints"):
        MAKERS[name]().init(TASK, straight_plan(PlanarRod(0.3, 10)))


@pytest.mark.parametrize("turns", [(1, 1), (1, 0), (0, -1)], ids=str)
@pytest.mark.parametrize("name", FEEDBACK)
def test_whole_turns_of_reported_angles_do_not_matter(
    started: Callable[[str], Any], name: str, turns: tuple[int, int]
) -> None:
    """A robot may report angles in (-pi, pi] while those of the plan run on: either gripper may be a turn off."""
    controller, state = started(name)
    for row in range(3):
        observation = at(row, shift=1e-3)
        turned = replace(observation, poses=observation.poses + 2 * np.pi * np.outer(turns, [0.0, 0.0, 1.0]))
        sent, after = controller.step(state, observation)
        np.testing.assert_allclose(controller.step(state, turned)[0], sent, atol=1e-9)
        state = after


def numbers_in(value: Any) -> int:
    """How many numbers and texts a state holds, in all of its parts."""
    if isinstance(value, np.ndarray):
        return value.size
    if is_dataclass(value):
        return sum(numbers_in(getattr(value, entry.name)) for entry in fields(value))
    if isinstance(value, (list, tuple)):
        return sum(map(numbers_in, value))
    return 1


@pytest.mark.parametrize("name", MAKERS)
def test_a_state_does_not_grow(started: Callable[[str], Any], name: str) -> None:
    controller, state = started(name)
    sizes = set()
    for row in range(40):
        _, state = controller.step(state, at(row, shift=1e-3 * (row % 3)))
        sizes.add(numbers_in(state))
    assert len(sizes) <= 2, "all but what the first step adds"
    assert numbers_in(state) == max(sizes)
