"""Laws of a run: command line, benchmark and Python give the same; events, cancelling, and what is left then."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from numba.core import event

import cableway as cw
from cableway import report
from cableway.benchmark.episode import jobs_of, run_job
from cableway.benchmark.suites import Episode, task_digest
from cableway.cli import main
from cableway.control.open_loop import OpenLoop
from cableway.core import compiled
from cableway.core.errors import Cancelled, InputError, PlanningError
from cableway.outcome import Outcome
from cableway.planning import candidates
from cableway.planning.named import PLANNERS
from cableway.records import Plan, Rollout
from cableway.scene.files.loading import load_task
from cableway.simulation.perturbations.variants import named_perturbation
from cableway.verification import record, verify_plan
from cableway.workflow import compilation
from cableway.workflow.events import CANCEL, Event, Finished, Planned, Progress
from cableway.workflow.find import _other_cable
from cableway.workflow.registry import CONTROLLERS, make_planner
from cableway.workflow.run import Run, SolveOptions
from cableway.workflow.solve import solve

TASK = load_task("single-obstacle-2")
BLIND = SolveOptions(controller=OpenLoop())
UNSAVED = {"solve_time", "metadata", "verdict"}


def same(one: Plan | Rollout | None, other: Plan | Rollout | None) -> None:
    """Bit for bit, apart from times, and from what no file has."""
    assert one is not None
    assert other is not None
    for name in set(one.__dataclass_fields__) - UNSAVED:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def test_command_benchmark_and_python_give_the_same(tmp_path: Path):
    """On a perturbed plant, with sensor noise."""
    perturbation = named_perturbation("hard", TASK)
    run = cw.solve(TASK, cw.SolveOptions(perturbation=perturbation, seed=3))
    assert run.rollout is not None

    parts = perturbation.as_dict(TASK)
    plant = {"cableway": 1, "cable": parts["cable"], "grasp": parts["grasp"], "sensing": parts["sensing"]}
    plant["cable"] = {key: value for key, value in plant["cable"].items() if value is not None}
    plant["grasp"] = {key: value for key, value in plant["grasp"].items() if value is not None}
    (tmp_path / "plant.yaml").write_text(yaml.safe_dump(json.loads(json.dumps(plant))))
    command = ["run", TASK.name, "--plant", str(tmp_path / "plant.yaml"), "--seed", "3", "--no-video", "--quiet"]
    status = main([*command, "--out", str(tmp_path / "out")])
    assert status == (0 if run.success else 1)
    same(run.plan, Plan.load(tmp_path / "out/plan.npz"))
    same(run.rollout, Rollout.load(tmp_path / "out/rollout.npz"))
    report = json.loads((tmp_path / "out/report.json").read_text())
    assert (report["outcome"], report["shape_error"]) == (run.report.outcome, run.report.shape_error)

    episode = Episode("plants", "here", TASK.name, "hard", 3, task_digest(TASK.name, TASK))
    result = run_job(jobs_of("cableway", [episode])[0]).result
    assert (result.outcome, result.shape_error) == (run.report.outcome, run.report.shape_error)
    assert result.clearance == run.rollout.least_clearance
    assert result.deviation == run.report.largest_deviation
    assert result.steps == run.rollout.steps


def events_of(options: SolveOptions, stop: type | None = None) -> tuple[list[Event], Run]:
    events: list[Event] = []

    def on_event(event: Event) -> str | None:
        events.append(event)
        return CANCEL if stop is not None and isinstance(event, stop) else None

    return events, solve(TASK, options, on_event)


@pytest.fixture(scope="module")
def followed() -> tuple[list[Event], Run]:
    """A run without feedback."""
    return events_of(BLIND)


def test_events_come_in_order_and_hold_what_there_is(followed: tuple[list[Event], Run]):
    events, run = followed
    halves = [event for event in events if isinstance(event, Planned | Finished)]
    assert [type(event) for event in halves] == [Planned, Finished]
    assert events[-1] == Finished(run)
    assert halves[0].run.plan is run.plan
    assert halves[0].run.rollout is None
    stages = [event.stage for event in events if isinstance(event, Progress)]
    assert stages[-1] == "track"
    assert {"set up", "verification"} <= set(stages)
    assert run.success
    assert run.report.outcome is Outcome.SUCCESS


@pytest.mark.parametrize(("stop", "has_plan"), [(Progress, False), (Planned, True)])
def test_a_cancelled_run_ends_with_what_is_there(stop: type, has_plan: bool):
    events, run = events_of(BLIND, stop)
    assert (run.plan is not None, run.rollout) == (has_plan, None)
    assert run.report.outcome is Outcome.INTERRUPTED
    assert not run.success
    assert events[-1] == Finished(run)


def test_a_run_cancelled_on_the_way_keeps_its_rollout(followed: tuple[list[Event], Run]):
    plan = followed[1].plan

    def after_a_while(event: Event) -> None:
        if isinstance(event, Progress) and event.stage == "track" and event.share > 0.4:
            raise Cancelled

    run = solve(TASK, replace(BLIND, plan=plan), after_a_while)
    assert plan is not None
    assert run.plan is not None
    assert run.rollout is not None
    assert run.plan.shapes is plan.shapes
    assert 0 < run.rollout.steps < run.plan.steps
    assert run.rollout.outcome is run.report.outcome is Outcome.INTERRUPTED


def test_a_plan_is_verified_once(followed: tuple[list[Event], Run], monkeypatch: pytest.MonkeyPatch):
    """The search's verdict is the report's, before and after tracking; that of a plan that is given likewise."""
    plan = followed[1].plan
    judged: list[Plan] = []
    for module in (candidates, report, record):
        verify = module.verify_plan
        monkeypatch.setattr(
            module, "verify_plan", lambda plan, *rest, verify=verify: (judged.append(plan), verify(plan, *rest))[1]
        )
    for options in (BLIND, replace(BLIND, plan=plan)):
        judged.clear()
        run = solve(TASK, options)
        assert len(judged) == 1
        assert run.plan is not None
        assert run.report.plan_verdict == verify_plan(run.plan, TASK)


def test_a_verdict_is_of_the_plan_that_was_judged(tmp_path: Path):
    """What was changed or comes from a file has none, whatever the file says."""
    plan = cw.plan(TASK)
    assert plan.verdict == verify_plan(plan, TASK)
    assert replace(plan, shapes=plan.shapes + 0.1).verdict is None
    np.savez(tmp_path / "forged.npz", verdict=np.array("{}"), **plan.to_arrays())
    assert Plan.load(tmp_path / "forged.npz").verdict is None
    assert plan.noted(by="hand").verdict is plan.verdict


def test_the_verdict_of_a_planner_of_ones_own_is_not_believed():
    """Such as one that plans in a world without obstacles."""

    def careless(task: cw.Task, seed: int) -> Plan:
        return cw.plan(replace(task, scene=replace(task.scene, obstacles=())), seed=seed)

    run = solve(TASK, replace(BLIND, planner=careless, track=False))
    assert run.report.outcome is Outcome.NOT_VERIFIED
    assert run.plan is not None
    assert run.report.plan_verdict == verify_plan(run.plan, TASK)


def test_at_a_share_of_the_speed_nothing_is_faster():
    """Neither the plan, nor what is sent; the same for a plan that was made for the whole limits."""
    whole = solve(TASK, replace(BLIND, track=False)).plan
    assert whole is not None
    limits = TASK.grippers
    for plan in (None, whole, replace(whole, q=None)):
        run = solve(TASK, replace(BLIND, plan=plan, speed=0.4))
        assert run.success, run.report.failure
        assert run.rollout is not None
        assert np.linalg.norm(run.rollout.actions[..., :2], axis=-1).max() <= 0.4 * limits.max_step
        assert np.abs(run.rollout.actions[..., 2]).max() <= 0.4 * limits.max_turn
        assert run.rollout.steps > 2 * whole.steps
        assert "Planned and tracked with 40% of the grippers' limits." in run.report.notes
    assert run.plan is not None
    again = solve(TASK, replace(BLIND, plan=run.plan, speed=0.4, track=False)).plan
    assert again is not None
    assert again.shapes is run.plan.shapes, "slow enough already"


def test_a_dry_run_moves_nothing_and_says_what_would_be_sent(followed: tuple[list[Event], Run]):
    run, dry = followed[1], solve(TASK, replace(BLIND, dry_run=True))
    assert run.rollout is not None
    assert (dry.success, dry.rollout, run.report.commands) == (True, None, None)
    sent = dry.report.commands
    assert sent is not None
    steps = np.linalg.norm(run.rollout.actions[..., :2], axis=-1)
    assert (sent.count, sent.duration) == (run.rollout.steps, run.rollout.times[-1])
    assert sent.speed == pytest.approx(steps.max() / 0.1)
    assert sent.turn_rate == pytest.approx(np.abs(run.rollout.actions[..., 2]).max() / 0.1)
    assert sent.clearance == run.rollout.least_clearance
    np.testing.assert_array_equal(sent.first, run.rollout.poses[0])
    x, y = run.plan.poses[..., :2].reshape(-1, 2).T if run.plan else (np.nan, np.nan)
    np.testing.assert_allclose(sent.box, [x.min(), x.max(), y.min(), y.max()], atol=1e-3)
    assert [name for name, _ in sent.rows()] == [
        "would be sent", "greatest speeds", "grippers stay in", "first pose, left", "first pose, right",
    ]  # fmt: skip
    assert dry.report.notes[0].startswith("Dry run: nothing was moved.")


@pytest.fixture(scope="module")
def inserted() -> Run:
    return solve(load_task("insertion"), SolveOptions())


def test_what_would_be_sent_includes_the_insertion(inserted: Run):
    run, dry = inserted, solve(load_task("insertion"), SolveOptions(dry_run=True))
    assert run.rollout is not None
    assert run.insertion is not None
    assert dry.report.commands is not None
    assert dry.insertion is None
    assert dry.report.commands.count == run.rollout.steps + run.insertion.steps
    assert dry.report.commands.box[1] == pytest.approx(
        max(part.poses[..., 0].max() for part in (run.rollout, run.insertion)), abs=1e-3
    )


def test_an_insertion_begins_with_what_the_run_to_the_port_estimated(inserted: Run):
    """What is known to half its prior deviation by then is known before the port from the first step on."""
    run = inserted
    assert run.rollout is not None
    assert run.insertion is not None
    assert run.insertion.deviations is not None
    first = dict(zip(run.rollout.estimated(), run.insertion.deviations[0], strict=True))
    known = [name for name, found in run.rollout.estimated().items() if found.deviation < 0.5 * found.prior]
    assert known
    for name in known:
        assert first[name] < 0.6 * run.rollout.estimated()[name].prior


def test_a_planner_may_be_a_function_and_its_failure_is_a_value():
    def nothing(task: cw.Task, seed: int) -> Plan:
        raise PlanningError("walled in", outcome="infeasible")

    run = solve(TASK, replace(BLIND, planner=nothing))
    assert (run.report.outcome, run.report.failure, run.plan) == (Outcome.INFEASIBLE, "walled in", None)


def test_what_no_one_can_do_is_refused():
    wrong = ({"time_limit": 0.0}, {"alternatives": 0}, {"speed": 0.0}, {"speed": 1.1}, {"speed": float("nan")})
    for options, said in ((each, next(iter(each))) for each in wrong):
        with pytest.raises(InputError, match=said):
            SolveOptions(**options)
    with pytest.raises(InputError, match="unknown controller 'best'"):
        solve(TASK, SolveOptions(controller="best"))
    with pytest.raises(InputError, match="unknown planner 'best'"):
        solve(TASK, replace(BLIND, planner="best"))


def test_every_planner_of_the_registry_loads():
    for name in PLANNERS:
        assert make_planner(name).config.limits.clearance > 0
    assert next(iter(CONTROLLERS)) == "rod-mpc"


def test_outcomes_of_old_files_are_read():
    for text, outcome, detail in (
        ("time ran out", Outcome.TIMED_OUT, ""),
        ("the cable left its plan: already planned anew 2 times", Outcome.LEFT_PLAN, "already planned anew 2 times"),
        (
            "something stands in the way: there is no plan: walled in",
            Outcome.BLOCKED_WAY,
            "there is no plan: walled in",
        ),
        ("plant failed: the chain came apart", Outcome.PLANT_FAILED, "the chain came apart"),
    ):
        assert Outcome.read(text) == (outcome, detail)
    with pytest.raises(InputError, match="outcome must be one of success, settled"):
        Outcome.read("lost")
    assert all(each.sentence.endswith(".") for each in Outcome)


def test_compilation_does_not_count_against_the_time_limit(monkeypatch: pytest.MonkeyPatch):
    """In the midst of planning a kernel is compiled for an hour, by a clock that stands still but for that."""
    now = [0.0]
    monkeypatch.setattr(compiled, "time", SimpleNamespace(monotonic=lambda: now[0]))

    def on_event(each: Event) -> None:
        if isinstance(each, Progress) and each.stage == "projection":
            with event.trigger_event("numba:compile", data={}):
                now[0] += 3600.0

    run = solve(TASK, SolveOptions(track=False), on_event)
    assert run.report.success
    assert now[0] >= 3600.0
    assert sum(run.timings.values()) < 1.0


def test_tracking_waits_for_its_kernels_after_the_plan_is_there(monkeypatch: pytest.MonkeyPatch):
    """So that the first picture comes before everything is compiled."""
    monkeypatch.setattr(compilation, "is_compiled", lambda stage: stage != compilation.TRACKING)
    seen: list[str] = []

    def on_event(each: Event) -> str | None:
        seen.append(each.stage.partition(":")[0] if isinstance(each, Progress) else type(each).__name__)
        return CANCEL if seen[-1] == "track" else None

    solve(TASK, SolveOptions(), on_event)
    compiled_at = max(place for place, name in enumerate(seen) if name == "compilation")
    assert seen.index("Planned") < compiled_at < seen.index("track")


def test_a_model_of_another_cable_is_named_before_anything_moves():
    """By what differs; a run on the cable it was trained on says nothing, nor does a controller without a model."""
    task = cw.load_task("maze-1")
    same = replace(task, cable=replace(task.cable, length=0.3))
    other = replace(same, cable=replace(same.cable, bending_stiffness=0.005))
    learned = {"controller": "neural-mpc", "model": "conv"}
    said = "; ".join(_other_cable(other, SolveOptions(**learned)))
    assert said.startswith("The model conv is of another cable than the task's, to which --adapt ")
    assert said.endswith(": bending stiffness 0.001 N m² instead of 0.005 N m².")
    assert "--adapt" not in "; ".join(_other_cable(other, SolveOptions(adapt=True, **learned)))
    assert _other_cable(same, SolveOptions(**learned)) == _other_cable(other, SolveOptions()) == []
