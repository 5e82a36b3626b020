"""What `cableway plan` does with a task in space: plan.npz, plan.png, report.json and the task itself."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from cableway.cli import outputs
from cableway.cli.interrupts import INTERRUPTS
from cableway.cli.terminal import Terminal, pairs
from cableway.core.compiled import clock

if TYPE_CHECKING:
    from cableway.cli.planning import PlanOptions
    from cableway.records import Plan
    from cableway.scene.spatial.task import SpatialTask


def leave_plan(options: PlanOptions, task: SpatialTask, since: float) -> int:
    """Plan, leave the files in the folder, show the report and return the exit status.

    Args:
        options: Of the command.
        task: The task.
        since: When reading it began, by `time.perf_counter`.
    """
    from cableway.core.errors import PlanningError
    from cableway.core.files import only_writer
    from cableway.figures.space import spatial_plan_figure
    from cableway.outcome import Outcome
    from cableway.planning.planner import plan as plan_task
    from cableway.report import Report
    from cableway.scene.files.saving import save_task

    terminal, folder = Terminal(options), options.folder(task.name)
    left, begun, found, failure, outcome = options.time_limit - (time.perf_counter() - since), clock(), None, None, None
    with only_writer(folder), terminal.progress() as progress:
        try:
            found = plan_task(
                task,
                seed=options.seed or 0,
                progress=progress,
                expired=lambda: clock() - begun > left or bool(INTERRUPTS.came),
            )
            shapes, outcome = found.shapes, Outcome.SUCCESS
        except PlanningError as error:
            failure, outcome = str(error), Outcome(error.outcome)
            shapes = error.attempt.shapes if error.attempt is not None else None
        report = Report(
            task=task.name, outcome=outcome, failure=failure, seed=options.seed or 0, planning_time=clock() - begun,
            plan_steps=None if found is None else found.steps, plan_verdict=None if found is None else found.verdict,
            **_figures(found),
        )  # fmt: skip
        outputs.clear(folder)
        if found is not None:
            found.save(folder / outputs.PLAN)
        save_task(task, folder / outputs.TASK)
        outputs.write_report(folder, report)
        options.draw(spatial_plan_figure(task, shapes, failure), folder / outputs.PLAN_PICTURE)
    outputs.announce(terminal, folder, report)
    terminal.result(report.as_dict(), pairs(report.rows()))
    return 0 if report.success else 1


def _figures(plan: Plan | None) -> dict[str, Any]:
    """What the verdict and the metadata say of a plan."""
    if plan is None or plan.verdict is None:
        return {}
    values = {check.name: check.value for check in plan.verdict.checks}
    return {
        "min_clearance": values["cable clearance"],
        "gripper_clearance": values["gripper clearance"],
        "versions": plan.metadata["versions"],
        "configuration": plan.metadata["planner"],
    }
