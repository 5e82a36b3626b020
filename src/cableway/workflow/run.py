"""What a run is asked for, and what it leaves."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cableway.control.base import Controller, require_controller
from cableway.core.brief import Brief
from cableway.core.checks import Checked, Positive, require_call
from cableway.core.errors import InputError
from cableway.planning.config import PlannerConfig
from cableway.planning.planner import plan as find_plan
from cableway.records import Attempt, Plan, Rollout
from cableway.report import Report
from cableway.scene.cell import Cell
from cableway.scene.task import Task
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.tracking import Plant, Watchdog
from cableway.tracking.eyes import EyesConfig
from cableway.workflow.registry import DEFAULT_CONTROLLER, DEFAULT_PLANNER, Planner, controller_entry, make_planner

TIME_LIMIT = 30.0
"""Time [s] after which a search for a plan ends."""


@dataclass(frozen=True, kw_only=True)
class SolveOptions(Checked):
    """How a task is solved.

    Attributes:
        planner: A name of `planning.named.PLANNERS`, a configuration of the default planner, a `Planner`, or any
            `function(task, seed)` that returns a plan or raises `PlanningError`.
        controller: A name of `registry.CONTROLLERS`, the "package.module:NAME" of one of your own, or a controller.
        model: Name or file of the deformation model, for a controller named that has one.
        adapt: Whether that model is adapted to the cable while it runs.
        cell: A cell, or its name, that the task is put into; None for that which the task has, if any.
        move_ends: Whether a start or goal that the grippers' bodies or the arms cannot hold is moved by as little as is
            needed; the report and the metadata of the plan say by how much.
        plan: Followed in place of one that is sought; a `Plan`, or the file of one. It must verify.
        alternatives: Number of plans wanted that go round the obstacles in different ways; the first is followed.
        perturbation: How the simulated plant differs from the task.
        plant: What makes another plant of the task, in place of the simulated one: a function, a class, or the
            "package.module:NAME" of either. A dry run leaves it alone.
        eyes: Cameras by which the controller knows the cable, where a plant's truth is rendered for them; None where it
            gets the keypoints that the plant reports.
        seed: Of everything random.
        time_limit: Time [s] after which each search for a plan ends: the first one, those of a rehearsal, and those
            of a recovery.
        clock: What that is measured by; wall time where None. By `time.process_time`, other work on the machine does
            not count.
        rehearse: Whether plans for a cable that is no uniform elastic rod, or lies with friction, are tried in
            simulation first.
        follow_unverified: Whether the closest attempt is followed where no plan verifies.
        track: Whether the plan is followed.
        recover: Whether a cable that left its plan is stopped and replanned for; None for all controllers but one named
            that ignores observations.
        speed: Share of the grippers' limits, above 0 and at most 1, with which it is planned and tracked.
        dry_run: Whether the plan is only rehearsed: `Run.rollout` stays None, and `report.commands` says what would be
            sent to the grippers.
        deadline: Wall time [s] after which a control step counts as missed, as on a robot; never where None.

    Raises:
        InputError: A number is out of range, or planner, controller or plant cannot be called as they will be.
    """

    planner: str | PlannerConfig | Planner | Callable[[Task, int], Plan] = DEFAULT_PLANNER
    controller: str | Controller[Any] = DEFAULT_CONTROLLER
    model: str | None = None
    adapt: bool = False
    cell: Cell | str | None = None
    move_ends: bool = False
    plan: Plan | Path | str | None = None
    alternatives: int = 1
    perturbation: Perturbation = field(default_factory=Perturbation)
    plant: Callable[[Task], Plant] | str | None = None
    eyes: EyesConfig | None = None
    seed: int = 0
    time_limit: Positive[float] = TIME_LIMIT
    clock: Callable[[], float] | None = None
    rehearse: bool = True
    follow_unverified: bool = False
    track: bool = True
    recover: bool | None = None
    speed: float = 1.0
    dry_run: bool = False
    deadline: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        Watchdog(deadline=self.deadline)  # checks it
        if not isinstance(self.planner, str | PlannerConfig | Planner):
            require_call(self.planner, "the planner", 2)
        if self.plant is not None and not isinstance(self.plant, str):
            require_call(self.plant, "the plant", 1)
        if not isinstance(self.controller, str):
            require_controller(self.controller)
        if self.plant is not None and self.perturbation != Perturbation():
            raise InputError("a perturbation is of the simulated plant, and another one is given")
        if self.plant is not None and self.eyes is not None:
            raise InputError("cameras are rendered for the simulated plant, and another one is given")
        if self.alternatives < 1:
            raise InputError(f"alternatives must be 1 or more, got {self.alternatives}")
        if not 0 < self.speed <= 1:
            raise InputError(f"speed must be above 0 and at most 1, got {self.speed!r}")

    def expired(self, wall: Callable[[], float]) -> Callable[[], bool]:
        """Tells whether a search that begins now has used up its time, by `clock` or else by a clock of wall time."""
        clock = self.clock or wall
        deadline = clock() + self.time_limit
        return lambda: clock() > deadline

    def resolved_planner(self) -> Planner:
        """The planner.

        Raises:
            UnknownNameError: There is none of that name; the message lists them.
        """
        chosen = self.planner
        if isinstance(chosen, str):
            return make_planner(chosen)
        if isinstance(chosen, Planner):
            return chosen
        if isinstance(chosen, PlannerConfig):
            return Planner(chosen, find_plan)
        return Planner(None, lambda task, *, seed, **_: chosen(task, seed))

    @property
    def recovers(self) -> bool:
        """Whether a cable that left its plan is replanned for."""
        if self.recover is not None:
            return self.recover
        return not (isinstance(self.controller, str) and controller_entry(self.controller).follows_blindly)


@dataclass(frozen=True, kw_only=True, repr=False)
class Run(Brief):
    """A task with what became of it; None for what it did not come to.

    Attributes:
        task: The task.
        report: The verdict with all figures.
        plan: What was followed.
        alternatives: Further plans, best first.
        attempt: What came closest to a plan, where none was found.
        rollout: What happened along the plan.
        insertion_plan: Where the task has a port, the plan of the insertion.
        insertion: What happened in the insertion.
        timings: Wall time [s] of each stage of planning.
    """

    task: Task
    report: Report
    plan: Plan | None = None
    alternatives: tuple[Plan, ...] = ()
    attempt: Attempt | None = None
    rollout: Rollout | None = None
    insertion_plan: Plan | None = None
    insertion: Rollout | None = None
    timings: Mapping[str, float] = field(default_factory=dict)

    def _facts(self) -> Iterator[str]:
        yield from self.report._facts()
        if self.plan is not None:
            yield f"plan of {self.plan.steps} steps"
        if self.rollout is not None:
            yield f"rollout of {self.rollout.steps} steps"

    def _repr_html_(self) -> str:
        from cableway.figures.draw import draw
        from cableway.figures.notebook import page

        return page(self.report.rows(), draw(self.task, self.rollout or self.plan or self.attempt))

    @property
    def success(self) -> bool:
        """Whether the task succeeded; see `cableway.report.judge`."""
        return self.report.success
