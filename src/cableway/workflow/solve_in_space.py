"""One run of a task in space, from the plan to the report, as `workflow.solve` has it on the table."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from cableway.core.compiled import clock, is_compiled, mark_compiled
from cableway.core.errors import Cancelled, PlanningError
from cableway.outcome import Outcome
from cableway.planning.planner import plan as find_plan
from cableway.records import Attempt, Plan, Rollout
from cableway.report import Report, rollout_figures
from cableway.scene.spatial.task import SpatialTask
from cableway.simulation.spatial_perturbation import SpatialPerturbation
from cableway.tracking import Row
from cableway.tracking.photographer import EyesConfig
from cableway.verification.record import require_verified
from cableway.workflow.compilation import COMPILING
from cableway.workflow.events import Finished, Listener, Note, OnEvent, Planned, Progress
from cableway.workflow.run import TIME_LIMIT
from cableway.workflow.spatial_run import follow_in_space, require_without_arms

COMPILED = "planning in space"
"""The stage whose kernels a first plan compiles."""


@dataclass(frozen=True, kw_only=True)
class SpatialOptions:
    """How a task in space is solved.

    Attributes:
        plan: Followed in place of one that is sought; a `Plan`, or the file of one. It must verify.
        controller: One of `spatial_run.CONTROLLERS`, which leads the simulated cable along the plan; None for a plan
            alone.
        perturbation: How the simulated cable differs; not at all where None.
        eyes: Cameras by which the controller knows the cable, by its markers; None where it gets the plant's keypoints.
        seed: Of everything random.
        time_limit: Time [s] after which the search for a plan ends.
        clock: What that is measured by; wall time where None.
    """

    plan: Plan | Path | None = None
    controller: str | None = None
    perturbation: SpatialPerturbation | None = None
    eyes: EyesConfig | None = None
    seed: int = 0
    time_limit: float = TIME_LIMIT
    clock: Callable[[], float] | None = None


@dataclass(frozen=True, kw_only=True)
class SpatialRun:
    """A task in space with what became of it; None for what it did not come to.

    Attributes:
        task: The task.
        report: The verdict with all figures.
        plan: What was found, or followed.
        attempt: What came closest to a plan, where none was found.
        rollout: What happened along the plan.
        timings: Wall time [s] of each stage of planning.
    """

    task: SpatialTask
    report: Report
    plan: Plan | None = None
    attempt: Attempt | None = None
    rollout: Rollout | None = None
    timings: Mapping[str, float] = field(default_factory=dict)

    @property
    def success(self) -> bool:
        """Whether the task succeeded; see `cableway.report.judge`."""
        return self.report.success


def solve_in_space(
    task: SpatialTask, options: SpatialOptions | None = None, on_event: OnEvent | None = None
) -> SpatialRun:
    """Plan a task in space, and lead the simulated cable along the plan where there is a controller.

    Args:
        task: The task.
        options: How; the defaults where None.
        on_event: Called with each event, see `cableway.workflow.events`; it may stop the run.

    Returns:
        All there is, also where no plan was found: the report says why.

    Raises:
        InputError: The options give a plan that is none of the task, a controller that is not known, or one for a task
            with arms.
        MissingExtraError: Coal, which the judge needs, is not installed.
    """
    options, listener = options or SpatialOptions(), Listener(on_event)
    if options.controller is not None:
        require_without_arms(task)
    run = _planned(task, options, listener) if options.plan is None else _given(task, options.plan)
    listener.emit(Planned(run))
    if options.controller is not None and run.plan is not None:
        listener.emit(Progress("run", 0.0))
        run = _followed(run, options, listener)
    listener.emit(Finished(run))
    return run


def _planned(task: SpatialTask, options: SpatialOptions, listener: Listener) -> SpatialRun:
    """With a new plan, or why there is none."""
    if not is_compiled(COMPILED):
        listener.emit(Note(COMPILING))
    begun, timer = clock(), options.clock or clock
    deadline = timer() + options.time_limit
    plan, attempt, failure, outcome = None, None, None, Outcome.SUCCESS
    try:
        plan = find_plan(task, seed=options.seed, progress=listener.progress, expired=lambda: timer() > deadline)
        mark_compiled(COMPILED)
    except PlanningError as error:
        failure, outcome, attempt = str(error), Outcome(error.outcome), error.attempt
    except Cancelled as error:
        failure, outcome = str(error), Outcome.INTERRUPTED
    timings = {"planning": clock() - begun}
    report = Report(
        task=task.name, outcome=outcome, failure=failure, seed=options.seed, planning_time=timings["planning"],
        **_figures(plan),
    )  # fmt: skip
    return SpatialRun(task=task, report=report, plan=plan, attempt=attempt, timings=timings)


def _given(task: SpatialTask, given: Plan | Path) -> SpatialRun:
    """With a plan that there is.

    Raises:
        InputError: It is none of this task, or does not verify.
    """
    plan, source = (given, "the plan") if isinstance(given, Plan) else (Plan.load(given), str(given))
    plan = plan.judged(require_verified(plan, task, source))
    report = Report(task=task.name, outcome=Outcome.SUCCESS, failure=None, seed=None, **_figures(plan))
    return SpatialRun(task=task, report=report, plan=plan)


def _followed(run: SpatialRun, options: SpatialOptions, listener: Listener) -> SpatialRun:
    """With what became of the plan."""
    assert run.plan is not None
    assert options.controller is not None
    rollout, verdict, outcome, failure = follow_in_space(
        run.task, run.plan, controller=options.controller, perturbation=options.perturbation, eyes=options.eyes,
        seed=options.seed, on_row=partial(_told, listener),
    )  # fmt: skip
    if rollout is None:
        return replace(run, report=replace(run.report, outcome=outcome, failure=failure))
    configuration = {"plan": run.report.configuration, "rollout": rollout.metadata["configuration"]}
    report = replace(
        run.report, outcome=outcome, failure=failure or None, seed=options.seed, rollout_verdict=verdict,
        configuration=configuration, **rollout_figures(rollout, run.task.keypoints("goal")),
    )  # fmt: skip
    return replace(run, report=report, rollout=rollout)


def _told(listener: Listener, row: Row) -> None:
    """Pass a row on.

    Raises:
        Cancelled: The run is to stop.
    """
    listener.row(row)
    if listener.cancelled:
        raise Cancelled("the run was cancelled")


def _figures(plan: Plan | None) -> dict[str, Any]:
    """What the verdict and the metadata say of a plan."""
    if plan is None or plan.verdict is None:
        return {}
    values = {check.name: check.value for check in plan.verdict.checks}
    return {
        "plan_steps": plan.steps,
        "plan_verdict": plan.verdict,
        "min_clearance": values["cable clearance"],
        "gripper_clearance": values["gripper clearance"],
        "versions": plan.metadata.get("versions"),
        "configuration": plan.metadata.get("planner"),
    }
