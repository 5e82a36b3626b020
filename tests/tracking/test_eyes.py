"""Laws of a plant seen by cameras: the cable is found, late but dated, and where it is not known nothing moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from quasi_static import GOAL, START, QuasiStaticPlant, straight_plan, task_for

from cableway.control.base import ControllerState
from cableway.control.rod_mpc import RodMPC
from cableway.core.errors import InputError, UnknownNameError
from cableway.outcome import Outcome
from cableway.perception import markers
from cableway.perception.rod_tracker import RodTracker
from cableway.perception.segmentation import CableColor, cable_mask
from cableway.perception.sighting import Sighting
from cableway.records import Observation
from cableway.scene.cable import Cable
from cableway.scene.obstacles import Disc
from cableway.tracking import track
from cableway.tracking.eyes import EyesConfig, SeenPlant
from cableway.tracking.lens import Lens
from cableway.tracking.loop import BLIND
from cableway.tracking.photographer import Photographer, State, camera_of
from cableway.tracking.shutter import Shutter
from cableway.tracking.stopping import StopRule, TrackConfig
from cableway.workflow.run import SolveOptions

STEPS = 12
PLAN = straight_plan(Cable().rod, START, START + 0.25 * (GOAL - START), STEPS)
TASK = task_for(PLAN)


def seen_plant(**config) -> SeenPlant:
    given = {"cameras": ("above",), "frame_rate": 10.0, "latency": 0.1, "noise": 0.0, "blur": 0.0} | config
    return SeenPlant(QuasiStaticPlant(TASK, START, Cable().rod), EyesConfig(**given))


def test_what_is_seen_is_where_the_cable_was_when_the_picture_was_taken():
    plant = seen_plant(frame_rate=20.0, latency=0.13)
    first = plant.reset()
    assert first.taken == 0.0
    truth = [plant.measure().keypoints]
    for k in range(1, 5):
        seen = plant.step(PLAN.poses[k] - PLAN.poses[k - 1])
        truth.append(plant.measure().keypoints)
        if k == 1:  # the second picture is still on its way
            assert np.isnan(seen.keypoints).all()
            assert seen.confidence is None
            continue
        assert seen.taken is not None
        assert seen.confidence is not None
        assert seen.time - 0.18 < seen.taken <= seen.time - 0.13 + 1e-9
        whole, share = divmod(seen.taken / 0.1 + 1e-9, 1.0)
        then = (1 - share) * truth[int(whole)] + share * truth[int(whole) + 1]
        assert np.linalg.norm(seen.keypoints - then, axis=1).max() < 0.002
        assert seen.confidence.min() > 0.5
    assert plant.record()["known"] == 1.0
    assert plant.record()["mean_error"] < 0.001
    assert plant.record()["mean_error"] < plant.record()["p99_error"] < 0.003
    assert not plant.record()["lost"]


@pytest.mark.parametrize("dark", [(0.5, 1.0), (0.5, 100.0)])
def test_a_camera_that_goes_dark_stops_the_grippers(dark):
    """Within 0.3 s of the first picture that shows nothing; they go on when it sees again, and else the run ends."""
    plant = seen_plant(dark=dark)
    rollout = track(plant, RodMPC(), PLAN)
    assert plant.record()["lost"] == (dark[1] > 10)
    since = dark[0] + 0.1  # the latency
    steps = np.abs(np.diff(rollout.poses, axis=0)).max(axis=(1, 2))
    blind = (rollout.times[:-1] >= since + 0.3) & (rollout.times[1:] <= dark[1])
    assert blind.any()
    assert steps[blind].max() == 0.0
    assert steps[rollout.times[1:] <= dark[0]].max() > 0.0
    assert BLIND in rollout.status
    if dark[1] < 10:
        assert rollout.metadata["outcome"] == Outcome.SETTLED.value
        assert np.linalg.norm(rollout.keypoints[-1] - TASK.goal, axis=1).max() < 0.003
    else:
        assert rollout.metadata["outcome"] == Outcome.PLANT_FAILED.value
        assert "has not seen the cable" in rollout.metadata["detail"]


@pytest.mark.parametrize("unsure", [False, True])
def test_a_cable_that_is_not_known_has_not_settled(unsure: bool):
    """Its error has stopped falling where there is none: what counts is whether the cable is known."""
    state = ControllerState(status="", reference=PLAN.shapes[-1], progress=1.0)
    rule = StopRule(TrackConfig(), PLAN, 0.1)
    off = np.linspace(0.01, 0.005, 5)
    near = [Observation(0.1 * k, PLAN.shapes[-1] + far, PLAN.poses[-1]) for k, far in enumerate(off)]
    assert [rule.outcome(state, each) for each in near] == [None] * len(near)
    dark = replace(near[-1], keypoints=np.full_like(PLAN.shapes[-1], np.nan))
    found = [rule.outcome(state, dark, unsure=unsure) for _ in range(60)]
    settled = [each is not None and each.outcome is Outcome.SETTLED for each in found]
    assert any(settled) is not unsure


def all_hidden(self: Photographer, state: State, rng: np.random.Generator) -> list[tuple[np.ndarray, np.ndarray]]:
    """Pictures in which arms are before everything."""
    return [(np.zeros((480, 640, 3), np.uint8), np.ones((480, 640), bool)) for _ in self.cameras]


@pytest.mark.parametrize(("beside", "found"), [(0.02, True), (0.1, True), (0.1, False)])
def test_a_hidden_cable_that_is_not_sure_goes_on_where_it_has_room(
    beside: float, found: bool, monkeypatch: pytest.MonkeyPatch
):
    """And settles nowhere; with something beside it, a distance [m] from its middle, or never seen, it stands still."""
    monkeypatch.setattr(Photographer, "shot", all_hidden)
    start = RodTracker.start
    monkeypatch.setattr(RodTracker, "start", lambda *given: replace(start(*given), found=found))
    middle = PLAN.shapes[0][6]
    post = Disc(center=(float(middle[0]), float(middle[1]) + beside + 0.01), radius=0.01)
    task = TASK.in_scene(replace(TASK.scene, obstacles=(post,)))
    plant = SeenPlant(QuasiStaticPlant(task, START, Cable().rod), EyesConfig(cameras=("above",), frame_rate=10.0))
    rollout = track(plant, RodMPC(), PLAN, config=TrackConfig(overtime=1.5))
    assert rollout.metadata["outcome"] == Outcome.TIMED_OUT.value
    moved = np.abs(np.diff(rollout.poses, axis=0)).max()
    if beside < 0.03 or not found:
        assert (set(rollout.status), moved) == ({BLIND}, 0.0)
        return
    assert BLIND not in rollout.status
    assert np.linalg.norm(rollout.keypoints[-1] - TASK.goal, axis=1).max() < 0.005


@pytest.mark.parametrize(
    ("unsure", "body", "room"), [(6, None, True), (2, None, True), (2, "2f-85", False), (1, None, False)]
)
def test_room_is_asked_for_between_what_is_not_sure_and_the_hands(unsure: int, body: str | None, room: bool):
    """Keypoints are 25 mm apart, and 12 mm of deviation ask for 36 mm; the fingers of a 2F-85 reach 24 mm."""
    open_air = replace(TASK.in_scene(replace(TASK.scene, obstacles=())), grippers=replace(TASK.grippers, body=body))
    plant = SeenPlant(QuasiStaticPlant(open_air, START, Cable().rod), EyesConfig(cameras=("above",)))
    covariance = np.tile(1e-6 * np.eye(2), (13, 1, 1))
    covariance[unsure] = 0.012**2 * np.eye(2)
    observation, unmarked = Observation(0.0, PLAN.shapes[0], PLAN.poses[0]), np.zeros(13, bool)
    shares = dict(unexplained=0.0, missing=0.0, hidden=1.0, residual=0.0)
    seen = Sighting(
        observation, PLAN.shapes[0], covariance, unmarked, **shares, explained=True, possible=True, known=False
    )
    assert plant._has_room(seen, PLAN.poses[0]) is room
    assert not plant._has_room(replace(seen, possible=False), PLAN.poses[0])


def shot(**config) -> tuple[np.ndarray, np.ndarray]:
    """The picture of a camera above after 3 s, and what is known to hide the cable."""
    given = {"cameras": ("above",), "noise": 0.0, "seed": 1} | config
    state = State(3.0, PLAN.shapes[0], PLAN.poses[0], None)
    return Photographer(TASK, None, EyesConfig(**given)).shot(state, np.random.default_rng(0))[0]


def test_pictures_that_are_lost_never_come_but_the_first_one_does():
    config = EyesConfig(frame_rate=10.0, latency=0.0, drop_rate=0.5)
    for seed in range(20):
        shutter = Shutter(config, 0.1, lambda a, b, share, time: State(time, b.cable, b.poses, None))
        came, rng = [], np.random.default_rng(seed)
        for k in range(100):
            shutter.note(State(0.1 * k, np.zeros((2, 2)), np.zeros((2, 3)), None))
            came += [state.time for state in shutter.taken(0.1 * k, rng)]
        assert came[0] == 0.0
        assert 25 < len(came) < 75
        assert len(set(came)) == len(came)


@pytest.mark.parametrize("tracker", ["rod", "markers"])
@pytest.mark.parametrize("lens", [(-0.3, 0.1, 0.001, -0.002, 0.0), (0.25, 0.0, 0.0, 0.0, 0.0)])
def test_through_a_lens_that_distorts_the_cable_is_where_it_is(lens: tuple, tracker: str):
    plant = seen_plant(tracker=tracker, noise=5.0, blur=0.7, latency=0.0, distortion=lens)
    seen = plant.reset()
    assert np.linalg.norm(seen.keypoints - plant.measure().keypoints, axis=1).max() < 0.0015
    assert plant.record()["known"] == 1.0


def test_a_lens_shows_points_where_its_camera_projects_them():
    """A picture whose colours are their own places: red is u, green v."""
    camera = camera_of(EyesConfig(distortion=(-0.4, 0.1, 0.003, 0.002, 0.0)), "front", (0.7, 0.7))
    lens = Lens(camera)
    width, height = lens.pinhole.size
    assert width > 640, "it sees more than without distortion"
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    seen = lens.through(np.stack([u, v], axis=-1).astype(float))
    points = np.array([[x, y, 0.05] for x in (0.1, 0.35, 0.6) for y in (0.1, 0.35, 0.6)])
    there, _ = camera.project(points)
    without, _ = lens.pinhole.project(points)
    assert np.abs(there - (without - (np.array([width, height]) - (640, 480)) / 2)).max() > 1.0, "it distorts"
    for (column, row), wanted in zip(there.round().astype(int), without, strict=True):
        assert np.abs(seen[row, column] - wanted).max() < 1.0
    near = lens.through((u < width // 2).astype(bool))
    assert near.dtype == bool
    assert near[:, 0].all()
    assert not near[:, -1].any()


def test_markers_are_painted_and_found_again():
    plant = seen_plant(tracker="markers", noise=5.0, blur=0.7, latency=0.0)
    for look in (plant.reset, lambda: plant.step(PLAN.poses[1] - PLAN.poses[0])):
        seen = look()
        off = np.linalg.norm(seen.keypoints - plant.measure().keypoints, axis=1)
        assert off.max() < 0.001
        assert seen.confidence is not None
        assert (seen.confidence > 0.95).sum() > 8
    assert plant.record()["known"] == 1.0
    assert plant.record()["mean_error"] < 0.0006


def test_a_cable_whose_markers_are_not_found_is_known_by_its_own_pixels(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(markers, "SMALLEST", np.inf)
    plant = seen_plant(tracker="markers", noise=5.0, blur=0.7, latency=0.0)
    seen = plant.reset()
    assert np.isfinite(seen.keypoints).all()
    assert seen.confidence is not None
    assert seen.confidence.max() < 0.9
    assert plant.record()["known"] == 1.0


def test_tracker_and_controller_have_one_estimate_of_a_cable_without_markers():
    assert seen_plant(tracker="markers").reset().rod is None
    plant, controller = seen_plant(noise=5.0, latency=0.0), RodMPC()
    seen, state = plant.reset(), controller.init(TASK, PLAN)
    for k in range(1, 4):
        assert seen.rod is not None
        _, state = controller.step(state, seen)
        known = state.estimates().values()
        np.testing.assert_array_equal([each.value for each in known], seen.rod.mean)
        np.testing.assert_allclose([each.deviation for each in known], np.sqrt(np.diag(seen.rod.covariance)))
        seen = plant.step(PLAN.poses[k] - PLAN.poses[k - 1])


def test_pictures_show_what_stands_there_known_or_not():
    x, y = TASK.start[6]
    post = Disc(center=(float(x), float(y) - 0.05), radius=0.01, height=0.1)
    there = TASK.in_scene(replace(TASK.scene, obstacles=(*TASK.scene.obstacles, post)))
    hidden = {}
    for name, known, actual in (("free", TASK, None), ("unknown", TASK, there.scene), ("known", there, there.scene)):
        behind = QuasiStaticPlant(known, START, Cable().rod)
        plant = SeenPlant(behind, EyesConfig(cameras=("front",), blur=0.0, noise=0.0), actual=actual)
        plant.reset()
        hidden[name] = plant.record()["hidden"]
    assert hidden["free"] < 0.02
    assert 0.04 < hidden["unknown"] == pytest.approx(hidden["known"], abs=0.02)


def test_what_turns_out_to_stand_there_hides_the_cable_from_then_on():
    """Until then the cable is not where it should be seen."""
    x, y = TASK.start[6]
    post = Disc(center=(float(x), float(y) - 0.06), radius=0.05, height=0.12)
    there = TASK.in_scene(replace(TASK.scene, obstacles=(*TASK.scene.obstacles, post)))
    behind = QuasiStaticPlant(TASK, START, Cable().rod)
    plant = SeenPlant(behind, EyesConfig(cameras=("front",), latency=0.0), actual=there.scene)
    first = plant.reset()
    assert first.confidence is not None
    assert not first.confidence.any()
    behind.task = there
    seen = plant.step(np.zeros((2, 3)))
    assert seen.confidence is not None
    assert seen.confidence.all()


def test_strangers_are_in_the_picture_and_nobody_is_told():
    plain, hiding = shot()
    for stranger in ("cable", "arm"):
        picture, told = shot(strangers=(stranger,))
        assert np.array_equal(told, hiding)
        assert (picture != plain).any(axis=2).sum() > 500
    color = CableColor(color=(217, 89, 13))
    masks = [cable_mask(each, color).sum() for each in (plain, shot(strangers=("cable",))[0])]
    assert masks[1] > 1.5 * masks[0]


def test_pictures_are_as_bright_and_of_the_colour_that_is_asked_for():
    plain, hiding = (each.astype(float) for each in shot(blur=0.0))
    assert np.abs(shot(blur=0.0, exposure=0.5)[0] - 0.5 * plain).max() <= 0.5
    assert shot(blur=0.0, exposure=2.0)[0].max() == 255
    changed = (shot(blur=0.0, tint=(0.2, 0.3, 0.9))[0] != plain).any(axis=2)
    assert np.array_equal(changed, cable_mask(plain.astype(np.uint8), CableColor(color=(217, 89, 13))))
    alike = shot(blur=0.0, alike=True)[0]
    changed = (alike != plain).any(axis=2)
    assert changed[hiding.astype(bool)].sum() > 30
    assert cable_mask(alike, CableColor(color=(217, 89, 13)))[changed].all()


def test_cameras_that_cannot_be_are_refused():
    with pytest.raises(UnknownNameError, match="below"):
        EyesConfig(cameras=("above", "below"))
    with pytest.raises(InputError, match="each once"):
        EyesConfig(cameras=("above", "above"))
    with pytest.raises(InputError, match="dark"):
        EyesConfig(dark=(2.0, 1.0))
    with pytest.raises(InputError, match="tint must be three numbers"):
        EyesConfig(tint=(2.0, 1.0, 0.0))
    with pytest.raises(InputError, match="distortion of a camera must be five finite numbers"):
        EyesConfig(distortion=(0.1, np.nan, 0.0, 0.0, 0.0))
    with pytest.raises(UnknownNameError, match="cable"):
        EyesConfig(strangers=("cat",))
    with pytest.raises(InputError, match="another one is given"):
        SolveOptions(plant=lambda task: None, eyes=EyesConfig())
