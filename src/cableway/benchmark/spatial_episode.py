"""One episode in space: planned and judged, then led along the plan in simulation."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any

from cableway.core.errors import InputError, PlanningError, UnknownNameError
from cableway.core.extras import require
from cableway.outcome import Outcome
from cableway.planning.spatial_planner import plan_in_space
from cableway.records import Attempt, Plan, Rollout, Verdict
from cableway.report import rollout_figures
from cableway.scene.spatial.task import SpatialTask
from cableway.tasks.space.generation import random_spatial_task
from cableway.workflow.run import TIME_LIMIT
from cableway.workflow.spatial_run import CONTROLLERS, follow_in_space

METHODS = {"cableway": next(iter(CONTROLLERS)), **{name: name for name in CONTROLLERS}}
"""Controller in space of each method; all have the same planner."""


@dataclass(frozen=True)
class SpatialRun:
    """What became of an episode.

    Attributes:
        figures: Of its result, by name.
        draw: Makes its picture, a PNG file's content.
    """

    figures: dict[str, Any]
    draw: Callable[[], bytes]


def require_in_space(method: str, deadline: float | None) -> None:
    """Check that a method, by name, can be run in space.

    Raises:
        UnknownNameError: It cannot; the message lists those that can.
        InputError: There is a deadline of control steps.
        MissingExtraError: Coal, which the judge needs, is not installed.
    """
    if method not in METHODS:
        raise UnknownNameError("method in space", method, METHODS)
    if deadline is not None:
        raise InputError(f"in space there is no deadline of control steps yet, got {deadline:g} s")
    require("cell", "the verification of plans in space,")


@cache
def warm_up_in_space() -> None:
    """Compile and load what episodes need, so that no figure of time has that in it: by a way through a window, of
    which no straight search finds any."""
    task = random_spatial_task(0, "window")
    follow_in_space(task, plan_in_space(task))


def run_in_space(task: SpatialTask, method: str, seed: int) -> SpatialRun:
    """Plan a task and lead the nominal cable along the plan, unless arms hold it, which are not simulated.

    Args:
        task: The task.
        method: A name of `METHODS`.
        seed: Of the planner and of the noise.
    """
    begun = time.process_time()
    try:
        plan = plan_in_space(task, seed=seed, expired=lambda: time.process_time() - begun > TIME_LIMIT)
    except PlanningError as error:
        figures = {"outcome": Outcome(error.outcome), "detail": str(error), "planned": False}
        attempt, reason = error.attempt or Attempt(""), str(error)
        return SpatialRun(figures | _taken(begun), lambda: _plan_picture(task, attempt, reason))
    figures = {"planned": True, **_taken(begun)}
    if task.cell is not None:
        return SpatialRun({**figures, **_judged(plan)}, lambda: _plan_picture(task, plan, ""))
    rollout, verdict, outcome, detail = follow_in_space(task, plan, controller=METHODS[method], seed=seed)
    figures |= {"outcome": outcome, "detail": detail, "success": outcome is Outcome.SUCCESS}
    if rollout is None or verdict is None:
        return SpatialRun(figures, lambda: _plan_picture(task, plan, detail))
    return SpatialRun(figures | _measured(task, rollout, verdict), lambda: _rollout_picture(task, rollout, detail))


def _taken(begun: float) -> dict[str, float]:
    return {"planning_time": time.process_time() - begun}


def _judged(plan: Plan) -> dict[str, Any]:
    assert plan.verdict is not None
    values = {check.name: check.value for check in plan.verdict.checks}
    clearance = min(values["cable clearance"], values["gripper clearance"])
    return {"outcome": Outcome.SUCCESS, "success": True, "verified": True, "clearance": clearance, "steps": plan.steps}


def _measured(task: SpatialTask, rollout: Rollout, verdict: Verdict) -> dict[str, Any]:
    found = rollout_figures(rollout, task.keypoints("goal"))
    control, kept = found["control_time"], {check.name: check.passed for check in verdict.checks}
    return {
        **{name: found[name] for name in ("shape_error", "mean_keypoint_error", "steps")},
        "contact": not rollout.least_clearance > 0,
        "clearance": rollout.least_clearance,
        "verified": verdict.passed,
        "deviation": found["largest_deviation"],
        "within_limits": kept["gripper step"] and kept["gripper turn"],
        **({} if control is None else {f"control_{name}": seconds for name, seconds in asdict(control).items()}),
    }


def _plan_picture(task: SpatialTask, made: Plan | Attempt, reason: str) -> bytes:
    from cableway.figures.space import spatial_plan_figure
    from cableway.figures.style import figure_png

    return figure_png(spatial_plan_figure(task, made, reason))


def _rollout_picture(task: SpatialTask, rollout: Rollout, reason: str) -> bytes:
    from cableway.figures.space import spatial_rollout_figure
    from cableway.figures.style import figure_png

    return figure_png(spatial_rollout_figure(task, rollout, reason or None))
