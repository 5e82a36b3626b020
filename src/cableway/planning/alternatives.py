"""Plans that go round the obstacles in different ways, best first."""

from __future__ import annotations

from collections.abc import Callable

from cableway.core.errors import Cancelled, PlanningError
from cableway.core.time_limit import OutOfTime
from cableway.geometry.groups import SE2
from cableway.outcome import Outcome
from cableway.planning.candidates import Search
from cableway.planning.initial_trajectories import routed
from cableway.planning.routes.homotopy import different_routes, motion_class, signature
from cableway.records import Plan
from cableway.scene.clearance import cable_clearance
from cableway.scene.task import Task

SEARCHES_EACH = 6
"""Pivot paths looked for, for each plan that is asked for."""

CLEARANCE_WEIGHT = 0.001
"""Of one over the least clearance, in `plan_cost` [m^2]: 5 mm count like 0.2 m of travel."""


def plan_cost(plan: Plan, task: Task) -> float:
    """What alternatives are ranked by: travel of both grippers [m] + 0.001 m^2 / least clearance of the cable."""
    travel, clearance = travel_and_clearance(plan, task)
    return travel + CLEARANCE_WEIGHT / max(clearance, 1e-4)


def travel_and_clearance(plan: Plan, task: Task) -> tuple[float, float]:
    """Travel of both grippers together and least clearance of the cable, [m] each."""
    travel = float(SE2.distance(plan.poses[1:], plan.poses[:-1])[0].sum())
    return travel, float(cable_clearance(plan.shapes, task).min())


def find_alternatives(search: Search, count: int, default: Callable[[], Plan]) -> tuple[Plan, ...]:
    """Up to `count` plans of different homotopy classes, in the order of their cost.

    Args:
        search: Of the task.
        count: Plans wanted.
        default: Finds the plan that is found where no alternatives are asked for; it is one of them.

    Raises:
        PlanningError: There is none at all, or the task is infeasible.
        OutOfTime: The time ran out before there was one.
    """
    found: dict[tuple[int, ...], Plan] = {}
    task, config = search.task, search.config

    def is_known(plan: Plan) -> str:
        known = motion_class(task, plan.shapes) in found
        return "the plan goes round the obstacles as an earlier one does" if known else ""

    def add(plan: Plan) -> None:
        found[motion_class(task, plan.shapes)] = plan

    try:
        _add_default(add, default)
        routes = different_routes(task, config.pivot, search.seed, SEARCHES_EACH * count)
        while len(found) < count and (route := next(routes, None)) is not None:
            if signature(task.scene, route) in found:
                continue
            trajectories, names = search.trajectories(route), config.initial_trajectories
            plans = (search.follow(trajectories, name, is_known) for name in routed(names))
            plan = next((plan for plan in plans if plan is not None), None)
            if plan is not None:
                add(plan)
    except (OutOfTime, Cancelled, KeyboardInterrupt):
        if not found:
            raise
    if not found:
        raise search.nothing("with any initial trajectory, nor along any other pivot path")
    return tuple(sorted(found.values(), key=lambda plan: plan_cost(plan, task)))


def _add_default(add: Callable[[Plan], None], default: Callable[[], Plan]) -> None:
    """Add the default plan where there is one; one for which the task is infeasible ends the search."""
    try:
        add(default())
    except PlanningError as error:
        if Outcome(error.outcome) is Outcome.INFEASIBLE:
            raise
