"""Laws of a session in space: the cable follows as the equilibrium it is, obstacles by their frames, files hold all."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from problems import free
from spatial_problems import ball_task

from cableway.core.errors import InputError
from cableway.geometry import rotations
from cableway.geometry.groups import SE3
from cableway.geometry.spatial_convex import SpatialWorld, signed_distance
from cableway.records import Plan, Rollout
from cableway.scene.files.loading import load_task
from cableway.scene.obstacles import Box, Polygon
from cableway.scene.spatial.obstacles import ConvexMesh, Cuboid, Cylinder, Prism, SpatialObstacle, Sphere
from cableway.scene.spatial.task import SpatialTask
from cableway.simulation.perturbations.spatial_reading import read_spatial_perturbation
from cableway.simulation.spatial_perturbation import SpatialPerturbation
from cableway.studio import spatial_obstacles as hands
from cableway.studio.curves import curves_of
from cableway.studio.film import film_page
from cableway.studio.opening import opened
from cableway.studio.replanner import Answer, _answer
from cableway.studio.running import Running, Wanted
from cableway.studio.session import Session
from cableway.studio.watch import Watch
from cableway.workflow.events import Finished, Planned, Progress, Stepped
from cableway.workflow.solve_in_space import SpatialOptions, SpatialRun, solve_in_space

pytest.importorskip("coal")

FAR = np.array([20.0, 20.0, 20.0])

OBSTACLES: list[SpatialObstacle] = [
    Cuboid(center=(0.3, 0.4, 0.5), size=(0.1, 0.2, 0.3), orientation=(0.8, 0.0, 0.6, 0.0)),
    Cylinder(center=(0.3, 0.4, 0.5), radius=0.05, height=0.3, axis=(0.6, 0.0, -0.8)),
    Sphere(center=(0.3, 0.4, 0.5), radius=0.1),
    ConvexMesh(points=np.array([[0.3, 0.4, 0.5], [0.5, 0.4, 0.5], [0.3, 0.7, 0.5], [0.3, 0.4, 0.6]])),
    Prism(section=Box(center=(0.3, 0.4), size=(0.1, 0.2), angle=0.4, height=0.3)),
    Prism(section=Polygon(vertices=np.array([[0.2, 0.2], [0.4, 0.2], [0.3, 0.5]]))),
]


class Recorder:
    """In place of the process that plans."""

    def __init__(self, on_answer: Any) -> None:
        self.on_answer, self.asked = on_answer, []

    def request(self, task: Any, options: Any, since: float = 0.0) -> int:
        self.asked.append((task, options))
        return len(self.asked)

    def start(self) -> None:
        pass

    cancel = close = start


def begun(source: Any) -> tuple[Session, Recorder]:
    made: list[Recorder] = []
    return Session(source, planner=lambda hear: made.append(Recorder(hear)) or made[0]), made[0]


@pytest.fixture(scope="module")
def ran() -> tuple[SpatialRun, tuple[Any, ...], dict[str, Any]]:
    """A run, its rows, and how it was asked for: all that the process beside a page does."""
    wire: Any = SimpleNamespace(said=[], poll=lambda *_: False)
    wire.send = wire.said.append
    options = SpatialOptions(controller="open-loop", perturbation=Wanted(length=1.005).perturbation(ball_task(), 0))
    done = _answer(wire, 1, ball_task(), options)
    assert done.run is not None, done.problem
    assert isinstance(done.run, SpatialRun)
    rows = tuple(each.row for each in wire.said if each.row is not None)
    return done.run, rows, {"perturbation": options.perturbation}


def test_the_cable_follows_a_gripper_that_moves_and_turns():
    session, planner = begun(ball_task())
    first, held = session.moment, session.hold()
    rod = ball_task().rod
    for _ in range(5):
        q = session.moment.shapes["start"]
        assert q is not None
        pose = SE3.plus(rod.end_poses(q[None])[0, 1], np.array([0.004, -0.003, 0.01, 0.05, 0.08, -0.04]))
        assert not session.preview_gripper("start", 1, pose)
        q = session.moment.shapes["start"]
        assert q is not None
        assert SE3.distance(rod.end_poses(q[None])[0, 1], pose)[0] < 1e-9
        assert SE3.distance(rod.end_poses(q[None])[0, 0], rod.end_poses(ball_task().start[None])[0, 0])[1] < 1e-7
        assert rod.stability(q[None])[0][0] > 0
    np.testing.assert_array_equal(getattr(session.draft, "start"), q)  # noqa: B009
    last = session.moment
    with pytest.raises(InputError, match="no stable shape"):  # taut, and turned aside at both ends
        session.preview_gripper("start", 1, np.array([5.0, 5.0, 5.0, *pose[3:]]))
    assert session.moment is last
    session.release(held)
    session.undo()
    assert session.moment is first
    for refused in (lambda: session.bend("start"), session.seek_ways):
        with pytest.raises(InputError, match="in space"):
            refused()
    assert all(isinstance(options, SpatialOptions) for _, options in planner.asked)


@pytest.mark.parametrize("obstacle", OBSTACLES, ids=lambda each: type(each).__name__)
def test_an_obstacle_moves_with_its_frame(obstacle: SpatialObstacle):
    frame = hands.frame_of(obstacle)
    stands = isinstance(obstacle, Prism)
    turn = rotations.from_vector(np.array([0.0, 0.0, 0.7]) if stands else np.array([0.3, -0.5, 0.7]))
    by = np.array([0.1, -0.05, 0.0 if stands else 0.2, *turn])
    about = np.concatenate([frame[:3] + by[:3], rotations.product(turn, frame[3:])])
    moved = hands.placed(obstacle, about)
    points = np.random.default_rng(0).uniform(-0.3, 0.3, (40, 3)) + frame[:3]
    there = about[:3] + rotations.rotate(turn, points - frame[:3])
    before, after = (
        signed_distance(at, SpatialWorld.of([each.solid], 2 * FAR, -FAR))[0]
        for at, each in ((points, obstacle), (there, moved))
    )
    np.testing.assert_allclose(after, before, atol=1e-9)
    same = hands.placed(obstacle, frame)
    np.testing.assert_allclose(signed_distance(points, SpatialWorld.of([same.solid], 2 * FAR, -FAR))[0], before)
    if (size := hands.size_of(obstacle)) is not None:
        larger = hands.resized(obstacle, (size[0], size[1], size[2] + 0.02))
        assert hands.size_of(larger)[2] == pytest.approx(size[2] + 0.02)  # pyright: ignore[reportOptionalSubscript]


def test_what_no_cable_can_do_is_said_where_it_is():
    session, _ = begun(ball_task())
    middle = ball_task().keypoints("start")[6]
    there: Any = session.draft.scene.obstacles[0]
    session.set_obstacle(0, hands.placed(there, np.array([*middle, 1.0, 0.0, 0.0, 0.0])))
    assert session.planning.status == "invalid"
    assert session.inspection.ends["start"].clearance < 0
    at = session.inspection.faults[0].at
    assert at is not None
    assert np.linalg.norm(np.array(at) - middle) < 0.08
    with pytest.raises(InputError, match="wholly outside"):
        session.set_obstacle(0, hands.placed(there, np.array([9.0, 9.0, 9.0, 1.0, 0.0, 0.0, 0.0])))


def test_a_session_goes_from_the_table_to_space_and_back():
    session, planner = begun(free())
    session.draw("lift", 1)
    assert session.draft.name == "lift-1"
    assert isinstance(planner.asked[-1][0], SpatialTask)
    session.undo()
    assert planner.asked[-1][0] == free()


def test_the_rows_of_a_run_in_space_are_its_rollout(ran: Any):
    run, rows, _ = ran
    assert run.rollout is not None
    np.testing.assert_array_equal([row.measured.centreline for row in rows], run.rollout.centreline)
    np.testing.assert_array_equal([row.reference for row in rows], run.rollout.reference)
    assert [row.status for row in rows] == ["", *run.rollout.status]


def test_curves_of_a_plan_in_space_are_near_what_the_judge_found(ran: Any):
    run, _, _ = ran
    curves = curves_of(run.task, run.plan)
    assert float(curves.cable.min()) == pytest.approx(run.report.min_clearance, abs=2e-3)
    assert float(curves.speed.max()) <= 1.0


def test_an_obstacle_is_pushed_in_space_where_nothing_has_been(ran: Any):
    run, rows, wanted = ran
    running = Running(task=run.task, plan=run.plan, controller="open-loop", **wanted)
    with pytest.raises(InputError, match="no run is under way"):
        running.pushed(0, (0.0, 0.01))
    pushed = replace(running, rows=rows[:20]).pushed(0, (0.0, 0.01))
    assert isinstance(pushed.perturbation, SpatialPerturbation)
    assert (pushed.perturbation.obstacles, pushed.perturbation.revealed) == (((0.0, 0.01, 0.0),), rows[19].time)
    assert np.allclose(pushed.scene.obstacles[0].center, (0.4, 0.41, 0.38))
    assert pushed.seen == rows[:20]
    with pytest.raises(InputError, match="one push a run"):
        replace(pushed, rows=rows[:20]).pushed(0, (0.0, 0.01))
    passed = rows[len(rows) // 2].measured.keypoints
    low = passed[np.argmin(passed[:, 2])]
    with pytest.raises(InputError, match="have been there: it would overlap them by"):
        replace(running, rows=rows[:-10]).pushed(0, tuple(low[:2] - [0.4, 0.4]))


def test_a_page_plays_a_run_in_space_by_itself(ran: Any):
    run, _, _ = ran
    page = film_page(run.task, run.rollout)
    assert not re.search(r"(src|href)=|https?:|import |fetch", page)
    (data,) = re.findall(r"const film = (.*);", page)
    film = json.loads(data)
    shown = {
        name: np.frombuffer(base64.b64decode(film[name]), "<f4") for name in ("cables", "poses", "reference", "seen")
    }
    rows = run.rollout.steps + 1
    np.testing.assert_allclose(shown["cables"].reshape(rows, film["points"], 3), run.rollout.centreline, atol=1e-6)
    np.testing.assert_allclose(shown["poses"].reshape(rows, 2, 7), run.rollout.poses, atol=1e-6)
    wanted = shown["reference"].reshape(rows, film["points"], 3)
    np.testing.assert_allclose(wanted[:, [0, -1]], run.rollout.reference[:, [0, -1]], atol=1e-6)
    np.testing.assert_allclose(shown["seen"].reshape(run.rollout.observed.shape), run.rollout.observed, atol=1e-6)
    plan = json.loads(re.findall(r"const film = (.*);", film_page(run.task, run.plan))[0])
    assert len(plan["times"]) == len(plan["clearance"]) == run.plan.steps + 1
    assert min(plan["clearance"]) == pytest.approx(run.report.min_clearance, abs=2e-3)


def test_a_run_in_space_from_elsewhere_is_watched(ran: Any):
    pytest.importorskip("viser")
    from cableway.studio.view.run_panel import PUSH, RunPanel

    run, rows, _ = ran
    with Watch(run.task, SpatialOptions(controller="open-loop"), patience=0.0) as watch:
        for event in (Progress("search", 0.0), Planned(replace(run, rollout=None)), *map(Stepped, rows[:3])):
            watch(event)
        assert watch.session.planning.plans == (run.plan,)
        assert watch.session.running is not None
        assert watch.session.running.seen == rows[:3]
        for watched in (True, False):  # stopped or pushed at is only a run of one's own
            panel = RunPanel(watch._studio.server.viser.gui, *[print] * 5)
            panel.show(watch.session.running, 2, True, in_space=True, watched=watched)
            assert (panel.start.disabled, PUSH in panel.said.content) == (watched, not watched)
        watch(Finished(run))
        assert watch.session.running.run is run


def test_a_run_in_space_is_kept_as_files_that_repeat_it(tmp_path: Path, ran: Any):
    run, rows, wanted = ran
    session, planner = begun(ball_task())
    planner.on_answer(Answer(1, replace(run, rollout=None)))
    assert session.planning.plans == (run.plan,)
    session.begin(Running(task=run.task, plan=run.plan, controller="open-loop", **wanted))
    assert planner.asked[-1][1].plan is run.plan
    for row in rows[:2]:
        planner.on_answer(Answer(2, row=row))
    planner.on_answer(Answer(2, run))
    names = {path.name for path in session.save(tmp_path)}
    assert names == {"task.yaml", "plan.npz", "report.json", "rollout.npz", "plant.yaml"}
    task, perturbation = load_task(tmp_path / "task.yaml"), read_spatial_perturbation(tmp_path / "plant.yaml", run.task)
    assert task == run.task
    assert isinstance(task, SpatialTask)
    again = SpatialOptions(plan=tmp_path / "plan.npz", controller="open-loop", perturbation=perturbation)
    rollout = solve_in_space(task, again).rollout
    assert rollout is not None
    np.testing.assert_array_equal(rollout.centreline, Rollout.load(tmp_path / "rollout.npz").centreline)
    found = opened(tmp_path / "rollout.npz")
    assert found.plan is not None
    np.testing.assert_array_equal(found.plan.shapes, Plan.load(tmp_path / "plan.npz").shapes)
    with pytest.raises(InputError, match=r"a cell is for a task, not for .*rollout\.npz"):
        opened(tmp_path / "rollout.npz", "dual-ur5e")
    other, idle = begun(tmp_path / "rollout.npz")
    assert idle.asked == []
    assert other.running is not None
    assert len(other.running.seen) == len(rows)
    free().save(tmp_path / "task.yaml")
    with pytest.raises(InputError, match=r"rollout\.npz: is in space, unlike"):
        opened(tmp_path / "rollout.npz")
