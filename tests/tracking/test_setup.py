"""A robot or a camera that is set up wrongly is not moved, and the sentence names the mistake."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from quasi_static import START, QuasiStaticPlant, straight_plan, task_for

from cableway.control.open_loop import OpenLoop
from cableway.control.rod_mpc import RodMPC
from cableway.core.errors import InputError
from cableway.geometry.groups import SE2
from cableway.outcome import Outcome
from cableway.planning.planner import plan
from cableway.records import Observation
from cableway.rod.planar import PlanarRod
from cableway.tracking import Recovery, track
from cableway.tracking.setup import cable_ends, disagreement, setup_mistake

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


def test_a_cable_must_end_at_its_grippers_and_point_as_they_do() -> None:
    """Turned grasps and noise are allowed; keypoints mirrored about the line of the grippers are not."""
    shape, poses = PLAN.shapes[0], PLAN.poses[0]
    noise = np.random.default_rng(0).normal(0.0, 0.002, shape.shape)
    assert disagreement(shape + 0.01 + noise, poses + [0.0, 0.0, np.radians(10)], shape) == ""
    assert disagreement(shape, poses + [[0.0, 0.0, 2 * np.pi], [0.0, 0.0, -4 * np.pi]], shape) == ""
    said = disagreement(shape + [0.0, 0.05], poses, shape)
    assert said == "the camera's cable ends 50.0 mm from where the left gripper is reported"
    said = disagreement(mirrored(shape, poses), poses, shape)
    assert "degrees away from where the right gripper is reported to point" in said
    bent = mirrored(shape, poses) + [0.0, 0.002]
    assert disagreement(bent, poses, mirrored(shape, poses)) == "", "where it should be, whatever its ends look like"
    hidden = shape.copy()
    hidden[[0, -1]] = np.nan
    assert disagreement(hidden, poses, shape) == "", "what is not seen contradicts nothing"


@pytest.mark.parametrize("keypoints", [3, 6, 7, 12, 13, 26, 200])
def test_ends_point_as_the_rod_does_whatever_the_number_of_keypoints(keypoints: int) -> None:
    rod = replace(ROD, keypoints=keypoints)
    stations, poses = rod.shapes(START[None])
    ends = cable_ends(rod.at_keypoints(stations)[0])
    assert np.isnan(ends[:, 2]).all() == (keypoints < 7)
    off = SE2.distance(poses[0], ends)
    assert (np.nan_to_num(off) < 0.25).all()


@pytest.mark.parametrize("since", [0, 20])
@pytest.mark.parametrize("recovery", [None, Recovery(replan=lambda task, left: plan(task, previous=left))])
def test_a_mirrored_cable_ends_the_run_before_anything_is_done_about_it(since: int, recovery: Recovery | None) -> None:
    plant = Wrong(lambda frame: frame)
    plant.mistake = lambda frame: (
        replace(frame, keypoints=mirrored(frame.keypoints, frame.poses)) if plant.asked >= since else frame
    )
    rollout = track(plant, RodMPC(), PLAN, recovery=recovery)
    assert rollout.outcome in (Outcome.PLANT_FAILED, Outcome.WRONG_SETUP)
    assert "gripper is reported to point" in rollout.detail
    assert rollout.metadata["recovered"] == []
    assert since <= rollout.steps <= since + 20


def mirrored(keypoints: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """About the line of the grippers."""
    left, right = poses[:, :2]
    along = (right - left) / np.linalg.norm(right - left)
    return left + 2 * ((keypoints - left) @ along)[:, None] * along - (keypoints - left)
