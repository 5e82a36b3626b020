"""What people type at a prompt: names of tasks, the wrong thing in the wrong place, and what the prompt then shows."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded import moved_plan, perfect_rollout

import cableway as cw
from cableway.benchmark.methods import Method
from cableway.core.brief import Brief
from cableway.records import Attempt, Measurement, Observation, Plan, Rollout

NAME = "insertion"


@pytest.fixture(scope="module")
def task() -> cw.Task:
    return cw.load_task(NAME)


def test_the_version_is_there():
    assert re.fullmatch(r"\d+\.\d+\.\d+.*", cw.__version__)
    assert "__version__" in dir(cw)


def test_all_public_names_are_there():
    assert all(getattr(cw, name) is not None for name in cw.__all__)
    for name in ("CablewayError", "PlanningError", "draw", "save_task", "load_task"):
        assert name in cw.__all__


def test_every_error_is_public():
    """A user can catch what is raised without looking up a module."""
    from cableway.core import errors

    raised = {name for name, value in vars(errors).items() if isinstance(value, type) and issubclass(value, Exception)}
    raised |= {"TrackingInterrupted"}
    assert raised <= set(cw.__all__)


def test_a_task_may_be_given_by_its_name_or_its_file(task: cw.Task, tmp_path: Path):
    """Wherever a task is asked for: one reads it, all use that."""
    task.save(tmp_path / "mine.yaml")
    for source in (NAME, tmp_path / "mine.yaml", str(tmp_path / "mine.yaml")):
        assert cw.CableSimulator(source).task == task
    _, plan = moved_plan(2)
    shapes = np.stack([task.start, task.goal])
    jump = replace(plan, shapes=shapes, poses=plan.poses[[0, -1]], q=None, stages=None)
    assert not cw.verify_plan(jump, NAME).passed
    assert cw.summarize(NAME, jump).task == NAME
    assert not cw.verify_rollout(perfect_rollout(task, jump), NAME).passed


@pytest.mark.parametrize("use", [
    cw.plan, cw.solve, cw.plan_insertion, cw.CableSimulator, cw.draw, cw.load_task,
    lambda given: cw.summarize(given, None), lambda given: cw.verify_plan(moved_plan(2)[1], given),
])  # fmt: skip
@pytest.mark.wrong_types
def test_what_is_no_task_is_told_what_one_is(use: Callable[[Any], Any]):
    """A name that is not in the catalogue gets the list, anything else what is wanted."""
    with pytest.raises(cw.InputError, match=r"^a task (must be|is loaded by) .* got 12$"):
        use(12)
    with pytest.raises(cw.InputError, match=r"^unknown task 'maze-1000'; known: .*maze-1"):
        use("maze-1000")


@pytest.mark.wrong_types
def test_a_task_in_place_of_a_plant_or_a_plan(task: cw.Task):
    controller, (_, plan) = cw.OpenLoop(), moved_plan(2)
    for wrong in (task, NAME):
        with pytest.raises(cw.InputError, match=r"^the plant must be what is led, such as cableway.CableSimulator\(ta"):
            cw.track(wrong, controller, plan)
    with pytest.raises(cw.InputError, match=r"^the plan must be a cableway.Plan, got Task\('insertion', "):
        cw.track(cw.CableSimulator(task), controller, task)
    with pytest.raises(cw.InputError, match=r"^options must be a cableway.SolveOptions, got \{'seed': 3\}"):
        cw.solve(task, {"seed": 3})


@pytest.mark.wrong_types
@pytest.mark.parametrize(("make", "said"), [
    (lambda: cw.SolveOptions(planner=lambda task: None), r"the planner\(task\) must take 2 arguments"),
    (lambda: cw.SolveOptions(planner=3), "the planner must be callable, got 3"),
    (lambda: cw.SolveOptions(plant=lambda: None), r"the plant\(\) must take 1 argument"),
    (lambda: cw.SolveOptions(controller=cw.OpenLoop), "the controller must be an object, got the class OpenLoop"),
    (lambda: cw.SolveOptions(controller=3), "the controller, of type int, lacks config, control_step, init"),
    (lambda: Method(name="mine", description="", planner=lambda: None),
     r"the planner of the method 'mine'\(\) must take 2 arguments"),
    (lambda: Method(name="mine", description="", controller=lambda task: None),
     r"the controller of the method 'mine'\(task\) must take 0 arguments"),
])  # fmt: skip
def test_signatures_are_checked_where_code_is_handed_over(make: Callable[[], Any], said: str):
    """Before anything is planned, in one sentence."""
    with pytest.raises(cw.InputError, match=rf"^{said}"):
        make()


def test_records_compare_as_objects():
    """Of arrays it could not be said whether they are equal."""
    _, plan = moved_plan(rows=5)
    assert plan == plan
    assert (plan, 1.0) != (replace(plan), 1.0)
    assert len({plan, replace(plan)}) == 2
    assert all(kind.__eq__ is object.__eq__ for kind in (Attempt, Measurement, Observation, Plan, Rollout))


def test_records_show_themselves_on_one_line(task: cw.Task):
    """Whatever they hold, and arrays by their shape."""
    moved, plan = moved_plan()
    rollout = perfect_rollout(moved, plan)
    report = cw.summarize(moved, plan, rollout)
    run = cw.Run(task=moved, report=report, plan=plan, rollout=rollout)
    records = [task, plan, rollout, report, run, report.plan_verdict, Attempt("none", shapes=plan.shapes), plan.stages]
    for record in records:
        shown = repr(record)
        assert isinstance(record, Brief)
        assert shown.startswith(f"{type(record).__name__}(")
        assert "\n" not in shown
        assert len(shown) < 240, shown
    assert repr(task) == "Task('insertion', cable 210 mm, 6 obstacles in 700 x 700 mm)"
    assert repr(plan).startswith("Plan(60 steps, shapes (61, 13, 2), poses (61, 2, 3)")
    assert "settled, 60 steps in 6.0 s" in repr(rollout)
    assert repr(report) == "Report('moved', success, shape error 0.00 mm)"


def test_one_call_draws_whatever_there_is(tmp_path: Path):
    task, plan = moved_plan()
    records = (None, plan, perfect_rollout(task, plan), Attempt("none", shapes=plan.shapes))
    panels = [len(cw.draw(task, record).axes) for record in records]
    assert panels[0] == 1
    assert min(panels[1:]) > 1
    cw.draw(task, path=tmp_path / "task.png")
    assert (tmp_path / "task.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.wrong_types
def test_what_cannot_be_drawn_is_said(task: cw.Task):
    with pytest.raises(cw.InputError, match=r"must be a Plan, a Rollout or an Attempt, got 'plan.npz'"):
        cw.draw(task, "plan.npz")
