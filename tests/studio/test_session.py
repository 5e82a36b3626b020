"""Laws of a session: what is led is the cable itself, every edit can be undone, and files hold all there is."""

from __future__ import annotations

import math
from dataclasses import replace
from multiprocessing import Pipe
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from problems import free

from cableway.core.errors import InputError
from cableway.core.provenance import describe
from cableway.geometry import polyline
from cableway.perception.placement import camera_at
from cableway.records import Plan, Rollout
from cableway.scene.files.loading import as_draft, load_task
from cableway.scene.obstacles import Disc
from cableway.simulation.perturbations.reading import read_perturbation
from cableway.studio import ends, replanner
from cableway.studio.obstacles import knobs, middle_of, new_obstacle, placed, pulled, turned, with_obstacle
from cableway.studio.pace import Pace
from cableway.studio.pictures import GREEN, SIZE, Pictures
from cableway.studio.replanner import Answer
from cableway.studio.running import Running, Wanted
from cableway.studio.session import Session
from cableway.studio.watch import Watch
from cableway.tracking import Row
from cableway.tracking.photographer import EyesConfig
from cableway.workflow.events import CANCEL, Event, Finished, Planned, Progress, Stepped
from cableway.workflow.run import Run, SolveOptions
from cableway.workflow.solve import solve


class Recorder:
    """In place of the process that plans: what it is asked for."""

    def __init__(self, on_answer: Any) -> None:
        self.on_answer, self.asked = on_answer, []
        self.options: list[tuple[SolveOptions, float]] = []

    def start(self) -> None:
        pass

    def request(self, task: Any, options: SolveOptions, since: float = 0.0) -> int:
        self.asked.append(task)
        self.options.append((options, since))
        return len(self.asked)

    def cancel(self) -> None:
        self.asked.append(None)

    def close(self) -> None:
        pass


def begun(source: Any = "multi-obstacle-1") -> tuple[Session, Recorder]:
    made: list[Recorder] = []

    def planner(on_answer: Any) -> Recorder:
        made.append(Recorder(on_answer))
        return made[0]

    return Session(source, planner=planner), made[0]


@pytest.fixture(scope="module")
def found() -> Run:
    return solve(free(), SolveOptions(track=False))


@pytest.fixture(scope="module")
def ran(found: Run) -> tuple[Run, list[Event]]:
    heard: list[Event] = []
    return solve(free(), SolveOptions(plan=found.plan, controller="open-loop"), heard.append), heard


def rows_of(heard: list[Event]) -> tuple[Row, ...]:
    return tuple(event.row for event in heard if isinstance(event, Stepped))


def poses_of(session: Session, end: Any) -> np.ndarray:
    q = session.moment.shapes[end]
    assert q is not None
    return session.draft.cable.rod.end_poses(q[None])[0]


def test_the_cable_follows_a_gripper_as_a_stable_equilibrium():
    session, _ = begun()
    for _ in range(8):
        pose = poses_of(session, "goal")[0] + [0.003, 0.002, 0.04]
        session.preview_gripper("goal", 0, pose)
        q = session.moment.shapes["goal"]
        assert q is not None
        np.testing.assert_allclose(poses_of(session, "goal")[0], pose, atol=1e-9)
        assert session.draft.cable.rod.stability(q[None])[0][0] > 0
        assert session.draft.goal is not None
        np.testing.assert_allclose(session.draft.goal[0], pose[:2], atol=1e-9)


def test_large_and_small_steps_of_a_hand_lead_to_the_same_cable():
    rod, q = load_task("multi-obstacle-1").cable.rod, load_task("multi-obstacle-1").start_equilibrium
    to = rod.end_poses(q[None])[0] + [[0.0, 0.0, 0.0], [0.05, -0.06, 0.9]]
    at_once, step_by_step = ends.led(rod, q, to).q, q
    for share in np.linspace(0, 1, 40)[1:]:
        step_by_step = ends.led(rod, step_by_step, (1 - share) * rod.end_poses(q[None])[0] + share * to).q
    np.testing.assert_allclose(*rod.shapes(np.stack([at_once, step_by_step]))[0], atol=1e-7)


def test_a_cable_that_is_turned_too_far_snaps_to_a_stable_one():
    rod, q = load_task("multi-obstacle-1").cable.rod, load_task("multi-obstacle-1").start_equilibrium
    snapped = False
    for _ in range(60):
        q, now = ends.led(rod, q, rod.end_poses(q[None])[0] + [[0.0, 0.0, 0.15], [0.0, 0.0, 0.0]])
        snapped = snapped or now
        assert rod.stability(q[None])[0][0] > 0
    assert snapped


def test_a_gripper_is_led_no_farther_than_the_cable_is_long():
    session, _ = begun()
    session.preview_gripper("start", 1, np.array([5.0, 5.0, 0.9]))
    left, right = poses_of(session, "start")[:, :2]
    assert math.dist(left, right) < session.draft.cable.length


def test_a_cable_is_bent_to_the_other_side_between_the_same_grippers():
    session, _ = begun()
    before, poses = session.draft.goal, poses_of(session, "goal")
    session.bend("goal")
    assert before is not None
    assert session.draft.goal is not None
    assert polyline.signed_area(before) * polyline.signed_area(session.draft.goal) < 0
    np.testing.assert_allclose(np.exp(1j * poses[:, 2]), np.exp(1j * poses_of(session, "goal")[:, 2]), atol=1e-6)


@pytest.mark.parametrize("kind", ["box", "disc", "polygon"])
def test_an_obstacle_is_pulled_by_a_knob_to_the_hand(kind: Any):
    obstacle = turned(new_obstacle(kind, free().scene), 0.4)
    for k, at in enumerate(knobs(obstacle)):
        to = at + 0.2 * (at - middle_of(obstacle))
        bigger = pulled(obstacle, k, (float(to[0]), float(to[1])))
        assert np.linalg.norm(knobs(bigger) - to, axis=1).min() < 1e-9
        if kind == "box":  # the other side stays
            np.testing.assert_allclose(knobs(bigger)[(k + 2) % 4], knobs(obstacle)[(k + 2) % 4], atol=1e-12)


def test_an_obstacle_stays_in_the_workspace_and_a_polygon_convex():
    draft = free().unchecked()
    corner = placed(new_obstacle("box", draft.scene), (9.0, -9.0))
    (kept,) = with_obstacle(draft, 0, corner).scene.obstacles
    low, high = kept.vertices.min(axis=0), kept.vertices.max(axis=0)
    assert (low >= -1e-9).all()
    assert (high <= np.array(draft.scene.size) + 1e-9).all()
    triangle = new_obstacle("polygon", draft.scene)
    with pytest.raises(InputError):  # a corner on the line between the other two
        pulled(triangle, 0, tuple(triangle.vertices[1:].mean(axis=0)))  # pyright: ignore[reportArgumentType]


def test_a_drag_is_one_edit_and_undone_as_one():
    session, planner = begun()
    first = session.moment
    held = session.hold()
    for k in range(5):
        there = held.draft.scene.obstacles[0]
        x, y = middle_of(there) + [0.004 * k, 0.0]
        session.preview_obstacle(held, 0, placed(there, (float(x), float(y))))
    session.release(held)
    moved = session.moment
    session.set_obstacle(1, None)
    assert len(session.draft.scene.obstacles) == len(first.draft.scene.obstacles) - 1
    session.undo()
    assert session.moment is moved
    session.undo()
    assert session.moment is first
    assert not session.can_undo
    session.redo()
    assert session.moment is moved
    assert planner.asked.count(None) == 1  # the plan under way is dropped when a hand takes hold
    session.bend("goal")
    assert not session.can_redo


def test_what_no_cable_can_do_is_said_and_not_planned():
    session, planner = begun()
    asked = len([task for task in planner.asked if task is not None])
    x, y = poses_of(session, "start")[0, :2]
    session.set_obstacle(0, placed(session.draft.scene.obstacles[0], (float(x), float(y))))
    assert session.planning.status == "invalid"
    assert any("overlaps" in sentence for sentence in session.inspection.sentences)
    assert session.inspection.faults[0].at is not None
    assert len([task for task in planner.asked if task is not None]) == asked
    session.undo()
    assert session.planning.status == "planning"
    assert planner.asked[-1] is not None


def test_clearance_is_that_of_the_scene():
    session, _ = begun()
    for figures, q in zip(session.inspection.ends.values(), session.moment.shapes.values(), strict=True):
        assert q is not None
        line = session.draft.cable.rod.shapes(q[None])[0]
        assert figures.clearance == pytest.approx(session.draft.scene.clearance(line, session.draft.cable.radius)[0])


def test_the_plan_is_shown_until_the_next_edit(found: Run):
    session, planner = begun(found.task)
    planner.on_answer(Answer(1, stage="projection"))
    assert "projection" in session.planning.sentence
    planner.on_answer(Answer(1, found))
    assert session.planning.status == "found"
    assert session.planning.plans == (found.plan,)
    session.hold()
    session.preview_gripper("goal", 0, poses_of(session, "goal")[0] + [0.0, 0.001, 0.0])
    assert session.planning.plans == ()


def test_an_answer_to_a_request_that_was_replaced_is_not_shown(found: Run):
    session, planner = begun(found.task)
    session.seek_ways()
    planner.on_answer(Answer(1, found))
    assert session.planning.status == "planning"
    planner.on_answer(Answer(len(planner.asked), found))
    assert session.planning.status == "found"


def test_a_plan_under_way_is_given_up_for_the_next_request(monkeypatch: pytest.MonkeyPatch, found: Run):
    ours, theirs = Pipe()

    def solved(task: Any, options: SolveOptions, on_event: Any) -> Run:
        assert options.clock is not None
        assert on_event(Progress("projection", 0.5)) is None
        assert options.clock() < math.inf
        ours.send("the next request")
        assert on_event(Progress("projection", 0.6)) == CANCEL
        assert options.clock() == math.inf
        return found

    monkeypatch.setattr(replanner, "solve", solved)
    assert replanner._answer(theirs, 1, found.task, SolveOptions(track=False)).run is found


def test_the_rows_of_a_run_are_the_rollout(ran: tuple[Run, list[Event]]):
    run, heard = ran
    rows, rollout = rows_of(heard), run.rollout
    assert rollout is not None
    np.testing.assert_array_equal([row.time for row in rows], rollout.times)
    np.testing.assert_array_equal([row.measured.centreline for row in rows], rollout.centreline)
    np.testing.assert_array_equal([row.observed for row in rows], rollout.observed)
    np.testing.assert_array_equal([row.reference for row in rows], rollout.reference)
    assert [row.status for row in rows] == ["", *rollout.status]


def test_a_run_is_watched_and_kept_as_files(tmp_path: Path, found: Run, ran: tuple[Run, list[Event]]):
    session, planner = begun(found.task)
    with pytest.raises(InputError, match="no plan to run yet"):
        session.run(Wanted())
    planner.on_answer(Answer(1, found))
    session.run(Wanted(controller="open-loop", plant="noise-1", stiffness=2.0, delay=0.1))
    number, (options, since) = len(planner.asked), planner.options[-1]
    assert (options.track, options.plan, options.controller, since) == (True, found.plan, "open-loop", 0.0)
    wanted = options.perturbation
    assert wanted.true_cable(found.task).bending_stiffness == 2 * found.task.cable.bending_stiffness
    assert (wanted.sensing.keypoint_noise, wanted.sensing.measurement_delay) == (0.001, 0.1)
    for row in rows_of(ran[1])[:3]:
        planner.on_answer(Answer(number, row=row))
        assert session.running is not None
        assert session.running.seen[-1] is row
    assert session.running is not None
    assert session.running.live
    assert session.planning.plans == (found.plan,)
    planner.on_answer(Answer(number, ran[0]))
    assert not session.running.live
    names = {path.name for path in session.save(tmp_path)}
    assert names == {"task.yaml", "plan.npz", "report.json", "rollout.npz", "plant.yaml"}
    assert ran[0].rollout is not None
    np.testing.assert_array_equal(Rollout.load(tmp_path / "rollout.npz").centreline, ran[0].rollout.centreline)
    assert replace(read_perturbation(tmp_path / "plant.yaml", found.task), notes=()) == wanted
    session.hold()
    assert session.running is None  # an edit ends it


def test_a_run_by_cameras_is_seen_as_they_see_it(tmp_path: Path, found: Run, ran: tuple[Run, list[Event]]):
    session, planner = begun(found.task)
    planner.on_answer(Answer(1, found))
    session.run(Wanted(cameras=("front", "above")))
    assert planner.options[-1][0].eyes == EyesConfig(cameras=("front", "above"))
    row = rows_of(ran[1])[3]
    running = session.running
    assert running is not None
    picture = Pictures(running).of(row)
    assert picture.shape == (2 * SIZE[1], SIZE[0], 3)
    for each, place in zip(np.split(picture, 2), ("front", "above"), strict=True):
        seen = camera_at(place, found.task.scene.size, SIZE).project(np.pad(row.observed, ((0, 0), (0, 1))))[0]
        marks = np.argwhere((each == GREEN).all(axis=2))[:, ::-1]
        assert np.linalg.norm(seen[:, None] - marks, axis=2).min(axis=1).max() < 2.0
    assert ran[0].rollout is not None
    record = {**ran[0].rollout.metadata, "eyes": {**describe(EyesConfig(cameras=("left",), blur=1.0)), "frames": 3}}
    recorded = Running.of_rollout(found.task, found.plan, replace(ran[0].rollout, metadata=record), "rollout.npz")
    assert recorded.eyes == EyesConfig(cameras=("left",), blur=1.0)
    record["eyes"]["cameras"] = ["nowhere"]
    with pytest.raises(InputError, match=r"rollout\.npz: eyes: .*'nowhere'"):
        Running.of_rollout(found.task, found.plan, replace(ran[0].rollout, metadata=record), "rollout.npz")


def test_a_plan_and_a_rollout_are_opened_with_their_task(tmp_path: Path, found: Run, ran: tuple[Run, list[Event]]):
    session, planner = begun(found.task)
    planner.on_answer(Answer(1, found))
    session.begin(Running(task=found.task, plan=found.plan))
    planner.on_answer(Answer(2, ran[0]))
    session.save(tmp_path)
    other, idle = begun(tmp_path / "rollout.npz")
    assert idle.asked == [None]  # nothing is planned until there is an edit
    assert other.draft.checked() == found.task
    assert other.running is not None
    for mine, row in zip(other.running.seen, rows_of(ran[1]), strict=True):
        assert (mine.time, mine.status) == (row.time, row.status)
        np.testing.assert_array_equal(mine.measured.centreline, row.measured.centreline)
    assert found.plan is not None
    np.testing.assert_array_equal(other.planning.plans[0].shapes, found.plan.shapes)
    other.open(tmp_path / "plan.npz")
    assert other.running is None
    other.open_content("mine.npz", (tmp_path / "plan.npz").read_bytes())  # of the task that is open
    other.open("single-obstacle-2")
    with pytest.raises(InputError, match=r"^mine\.npz: begins or ends .* from where single-obstacle-2 does"):
        other.open_content("mine.npz", (tmp_path / "plan.npz").read_bytes())
    (tmp_path / "task.yaml").unlink()
    with pytest.raises(InputError, match=r"is to lie beside it, as task\.yaml"):
        other.open(tmp_path / "plan.npz")


def test_an_obstacle_is_pushed_into_the_way_and_the_run_begun_anew(found: Run, ran: tuple[Run, list[Event]]):
    assert found.plan is not None
    aside = Disc(center=(0.05, 0.05), radius=0.008)
    rows, task = rows_of(ran[1])[:60], free().in_scene(replace(free().scene, obstacles=(aside,)))
    running = Running(task=task, plan=found.plan, rows=rows)
    x, y = rows[30].measured.centreline[len(rows[30].measured.centreline) // 2] - aside.center
    with pytest.raises(InputError, match="have been there: it would overlap them"):
        running.pushed(0, (x, y))
    pushed = running.pushed(0, (0.0, 0.01))
    assert pushed.perturbation.obstacles == ((0.0, 0.01),)
    assert pushed.perturbation.revealed == rows[-1].time
    assert pushed.seen == rows  # as long as the run anew is shorter
    with pytest.raises(InputError, match="one push a run"):
        replace(pushed, rows=rows).pushed(0, (0.0, 0.01))
    session, planner = begun(task)
    session.begin(running)
    session.push(0, (0.0, 0.01))
    assert planner.options[-1][1] == rows[-1].time
    for row in rows[:-1]:
        planner.on_answer(Answer(len(planner.asked), row=row))
        assert session.running is not None
        assert session.running.seen == rows


def test_rows_take_the_time_that_they_say():
    waits: list[float] = []
    pace = Pace(0.2, waits.append)
    for time in (0.0, 0.1, 0.2, 0.3, 0.4, 0.0, 0.1):
        pace.keep(time)
    np.testing.assert_allclose(waits, [0.1, 0.2], atol=0.05)  # from 0.2 s on; another start is not waited for


def test_a_run_from_elsewhere_is_watched_and_not_edited(found: Run, ran: tuple[Run, list[Event]]):
    pytest.importorskip("viser")
    run, heard = ran
    options = SolveOptions(controller="open-loop", eyes=EyesConfig(cameras=("above",)))
    with Watch(found.task, options, patience=0.0) as watch:
        for event in (*heard[:-1][:1], Planned(found), *(each for each in heard if isinstance(each, Stepped))):
            if not isinstance(event, Stepped) or event.row.time < 0.25:
                watch(event)
        running = watch.session.running
        assert running is not None
        assert running.seen == rows_of(heard)[:3]
        assert running.eyes == options.eyes
        watch(Finished(run))
        assert watch.session.running is not None
        assert watch.session.running.run is run
        with pytest.raises(InputError, match="watches a run from elsewhere"):
            watch.session.hold()


def test_what_is_saved_is_what_there_was(tmp_path: Path, found: Run):
    session, planner = begun(found.task)
    planner.on_answer(Answer(1, found))
    task, plan, report = session.save(tmp_path)
    assert load_task(task) == found.task
    assert found.plan is not None
    np.testing.assert_array_equal(Plan.load(plan).shapes, found.plan.shapes)
    assert report.name == "report.json"


def test_what_no_cable_can_do_is_saved_and_opened_again(tmp_path: Path):
    session, _ = begun()
    x, y = poses_of(session, "start")[0, :2]
    session.set_obstacle(0, placed(session.draft.scene.obstacles[0], (float(x), float(y))))
    (path,) = session.save(tmp_path)
    other, _ = begun()
    other.open_content("mine.yaml", path.read_bytes())
    assert other.inspection.sentences == session.inspection.sentences
    assert other.draft.scene == as_draft(path).scene
    other.undo()
    assert not other.inspection.faults


def test_a_file_that_is_none_is_named_and_changes_nothing():
    session, _ = begun()
    before = session.moment
    with pytest.raises(InputError, match=r"^mine\.yaml:1: "):
        session.open_content("../mine.yaml", b"no: task")
    assert session.moment is before
