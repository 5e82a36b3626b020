"""Episodes in space: what is measured of one with a plan and of one without, and what cannot be run there."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import pytest
from spatial_problems import ball_task

from cableway.benchmark import episode, spatial_episode, suites
from cableway.benchmark.episode import Result, died, jobs_of, run_job
from cableway.benchmark.suites import frozen_episodes
from cableway.core.errors import InputError, UnknownNameError
from cableway.outcome import Outcome
from cableway.scene.spatial.task import SpatialTask
from cableway.simulation.spatial_perturbation import SpatialPerturbation
from cableway.workflow.spatial_run import follow_in_space

EPISODE = frozen_episodes("space-clutter")[0]


def result_of(task: SpatialTask, monkeypatch: pytest.MonkeyPatch, method: str = "open-loop") -> tuple[Result, bytes]:
    """What an episode with another task, and a coarse cable in simulation, comes to."""
    coarse = SpatialPerturbation()
    coarse = replace(coarse, config=replace(coarse.config, links=21))
    monkeypatch.setattr(spatial_episode, "follow_in_space", partial(follow_in_space, perturbation=coarse))
    monkeypatch.setattr(suites, "make_spatial_task", lambda reference: task)
    monkeypatch.setattr(episode, "warm_up_in_space", lambda: None)
    (job,) = jobs_of(method, [replace(EPISODE, digest=suites.task_digest(EPISODE.task, task))])
    scored = run_job(job)
    return scored.result, scored.picture or b""


def test_a_plan_is_judged_followed_and_measured(monkeypatch: pytest.MonkeyPatch):
    result, picture = result_of(ball_task(), monkeypatch)
    assert (result.outcome, result.planned, result.success, result.strict) == (Outcome.SUCCESS, True, True, True)
    assert (result.contact, result.verified, result.within_limits) == (False, True, True)
    assert result.shape_error is not None
    assert result.shape_error < 0.01
    assert result.clearance is not None
    assert result.clearance > 0.004
    assert result.planning_time is not None
    assert result.steps
    assert not picture


def test_planning_ends_with_its_limit_as_a_failure_with_a_reason_and_a_picture(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(spatial_episode, "TIME_LIMIT", 0.0)
    result, picture = result_of(ball_task(), monkeypatch)
    assert (result.outcome, result.planned, result.success) == (Outcome.TIMED_OUT, False, False)
    assert "the time limit ran out" in result.detail
    assert result.shape_error is None
    assert picture.startswith(b"\x89PNG")


def test_an_episode_that_died_is_drawn():
    (job,) = jobs_of("cableway", [EPISODE])
    scored = died(job, Outcome.CRASHED, "its process ended")
    assert (scored.result.outcome, scored.result.planned) == (Outcome.CRASHED, False)
    assert scored.picture is not None


def test_methods_and_options_of_the_table_alone_are_refused():
    with pytest.raises(UnknownNameError, match="method in space 'broyden'; known: cableway, open-loop, rod-jacobian,"):
        jobs_of("broyden", [EPISODE])
    with pytest.raises(InputError, match="no deadline of control steps yet"):
        jobs_of("cableway", [EPISODE], deadline=0.1)
