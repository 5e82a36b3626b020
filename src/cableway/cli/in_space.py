"""What `cableway plan` and `cableway run` do with a task in space: its files, pictures and report."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cableway.cli import outputs
from cableway.cli.interrupts import INTERRUPTS
from cableway.cli.terminal import OnProgress, Terminal, pairs
from cableway.core.compiled import clock, is_compiled, mark_compiled
from cableway.core.errors import InputError

if TYPE_CHECKING:
    from cableway.cli.planning import PlanOptions
    from cableway.records import Plan, Rollout
    from cableway.report import Report
    from cableway.scene.spatial.task import SpatialTask
    from cableway.simulation.spatial_perturbation import SpatialPerturbation


SPACE = "planning in space"
"""The stage whose kernels a first plan compiles."""


def refuse(task: SpatialTask, chosen: dict[str, bool]) -> None:
    """Refuse options that tasks in space do not have.

    Args:
        task: The task.
        chosen: Which options of the command are given.

    Raises:
        InputError: One is.
    """
    names = ", ".join(name for name, given in chosen.items() if given)
    if names:
        raise InputError(f"the task {task.name!r} is in space, where there is no {names} yet")


def leave_in_space(
    options: PlanOptions,
    task: SpatialTask,
    since: float,
    *,
    controller: str | None = None,
    plan: Path | None = None,
    perturbation: SpatialPerturbation | None = None,
) -> int:
    """Plan, run where there is a controller, leave the files in the folder, show the report; the exit status.

    Args:
        options: Of the command.
        task: The task.
        since: When reading it began, by `time.perf_counter`.
        controller: What leads the simulated cable along the plan; None for a plan alone.
        plan: File of a plan of the task, in place of a new one.
        perturbation: How the simulated cable differs; not at all where None.
    """
    from cableway.core.files import only_writer
    from cableway.figures.space import spatial_plan_figure, spatial_rollout_figure
    from cableway.scene.files.saving import save_task

    terminal, folder = Terminal(options), options.folder(task.name)
    if plan is None and not is_compiled(SPACE):
        from cableway.workflow.compilation import COMPILING

        terminal.note(COMPILING)
    with only_writer(folder), terminal.progress() as progress:
        left = options.time_limit - (time.perf_counter() - since)
        report, found, shapes = _planned(options, task, left, progress) if plan is None else _given(task, plan)
        rollout = None
        if controller is not None and found is not None:
            progress("run", 0.0)
            report, rollout = _followed(report, task, found, controller, perturbation, options.seed or 0)
        outputs.clear(folder)
        if found is not None:
            found.save(folder / outputs.PLAN)
        if rollout is not None:
            rollout.save(folder / outputs.ROLLOUT)
        save_task(task, folder / outputs.TASK)
        outputs.write_report(folder, report)
        failure = report.failure if rollout is None else None
        options.draw(spatial_plan_figure(task, shapes, failure), folder / outputs.PLAN_PICTURE)
        if rollout is not None:
            options.draw(spatial_rollout_figure(task, rollout, report.failure), folder / outputs.ROLLOUT_PICTURE)
    outputs.announce(terminal, folder, report)
    terminal.result(report.as_dict(), pairs(report.rows()))
    return 0 if report.success else 1


def _planned(
    options: PlanOptions, task: SpatialTask, left: float, progress: OnProgress
) -> tuple[Report, Plan | None, Any]:
    """The report on a new plan, the plan, and its shapes or those of the closest attempt [m]."""
    from cableway.core.errors import PlanningError
    from cableway.outcome import Outcome
    from cableway.planning.planner import plan as plan_task
    from cableway.report import Report

    begun, found, failure, seed = clock(), None, None, options.seed or 0
    try:
        found = plan_task(
            task, seed=seed, progress=progress, expired=lambda: clock() - begun > left or bool(INTERRUPTS.came)
        )
        shapes, outcome = found.shapes, Outcome.SUCCESS
        mark_compiled(SPACE)
    except PlanningError as error:
        failure, outcome = str(error), Outcome(error.outcome)
        shapes = error.attempt.shapes if error.attempt is not None else None
    report = Report(
        task=task.name, outcome=outcome, failure=failure, seed=seed, planning_time=clock() - begun, **_figures(found),
    )  # fmt: skip
    return report, found, shapes


def _given(task: SpatialTask, file: Path) -> tuple[Report, Plan, Any]:
    """The same of a plan in a file.

    Raises:
        InputError: It is none of this task, or does not verify.
    """
    from cableway.outcome import Outcome
    from cableway.records import Plan
    from cableway.report import Report
    from cableway.verification.record import require_verified

    found = Plan.load(file)
    found = found.judged(require_verified(found, task, str(file)))
    report = Report(task=task.name, outcome=Outcome.SUCCESS, failure=None, seed=None, **_figures(found))
    return report, found, found.shapes


def _followed(
    report: Report, task: SpatialTask, plan: Plan, controller: str, perturbation: SpatialPerturbation | None, seed: int
) -> tuple[Report, Rollout | None]:
    """The report with what became of the plan, and the rollout if there is one."""
    from cableway.report import rollout_figures
    from cableway.workflow.spatial_run import follow_in_space

    rollout, verdict, outcome, failure = follow_in_space(
        task, plan, controller=controller, perturbation=perturbation, seed=seed
    )
    if rollout is None:
        return replace(report, outcome=outcome, failure=failure), None
    figures = rollout_figures(rollout, task.keypoints("goal"))
    configuration = {"plan": report.configuration, "rollout": rollout.metadata["configuration"]}
    report = replace(
        report, outcome=outcome, failure=failure or None, seed=seed, rollout_verdict=verdict,
        configuration=configuration, **figures,
    )  # fmt: skip
    return report, rollout


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
