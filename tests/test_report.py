"""Laws of the report: its figures are those of the records, and it says failure where there is any."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from recorded import moved_aside, moved_plan, perfect_rollout

from cableway.core.quantities import quantity
from cableway.outcome import SUCCESS_ERROR, Outcome, stacked_limit
from cableway.records import Attempt, Check, Plan, Rollout, Verdict
from cableway.report import Report, least_achievable_error, summarize
from cableway.rod.inverse import fit_keypoints, nearest_shape
from cableway.scene.files.loading import load_task
from cableway.scene.task import Task
from cableway.verification import VerificationLimits

ONLY_OF_A_RUN = {
    "shape_error",
    "least_achievable_error",
    "mean_keypoint_error",
    "min_clearance",
    "gripper_clearance",
    "largest_deviation",
    "control_time",
    "steps",
    "duration",
    "rollout_verdict",
}


@pytest.fixture(scope="module")
def recorded() -> tuple[Task, Plan, Rollout]:
    task, plan = moved_plan()
    return task, plan, perfect_rollout(task, plan)


def test_a_perfect_run_succeeds_and_its_figures_are_those_of_the_records(recorded: tuple[Task, Plan, Rollout]):
    task, plan, rollout = recorded
    report = summarize(task, plan, rollout, timings={"pivot path": 0.25, "projection": 1.5}, notes=["A note."])
    assert report.success
    assert report.failure is None
    assert report.seed == 7
    assert report.shape_error == pytest.approx(np.linalg.norm(plan.shapes[-1] - task.goal))
    assert report.min_clearance == rollout.clearance.min()
    assert report.gripper_clearance == rollout.gripper_clearance.min()
    assert report.largest_deviation == 0.0
    assert (report.steps, report.plan_steps, report.duration) == (60, 60, pytest.approx(6.0))
    assert report.planning_time == 1.75
    assert report.control_time is not None
    assert report.control_time.median == pytest.approx(0.0015)
    assert report.control_time.max == pytest.approx(0.002)
    assert report.control_time.median < report.control_time.p99 < report.control_time.max
    assert report.gripper_travel is not None
    assert report.gripper_travel[0] >= np.linalg.norm(plan.poses[-1, 0, :2] - plan.poses[0, 0, :2])
    assert report.configuration == {"plan": {"seed": 7}, "rollout": {"outcome": "settled"}}


def test_an_offset_of_the_whole_cable_shows_in_both_errors_and_in_the_deviation(recorded: tuple[Task, Plan, Rollout]):
    task, plan, rollout = recorded
    report = summarize(task, plan, moved_aside(rollout, 0.002))
    n = task.cable.keypoints
    assert report.mean_keypoint_error == pytest.approx(0.002, abs=1e-4)
    assert report.shape_error == pytest.approx(0.002 * math.sqrt(n), rel=0.05)
    assert report.largest_deviation == pytest.approx(0.002)
    assert report.success


def test_three_centimetres_stacked_are_too_many(recorded: tuple[Task, Plan, Rollout]):
    task, plan, rollout = recorded
    report = summarize(task, plan, moved_aside(rollout, 0.009))
    assert not report.success
    assert report.failure is not None
    assert report.failure.startswith("the final shape error is 32.")
    assert "not below 30 mm" in report.failure


def test_what_was_done_blindly_is_no_success(recorded: tuple[Task, Plan, Rollout]):
    task, plan, rollout = recorded
    failed = np.array(["solver failed: feedforward"] * rollout.steps)
    report = summarize(task, plan, replace(rollout, status=failed))
    assert not report.success
    assert report.failure == f"{rollout.steps} of the controller's {rollout.steps} steps came late or failed"
    dark = rollout.observed.copy()
    dark[-12:] = np.nan
    report = summarize(task, plan, replace(rollout, observed=dark))
    assert not report.success
    assert report.failure == "the cable was not observed during the last 1 s"


def test_the_limit_is_that_of_each_keypoint_however_many_there_are():
    """The same displacement of all keypoints is judged alike for 13 and for 25."""
    for size, reached in ((0.008, True), (0.009, False)):
        for n in (13, 25, 101):
            stacked = size * math.sqrt(n)
            assert (stacked < stacked_limit(SUCCESS_ERROR, n)) == reached


@pytest.mark.parametrize(("name", "what"), [("clearance", "cable"), ("gripper_clearance", "grippers")])
@pytest.mark.parametrize("value", [0.0, -0.001])
def test_any_contact_in_between_is_failure(recorded: tuple[Task, Plan, Rollout], name: str, what: str, value: float):
    task, plan, rollout = recorded
    touched = getattr(rollout, name).copy()
    touched[30] = value
    report = summarize(task, plan, replace(rollout, **{name: touched}))
    assert report.failure == f"contact: the least clearance of the {what} is {quantity(value)}"


def test_what_the_simulator_does_not_see_the_verification_does(recorded: tuple[Task, Plan, Rollout]):
    """A rollout whose keypoints are not on its cable has good figures and fails all the same."""
    task, plan, rollout = recorded
    report = summarize(task, plan, replace(rollout, centreline=rollout.centreline + np.array([0.0, 0.01])))
    assert report.shape_error is not None
    assert report.shape_error < 0.03
    assert not report.success
    assert report.failure is not None
    assert "from its place along the cable" in report.failure


@pytest.mark.parametrize(
    ("outcome", "failure"),
    [
        ("plant failed: the grasp slipped", "plant failed: the grasp slipped"),
        ("something stands in the way: no plan", "blocked way: no plan"),
    ],
)
def test_why_a_run_ended_early_is_said_first(recorded: tuple[Task, Plan, Rollout], outcome: str, failure: str):
    task, plan, rollout = recorded
    report = summarize(task, plan, replace(rollout, metadata={"outcome": outcome}))
    assert report.failure == failure
    ended = replace(rollout, metadata={"outcome": "time ran out"})
    assert ended.outcome.finished
    assert summarize(task, plan, ended).success


def test_a_plan_alone_leaves_out_what_it_has_no_figure_for(recorded: tuple[Task, Plan, Rollout]):
    task, plan, rollout = recorded
    alone, run = summarize(task, plan).as_dict(), summarize(task, plan, rollout).as_dict()
    assert alone["success"] is True
    assert not ONLY_OF_A_RUN & set(alone)
    assert set(run) - set(alone) == ONLY_OF_A_RUN
    assert "planning_time" not in alone


def test_a_plan_is_judged_by_the_limits_it_was_made_for(recorded: tuple[Task, Plan, Rollout]):
    task, plan, _ = recorded
    report = summarize(task, plan, limits=VerificationLimits(clearance=0.3))
    assert not report.success
    assert report.failure is not None
    assert "the cable and the bottom wall are" in report.failure


def test_a_failed_planning_is_reported_with_its_reason_and_checks(recorded: tuple[Task, Plan, Rollout]):
    task = recorded[0]
    verdict = Verdict((Check("rod deviation", math.nan, "m", 0.002, False, "at row 3"),))
    report = summarize(task, None, attempt=Attempt("the rod snaps", verdict=verdict), timings={"pivot path": 0.1})
    content = report.as_dict()
    assert content["success"] is False
    assert content["failure"] == "no plan was found: the rod snaps"
    assert content["plan_verdict"]["checks"][0]["value"] is None
    assert content["planning_time"] == 0.1
    assert "plan_steps" not in content


def test_what_stopped_it_is_the_failure(recorded: tuple[Task, Plan, Rollout]):
    task, plan, _ = recorded
    assert (
        summarize(task, plan, problem=(Outcome.PLANT_FAILED, "tracking failed: no start")).failure
        == "tracking failed: no start"
    )


def test_the_report_is_json_whatever_is_not_finite(recorded: tuple[Task, Plan, Rollout]):
    task, plan, rollout = recorded
    unknown = np.full_like(rollout.clearance, np.nan)
    blind = replace(rollout, clearance=unknown, solve_time=rollout.solve_time * np.nan)
    report = summarize(task, plan, blind, configuration={"plant": {"limit": math.inf}})
    content = json.loads(json.dumps(report.as_dict(), allow_nan=False))
    assert not report.success
    assert "min_clearance" not in content
    assert "control_time" not in content
    assert content["configuration"]["plant"] == {"limit": "inf"}


def test_all_fields_of_a_run_are_in_the_file(recorded: tuple[Task, Plan, Rollout]):
    task, plan, rollout = recorded
    content = summarize(task, plan, rollout, timings={"pivot path": 0.1}).as_dict()
    of_a_plug = {"plug_clearance", "insertion", "insertion_plan_verdict", "insertion_verdict"}
    expected = set(Report.__dataclass_fields__) - of_a_plug - {"failure", "estimates", "commands", "timing"} | {
        "success"
    }
    assert set(content) == expected
    assert set(content["control_time"]) == {"median", "p99", "max"}
    assert content["rollout_verdict"]["passed"] is True
    assert content["versions"]["cableway"]


def test_the_text_names_every_figure_with_its_unit(recorded: tuple[Task, Plan, Rollout]):
    task, plan, rollout = recorded
    text = str(summarize(task, plan, moved_aside(rollout, 0.002), timings={"pivot path": 0.5}, notes=["No plug."]))
    for part in ("moved", "success", "largest deviation", "2.0 mm", "0.50 s (pivot path 0.50)", "No plug."):
        assert part in text
    starts = {len(line) - len(line.split("  ", 1)[1].lstrip()) for line in text.splitlines()}
    assert len(starts) == 1, "values stand below each other"


def test_the_least_achievable_error_is_what_no_gripper_poses_go_below(recorded: tuple[Task, Plan, Rollout]):
    """Nothing for the task's own cable, the nearest shape of a rod that is 3% short for such a cable."""
    task = recorded[0]
    goal = task.cable.rod.at_keypoints(task.cable.rod.shapes(task.goal_equilibrium[None])[0])[0]
    assert least_achievable_error(task.cable, goal) == pytest.approx(0.0, abs=1e-6)
    short = replace(task.cable, length=0.97 * task.cable.length)
    assert least_achievable_error(short, goal) == pytest.approx(fit_keypoints(short.rod, goal)[1], rel=1e-4)
    graded = replace(task.cable, stiffness_profile=(0.5, 2.0))
    assert 1e-4 < (least_achievable_error(graded, goal) or 0.0) < 0.02
    assert least_achievable_error(replace(task.cable, yield_curvature=5.0), goal) is None


def test_the_least_achievable_error_of_a_cable_curled_at_one_end_is_found():
    """The shape that it takes nearest to a goal is one that it takes, so its own least achievable error is nothing."""
    task = load_task("single-obstacle-1")
    places = (np.arange(task.cable.rod.hinges) + 0.5) / task.cable.rod.hinges
    curled = replace(task.cable, rest_curvature=(0.0, 0.0, 12.0, 25.0))
    rest = curled.length * curled.along("rest_curvature", places)
    shape, least = nearest_shape(curled.rod, np.ones_like(places), rest, task.goal)
    assert least < 2e-3
    assert least_achievable_error(curled, shape) == pytest.approx(0.0, abs=1e-5)


def test_a_new_plan_on_the_way_is_reported(recorded: tuple[Task, Plan, Rollout]):
    task, plan, rollout = recorded
    again = replace(rollout, metadata={**rollout.metadata, "recovered": [1.0, 7.25]})
    notes = summarize(task, plan, again).notes
    assert notes[0] == "From 1.0 s on, the run follows a new plan from where the cable was."
    assert notes[1].startswith("From 7.2 s on,")
