"""What a page says of a search that is over."""

from __future__ import annotations

from cableway.studio.planning import planning_of
from cableway.tasks.generation import random_task
from cableway.workflow.run import SolveOptions
from cableway.workflow.solve import solve


def test_that_there_is_no_plan_is_said_once():
    said = planning_of(solve(random_task(0, "blocked"), SolveOptions(track=False)))
    assert said.status == "none"
    assert said.sentence.startswith("No plan: ")
    assert "there is no plan" not in said.sentence
