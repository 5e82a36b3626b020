"""A robot or a camera that is set up wrongly is not moved, and the sentence names the mistake."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from quasi_static import START, QuasiStaticPlant, straight_plan, task_for

from cableway.control.open_loop import OpenLoop
from cableway.core.errors import InputError
from cableway.outcome import Outcome
from cableway.records import Observation
from cableway.rod.planar import PlanarRod
from cableway.tracking import track
from cableway.tracking.setup import disagreement, setup_mistake

ROD = PlanarRod(0.3)
PLAN = straight_plan(ROD)
TASK = task_for(PLAN)
DOWN = np.array([1.0, -1.0])

Mistake = Callable[[Observation], Observation]
MISTAKES: dict[str, Mistake] = {
    "keypoints look like millimetres": lambda frame: replace(frame, keypoints=1000 * frame.keypoints),
    "keypoints look like centimetres": lambda frame: replace(frame, keypoints=100 * frame.keypoints),
    "keypoints come in the opposite order": lambda frame: replace(frame, keypoints=frame.keypoints[::-1].copy()),
    "keypoints look as if y pointed downwards": lambda at: replace(at, keypoints=[0, 0.7] + DOWN * at.keypoints),
    "keypoints look as if x and y were exchanged": lambda at: replace(at, keypoints=at.keypoints[:, ::-1].copy()),
    "positions look like millimetres": lambda frame: replace(frame, poses=frame.poses * [1e3, 1e3, 1]),
    "positions come in the opposite order": lambda frame: replace(frame, poses=frame.poses[::-1].copy()),
    "look like degrees, not radians": lambda frame: replace(frame, poses=frame.poses * [1, 1, 180 / np.pi]),
}  # fmt: skip


class Wrong(QuasiStaticPlant):
    """A plant that reports with a mistake, and counts what it is asked to do."""

    def __init__(self, mistake: Mistake) -> None:
        super().__init__(TASK, START, ROD)
        self.mistake, self.asked = mistake, 0

    def reset(self) -> Observation:
        return self.mistake(super().reset())

    def step(self, action: np.ndarray) -> Observation:
        self.asked += 1
        return self.mistake(super().step(action))


@pytest.mark.parametrize("name", MISTAKES)
def test_nothing_moves_and_the_mistake_is_named(name: str) -> None:
    plant = Wrong(MISTAKES[name])
    rollout = track(plant, OpenLoop(), PLAN)
    assert rollout.outcome is Outcome.WRONG_SETUP
    assert name in rollout.detail
    assert plant.asked == 0


def test_another_number_of_keypoints_is_refused() -> None:
    with pytest.raises(InputError, match=r"keypoints of shape \(7, 2\), not \(13, 2\)"):
        track(Wrong(lambda frame: replace(frame, keypoints=frame.keypoints[::2])), OpenLoop(), PLAN)
    with pytest.raises(InputError, match=r"gripper poses of shape \(1, 3\)"):
        track(Wrong(lambda frame: replace(frame, poses=frame.poses[:1])), OpenLoop(), PLAN)


def test_a_cable_elsewhere_or_unseen_is_no_mistake() -> None:
    rng = np.random.default_rng(0)
    for _ in range(100):
        moved = START + rng.normal(0.0, 1.0, 6) * [0.05, 0.05, 0.4, 1.0, 1.0, 0.3]
        stations, poses = ROD.shapes(moved[None])
        frame = Observation(0.0, ROD.at_keypoints(stations)[0], poses[0])
        assert setup_mistake(frame, PLAN, TASK) == ""
    nothing = Observation(0.0, np.full((13, 2), np.nan), np.full((2, 3), np.nan))
    assert setup_mistake(nothing, PLAN, TASK) == ""


def test_a_cable_must_end_at_its_grippers() -> None:
    frame = Observation(0.0, PLAN.shapes[0], PLAN.poses[0])
    assert disagreement(PLAN.shapes[0] + 0.01, frame.poses) == ""
    assert (
        disagreement(PLAN.shapes[0] + [0.0, 0.05], frame.poses) == "the camera's cable ends 50 mm from the left gripper"
    )
