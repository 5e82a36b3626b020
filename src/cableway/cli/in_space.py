"""What `cableway plan` and `cableway run` do with a task in space: its files, pictures and report."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from cableway.cli import outputs
from cableway.cli.interrupts import INTERRUPTS
from cableway.cli.terminal import Terminal, pairs
from cableway.core.compiled import clock
from cableway.core.errors import InputError

if TYPE_CHECKING:
    from cableway.cli.planning import PlanOptions
    from cableway.scene.spatial.task import SpatialTask
    from cableway.simulation.spatial_perturbation import SpatialPerturbation
    from cableway.tracking.photographer import EyesConfig
    from cableway.workflow.solve_in_space import SpatialRun


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
    eyes: EyesConfig | None = None,
    video: bool = False,
    watch: bool = False,
) -> int:
    """Plan, run where there is a controller, leave the files in the folder, show the report; the exit status.

    Args:
        options: Of the command.
        task: The task.
        since: When reading it began, by `cableway.core.compiled.clock`.
        controller: What leads the simulated cable along the plan; None for a plan alone.
        plan: File of a plan of the task, in place of a new one.
        perturbation: How the simulated cable differs; not at all where None.
        eyes: Cameras by which the controller knows the cable; None where it gets the plant's keypoints.
        video: Whether a video is made of the run.
        watch: Whether the run is shown on a page; the command then goes on until that is closed.
    """
    from cableway.cli.planning import both
    from cableway.core.files import only_writer
    from cableway.workflow.events import CANCEL, Event, Note, Planned, Progress
    from cableway.workflow.solve_in_space import SpatialOptions, SpatialRun, solve_in_space
    from cableway.workflow.spatial_run import require_without_arms

    if controller is not None:
        require_without_arms(task)
    terminal, folder = Terminal(options), options.folder(task.name)
    chosen = SpatialOptions(
        plan=plan, controller=controller, perturbation=perturbation, eyes=eyes, seed=options.seed or 0,
        time_limit=options.time_limit - (clock() - since),
        clock=lambda: math.inf if INTERRUPTS.came else clock(),
    )  # fmt: skip
    page = options.watched(task, chosen, terminal) if watch else None
    with only_writer(folder), terminal.progress() as progress:

        def on_event(event: Event) -> str | None:
            match event:
                case Progress(stage, share):
                    progress(stage, share)
                case Note(text):
                    terminal.note(text)
                case Planned(SpatialRun() as run):
                    INTERRUPTS.hold()
                    INTERRUPTS.kept = partial(outputs.listed, folder)
                    _leave_plan(options, task, folder, run, tracked=controller is not None)
                case _:
                    pass
            return CANCEL if INTERRUPTS.came else None

        run = solve_in_space(task, chosen, on_event if page is None else both(on_event, page))
        _leave_rollout(options, task, folder, run)
        INTERRUPTS.release()
        if run.rollout is not None and video:
            from cableway.figures.video import write_video

            write_video(folder / outputs.VIDEO, task, run.rollout, progress=progress)
    report = run.report
    outputs.announce(terminal, folder, report)
    terminal.result(report.as_dict(), pairs(report.rows()))
    if page is not None:
        page.linger()
        page.close()
    return 0 if report.success else 1


def _leave_plan(options: PlanOptions, task: SpatialTask, folder: Path, run: SpatialRun, *, tracked: bool) -> None:
    """The files of a plan; `tracked`: that a run is to come, without which the report has it interrupted."""
    from cableway.cli.planning import UNTRACKED
    from cableway.figures.space import spatial_plan_figure
    from cableway.outcome import Outcome
    from cableway.scene.files.saving import save_task

    outputs.clear(folder)
    if run.plan is not None:
        run.plan.save(folder / outputs.PLAN)
    save_task(task, folder / outputs.TASK)
    report, failure = run.report, None if run.plan is not None else run.report.failure
    if tracked and run.plan is not None:
        report = replace(report, outcome=Outcome.INTERRUPTED, failure=UNTRACKED)
    outputs.write_report(folder, report)
    options.draw(spatial_plan_figure(task, run.plan or run.attempt, failure), folder / outputs.PLAN_PICTURE)


def _leave_rollout(options: PlanOptions, task: SpatialTask, folder: Path, run: SpatialRun) -> None:
    """The files of a run that is over: the report, and what was tracked."""
    from cableway.figures.space import spatial_rollout_figure

    if run.rollout is not None:
        run.rollout.save(folder / outputs.ROLLOUT)
    outputs.write_report(folder, run.report)
    if run.rollout is not None:
        figure = spatial_rollout_figure(task, run.rollout, run.report.failure)
        options.draw(figure, folder / outputs.ROLLOUT_PICTURE)
