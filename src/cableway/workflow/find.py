"""The first half of a run: a plan, rehearsed where the cable asks for it, the plan of the insertion, their report."""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np

from cableway.core.compiled import clock
from cableway.core.errors import Cancelled, InputError, PlanningError, PlanningInterrupted
from cableway.core.provenance import describe
from cableway.core.quantities import limit_text, quantity
from cableway.core.time_limit import OutOfTime, time_limit
from cableway.motion.resampling import smoothed
from cableway.motion.time_parametrization import gripper_effort
from cableway.outcome import Outcome
from cableway.planning.alternatives import CLEARANCE_WEIGHT, travel_and_clearance
from cableway.planning.insertion import plan_insertion
from cableway.planning.planner import plan as find_plan
from cableway.records import Plan
from cableway.report import summarize
from cableway.scene.cable import FRICTION_RULES, QUASI_STATIC
from cableway.scene.task import Task
from cableway.verification import kind_of, require_verified
from cableway.workflow.events import Listener, Note, Planned
from cableway.workflow.in_sight import in_sight
from cableway.workflow.registry import Planner, controller_entry
from cableway.workflow.rehearsal import Rehearsed, rehearsed_plan
from cableway.workflow.run import Run, SolveOptions

LOGGER = logging.getLogger(__name__)


def find(task: Task, options: SolveOptions, listener: Listener, notes: tuple[str, ...] = ()) -> Run:
    """Plan a task.

    Args:
        task: The task.
        options: How.
        listener: Is told how far it is.
        notes: For the report.

    Returns:
        The run so far: the plan with its report, or the closest attempt and why it is no plan.

    Raises:
        InputError: The options give a plan, and it is none of the task.
        KeyboardInterrupt: The search was interrupted from the keyboard; the listener has what came closest.
    """
    planner, insertion_plan = options.resolved_planner(), None
    LOGGER.info("planner: %s", json.dumps(describe(planner.config)))
    notes = (*_warnings(task, options, listener), *notes)
    timer = StageTimer(listener.progress)
    common: dict[str, Any] = {"timings": timer.seconds, "seed": options.seed, "limits": planner.limits}
    try:
        with time_limit(options.expired(clock)):
            timer("set up", 0.0)
            if task.cell is None:
                insertion_plan = _insertion(task, planner, timer)
            plans = _plans(task, options, planner, timer)
            if options.eyes is not None and options.plan is None:
                plans = [in_sight(plan, task, options.eyes.cameras, planner.limits) for plan in plans]
            if task.cell is not None:
                insertion_plan = _insertion(task, planner, timer, plans[0])
    except OutOfTime:
        timer.stop()
        late = PlanningError("the time limit ran out before there was a plan", outcome=Outcome.TIMED_OUT)
        return _without_plan(task, planner, late, {**common, "notes": notes})
    except (PlanningError, Cancelled) as error:
        timer.stop()
        run = _without_plan(task, planner, error, {**common, "notes": notes})
        if isinstance(error, PlanningInterrupted) and not listener.cancelled:
            listener.emit(Planned(run))
            raise KeyboardInterrupt from None
        return run
    if options.alternatives > 1:
        notes = (*notes, *_ranked(task, plans, options.alternatives))
    if options.speed < 1:
        notes = (*notes, f"Planned and tracked with {100 * options.speed:g}% of the grippers' limits.")
    if options.plan is not None and not isinstance(options.plan, Plan):
        notes = (*notes, f"The plan is that of {options.plan}.")
    verdict = plans[0].verdict if planner.find is find_plan else None  # a planner of the user's own is not believed
    report = summarize(
        task, plans[0], insertion_plan=insertion_plan,
        notes=(*notes, *_rehearsed(plans[0]), *_in_sight(plans[0]), *_without_hands(plans[0])),
        plan_verdict=verdict, insertion_plan_verdict=insertion_plan and insertion_plan.verdict, **common,
    )  # fmt: skip
    return Run(
        task=task, report=report, plan=plans[0], alternatives=tuple(plans[1:]), insertion_plan=insertion_plan,
        timings=timer.seconds,
    )  # fmt: skip


def _insertion(task: Task, planner: Planner, timer: StageTimer, after: Plan | None = None) -> Plan | None:
    """The plan of the insertion, in a cell after the plan that leads to it; None where there is no port."""
    if task.port is None:
        return None
    timer("insertion plan", 0.0)
    found = plan_insertion(task, planner.limits, after)
    timer("insertion plan", 1.0)
    return found


def search(
    task: Task, options: SolveOptions, planner: Planner, progress: Any, seed: int, previous: Plan | None = None
) -> Plan:
    """One search for a plan, with its own time limit.

    Raises:
        PlanningError: There is none.
    """
    expired = options.expired(clock)
    try:
        return planner.find(
            task, config=planner.config, seed=seed, progress=progress, previous=previous, expired=expired
        )
    except PlanningInterrupted:
        raise
    except PlanningError as error:
        attempt = error.attempt
        if not options.follow_unverified or attempt is None or attempt.poses is None:
            raise
        made_by = {} if attempt.stages is None else attempt.stages.metadata
        metadata = {**made_by, "unverified": attempt.reason}
        return Plan(attempt.shapes, attempt.poses, stages=attempt.stages, metadata=metadata)


def _plans(task: Task, options: SolveOptions, planner: Planner, timer: StageTimer) -> Sequence[Plan]:
    if options.plan is not None:
        return [_given(options.plan, task, options, planner)]
    if options.alternatives > 1:
        return planner.find(
            task, config=planner.config, seed=options.seed, progress=timer, alternatives=options.alternatives,
            expired=options.expired(clock),
        )  # fmt: skip
    one = partial(search, task, options, planner, timer)
    if options.rehearse:
        return [rehearsed_plan(task, one, seed=options.seed, progress=timer)]
    return [one(options.seed)]


def _given(given: Plan | Path | str, task: Task, options: SolveOptions, planner: Planner) -> Plan:
    """The plan that the options name, at the speed that they ask for.

    Raises:
        FileFormatError: It is no file of a plan.
        InputError: It is not a plan of the task.
    """
    plan, source = (given, "the plan") if isinstance(given, Plan) else (Plan.load(given), str(given))
    if kind_of(plan) != "plan":
        raise InputError(f"{source}: the plan of an insertion, which begins at the goal, not a plan of {task.name!r}")
    plan = _slowed(plan, task, options.speed)
    verdict = None if options.follow_unverified else require_verified(plan, task, source, planner.limits)
    return plan.judged(verdict)


def _ranked(task: Task, plans: Sequence[Plan], wanted: int) -> tuple[str, ...]:
    """By what alternatives are ranked, and how many there are, for the reader of the report."""
    each = [f"{quantity(travel)} and {quantity(clearance)}"
            for travel, clearance in (travel_and_clearance(plan, task) for plan in plans)]  # fmt: skip
    ranked_by = f"travel of both grippers + {limit_text(CLEARANCE_WEIGHT, 'm²')} / least clearance"
    ranked = f"Plans, best first, by {ranked_by}: {'; '.join(each)}."
    return (ranked,) if len(plans) == wanted else (f"{len(plans)} of {wanted} alternatives were found.", ranked)


def _slowed(plan: Plan, task: Task, share: float) -> Plan:
    """A plan made for the grippers' whole limits at a share of its speed; one that keeps the task's as it is."""
    limits = task.grippers
    if share == 1 or gripper_effort(plan.poses, limits.max_step, limits.max_turn).max() <= 1:
        return plan
    at = np.linspace(-1, plan.steps + 1, math.ceil((plan.steps + 2) / share) + 1)
    if plan.q is not None:
        return Plan.of(task.cable.rod, smoothed(plan.q, at), plan.metadata)
    return Plan(smoothed(plan.shapes, at), smoothed(plan.poses, at), metadata=plan.metadata)


def _without_plan(task: Task, planner: Planner, error: PlanningError | Cancelled, common: dict[str, Any]) -> Run:
    attempt, outcome = None, Outcome.INTERRUPTED
    if isinstance(error, PlanningError):
        attempt, outcome = error.attempt, Outcome(error.outcome)
    configuration = {"plan": {"planner": describe(planner.config)}}
    report = summarize(
        task, None, attempt=attempt, problem=(outcome, str(error)), configuration=configuration, **common
    )
    return Run(task=task, report=report, attempt=attempt, timings=common["timings"])


def _rehearsed(plan: Plan) -> tuple[str, ...]:
    """How the rehearsal went, for the reader of the report."""
    record = plan.metadata.get("rehearsal")
    if record is None:
        return ()
    if not record["plans"]:
        return ("The time limit ran out in the rehearsal of the plan on the simulated cable.",)
    went = Rehearsed(**{field: record[field] for field in ("deviation", "clearance", "shape_error")})
    if record["passed"]:
        return (f"Plan {record['plans']} of those rehearsed on the simulated cable: {went}.",)
    return (f"None of {record['plans']} plans passed rehearsal on the simulated cable; the best one: {went}.",)


def _in_sight(plan: Plan) -> tuple[str, ...]:
    """That the arms were led another way than with most room, for the reader of the report."""
    record = plan.metadata.get("in_sight")
    if record is None:
        return ()
    hidden, before = (f"{100 * record[name]:.0f}%" for name in ("hidden", "before"))
    return (f"The arms hold the cable so that they hide {hidden} of it from the cameras; with most room, {before}.",)


def _without_hands(plan: Plan) -> tuple[str, ...]:
    """Why open hands cannot get to the cable, or away from it, for the reader of the report."""
    arms = plan.metadata.get("arms")
    faults = {} if not isinstance(arms, dict) else {name: arms.get(f"no_{name}") for name in ("approach", "retreat")}
    return tuple(f"The plan has no {name}: {why}." for name, why in faults.items() if why)


class StageTimer:
    """Measures how long each stage of a computation takes, from the progress that it reports.

    Args:
        progress: Called with the same progress.
        clock: Seconds; by default, compiling and loading kernels does not count.
    """

    def __init__(self, progress: Callable[[str, float], None], clock: Callable[[], float] = clock) -> None:
        self._progress, self._clock = progress, clock
        self._last, self._running = clock(), ""
        self.seconds: dict[str, float] = {}

    def __call__(self, stage: str, share: float) -> None:
        """Count the time since the last call to the stage that was running, or else to this one."""
        self._count(self._running or stage)
        self._running = stage if share < 1 else ""
        self._progress(stage, share)

    def stop(self) -> None:
        """Count the time since the last call to the stage that never said that it ended, if there is one."""
        if self._running:
            self._count(self._running)
            self._running = ""

    def _count(self, stage: str) -> None:
        now = self._clock()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now


def _warnings(task: Task, options: SolveOptions, listener: Listener) -> tuple[str, ...]:
    """Of a cable that does not move as its equilibria do."""
    found = []
    if (frequency := task.cable.frequency) < QUASI_STATIC:
        found.append(
            f"The cable swings: its first bending mode is at {frequency:.2f} Hz, and below {QUASI_STATIC:g} Hz plan "
            "and feedback, which take it to be at rest at every moment, are less accurate."
        )
    if (number := options.perturbation.friction_number(task)) >= FRICTION_RULES:
        found.append(
            f"Friction may hold the cable: mu rho g L^3 / EI is {number:.0f}, and from {FRICTION_RULES:g} on it may "
            "stray by 10 cm and more on its way, and the run may fail."
        )
    found += _other_cable(task, options)
    for warning in found:
        listener.emit(Note(warning))
    return tuple(found)


LEARNED = {"length": "m", "bending_stiffness": "N m²", "damping_time": "s", "linear_density": "kg/m", "friction": ""}
"""Fields of a cable by which its motion differs, and the model of it, with their units."""


def _other_cable(task: Task, options: SolveOptions) -> list[str]:
    """A sentence where the controller's model was trained on another cable than the task's."""
    if not (options.track and isinstance(options.controller, str)):
        return []
    entry = controller_entry(options.controller)
    if not entry.cable:
        return []
    name = options.model or entry.model
    learned: Mapping[str, Any] = resolve_name(entry.cable)(name)
    differing = [
        f"{field.replace('_', ' ')} {limit_text(learned[field], unit)} instead of {limit_text(own, unit)}"
        for field, unit in LEARNED.items()
        if field in learned and not math.isclose(own := getattr(task.cable, field), learned[field], rel_tol=0.01)
    ]
    if not differing:
        return []
    helps = "" if options.adapt else ", to which --adapt (SolveOptions.adapt) brings it closer while it runs"
    return [f"The model {name} is of another cable than the task's{helps}: {'; '.join(differing)}."]
