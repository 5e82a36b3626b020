"""Plans that go round the obstacles in different ways, best first."""

from __future__ import annotations

from cableway.core.errors import Cancelled
from cableway.geometry.groups import SE2
from cableway.motion.clearance import cable_clearance
from cableway.planning.candidates import OutOfTime, Search
from cableway.planning.initial_trajectories import PIVOTED
from cableway.planning.routes.homotopy import different_routes, motion_class
from cableway.records import Plan
from cableway.scene.task import Task

SEARCHES_EACH = 6
"""Pivot paths looked for, for each plan that is asked for."""

CLEARANCE_WEIGHT = 0.001
"""Of one over the least clearance, in `plan_cost` [m^2]: 5 mm count like 0.2 m of travel."""


def plan_cost(plan: Plan, task: Task) -> float:
    """What alternatives are ranked by: travel of both grippers [m] + 0.001 m^2 / least clearance of the cable."""
    travel = float(SE2.distance(plan.poses[1:], plan.poses[:-1])[0].sum())
    clearance = float(cable_clearance(plan.shapes, task).min())
    return travel + CLEARANCE_WEIGHT / max(clearance, 1e-4)


def find_alternatives(search: Search, count: int) -> tuple[Plan, ...]:
    """Up to `count` plans of different homotopy classes, in the order of their cost.

    Raises:
        PlanningError: There is none at all.
        OutOfTime: The time ran out before there was one.
    """
    found: dict[tuple[int, ...], Plan] = {}
    task, config = search.task, search.config

    def is_known(plan: Plan) -> str:
        known = motion_class(task, plan.shapes) in found
        return "the plan goes round the obstacles as an earlier one does" if known else ""

    try:
        for route in different_routes(task, config.pivot, search.seed, SEARCHES_EACH * count):
            trajectories, names = search.trajectories(route=lambda route=route: route), config.initial_trajectories
            plans = (search.follow(trajectories, name, is_known) for name in names if name in PIVOTED)
            plan = next((plan for plan in plans if plan is not None), None)
            if plan is not None:
                found[motion_class(task, plan.shapes)] = plan
            if len(found) == count:
                break
    except (OutOfTime, Cancelled, KeyboardInterrupt):
        if not found:
            raise
    if not found:
        raise search.blocked() or search.nothing("along any pivot path")
    return tuple(sorted(found.values(), key=lambda plan: plan_cost(plan, task)))
