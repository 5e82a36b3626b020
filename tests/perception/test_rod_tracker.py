"""Laws of the tracker: it finds a cable that is not the nominal one, leaves out what is not cable, and says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from seen_cables import ABOVE, CABLE, NOMINAL, POSES, true_cable

from cableway.estimation import curve_filter
from cableway.estimation.curve_filter import CurveConfig, CurveEstimator
from cableway.estimation.rod_filter import EstimatorConfig
from cableway.perception.calibration import CalibratedCamera
from cableway.perception.rod_tracker import RodTracker
from cableway.perception.sighting import Sighting, TrackerConfig
from cableway.perception.views import View, axis_points
from cableway.rendering.camera import Camera
from cableway.rendering.mesh import tube
from cableway.rendering.picture import Light, render
from cableway.rod.continuation import lead
from cableway.rod.inverse import nearest_equilibrium, shape_between


def view(line: np.ndarray, camera: CalibratedCamera = ABOVE) -> View:
    """A cable as a camera sees it, with nothing before it."""
    radius = CABLE.radius
    mesh = tube(np.column_stack([line, np.full(len(line), radius)]), radius).painted((0.8, 0.3, 0.1), 1)
    mask = render(mesh, camera.pinhole, Light(position=(0.3, 0.3, 2.0), shadows=0)).label == 1
    return View(camera, mask, np.zeros_like(mask))


def followed(shown: View, frames: int = 10, tracker: RodTracker | None = None, poses: np.ndarray = POSES) -> Sighting:
    tracker = tracker or RodTracker(CABLE, 0.1)
    track = tracker.start(POSES, NOMINAL)
    track, seen = tracker.update(track, [shown], poses, 0.0)
    for k in range(1, frames):
        track, seen = tracker.update(track, [shown], poses, 0.1 * k)
    return seen


def beside(offset: np.ndarray) -> np.ndarray:
    """The stations of the nominal cable, moved to its left by distances [m]."""
    line = CABLE.rod.shapes(NOMINAL[None])[0][0]
    along = np.gradient(line, axis=0)
    normals = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    return line + offset[:, None] * normals


def off_line(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Distances [m] of points from a line."""
    fine = np.stack([np.interp(np.linspace(0, len(line) - 1, 5000), np.arange(len(line)), part) for part in line.T], 1)
    return np.linalg.norm(points[:, None] - fine, axis=2).min(axis=1)


def test_points_of_the_axis_lie_on_it():
    """To a tenth of a pixel in the mean, from above and from the side."""
    _, line = true_cable()
    side = Camera.looking(np.array([0.31, -0.4, 0.7]), np.array([0.0, 0.75, -0.7]), size=(640, 480), view=0.6)
    fine = np.stack([np.interp(np.linspace(0, 48, 5000), np.arange(49), part) for part in line.T], axis=1)
    for camera in (ABOVE, CalibratedCamera(pinhole=side)):
        points = axis_points(view(line, camera), CABLE.radius)
        inner = points[np.linalg.norm(points[:, None] - line[[0, -1]], axis=2).min(axis=1) > 0.01]
        away = inner[:, None] - fine
        nearest = np.argmin(np.sum(away**2, axis=2), axis=1)
        along = np.gradient(fine, axis=0)[nearest]
        off = away[np.arange(len(inner)), nearest]
        distance = (along[:, 0] * off[:, 1] - along[:, 1] * off[:, 0]) / np.linalg.norm(along, axis=1)
        assert len(inner) > 100
        assert abs(distance.mean()) < 1.5e-4
        assert np.abs(distance).max() < 2e-3


def test_another_cable_is_found_and_explained():
    rod, line = true_cable()
    seen = followed(view(line))
    error = seen.observation.keypoints - rod.at_keypoints(line[None])[0]
    before = CABLE.rod.at_keypoints(CABLE.rod.shapes(NOMINAL[None])[0])[0] - rod.at_keypoints(line[None])[0]
    assert np.linalg.norm(error, axis=1).mean() < 0.5 * np.linalg.norm(before, axis=1).mean()
    assert seen.explained
    assert seen.missing == 0.0
    assert np.linalg.eigvalsh(seen.covariance).min() > 0


def test_a_bare_table_where_the_rod_claims_to_be_counts_against_it():
    """With nothing in the mask; but not where all is hidden, and then confidence falls."""
    _, line = true_cable()
    shown = view(line)
    empty = followed(replace(shown, mask=np.zeros_like(shown.mask)))
    assert empty.missing == 1.0
    assert not empty.explained
    hidden = followed(replace(shown, mask=np.zeros_like(shown.mask), hiding=np.ones_like(shown.mask)))
    assert hidden.missing == 0.0
    assert hidden.hidden == 1.0
    assert not hidden.explained, "nothing is seen, whatever the reason"
    assert not followed(replace(shown, mask=np.zeros_like(shown.mask), hiding=None)).explained
    sure = followed(shown).observation.confidence
    assert hidden.observation.confidence is not None
    assert sure is not None
    assert (hidden.observation.confidence <= sure + 1e-12).all()
    assert hidden.observation.confidence[6] < 0.5 * sure[6]


def striped(shown: View, row: int) -> View:
    """With a stripe as wide as the cable, below it, more than 291 rows down."""
    mask = shown.mask.copy()
    mask[row : row + 6, 240:400] = True
    return replace(shown, mask=mask)


def test_what_is_known_of_a_cable_is_forgotten_as_grippers_move_not_as_time_goes_by():
    _, line = true_cable()
    shown, tracker = view(line), RodTracker(CABLE, 0.1)
    dark = replace(shown, mask=np.zeros_like(shown.mask), hiding=np.ones_like(shown.mask))
    seen_of: list[Sighting] = []
    for way in (0.0, 0.02):
        track, poses = tracker.start(POSES, NOMINAL), POSES
        for k in range(60):
            poses = poses + [[0.0, way * (-1) ** k, 0.0]] if k >= 10 else poses
            track, seen = tracker.update(track, [dark if k >= 10 else shown], poses, 0.1 * k)
            if k in (9, 59):
                seen_of.append(seen)
    before, stood, _, moved = seen_of
    np.testing.assert_allclose(stood.keypoints, before.keypoints, atol=3e-4)
    sure = [np.sqrt(np.linalg.eigvalsh(seen.covariance)[:, -1]).max() for seen in (before, stood, moved)]
    assert sure[1] < 1.05 * sure[0] < 1.5 * sure[0] < sure[2]
    assert stood.known


def test_what_is_no_cable_is_left_out_and_counted_where_a_hidden_part_of_it_could_be():
    _, line = true_cable()
    shown, hiding = view(line), np.zeros_like(view(line).mask)
    hiding[:296, 260:] = True
    alone = followed(shown)
    for row in (300, 440):
        beside = followed(striped(shown, row))
        assert (beside.unexplained, beside.explained) == (0.0, True), "all of the cable is seen elsewhere"
        np.testing.assert_allclose(beside.observation.keypoints, alone.observation.keypoints, atol=1e-9)
    near, far = (followed(replace(striped(shown, row), hiding=hiding)) for row in (300, 440))
    assert near.hidden > 0.6
    assert near.unexplained > 0.3
    assert not near.explained, "it may be the part of the cable that is not seen"
    assert (far.hidden > 0.6, far.unexplained) == (True, 0.0)
    assert far.explained, "that part is not long enough"
    assert followed(replace(shown, hiding=hiding)).explained


def test_where_some_of_the_rod_is_missing_nothing_is_too_far_away_to_be_the_cable():
    """The rod may be elsewhere than that then."""
    _, line = true_cable()
    shown = view(line)
    gap = shown.mask.copy()
    gap[:, 290:330] = False
    seen = followed(striped(replace(shown, mask=gap), 440), frames=1)
    assert 0.05 < seen.missing < 0.2
    assert seen.unexplained > 0.3


def test_of_a_cable_that_is_partly_hidden_only_what_it_cannot_reach_is_remembered_as_something_else():
    _, line = true_cable()
    shown, tracker, hiding = view(line), RodTracker(CABLE, 0.1), np.zeros_like(view(line).mask)
    hiding[:296, 260:] = True
    near = shown.mask.copy()
    near[300:306, 300:315] = True
    remembered = []
    for each in (replace(shown, mask=near), striped(shown, 440)):
        track, seen = tracker.update(tracker.start(POSES, NOMINAL), [replace(each, hiding=hiding)], POSES, 0.0)
        assert (seen.explained, seen.hidden > 0.3) == (True, True)
        remembered.append(len(track.others))
    assert remembered[0] == 0 < remembered[1]


def test_what_lay_there_while_the_cable_was_seen_is_no_part_of_it_once_that_is_hidden():
    """But what comes then may be; and where nothing lies any more, the next that does is unknown again."""
    _, line = true_cable()
    shown, tracker = view(line), RodTracker(CABLE, 0.1)
    hiding = np.zeros_like(shown.mask)
    hiding[:296, 260:] = True

    def told(*views: View) -> bool:
        track = tracker.start(POSES, NOMINAL)
        for k, each in enumerate(views):
            track, seen = tracker.update(track, [each], POSES, 0.1 * k)
        return seen.explained

    first, other = striped(shown, 300), striped(shown, 316)
    half, half_other = (replace(each, hiding=hiding) for each in (first, other))
    assert told(first, first, half)
    assert not told(half)
    assert not told(first, first, half_other)
    assert not told(first, shown, half)


def test_a_cable_that_is_curved_like_no_rod_at_its_gripper_is_known_where_all_of_it_is_seen():
    """The rod leaves its gripper askew there; where some of the cable is hidden, it may be anywhere."""
    _, line = true_cable()
    turned = POSES + [[0.0, 0.0, 0.6], [0.0, 0.0, 0.0]]
    shown, tracker = view(line), RodTracker(CABLE, 0.1, TrackerConfig(most_askew=2.0))
    assert followed(shown, poses=turned, tracker=tracker).explained
    hand = np.zeros_like(shown.mask)
    hand[:, 300:360] = True
    assert followed(replace(shown, hiding=hand), tracker=tracker).explained
    assert not followed(replace(shown, hiding=hand), poses=turned, tracker=tracker).explained


def test_points_on_the_rod_change_no_parameter():
    estimator = CurveEstimator(CABLE.rod, EstimatorConfig(), CurveConfig(), 0.1)
    start = estimator.start(NOMINAL)
    _, fit = estimator.update_points(start, np.empty((0, 2)), POSES, 0.0)
    assert fit is not None
    on = fit.places(np.linspace(0.5, 23.5, 60))[0]
    after, fit = estimator.update_points(start, on, POSES, 0.0)
    assert fit is not None
    assert np.abs(fit.residuals).max() < 1e-4
    np.testing.assert_allclose(after.theta, start.theta, atol=5e-3)
    assert np.trace(after.covariance) < np.trace(start.covariance)


def test_bands_of_another_width_and_what_is_half_hidden_give_no_points():
    _, line = true_cable()
    shown = view(line)
    bar, hiding = shown.mask.copy(), np.zeros_like(shown.mask)
    bar[400:440, 100:500] = True
    points = axis_points(shown, CABLE.radius)
    np.testing.assert_array_equal(axis_points(replace(shown, mask=bar), CABLE.radius), points)
    for column in range(290, 370):
        hiding[int(np.flatnonzero(shown.mask[:, column]).mean()) + 1 :, column] = True
    halved = replace(shown, mask=shown.mask & ~hiding, hiding=hiding)
    assert off_line(axis_points(halved, CABLE.radius), line).mean() < 3e-4
    unaware = replace(halved, hiding=np.zeros_like(hiding))
    assert off_line(axis_points(unaware, CABLE.radius), line).mean() > 4e-4


def test_what_hides_the_cable_may_be_of_its_colour():
    _, line = true_cable()
    shown = view(line)
    hand = np.zeros_like(shown.mask)
    hand[:, 260:420] = True
    grey = followed(replace(shown, mask=shown.mask & ~hand, hiding=hand))
    orange = followed(replace(shown, mask=shown.mask | hand, hiding=hand))
    assert orange.hidden == grey.hidden > 0.3
    np.testing.assert_array_equal(orange.observation.keypoints, grey.observation.keypoints)


def test_half_of_the_cable_missing_is_not_explained():
    """Though all that is seen is on the rod."""
    _, line = true_cable()
    shown = view(line)
    half = shown.mask.copy()
    half[:, :320] = False
    seen = followed(replace(shown, mask=half))
    assert (seen.unexplained, seen.residual < 5e-4) == (0.0, True)
    assert seen.missing > 0.4
    assert not seen.explained


def test_a_cable_that_is_no_rod_is_not_explained():
    waves = 0.003 * np.sin(16 * np.pi * np.linspace(0, 1, 49))
    shown = view(beside(waves))
    for most, explained in ((0.004, True), (0.001, False)):
        seen = followed(shown, tracker=RodTracker(CABLE, 0.1, TrackerConfig(most_residual=most)))
        assert (seen.unexplained, seen.missing) == (0.0, 0.0)
        assert seen.explained is explained


def test_keypoints_lie_where_the_cable_lies_beside_its_rod():
    """With parameters that are known, so that the field has to explain a bump; it is known to be none at the ends."""
    bump = beside(0.002 * np.exp(-(((np.linspace(0, 1, 49) - 0.5) / 0.1) ** 2)))
    shown, tracker = view(bump), RodTracker(CABLE, 0.1, parameters=EstimatorConfig.nominal())
    seen = followed(shown, tracker=tracker)
    assert np.linalg.norm(seen.observation.keypoints - bump[:: CABLE.rod.stride], axis=1).max() < 4e-4
    dark = replace(shown, mask=np.zeros_like(shown.mask), hiding=np.ones_like(shown.mask))
    deviations = np.sqrt(np.linalg.eigvalsh(followed(dark, tracker=tracker).covariance)[:, -1])
    config = TrackerConfig()
    np.testing.assert_allclose(
        deviations[[0, 6, -1]], [config.pixel, np.hypot(config.pixel, config.beside), config.pixel], rtol=1e-3
    )


@pytest.mark.parametrize("marked", [False, True])
def test_pictures_close_in_time_say_little_more_than_one(marked):
    """The first one counts in full."""
    _, line = true_cable()
    points, blobs = (np.empty((0, 2)), (line[:: CABLE.rod.stride],)) if marked else (line, ())
    surer = []
    for step in (10.0, 0.02):
        estimator = CurveEstimator(CABLE.rod, EstimatorConfig(), CurveConfig(), step)
        estimate, known = estimator.start(NOMINAL), []
        for _ in range(3):
            estimate, _ = estimator.update_points(estimate, points, POSES, 0.0, blobs)
            known.append(np.trace(estimate.covariance))
        surer.append(known)
    far, close = surer
    assert far[0] == pytest.approx(close[0], rel=1e-9)
    assert far[0] - far[2] > 3 * (close[0] - close[2]) > 0


def test_the_first_picture_of_a_cable_that_changed_counts_in_full():
    (_, line), (_, after) = true_cable(), true_cable((-0.6, 0.5, 0.3, 0.0, -1.5, 1.5, 1.0, 0.0))
    traces = []
    for step in (10.0, 1 / 30):
        estimator = CurveEstimator(CABLE.rod, EstimatorConfig(), CurveConfig(), step)
        estimate = estimator.start(NOMINAL)
        for _ in range(100):
            estimate, _ = estimator.update_points(estimate, line, POSES, 0.0)
        estimate, fit = estimator.update_points(estimate, after, POSES, 0.0)
        assert fit is not None
        assert estimate.updates == 1
        assert off_line(fit.stations, after).mean() < 5e-4
        traces.append(np.trace(estimate.covariance))
    assert traces[0] == pytest.approx(traces[1], rel=0.01)


def test_a_cable_that_changed_is_one_that_nothing_is_known_of(monkeypatch):
    """It slipped or was touched: what was sure before is not held against what is seen now."""
    (_, line), (_, after) = true_cable(), true_cable((-0.6, 0.5, 0.3, 0.0, -1.5, 1.5, 1.0, 0.0))
    before, now = (axis_points(view(each), CABLE.radius) for each in (line, after))
    estimator = CurveEstimator(CABLE.rod, EstimatorConfig(), CurveConfig(), 0.1)
    estimate = estimator.start(NOMINAL)
    for _ in range(20):
        estimate, fit = estimator.update_points(estimate, before, POSES, 0.0)
        assert fit is not None
    assert fit.strain < curve_filter.SURPRISING
    errors = []
    for surprising in (curve_filter.SURPRISING, np.inf):
        monkeypatch.setattr(curve_filter, "SURPRISING", surprising)
        _, fit = estimator.update_points(estimate, now, POSES, 0.0)
        assert fit is not None
        errors.append(off_line(fit.stations, after).mean())
    assert errors[0] < 0.6 * errors[1]


def test_a_cable_that_left_its_gripper_is_not_explained():
    """Though a rod lies along all that is seen: it is not held where the gripper is."""
    _, line = true_cable()
    away = POSES + [[0.0, 0.022, 0.0], [0.0, 0.0, 0.0]]
    assert followed(view(line)).explained
    seen = followed(view(line), poses=away)
    assert (seen.missing, seen.unexplained < 0.3) == (0.0, True)
    assert not seen.explained


@pytest.mark.parametrize("reach", [0.26, 0.28])
def test_a_branch_of_shapes_that_ends_is_no_end_of_the_track(reach):
    """The grippers turn until the arch between them is no shape of the rod any more, and it snaps."""
    middle, snapped, rod = np.array([0.31, 0.3]), False, CABLE.rod
    turns = 0.5 - np.linspace(0.0, 1.4, 6)
    poses = [np.array([[*middle - [reach / 2, 0], turn], [*middle + [reach / 2, 0], -turn]]) for turn in turns]
    q = shape_between(rod, poses[0], "left")
    tracker = RodTracker(CABLE, 0.1)
    track = tracker.start(poses[0], q)
    for k, now in enumerate(poses):
        if k:
            led = lead(rod, q, np.stack([poses[k - 1], now]))
            after = nearest_equilibrium(rod, now, rod.at_keypoints(rod.shapes(q[None])[0])[0])
            q, snapped = (led.q[-1], snapped) if led.snap is None else (after, True)
        line = rod.shapes(q[None])[0][0]
        track, seen = tracker.update(track, [view(line)], now, 0.1 * k)
        assert np.linalg.norm(seen.observation.keypoints - line[:: rod.stride], axis=1).max() < 0.002
        assert seen.explained
    assert snapped


def test_a_lost_cable_is_looked_for_anew():
    """By the shapes that it can have between these grippers; here it was taken to bend to the other side."""
    other = shape_between(CABLE.rod, POSES, "right")
    tracker, shown = RodTracker(CABLE, 0.1), view(CABLE.rod.shapes(NOMINAL[None])[0][0])
    track, seen = tracker.update(tracker.start(POSES, other), [shown], POSES, 0.0)
    assert seen.explained
    assert track.looked == 0.0
    line = CABLE.rod.shapes(NOMINAL[None])[0][0]
    assert np.linalg.norm(seen.observation.keypoints - line[:: CABLE.rod.stride], axis=1).max() < 0.002


def test_angles_in_another_turn_are_the_same():
    shown = view(true_cable()[1])
    turned = POSES + [[0.0, 0.0, 2 * np.pi], [0.0, 0.0, 0.0]]
    np.testing.assert_allclose(
        followed(shown, poses=turned).observation.keypoints, followed(shown).observation.keypoints, atol=1e-9
    )


@pytest.mark.parametrize("bend", ["left", "right"])
def test_the_side_to_which_the_cable_bends_is_found(bend):
    line = CABLE.rod.shapes(shape_between(CABLE.rod, POSES, bend)[None])[0][0]
    tracker = RodTracker(CABLE, 0.1)
    shown = view(line)
    _, seen = tracker.update(tracker.found([shown], POSES), [shown], POSES, 0.0)
    assert np.linalg.norm(seen.observation.keypoints - line[:: CABLE.rod.stride], axis=1).max() < 0.002
