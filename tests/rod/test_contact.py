"""Where something holds a cable that lies still, against the simulator, which shares no code with it."""

from __future__ import annotations

import numpy as np
import pytest

from cableway.geometry import polyline
from cableway.records import Measurement
from cableway.rod.contact import contacts_on
from cableway.scene.cable import Cable
from cableway.scene.obstacles import Disc
from cableway.scene.scene import Scene
from cableway.scene.task import Task
from cableway.simulation.plant import CableSimulator

CABLE = Cable()
RADIUS = 0.006
PLACES = [0.3, 0.5, 0.75]
"""Shares of the cable's length."""


def led_over_a_peg(share: float, way: float = 0.03, cable: Cable = CABLE) -> tuple[Measurement, np.ndarray]:
    """A bent cable at rest after both grippers moved by some `way` [m] across a peg, and the peg's middle [m]."""
    q = np.array([0.35, 0.3, 0.0, -10.0, 0.0, -1.5])
    stations = cable.rod.shapes(q[None])[0][0]
    touch = polyline.point_at(stations, np.array([share * cable.length]))[0]
    middle = touch + [0.0, RADIUS + cable.radius + 0.002]
    shape = cable.rod.at_keypoints(stations[None])[0]
    peg = Disc(center=(float(middle[0]), float(middle[1])), radius=RADIUS)
    plant = CableSimulator(Task(name="peg", scene=Scene(obstacles=(peg,)), cable=cable, start=shape, goal=shape))
    for step in (*np.full(10, way / 10), *np.zeros(10)):
        plant.step(np.tile([0.0, step, 0.0], (2, 1)))
    return plant.measure(), middle


def off(contact: tuple[np.ndarray, np.ndarray], middle: np.ndarray) -> float:
    """Distance [m] of where a contact has the middle of the peg from where it is."""
    place, direction = contact
    return float(np.linalg.norm(place - (RADIUS + CABLE.radius) * direction - middle))


@pytest.mark.parametrize("share", PLACES)
def test_the_contact_is_found_where_it_is(share: float) -> None:
    """To half the distance of two keypoints, with the noise of some frames; its force points away from the peg."""
    truth, middle = led_over_a_peg(share)
    noise = np.random.default_rng(0).normal(0.0, 0.0005, truth.keypoints.shape)
    places = contacts_on(CABLE.rod, truth.keypoints + noise, truth.poses)
    assert off(places[0], middle) < CABLE.length / 12 / 2


@pytest.mark.parametrize(("share", "way"), [(0.125, 0.03), (0.2, 0.06), (0.375, 0.05), (0.625, 0.05)])
def test_a_contact_that_presses_hard_is_found_between_keypoints_too(share: float, way: float) -> None:
    """The shape is far from any that the rod has without it, and from the one of a contact at the next keypoint."""
    truth, middle = led_over_a_peg(share, way)
    noise = np.random.default_rng(0).normal(0.0, 0.0005, truth.keypoints.shape)
    places = contacts_on(CABLE.rod, truth.keypoints + noise, truth.poses)
    assert max(off(place, middle) for place in places) < 0.008


def test_a_cable_that_nothing_touches_is_not_held() -> None:
    truth, _ = led_over_a_peg(0.5, way=0.0)
    assert contacts_on(CABLE.rod, truth.keypoints, truth.poses) == []


@pytest.mark.parametrize("apart", [0.0, 0.005, -0.003])
def test_a_straight_cable_is_not_held(apart: float) -> None:
    """Exactly straight, as far apart as it is long, or pulled or pressed a little more than measured."""
    line = np.column_stack([np.linspace(0.2, 0.5, 13), np.full(13, 0.1)])
    poses = np.array([[0.2 - apart, 0.1, 0.0], [0.5 + apart, 0.1, 0.0]])
    assert contacts_on(CABLE.rod, line, poses) == []


def test_a_cable_that_is_exactly_its_rod_is_not_held() -> None:
    """What its residuals are of is rounding."""
    stations, poses = CABLE.rod.shapes(np.array([[0.35, 0.3, 0.0, -10.0, 0.0, -1.5]]))
    assert contacts_on(CABLE.rod, CABLE.rod.at_keypoints(stations)[0], poses[0]) == []


@pytest.mark.parametrize("keypoints", [13, 25])
def test_a_contact_whose_place_is_not_known_may_be_at_several(keypoints: int) -> None:
    """A cable that is hardly bent is explained by contacts far apart, however many keypoints it has."""
    cable = Cable(keypoints=keypoints)
    truth, middle = led_over_a_peg(0.3, way=0.005, cable=cable)
    places = contacts_on(cable.rod, truth.keypoints, truth.poses)
    assert len(places) > 2
    assert min(off(place, middle) for place in places) < CABLE.length / 12 / 2


def test_a_contact_beside_a_gripper_is_found() -> None:
    truth, middle = led_over_a_peg(1 / 12)
    noise = np.random.default_rng(0).normal(0.0, 0.0005, truth.keypoints.shape)
    assert off(contacts_on(CABLE.rod, truth.keypoints + noise, truth.poses)[0], middle) < CABLE.length / 12 / 2


def test_a_contact_that_explains_little_more_than_none_is_none() -> None:
    """Noise of 1.5 mm is fitted best by a contact 33 mm from the peg, which is hardly touched."""
    truth, _ = led_over_a_peg(0.15, way=0.008)
    noise = np.random.default_rng(1).normal(0.0, 0.0015, truth.keypoints.shape)
    assert contacts_on(CABLE.rod, truth.keypoints + noise, truth.poses) == []


def test_one_contact_does_not_explain_a_shape_that_no_cable_has() -> None:
    truth, _ = led_over_a_peg(0.5)
    zigzag = 0.01 * np.where(np.arange(13) % 2, 1.0, -1.0)[:, None]
    assert contacts_on(CABLE.rod, truth.keypoints + zigzag, truth.poses) == []
