"""Laws of surveys: what stands on a table is found by depths where it is, and what nobody saw is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from seen_tables import CABLE, SIZE, seen, standing

from cableway.core.errors import InputError
from cableway.perception.calibration import CalibratedCamera
from cableway.perception.depth import DepthView, raised, relief
from cableway.perception.survey import SurveyConfig, survey
from cableway.rendering.depth_sensor import DepthSensor
from cableway.scene.obstacles import Box, Disc, Obstacle, Polygon, to_shapely
from cableway.scene.scene import Scene

BOX = Box(center=(0.25, 0.35), size=(0.12, 0.05), angle=0.4, height=0.06)
DISC = Disc(center=(0.5, 0.5), radius=0.03, height=0.09)
WEDGE = Polygon(vertices=np.array([[0.45, 0.2], [0.55, 0.2], [0.5, 0.28]]), height=0.03)
THINGS = (BOX, DISC, WEDGE)
SENSOR = DepthSensor(subpixel=0.03, offset=0.15)
"""Pictures of half the size: errors [mm] are those of a D415, less a little, for what a pixel here is wide."""

PIXEL = 0.005
"""[m] of the table in these pictures: 1.7 m from above are 3.5 mm, slanted ones 2.8 by 4.3."""


def paired(found: tuple[Polygon, ...], *true: Obstacle) -> list[tuple[Obstacle, Polygon]]:
    """Each true obstacle with the one found there."""
    assert len(found) == len(true)
    return [(each, next(f for f in found if to_shapely(f).intersects(to_shapely(each)))) for each in true]


def apart(found: Polygon, true: Obstacle) -> float:
    """Hausdorff distance [m]."""
    mine, other = (shapely.segmentize(to_shapely(each).exterior, 0.001) for each in (found, true))
    return float(shapely.hausdorff_distance(mine, other))


@pytest.mark.parametrize("places", [("above",), ("front", "back")])
@pytest.mark.parametrize("sensor", [None, SENSOR])
def test_outlines_and_heights_are_those_of_what_stands_there(places: tuple[str, ...], sensor: DepthSensor | None):
    """With a margin of 5 mm they cover it, but for corners that a pixel rounds off."""
    margin, noise = 0.005, 0.0 if sensor is None else 0.006
    found = survey(seen(standing(*THINGS), *places, sensor=sensor), SIZE, config=SurveyConfig(margin=margin))
    for true, mine in paired(found.obstacles, *THINGS):
        assert apart(mine, true) < margin + PIXEL
        assert shapely.difference(to_shapely(true), to_shapely(mine)).area < 0.02 * to_shapely(true).area
        assert -0.001 < (mine.height or 0) - margin - (true.height or 0) < 0.001 + noise


def test_depths_that_are_all_off_are_mended_at_the_table():
    """By 0.4 pixels of disparity, which at the focal length of these pictures is 25 mm of depth."""
    sensor = DepthSensor(offset=0.4, subpixel=0.02)
    shown = relief(seen(standing(*THINGS), "front", sensor=sensor)[0], SIZE)
    assert abs(shown.off) > 0.01
    bare = shown.points[np.linalg.norm(shown.points[..., :2] - (0.6, 0.1), axis=-1) < 0.05]
    assert abs(np.median(bare[:, 2])) < 0.001


def test_walls_that_meet_leave_the_room_between_them_free():
    corner = (
        Box(center=(0.35, 0.2), size=(0.4, 0.02), height=0.05),
        Box(center=(0.16, 0.36), size=(0.02, 0.34), height=0.05),
    )
    found = survey(seen(standing(*corner), "above"), SIZE)
    covered = shapely.union_all([to_shapely(each) for each in found.obstacles])
    assert not shapely.intersects_xy(covered, 0.35, 0.35)
    assert not shapely.intersects_xy(covered, 0.2, 0.24), "20 mm from both walls"
    assert all(covered.intersection(to_shapely(wall)).area > 0.98 * to_shapely(wall).area for wall in corner)


def test_what_no_camera_sees_may_stand_there():
    """Behind a tall box from the front: 0.1 m at 40 degrees hide 0.12 m; a second camera sees that."""
    tall = Box(center=(0.35, 0.3), size=(0.2, 0.04), height=0.1)
    one, both = (survey(seen(standing(tall), *places), SIZE) for places in (("front",), ("front", "back")))
    shadow = shapely.union_all([to_shapely(each) for each in one.hidden])
    assert shapely.intersects_xy(shadow, 0.35, 0.36)
    assert not shapely.intersects_xy(shadow, 0.35, 0.5)
    assert not both.hidden
    assert one.seen < 0.97 < 0.99 < both.seen
    assert len(one.scene(Scene(SIZE)).obstacles) == 1 + len(one.hidden)
    assert len(one.scene(Scene(SIZE), hidden=False).obstacles) == 1


def test_a_cable_is_no_obstacle_and_a_tall_thing_of_its_colour_is_one():
    view, low = seen(standing(DISC), "above")[0], SurveyConfig(lowest=0.003)
    assert len(survey([view], SIZE, config=low).obstacles) == 1
    orange, blind = (replace(view, cable=np.full_like(view.cable, every)) for every in (True, False))
    assert len(survey([orange], SIZE, config=low).obstacles) == 1
    assert len(survey([blind], SIZE, config=low).obstacles) > 1, "the cable, were its colour not known"


def test_what_is_known_to_be_a_hand_is_neither_table_nor_obstacle():
    hand = Disc(center=(0.25, 0.5), radius=0.03, height=0.1)
    view = seen(standing(DISC, hand), "above")[0]
    at, _ = view.camera.project(np.array([*hand.center, 0.08]))
    rows, columns = np.indices(view.depth.shape)
    covers = np.hypot(columns - at[0], rows - at[1]) < 14
    masked = survey([replace(view, ignored=covers)], SIZE)
    paired(masked.obstacles, DISC)
    assert any(shapely.intersects_xy(to_shapely(each), *hand.center) for each in masked.hidden)
    told = survey([replace(view, ignored=covers)], SIZE, shapely.Point(hand.center).buffer(0.06))
    assert not any(shapely.intersects_xy(to_shapely(each), *hand.center) for each in told.hidden)


def test_specks_do_not_count():
    speck = Box(center=(0.5, 0.3), size=(0.006, 0.006), height=0.03)
    found = survey(seen(standing(DISC, speck), "above"), SIZE)
    paired(found.obstacles, DISC)
    assert found.specks == 1


def test_a_cable_on_the_table_is_told_by_its_height():
    """Where depths are exact; it is 8 mm high."""
    view = seen(standing(DISC), "above")[0]
    mask = raised(relief(view, SIZE), 0.004, 0.012)
    inner, _ = view.camera.project(np.column_stack([CABLE, np.full(20, 0.008)])[2:-2])
    u, v = inner.round().astype(int).T
    assert mask[v, u].mean() > 0.8
    assert mask.sum() < 2 * view.cable.sum()


def off_by(view: DepthView, height: float) -> DepthView:
    """The same with a camera that the calibration has too high [m]."""
    pose = view.camera.pinhole.pose.copy()
    pose[2, 3] += height
    return replace(view, camera=CalibratedCamera(pinhole=replace(view.camera.pinhole, pose=pose)))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda view: off_by(view, 0.06), "mm above where the calibration has it"),
        (lambda view: off_by(view, 0.5), "depths and calibration do not belong together"),
        (lambda view: replace(view, depth=np.zeros_like(view.depth)), "of the table 0 pixels are seen"),
        (lambda view: replace(view, depth=view.depth[:-1]), "depth of a view must be 240 x 320"),
        (lambda view: replace(view, depth=view.depth - 9.0), "depth of a view must be numbers from 0 on"),
    ],
)
def test_depths_that_say_nothing_of_the_table_are_refused(change, said: str):
    with pytest.raises(InputError, match=said):
        survey([change(seen(standing(), "above")[0])], SIZE)
    with pytest.raises(InputError, match="one view"):
        survey([], SIZE)
