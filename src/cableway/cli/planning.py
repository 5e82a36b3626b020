"""What `plan` and `run` share: the options, and the files that a run leaves as it goes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from cableway.cli import outputs
from cableway.cli.interrupts import INTERRUPTS
from cableway.cli.options import Flag, PictureOptions, TaskOptions, option
from cableway.cli.terminal import OnProgress, Terminal, pairs
from cableway.core.errors import InputError
from cableway.planning.named import PLANNERS
from cableway.workflow.registry import CONTROLLERS, DEFAULT_PLANNER, Planner, make_planner

if TYPE_CHECKING:
    from cableway.figures.style import Figure
    from cableway.planning.moved_ends import MovedEnds
    from cableway.scene.files.loading import AnyTask
    from cableway.scene.task import Task
    from cableway.studio.watch import Watch
    from cableway.workflow.events import Event, OnEvent
    from cableway.workflow.run import Run, SolveOptions
    from cableway.workflow.solve_in_space import SpatialOptions

CONTROLLER_NAMES = "{" + ",".join(CONTROLLERS) + ",package.module:Class}"
PLANNER_NAMES = "{" + ",".join(PLANNERS) + "}"
CELL_NAMES = (
    "{dual-ur5e,dual-ur5e-long-fingers,dual-ur5e-hand-e,dual-ur5e-tilted,dual-ur5e-tilted-aside,dual-ur10e,FILE.yaml}"
)
LEAST_TIME = 1e-3
"""Time limit [s] of a search for which reading the task left none."""

Draw = Callable[["Figure", Path], None]
"""Writes a picture to a file."""

UNTRACKED = "the run ended before its plan was tracked"


@dataclass(frozen=True, kw_only=True)
class PlanOptions(PictureOptions, TaskOptions):
    """Options of the commands that plan."""

    planner: Annotated[str, tyro.conf.arg(metavar=PLANNER_NAMES)] = DEFAULT_PLANNER
    """The planner; tang2025 is that of Tang et al., the others are baselines for comparison."""

    pivot: Annotated[str | None, option(metavar="{grid,rrt_star}")] = None
    """How the pivot path is found; by default, as the planner does."""

    cell: Annotated[str | None, option(metavar=CELL_NAMES)] = None
    """Arms that hold the grippers: a plan has their joints, and neither they nor the hands touch anything. By default,
    what the task says, else grippers alone."""

    move_ends: Flag = False
    """Move a start or goal that hands or arms cannot hold to the nearest shape found that they can, and say by how
    much."""

    time_limit: float = 30.0
    """Seconds after which the search for a plan stops, reading the task included; files and pictures are written after
    that. A search that ends earlier does not depend on it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.time_limit > 0:
            raise InputError(f"--time-limit must be positive, got {self.time_limit}")

    def load(self) -> Task:
        """See `TaskOptions.load`; in the cell that is asked for, its ends moved if they may be.

        Raises:
            InputError: There is no such cell, or the task leaves its hands no room.
        """
        return self.moved.task

    @cached_property
    def moved(self) -> MovedEnds:
        """The task of `load`, with what was moved."""
        from cableway.core.errors import TaskError
        from cableway.planning.moved_ends import set_up
        from cableway.scene.files.loading import load_cell

        source = self.task if self.move_ends else super().load()
        if self.cell is None:
            return set_up(source, move=self.move_ends)
        cell = load_cell(self.cell)
        try:
            return set_up(source, cell, move=self.move_ends)
        except TaskError as error:
            raise InputError(f"{self.task} in the cell {cell.name}: {error}") from None

    def planar_options(self) -> dict[str, bool]:
        """Which options are given that tasks in space do not have."""
        return {
            "--planner": self.planner != DEFAULT_PLANNER,
            "--pivot": self.pivot is not None,
            "--move-ends": self.move_ends,
        }

    def chosen_planner(self) -> Planner:
        """The planner that the options ask for.

        Raises:
            UnknownNameError: There is no such planner or pivot method; the message lists them.
        """
        planner = make_planner(self.planner)
        if self.pivot is None:
            return planner
        pivot: Any = replace(planner.config.pivot, method=self.pivot)
        return replace(planner, config=replace(planner.config, pivot=pivot))

    @staticmethod
    def watched(task: AnyTask, options: SolveOptions | SpatialOptions, terminal: Terminal) -> Watch:
        """The page that shows a run."""
        import webbrowser

        from cableway.studio.watch import Watch

        watch = Watch(task, options)
        terminal.note(f"{watch.address} (closing that page ends the command)")
        webbrowser.open(watch.address)
        return watch

    def solve(self, task: Task, *, since: float, video: bool = False, watch: bool = False, **options: Any) -> int:
        """Solve the task, leave its files in the folder, show the report and return the exit status.

        Args:
            task: The task.
            since: When reading it began, by `cableway.core.compiled.clock`.
            video: Whether a video is made of the rollout.
            watch: Whether the run is shown on a page; the command then goes on until that is closed.
            options: Of `SolveOptions`.
        """
        from cableway.core.compiled import clock
        from cableway.core.files import only_writer
        from cableway.workflow.run import SolveOptions
        from cableway.workflow.solve import solve

        terminal, folder = Terminal(self), self.folder(task.name)
        left = max(self.time_limit - (clock() - since), LEAST_TIME)
        chosen = SolveOptions(planner=self.chosen_planner(), seed=self.seed or 0, time_limit=left, **options)
        page = self.watched(task, chosen, terminal) if watch else None
        with only_writer(folder), terminal.progress() as progress:
            shown = _shown(terminal, progress, folder, self.draw, tracked=chosen.track)
            run = solve(self.moved, chosen, shown if page is None else both(shown, page))
            INTERRUPTS.release()
            if video and run.rollout is not None:
                from cableway.figures.video import write_video

                write_video(folder / outputs.VIDEO, task, run.rollout, run.insertion, plan=run.plan, progress=progress)
        outputs.announce(terminal, folder, run.report)
        terminal.result(run.report.as_dict(), pairs(run.report.rows()))
        if page is not None:
            page.linger()
            page.close()
        return 0 if run.success else 1


def both(first: OnEvent, second: OnEvent) -> OnEvent:
    """What tells both of each event; what the first returns counts."""

    def on_event(event: Event) -> Any:
        second(event)
        return first(event)

    return on_event


def _shown(terminal: Terminal, progress: OnProgress, folder: Path, draw: Draw, *, tracked: bool) -> OnEvent:
    """Shows a run at the terminal and leaves its files in a folder as they come.

    The folder stays as it was until there is something to write, so that an interrupt costs nothing. From then on an
    interrupt cancels the run, so that what was tracked until then is kept.
    """
    from cableway.workflow.events import CANCEL, Finished, Note, Planned, Progress
    from cableway.workflow.run import Run

    def on_event(event: Event) -> str | None:
        match event:
            case Progress(stage, share):
                progress(stage, share)
            case Note(text):
                terminal.note(text)
            case Planned(Run() as run):
                INTERRUPTS.hold()
                INTERRUPTS.kept = partial(outputs.listed, folder)
                write_plans(folder, run, draw, tracked=tracked)
            case Finished(Run() as run):
                _write_rollouts(folder, run, draw)
        return CANCEL if INTERRUPTS.came else None

    return on_event


def write_plans(folder: Path, run: Run, draw: Draw, *, tracked: bool) -> None:
    """Write the plans, or where there is none a picture of the closest attempt.

    Until a plan has been tracked, the report calls the run interrupted: so it is right however the run ends.
    """
    from cableway.figures.plan import alternatives_figure, attempt_figure, plan_figure
    from cableway.records import Attempt
    from cableway.scene.files.saving import save_task
    from cableway.workflow.follow import stopped

    plans = [] if run.plan is None else [run.plan, *run.alternatives]
    outputs.clear(folder)
    for place, each in enumerate(plans, start=1):
        each.save(folder / outputs.alternative(place))
    if run.insertion_plan is not None:
        run.insertion_plan.save(folder / outputs.INSERTION_PLAN)
    save_task(run.task, folder / outputs.TASK)
    outputs.write_report(folder, stopped(run, UNTRACKED).report if tracked and run.plan is not None else run.report)
    attempt = run.attempt or Attempt(reason=run.report.failure or "")
    _draw(
        draw,
        folder / outputs.PLAN_PICTURE,
        lambda: attempt_figure(run.task, attempt) if run.plan is None else plan_figure(run.task, run.plan),
    )
    if run.plan is not None and run.plan.joints is not None:
        from cableway.figures.cell import cell_figure

        _draw(draw, folder / outputs.CELL_PICTURE, lambda: run.plan and cell_figure(run.task, run.plan))
    if run.alternatives:
        shapes = [each.shapes for each in plans]
        _draw(draw, folder / outputs.ALTERNATIVES_PICTURE, lambda: alternatives_figure(run.task, shapes))


def _write_rollouts(folder: Path, run: Run, draw: Draw) -> None:
    from cableway.figures.insertion import insertion_figure
    from cableway.figures.replanning import replanning_figure
    from cableway.figures.rollout import estimates_figure, rollout_figure

    plan, rollout, insertion = run.plan, run.rollout, run.insertion
    if rollout is not None:
        rollout.save(folder / outputs.ROLLOUT)
    if insertion is not None:
        insertion.save(folder / outputs.INSERTION)
    outputs.write_report(folder, run.report)
    if rollout is not None:
        _draw(
            draw,
            folder / outputs.ROLLOUT_PICTURE,
            lambda: rollout_figure(
                run.task, rollout, plan=plan, failure=run.report.failure, verdict=run.report.rollout_verdict
            ),
        )
        _draw(draw, folder / outputs.ESTIMATES_PICTURE, lambda: estimates_figure(rollout))
        if plan is not None and rollout.metadata.get("recovered"):
            _draw(draw, folder / outputs.REPLANNING_PICTURE, lambda: replanning_figure(run.task, plan, rollout))
    if insertion is not None:
        _draw(draw, folder / outputs.INSERTION_PICTURE, lambda: insertion_figure(run.task, insertion))


def _draw(draw: Draw, path: Path, figure: Callable[[], Figure | None]) -> None:
    """Make a picture where there is something to draw, unless somebody waits for the command to end."""
    if not INTERRUPTS.came and (made := figure()) is not None:
        draw(made, path)
