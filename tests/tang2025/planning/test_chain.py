"""The paper's chain in a run: how its optimisation ended is on record, and said where it did not end at a minimum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import problems
import pytest

from cableway.planning.initial_trajectories import InitialTrajectories
from cableway.records import Plan
from cableway.report import summarize
from cableway.tang2025.planning.chain import PaperChain
from cableway.tang2025.planning.config import PaperPlannerConfig, paper_planner
from cableway.tang2025.planning.deformation import GUESSES
from cableway.workflow.run import Run, SolveOptions
from cableway.workflow.solve import solve

STOPPED = "Ipopt stopped after 3 iterations without converging (Maximum_Iterations_Exceeded)."


def config(iterations: int) -> PaperPlannerConfig:
    """The paper's, on a grid, so that most of the time is that of Ipopt."""
    paper = paper_planner()
    pivot = replace(paper.pivot, method="grid")
    return replace(paper, pivot=pivot, deformation=replace(paper.deformation, iterations=iterations))


@pytest.fixture(scope="module")
def stopped() -> Run:
    return solve(
        problems.free(),
        SolveOptions(planner=config(3), controller="open-loop", follow_unverified=True, rehearse=False, time_limit=1e4),
    )


def test_an_iterate_that_is_no_minimum_is_never_followed_silently(stopped: Run):
    """The plan says how Ipopt ended, and the report says once that it had not converged, after tracking too."""
    assert stopped.plan is not None
    assert stopped.rollout is not None
    ended = stopped.plan.metadata["ipopt"]
    assert (ended["status"], ended["iterations"], ended["converged"]) == ("Maximum_Iterations_Exceeded", 3, False)
    assert stopped.report.notes.count(STOPPED) == 1
    assert stopped.report.configuration["plan"]["ipopt"] == ended


def test_a_plan_from_a_file_still_says_it(stopped: Run, tmp_path):
    assert stopped.plan is not None
    stopped.plan.save(tmp_path / "plan.npz")
    assert STOPPED in summarize(stopped.task, Plan.load(tmp_path / "plan.npz")).notes


def test_an_attempt_that_is_no_minimum_says_so_where_there_is_no_plan():
    run = solve(problems.free(), SolveOptions(planner=config(3), track=False, time_limit=1e4))
    assert run.plan is None
    assert STOPPED in run.report.notes


def test_a_minimum_is_recorded_and_needs_no_note():
    """The paper's configuration has iterations enough to converge, where a hundred are too few."""
    run = solve(
        problems.doorway(),
        SolveOptions(planner=config(paper_planner().deformation.iterations), track=False, time_limit=1e4),
    )
    assert run.attempt is not None
    assert run.attempt.stages is not None
    ended = run.attempt.stages.metadata["ipopt"]
    assert ended["converged"]
    assert ended["status"] == "Solve_Succeeded"
    assert 1 <= ended["iterations"] < 1000
    assert not any("Ipopt" in note for note in run.report.notes)


def test_least_energy_is_the_least_of_the_three_first_guesses():
    task, paper = problems.free(), config(1000)
    chain = PaperChain(task, paper, InitialTrajectories(task, paper).pivot)
    made = {guess: chain.deformation(guess) for guess in GUESSES}
    energies = {guess: stages.metadata["ipopt"]["energy"] for guess, (_, stages) in made.items()}
    shapes, stages = chain.deformation("least-energy")
    best = min(energies, key=energies.__getitem__)
    assert stages.metadata["ipopt"]["guess"] == best
    assert np.array_equal(shapes, made[best][0])
    assert len(set(energies.values())) == 3, "the first guess decides"
