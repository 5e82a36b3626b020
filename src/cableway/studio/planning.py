"""How far planning is, and what became of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from cableway.core.errors import Point
from cableway.core.quantities import quantity
from cableway.records import Plan
from cableway.scene.task import CONTROL_STEP
from cableway.workflow.run import Run
from cableway.workflow.solve_in_space import SpatialRun

PLANNING = "Planning ..."
"""Said while it is not known yet at what stage."""

Status = Literal["planning", "found", "none", "invalid"]


@dataclass(frozen=True)
class Planning:
    """How far planning is.

    Attributes:
        status: "invalid" where the draft is no task; "none" where no plan was found.
        sentence: The same in words, with the reason.
        plans: What was found, best first.
        run: All there is of it.
        at: Where on the table [m] the reason is why there is no plan; None where it is nowhere in particular.
    """

    status: Status
    sentence: str
    plans: tuple[Plan, ...] = ()
    run: Run | SpatialRun | None = None
    at: Point | None = None


def planning_of(run: Run | SpatialRun) -> Planning:
    """What a run that is over comes to."""
    if run.plan is None:
        at = None if run.attempt is None else run.attempt.at
        why = (run.report.failure or run.report.outcome.sentence).removeprefix("there is no plan: ")
        return Planning("none", f"No plan: {why}", run=run, at=at)
    clearance, plan = run.report.min_clearance, run.plan
    room = "" if clearance is None else f", {quantity(clearance)} clear at least"
    took = "" if run.report.planning_time is None else f" Found in {run.report.planning_time:.1f} s."
    sentence = f"A verified plan: {plan.steps} steps, {plan.steps * CONTROL_STEP:.1f} s{room}.{took}"
    return Planning("found", sentence, (plan, *(run.alternatives if isinstance(run, Run) else ())), run)


def planning_from(plan: Plan | None, name: str) -> Planning:
    """What was opened from the file of that name, or lay beside it."""
    if plan is None:
        return Planning("none", f"There is no plan beside {name}; the next edit seeks one.")
    return Planning("found", f"The plan of {name}: {plan.steps} steps, {plan.steps * CONTROL_STEP:.1f} s.", (plan,))
