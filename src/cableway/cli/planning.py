"""Planning at the edge, shared by `plan` and `run`: options, stage times, and the files that are left."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from cableway.cli import outputs
from cableway.cli.options import Options
from cableway.cli.terminal import StageTimer, Tell, Terminal
from cableway.core.errors import InputError, PlanningError, PlanningInterrupted

if TYPE_CHECKING:
    from cableway.planning.config import PlannerConfig
    from cableway.records import Plan
    from cableway.report import Report
    from cableway.scene.task import Task
    from cableway.verification import VerificationLimits


@dataclass(frozen=True, kw_only=True)
class PlanOptions(Options):
    """Options of the commands that plan."""

    task: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="TASK")]
    """Name in the catalogue, or a YAML file."""

    planner: Annotated[str, tyro.conf.arg(metavar="NAME")] = "default"
    """default, paper, or one to compare with: paper-refined, straight, slide, rrt-connect."""

    pivot: Annotated[str | None, tyro.conf.arg(metavar="{grid,rrt_star}")] = None
    """How the pivot path is found; as the planner has it unless given."""

    time_limit: float = 30.0
    """Seconds after which the search for a plan ends; a search that it does not cut short gives the same plan."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.time_limit > 0:
            raise InputError(f"--time-limit must be positive, got {self.time_limit}")

    def planner_config(self) -> PlannerConfig:
        """The planner's configuration that the options ask for.

        Raises:
            UnknownNameError: There is no such planner or pivot method; the message lists them.
        """
        from cableway.workflow.registry import make_planner

        config = make_planner(self.planner).config
        return config if self.pivot is None else replace(config, pivot=_with_method(config.pivot, self.pivot))


def _with_method(pivot: Any, method: str) -> Any:
    return replace(pivot, method=method)


@dataclass(frozen=True, kw_only=True)
class Planned:
    """What planning gave.

    Attributes:
        plan: The plan, or None where there is none.
        report: Of planning alone.
        timings: Wall time of each stage [s].
        config: The planner's configuration.
        notes: Sentences for the reader of the report.
        push: Where the task has a port, the plan of the push into it.
    """

    plan: Plan | None
    report: Report
    timings: Mapping[str, float]
    config: PlannerConfig
    notes: tuple[str, ...]
    push: Plan | None = None


def plan_into(
    folder: Path,
    task: Task,
    options: PlanOptions,
    terminal: Terminal,
    tell: Tell,
    *,
    alternatives: int = 1,
    rehearsal: bool = False,
) -> Planned:
    """Plan a task and leave plan, picture, report and task in a folder, in place of what was there.

    With more than one of `alternatives` there are also the other plans and a picture of all of them; with `rehearsal`
    the plan is tried in simulation where the cable asks for it.

    A folder is left as it was until there is something to write, so an interrupt costs nothing.
    """
    from cableway.core.provenance import describe
    from cableway.planning.planner import plan as find_plan
    from cableway.report import summarize

    config, seed = options.planner_config(), options.seed or 0
    notes = _compile(terminal, tell)
    timer = StageTimer(tell)
    timer("set up", 0.0)
    common: dict[str, Any] = {"timings": timer.seconds, "seed": seed, "notes": notes, "limits": config.limits}
    try:
        deadline = time.monotonic() + options.time_limit
        search: dict[str, Any] = {"seed": seed, "config": config, "progress": timer}
        search["expired"] = lambda: time.monotonic() > deadline
        push = _plan_push(task, config.limits, timer)
        if alternatives > 1:
            plans = find_plan(task, alternatives=alternatives, **search)
        else:
            plans = [_plan(task, search, timer, rehearsal)]
    except PlanningError as error:
        timer.stop()
        configuration = {"plan": {"planner": describe(config)}}
        report = summarize(task, None, attempt=error.attempt, problem=str(error), configuration=configuration, **common)
        _write_attempt(folder, task, report, error)
        if isinstance(error, PlanningInterrupted):
            raise KeyboardInterrupt from None
        return Planned(plan=None, report=report, timings=timer.seconds, config=config, notes=notes)
    if len(plans) < alternatives:
        common["notes"] = notes = (*notes, f"Of {alternatives} alternatives {len(plans)} were found.")
    common["notes"] = notes = (*notes, *_rehearsal_notes(plans[0]))
    report = summarize(task, plans[0], push=push, **common)
    _write_plans(folder, task, report, plans)
    if push is not None:
        push.save(folder / outputs.PUSH)
    return Planned(plan=plans[0], report=report, timings=timer.seconds, config=config, notes=notes, push=push)


def _plan(task: Task, search: Mapping[str, Any], tell: Tell, rehearsal: bool) -> Plan:
    """One plan, rehearsed where that is wanted and the cable asks for it.

    Raises:
        PlanningError: There is none.
    """
    from cableway.planning.planner import plan

    if not rehearsal:
        return plan(task, **search)
    from cableway.workflow.rehearsal import rehearsed_plan

    return rehearsed_plan(task, lambda seed: plan(task, **{**search, "seed": seed}), seed=search["seed"], progress=tell)


def _rehearsal_notes(plan: Plan) -> tuple[str, ...]:
    """What the rehearsal came to, for the reader of the report."""
    record = plan.metadata.get("rehearsal")
    if record is None:
        return ()
    deviation, clearance = (f"{1000 * record[name]:.1f} mm" for name in ("deviation", "clearance"))
    went = f"largest deviation {deviation}, clearance {clearance}, final error {1000 * record['shape_error']:.1f} mm"
    if record["passed"]:
        return (f"The plan is number {record['plans']} of those rehearsed on the simulated cable: {went}.",)
    return (f"None of {record['plans']} plans went well in rehearsal on the simulated cable; the best: {went}.",)


def _plan_push(task: Task, limits: VerificationLimits, tell: Tell) -> Plan | None:
    """The push into the task's port, if it has one.

    Raises:
        PlanningError: None verifies.
    """
    if task.port is None:
        return None
    from cableway.planning.insertion import plan_push

    tell("push", 0.0)
    push = plan_push(task, limits)
    tell("push", 1.0)
    return push


def _compile(terminal: Terminal, tell: Tell) -> tuple[str, ...]:
    """Compile the kernels where that is yet to be done; what the report is to say about it."""
    from cableway.core.compiled import is_compiled

    if is_compiled("planning"):
        return ()
    from cableway.planning.compilation import compile_kernels

    terminal.note("Compiling the planner's kernels; this happens once, the next run finds them in your cache folder.")
    tell("compilation", 0.0)
    start = time.monotonic()
    compile_kernels()
    tell("compilation", 1.0)
    return (f"Before planning, kernels were compiled for {time.monotonic() - start:.0f} s, which happens once.",)


def _write_plans(folder: Path, task: Task, report: Report, plans: Sequence[Plan]) -> None:
    from cableway.figures.plan import alternatives_figure, plan_figure
    from cableway.figures.style import save_figure
    from cableway.scene.files.saving import save_task

    figure = plan_figure(task, plans[0])
    together = alternatives_figure(task, [plan.shapes for plan in plans]) if len(plans) > 1 else None
    outputs.clear(folder)
    for place, plan in enumerate(plans, start=1):
        plan.save(folder / outputs.alternative(place))
    save_task(task, folder / outputs.TASK)
    outputs.write_report(folder, report)
    save_figure(figure, folder / outputs.PLAN_PICTURE)
    if together is not None:
        save_figure(together, folder / outputs.ALTERNATIVES_PICTURE)


def _write_attempt(folder: Path, task: Task, report: Report, error: PlanningError) -> None:
    from cableway.figures.plan import attempt_figure
    from cableway.figures.style import save_figure
    from cableway.records import Attempt
    from cableway.scene.files.saving import save_task

    figure = attempt_figure(task, error.attempt or Attempt(reason=str(error)))
    outputs.clear(folder)
    save_task(task, folder / outputs.TASK)
    outputs.write_report(folder, report)
    save_figure(figure, folder / outputs.PLAN_PICTURE)
