"""Laws of markers: each is found where it is, named by the rod and nothing before, and left out where it is hidden."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from seen_cables import ABOVE, CABLE, NOMINAL, POSES, true_cable

from cableway.core.errors import InputError
from cableway.estimation.naming import named
from cableway.perception.calibration import CalibratedCamera
from cableway.perception.markers import MarkerTracker, marks_of
from cableway.perception.placement import camera_at
from cableway.perception.sighting import Sighting
from cableway.perception.views import View
from cableway.rendering.markers import BAND
from cableway.rendering.mesh import Mesh, tube
from cableway.rendering.picture import labels

ROD, LINE = true_cable()
TRUTH = ROD.at_keypoints(LINE[None])[0]
"""Of a cable that is longer than the nominal one and bent otherwise: up to 5 mm from where that is expected."""


def marked(places: np.ndarray = TRUTH[1:-1], camera: CalibratedCamera = ABOVE, curve: np.ndarray = LINE) -> View:
    """Markers about the cable at places [m], as a camera sees them; the cable between them hides nothing."""
    radius, bands = CABLE.radius, []
    keypoints = ROD.at_keypoints(curve[None])[0]
    along = np.gradient(keypoints, axis=0)
    for place in places:
        way = along[np.argmin(np.linalg.norm(keypoints - place, axis=1))]
        line = place + radius * np.array([[-1.0], [0.0], [1.0]]) * way / np.linalg.norm(way)
        bands.append(tube(np.column_stack([line, np.full(3, radius)]), BAND * radius).painted((0.0, 0.6, 0.2), 1))
    bands.append(tube(np.column_stack([curve, np.full(len(curve), radius)]), radius).painted((0.8, 0.3, 0.1), 2))
    mask = labels(Mesh.joined(bands), camera.pinhole) == 1
    return View(camera, mask, np.zeros_like(mask))


def with_cable(shown: View) -> View:
    """The same with the pixels of the cable between its markers told apart from these."""
    line = tube(np.column_stack([LINE, np.full(len(LINE), CABLE.radius)]), CABLE.radius).painted((0.8, 0.3, 0.1), 2)
    return replace(shown, mask=(labels(line, shown.camera.pinhole) == 2) & ~shown.mask, marks=shown.mask)


def followed(shown: View, frames: int = 3) -> Sighting:
    tracker = MarkerTracker(CABLE, 0.1)
    track = tracker.start(POSES, NOMINAL)
    for k in range(frames):
        track, seen = tracker.update(track, [shown], POSES, 0.1 * k)
    return seen


def found_by(seen: Sighting) -> np.ndarray:
    """Where markers are seen [m], NaN where none is."""
    return np.where(seen.marked[:, None], seen.observation.keypoints, np.nan)


def test_markers_are_found_and_named_and_say_where_along_the_cable_a_keypoint_is():
    seen = followed(marked())
    found = seen.observation.keypoints
    assert seen.marked.tolist() == [False, *[True] * 11, False], "hands hold the ends"
    beside = np.linalg.norm(found - seen.keypoints, axis=1) > 1e-6
    np.testing.assert_array_equal(beside, seen.marked, "markers are where they are seen, and not where the rod is")
    assert np.linalg.norm(found - TRUTH, axis=1)[1:-1].max() < 0.0007
    assert np.linalg.norm(seen.keypoints - TRUTH, axis=1).max() < 0.0015, "the rod, the ends included"
    assert seen.known
    assert seen.unexplained == seen.missing == 0.0
    assert seen.observation.confidence is not None
    assert seen.observation.confidence[[0, -1]].max() < seen.observation.confidence[1:-1].min()
    assert seen.observation.confidence[1:-1].min() > 0.9


@pytest.mark.parametrize("side", ["left", "front"])
def test_a_low_camera_sees_a_band_above_the_axis_and_that_is_taken_into_account(side: str):
    """The cable runs towards the camera at the left, which else would see markers 3 mm farther off."""
    shown = marked(camera=camera_at(side, (0.7, 0.7)))
    found = found_by(followed(shown))
    assert np.isfinite(found[:, 0]).sum() > 8
    assert np.nanmax(np.linalg.norm(found - TRUTH, axis=1)) < 0.001
    if side == "left":
        plain = marks_of(shown, CABLE.radius)
        assert np.median(np.linalg.norm(plain[:, None] - TRUTH, axis=2).min(axis=1)) > 0.002


def test_a_cable_is_found_by_its_markers_where_it_lies_farther_from_what_was_expected_than_these_are_apart():
    """Marks that no marker is expected near are points of the cable first, by which the others find their names."""
    rod, line = true_cable((3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    truth = rod.at_keypoints(line[None])[0]
    expected = CABLE.rod.at_keypoints(CABLE.rod.shapes(NOMINAL[None])[0])[0]
    assert np.linalg.norm(truth - expected, axis=1).max() > 0.03
    seen = followed(marked(truth[1:-1], curve=line), frames=2)
    assert seen.marked[1:-1].all()
    assert np.linalg.norm(seen.keypoints - truth, axis=1).max() < 0.003
    assert seen.known


@pytest.mark.parametrize(("moved", "updates"), [(0.001, 11), (0.006, 1)])
def test_a_cable_is_forgotten_where_its_markers_move_by_more_than_friction_moves_them(moved: float, updates: int):
    """Marks are seen to half a millimetre, but a cable that friction holds a millimetre aside is the same cable."""
    tracker = MarkerTracker(CABLE, 0.1)
    track = tracker.start(POSES, NOMINAL)
    aside = moved * np.sin(np.linspace(0.0, np.pi, len(TRUTH)))[:, None] * [0.0, 1.0]
    shown, after = marked(), marked((TRUTH + aside)[1:-1])
    for k in range(10):
        track, _ = tracker.update(track, [shown], POSES, 0.1 * k)
    track, _ = tracker.update(track, [after], POSES, 1.0)
    assert track.estimate.updates == updates


def test_a_hidden_marker_is_left_out_and_the_others_keep_their_names():
    """Whether all of it is hidden, by something known or not, or a part by something known."""
    shown = marked()
    (u, v), _ = ABOVE.project(np.append(TRUTH[5], CABLE.radius))
    hiding = np.zeros_like(shown.mask)
    hiding[round(v) - 1 :, : round(u) + 60] = True
    for each in (marked(np.delete(TRUTH[1:-1], 4, axis=0)), replace(shown, hiding=hiding)):
        found = found_by(followed(each))
        there = np.isfinite(found[:, 0])
        assert not there[5]
        assert 3 < there.sum() < 11
        assert np.linalg.norm(found - TRUTH, axis=1)[there].max() < 0.0007


def test_pixels_between_markers_tell_where_the_cable_is_when_markers_are_hidden():
    """All but three are, and then all of them: what is observed are markers, and the rod is known by its pixels."""
    few, none = TRUTH[[2, 6, 10]], TRUTH[:0]
    alone, both, bare = (followed(shown) for shown in (marked(few), with_cable(marked(few)), with_cable(marked(none))))
    assert np.linalg.norm(both.keypoints - TRUTH, axis=1).max() < 0.001
    assert np.linalg.norm(both.keypoints - TRUTH, axis=1).max() < np.linalg.norm(alone.keypoints - TRUTH, axis=1).max()
    assert both.marked.sum() == 3
    assert not bare.marked.any()
    np.testing.assert_array_equal(bare.observation.keypoints, bare.keypoints)
    assert bare.known
    assert np.linalg.norm(bare.keypoints - TRUTH, axis=1).max() < 0.004


def test_a_view_tells_markers_from_the_cable_of_which_they_are():
    shown = with_cable(marked())
    assert shown.marks is not None
    hiding = np.zeros_like(shown.mask)
    hiding[:, :300] = True
    both = replace(shown, hiding=hiding)
    np.testing.assert_array_equal(both.cable, (shown.mask | shown.marks) & ~hiding)
    np.testing.assert_array_equal(both.markers, shown.marks & ~hiding)
    np.testing.assert_array_equal(replace(both, marks=None).markers, shown.mask & ~hiding)
    with pytest.raises(InputError, match="marks of a view must be 480 x 640 truth values"):
        replace(shown, marks=np.zeros((2, 2), bool))


def test_a_bare_table_between_markers_counts_where_the_pixels_of_the_cable_are_looked_for():
    shown = with_cable(marked())
    bare = followed(replace(shown, mask=np.zeros_like(shown.mask)))
    assert followed(shown).missing == followed(marked()).missing == 0.0
    assert bare.missing > 0.15
    assert not bare.known


def test_marks_of_something_else_are_not_named_and_are_counted():
    stray = np.array([[0.5, 0.5], [0.12, 0.2]])
    seen = followed(marked(np.vstack([TRUTH[1:-1], stray])))
    assert seen.unexplained == pytest.approx(2 / 13)
    assert np.linalg.norm(seen.observation.keypoints - TRUTH, axis=1)[1:-1].max() < 0.0007


def test_without_any_mark_none_is_found_and_a_bare_table_is_not_explained():
    shown = marked()
    bare = followed(replace(shown, mask=np.zeros_like(shown.mask)))
    assert not bare.marked.any()
    assert bare.missing == 1.0
    assert not bare.known
    assert len(marks_of(replace(shown, mask=np.ones_like(shown.mask)), CABLE.radius)) == 0, "too large for a marker"


def test_no_mark_has_two_names():
    expected = np.array([[0.0, 0.0], [0.02, 0.0], [0.04, 0.0]])
    found = named(np.array([[0.01, 0.001]]), expected, np.full(3, 0.015))
    assert np.isfinite(found[:, 0]).sum() == 1
    crossed = named(np.array([[0.022, 0.0], [0.003, 0.0]]), expected, np.full(3, 0.01))
    np.testing.assert_array_equal(crossed[:2], [[0.003, 0.0], [0.022, 0.0]])
