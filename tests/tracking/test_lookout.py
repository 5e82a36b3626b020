"""Laws of the lookout: what appears on the table is known when it was seen twice, and stays where it is hidden."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from quasi_static import GOAL, START, QuasiStaticPlant, straight_plan, task_for

from cableway.perception.survey import Survey
from cableway.rendering.depth_sensor import DepthSensor
from cableway.scene.cable import Cable
from cableway.scene.obstacles import Disc, Polygon
from cableway.scene.scene import Scene
from cableway.tracking.eyes import EyesConfig, SeenPlant
from cableway.tracking.lookout import EVERY, LATE, NEAR, Lookout

TASK = task_for(straight_plan(Cable().rod, START, START + 0.25 * (GOAL - START), 12))

KNOWN = Scene((0.7, 0.7), (Disc(center=(0.2, 0.2), radius=0.05),))


def square(x: float, y: float, half: float = 0.02) -> Polygon:
    return Polygon(vertices=np.array([x, y]) + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]), height=0.05)


def seen(*obstacles: Polygon, hidden: tuple[Polygon, ...] = ()) -> Survey:
    return Survey(obstacles, hidden, 1.0, 0, 0.012, (0.0,))


def after(*surveys: Survey) -> tuple[Polygon, ...]:
    """What stands there after surveys."""
    lookout = Lookout(KNOWN)
    for each in surveys:
        lookout.note(each)
    return lookout.appeared


def at(*obstacles: Polygon) -> list[list[float]]:
    """Their middles [m]."""
    return [each.vertices.mean(axis=0).round(4).tolist() for each in obstacles]


THERE = seen(square(0.5, 0.5))
GONE = seen()


def test_what_was_seen_twice_stands_there():
    assert after(THERE) == ()
    assert len(after(THERE, THERE)) == 1
    assert after(THERE, GONE, THERE) == ()
    assert after(THERE, seen(square(0.3, 0.6))) == ()


def test_what_is_known_and_what_is_about_it_is_not_new():
    around = seen(square(0.2, 0.2, 0.05 - 0.001))
    assert after(around, around) == ()
    beside = seen(square(0.2, 0.2 + 0.05 + NEAR + 0.02))
    assert len(after(beside, beside)) == 1


def test_it_stays_until_it_was_seen_to_be_gone_twice():
    assert len(after(THERE, THERE, GONE)) == 1
    assert after(THERE, THERE, GONE, GONE) == ()
    assert len(after(THERE, THERE, GONE, THERE, GONE)) == 1
    unsure = seen(hidden=(square(0.51, 0.5),))
    assert len(after(THERE, THERE, *[unsure] * 5)) == 1, "what no camera sees has not gone"


def test_it_moves_at_once_and_does_not_jitter():
    moved = seen(square(0.53, 0.5))
    assert at(*after(THERE, THERE, moved)) == [[0.53, 0.5]]
    assert at(*after(THERE, THERE, seen(square(0.503, 0.5)))) == [[0.5, 0.5]]


def test_surveys_come_at_their_rate_and_are_known_later():
    lookout = Lookout(KNOWN)
    assert lookout.is_due(0.0)
    lookout.look(0.0, [])  # no view: too little of the table is seen
    assert (lookout.surveys, lookout.failures) == (1, 1)
    assert not lookout.is_due(EVERY / 2)
    assert lookout.is_due(EVERY)
    lookout._coming.extend([(LATE, THERE), (EVERY + LATE, THERE)])
    assert not lookout.learn(LATE)
    assert lookout.scene is KNOWN
    assert lookout.learn(EVERY + LATE)
    assert at(*lookout.appeared) == [[0.5, 0.5]]
    assert lookout.scene.obstacles == (*KNOWN.obstacles, *lookout.appeared)


@pytest.mark.parametrize("half", [0.004, 0.015])
def test_less_than_half_of_what_counts_as_near_is_nothing(half: float):
    small = seen(square(0.5, 0.5, half))
    assert len(after(small, small)) == (half > NEAR / 4)


def test_depth_cameras_tell_a_loop_what_appears(monkeypatch: pytest.MonkeyPatch):
    """A post that nobody told of, in the pictures of a camera above, is in the task that the loop looks at."""
    monkeypatch.setattr("cableway.tracking.photographer.PICTURE", (320, 240))
    monkeypatch.setattr("cableway.tracking.photographer.DepthSensor", lambda: DepthSensor(subpixel=0.03))
    post = Disc(center=(0.2, 0.55), radius=0.02, height=0.06)
    actual = replace(TASK.scene, obstacles=(*TASK.scene.obstacles, post))
    config = EyesConfig(cameras=("above",), frame_rate=1.0, noise=0.0, blur=0.0, depth=True)
    plant = SeenPlant(QuasiStaticPlant(TASK, START, Cable().rod), config, None, TASK, actual)
    plant.reset()
    known = [len(plant.task.scene.obstacles)]
    for _ in range(10):
        plant.step(np.zeros((2, 3)))
        known.append(len(plant.task.scene.obstacles))
    before = len(TASK.scene.obstacles)
    assert known == [before] * 10 + [before + 1], "seen at 0 and 0.5 s, understood half a second later"
    found = plant.task.scene.signed_distance(np.array([post.center]))
    assert found[0] < -0.015
    assert len(plant.record()["appeared"]) == 1
