"""One run of a task, from the plan to the report. Command line, benchmark, studies and scripts all go through it."""

from __future__ import annotations

from dataclasses import replace

from cableway.core.checks import require_type
from cableway.planning.moved_ends import MovedEnds, set_up
from cableway.scene.files.loading import TaskSource
from cableway.workflow.compilation import Compilation
from cableway.workflow.events import Finished, Listener, Note, OnEvent, Planned
from cableway.workflow.find import find
from cableway.workflow.follow import follow, needs_kernels, prepare_controller, stopped
from cableway.workflow.own_plant import prepare_plant
from cableway.workflow.run import Run, SolveOptions


def solve(task: TaskSource | MovedEnds, options: SolveOptions | None = None, on_event: OnEvent | None = None) -> Run:
    """Solve a task: plan, rehearse, track and recover, insert, verify, report.

    Args:
        task: The task, or its name or file, or one whose ends were moved already.
        options: How; the defaults where None.
        on_event: Called with progress and partial results, see `cableway.workflow.events`; it may stop the run.

    Returns:
        All there is. `report.outcome` says how it ended, also where no plan was found, the plant failed or the run was
        cancelled; `report.failure` says why.

    Raises:
        InputError: The options name something that is not known, or do not fit the task, as a plan of another one.
        KeyboardInterrupt: The run was interrupted from the keyboard; `Finished` has come with what there is.
    """
    options, listener = SolveOptions() if options is None else options, Listener(on_event)
    require_type(options, SolveOptions, "options")
    moved = task if isinstance(task, MovedEnds) else set_up(task, options.cell, move=options.move_ends)
    task = moved.task.at_speed(options.speed)
    if options.plant is None:
        options = replace(options, perturbation=options.perturbation.resolved(task))
    for note in moved.notes():
        listener.emit(Note(note))
    controller = prepare_controller(options, listener) if options.track else None
    plant = prepare_plant(task, options, listener) if options.track else None
    with Compilation(listener, tracking=controller is not None and needs_kernels(options)) as compilation:
        # plan, rehearsal, plan of the insertion, verification
        run = _noted(find(task, options, listener, (*moved.notes(), *compilation.for_planning())), moved)
        listener.emit(Planned(run))
        if controller is not None and run.plan is not None:
            compilation.for_tracking()
            run = stopped(run) if listener.cancelled else follow(run, options, controller, plant, listener)
    listener.emit(Finished(run))
    if listener.interrupted:
        raise KeyboardInterrupt
    return run


def _noted(run: Run, moved: MovedEnds) -> Run:
    """A run whose plans say by how much the ends of the task were moved [m]."""
    if run.plan is None or not moved.moved:
        return run
    record = {"moved_ends": dict(moved.moved)}
    plan, *others = (plan.noted(**record) for plan in (run.plan, *run.alternatives))
    return replace(run, plan=plan, alternatives=tuple(others))
