"""A plan for a cable that friction holds is tried in simulation first, and the best of several is taken."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import problems
import pytest

from cableway.core.errors import InputError, PlanningError
from cableway.core.time_limit import OutOfTime, time_limit
from cableway.planning.planner import plan
from cableway.records import Plan
from cableway.scene.files.loading import load_task
from cableway.workflow import rehearsal
from cableway.workflow.rehearsal import RehearsalConfig, Rehearsed, needs_rehearsal, rehearsed_plan

HELD = replace(problems.moved(), cable=replace(problems.moved().cable, friction=0.35))
"""Carried over free ground by a cable with the friction of `real-multi`, whose rehearsal takes far longer."""


@cache
def found(seed: int) -> Plan:
    return plan(HELD, seed=seed)


def test_only_a_cable_that_differs_from_the_rod_is_rehearsed():
    free = load_task("single-obstacle-1")
    graded = replace(free, cable=replace(free.cable, stiffness_profile=(0.5, 2.0)))
    assert [needs_rehearsal(task) for task in (HELD, load_task("real-multi"), graded, free)] == [True] * 3 + [False]
    seeds = []
    one = rehearsed_plan(free, lambda seed: seeds.append(seed) or found(0), seed=5)
    assert seeds == [5]
    assert "rehearsal" not in one.metadata


def test_the_first_plan_that_goes_well_is_taken():
    stages = []
    chosen = rehearsed_plan(HELD, found, seed=0, progress=lambda stage, share: stages.append((stage, share)))
    record = chosen.metadata["rehearsal"]
    assert (record["plans"], record["passed"]) == (1, True)
    assert record["deviation"] <= 0.01
    assert stages[0] == ("rehearsal", 0.0)
    assert stages[-1] == ("rehearsal", 1.0)


def test_where_none_goes_well_the_one_that_strays_least_is_taken():
    """The first leads the cable three times as fast as the second."""
    asked: list[int] = []
    good = found(0)
    assert good.q is not None
    hurried = replace(good, shapes=good.shapes[::3], poses=good.poses[::3], q=good.q[::3])

    def find(seed: int) -> Plan:
        asked.append(seed)
        return good if len(asked) == 2 else hurried

    chosen = rehearsed_plan(HELD, find, config=RehearsalConfig(plans=2, deviation=1e-9))
    assert len(set(asked)) == 2
    assert np.array_equal(chosen.poses, good.poses)
    assert (chosen.metadata["rehearsal"]["plans"], chosen.metadata["rehearsal"]["passed"]) == (2, False)


def test_a_plan_found_again_is_not_rehearsed_again(monkeypatch: pytest.MonkeyPatch):
    done: list[Plan] = []
    how = Rehearsed(deviation=0.1, clearance=0.01, shape_error=0.1)
    monkeypatch.setattr(rehearsal, "rehearse", lambda task, plan, *others: done.append(plan) or how)
    chosen = rehearsed_plan(HELD, lambda seed: found(0))
    assert len(done) == 1
    assert chosen.metadata["rehearsal"]["plans"] == RehearsalConfig().plans


def test_contact_is_worse_than_straying():
    strays = Rehearsed(deviation=0.1, clearance=0.001, shape_error=0.1)
    touches = Rehearsed(deviation=0.01, clearance=-0.001, shape_error=0.001)
    assert strays.badness() < touches.badness()


def test_a_search_that_ends_keeps_what_was_rehearsed():
    def find(seed: int) -> Plan:
        if seed:
            raise PlanningError("the time limit ran out")
        return found(0)

    assert rehearsed_plan(HELD, find, config=RehearsalConfig(deviation=1e-9)).metadata["rehearsal"]["plans"] == 1
    with pytest.raises(PlanningError, match="time limit"):
        rehearsed_plan(HELD, find, seed=1)


def test_settings_out_of_range_are_refused():
    with pytest.raises(InputError, match=r"rehearsal\.plans must be whole and positive, got 0"):
        RehearsalConfig(plans=0)


def test_a_time_limit_ends_the_rehearsal_and_leaves_the_best_plan_so_far():
    """Over before the first rehearsal ends, it leaves the plan as it is; during a second search, the first plan."""
    with time_limit(lambda: True):
        chosen = rehearsed_plan(HELD, lambda seed: found(0))
    assert (chosen.poses == found(0).poses).all()
    assert chosen.metadata["rehearsal"] == {"plans": 0}
    over: list[bool] = []

    def find(seed: int) -> Plan:
        if over:
            raise OutOfTime
        over.append(True)
        return found(0)

    chosen = rehearsed_plan(HELD, find, config=RehearsalConfig(plans=2, deviation=1e-9))
    assert chosen.metadata["rehearsal"]["plans"] == 1
