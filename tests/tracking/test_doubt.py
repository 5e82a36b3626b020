"""The grippers stop and look where something unknown may hold the cable, and go back where it had room."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from quasi_static import GOAL, START, QuasiStaticPlant, outward, straight_plan, task_for

from cableway.control.base import Contact
from cableway.control.following import FollowerState
from cableway.control.open_loop import OpenLoop, OpenLoopConfig
from cableway.core.errors import SimulationError
from cableway.outcome import Outcome
from cableway.records import Observation
from cableway.rod.planar import PlanarRod
from cableway.scene.obstacles import Disc
from cableway.scene.scene import Scene
from cableway.scene.task import CONTROL_STEP, Task
from cableway.tracking import recovery
from cableway.tracking.closed_loop import _advance
from cableway.tracking.loop import Loop
from cableway.tracking.recovering import Recovery
from cableway.tracking.recovery import DOUBT, LOOKS, Watch
from cableway.tracking.stopping import TrackConfig
from cableway.tracking.suspicion import SUSPECTED, narrowed
from cableway.tracking.watchdog import Watchdog
from cableway.tracking.way_back import Motion, had_room

ROD = PlanarRod(0.3)
PLAN = straight_plan(ROD, START, START + 0.4 * (GOAL - START), steps=30)
TASK = task_for(PLAN)
PUSH = outward(PLAN.shapes[20])


class Doubting(FollowerState):
    """The state of a controller that takes the cable for held, but is not sure."""

    def contact(self, share: float = 1.0) -> Contact | None:
        return Contact(self.reference[6], PUSH) if share <= DOUBT else None


def doubting(deflection: float) -> Loop:
    """A run whose cable, once it is under way, is seen bent out by some [m] in its middle, as by a peg."""

    class Held(QuasiStaticPlant):
        def _observe(self) -> Observation:
            seen = super()._observe()
            middle = np.clip(6 - np.abs(np.arange(13) - 6), 0, 3)[:, None] / 3
            return replace(seen, keypoints=seen.keypoints + deflection * middle * PUSH)

    loop = Loop(Held(TASK, START, ROD), OpenLoop(OpenLoopConfig(hold=0.0)), PLAN, TrackConfig(), Watchdog())
    for _ in range(20):
        assert loop.step() is None
    loop.state = Doubting(**vars(loop.state))
    return loop


def test_where_nothing_holds_the_cable_the_run_goes_on_after_a_look() -> None:
    loop, watch = (
        doubting(0.0),
        Watch(Recovery(replan=lambda task, left: left, deviation=1.0, beside=1.0), CONTROL_STEP),
    )
    steps = len(loop.log.actions)
    progress = loop.state.progress
    for _ in range(LOOKS + 4):
        assert _advance(loop, watch) is None
    stood = ~np.any(loop.log.actions[steps:], axis=(1, 2))
    assert stood.sum() == LOOKS * 6, "at once and half a second each, three times"
    assert loop.state.progress > progress
    assert not watch.recovered
    assert not loop.suspected


def test_friction_once_seen_ends_the_doubt() -> None:
    loop, watch = doubting(0.0), Watch(Recovery(replan=lambda task, left: left), CONTROL_STEP)
    assert watch.may_be_held(loop)
    watch.friction = 0.005
    assert not watch.may_be_held(loop)


@pytest.mark.parametrize(("left", "steps"), [(True, 15), (False, 20)], ids=["clear", "still there"])
def test_grippers_go_farther_back_while_the_cable_lies_at_the_contact(
    left: bool, steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second and a half at first, then up to as much again: here as far as the run has come."""
    monkeypatch.setattr(recovery, "has_left", lambda *given: left)
    loop, watch = doubting(0.0), Watch(Recovery(replan=lambda task, before: before), CONTROL_STEP)
    begun = len(loop.log.actions)
    assert watch.avoid(loop, Contact(loop.observation.keypoints[6], PUSH)) is None
    moved = np.flatnonzero(np.any(loop.log.actions[begun:], axis=(1, 2)))
    assert len(moved) == steps
    assert moved[-1] - moved[0] <= steps, "with one stop at most"


def seen(keypoints: np.ndarray, row: int) -> Observation:
    return Observation(time=0.0, keypoints=keypoints, poses=PLAN.poses[row])


def way(rows: range) -> list[Motion]:
    return [Motion(PLAN.poses[k + 1] - PLAN.poses[k], PLAN.shapes[k], PLAN.poses[k]) for k in rows]


def test_the_way_back_had_room_where_the_cable_lies_near_it() -> None:
    held = PLAN.shapes[20] + 0.01 * PUSH
    assert had_room(way(range(10, 20)), seen(held, 20), TASK)
    elsewhere = seen(held + 0.06 * PUSH, 20)
    assert not had_room(way(range(10, 20)), elsewhere, TASK)
    fast = way(range(0, 20, 4))
    assert had_room(fast, seen(held, 20), TASK), "it is far from there, as grippers at full speed are"
    assert not had_room(fast, elsewhere, TASK), "it snapped"
    hidden = np.where(np.arange(13)[:, None] == 4, np.nan, held)
    assert not had_room(way(range(10, 20)), seen(hidden, 20), TASK), "nobody knows"


def test_frames_that_miss_keypoints_say_where_the_cable_was_together() -> None:
    gaps = [
        motion._replace(keypoints=np.where(np.arange(13)[:, None] == 3 + k % 3, np.nan, motion.keypoints))
        for k, motion in enumerate(way(range(10, 20)))
    ]
    assert had_room(gaps, seen(PLAN.shapes[20], 20), TASK)


def test_what_appeared_on_the_way_leaves_no_room() -> None:
    place = PLAN.shapes[18, 6]
    behind = Disc(center=(float(place[0]), float(place[1])), radius=0.01)
    blocked: Task = TASK.in_scene(Scene(obstacles=(behind,)))
    assert not had_room(way(range(10, 20)), seen(PLAN.shapes[28], 28), blocked)


def test_a_suspected_disc_is_narrowed_to_where_the_cable_does_not_lie() -> None:
    shape, radius = PLAN.shapes[20], TASK.cable.radius
    for away, left in ((0.05, [0.015]), (0.012, [0.012 - radius - 0.001]), (0.0, [])):
        center = shape[6] + away * PUSH
        disc = Disc(center=(float(center[0]), float(center[1])), radius=0.015)
        assert np.allclose([one.radius for one in narrowed([disc], shape, TASK)], left, atol=5e-4)
    assert min(SUSPECTED) > 0


class Failing(QuasiStaticPlant):
    """A plant that fails once and would go on as if nothing had happened."""

    fails = False

    def step(self, action: np.ndarray) -> Observation:
        if self.fails:
            self.fails = False
            raise SimulationError("it fell off the table")
        return super().step(action)


@pytest.mark.parametrize("doubt", [True, False], ids=["doubt", "off the plan"])
def test_a_plant_that_fails_while_the_grippers_stop_to_look_ends_the_run(doubt: bool) -> None:
    plant = Failing(TASK, START, ROD)
    loop = Loop(plant, OpenLoop(OpenLoopConfig(hold=0.0)), PLAN, TrackConfig(), Watchdog())
    for _ in range(10):
        assert loop.step() is None
    watch, plant.fails = Watch(Recovery(replan=lambda task, left: left), CONTROL_STEP), True
    ending = watch.look(loop) if doubt else watch.avoid(loop, None)
    assert ending is not None
    assert (ending.outcome, ending.detail) == (Outcome.PLANT_FAILED, "it fell off the table")
    assert not watch.recovered
