"""One episode of one method: planned, tracked, measured."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Any

from cableway.benchmark.conditions import condition_of
from cableway.benchmark.contacts import is_unavoidable
from cableway.benchmark.faulty import FAULTS, FaultyController
from cableway.benchmark.methods import DEFAULT, Method, load_method, made_by
from cableway.benchmark.spatial_episode import require_in_space, run_in_space, warm_up_in_space
from cableway.benchmark.suites import Episode
from cableway.commands import stopping_time
from cableway.control.base import Controller
from cableway.core.errors import InputError, TaskError
from cableway.core.provenance import commit
from cableway.core.quantities import quantity
from cableway.outcome import Outcome, stacked_limit
from cableway.planning.planner import plan as find_plan
from cableway.records import Attempt, Plan
from cableway.report import Report
from cableway.scene.files.loading import load_planar_task
from cableway.scene.task import Task
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.perturbations.sensing import SensingConfig
from cableway.simulation.perturbations.variants import FAULTS_SUITE, named_perturbation
from cableway.tracking import Watchdog
from cableway.workflow.compilation import EXAMPLE
from cableway.workflow.registry import require_extras
from cableway.workflow.run import Run
from cableway.workflow.solve import solve

LOGGER = logging.getLogger(__name__)

STRICT_ERROR = 0.01
"""Stacked shape error [m] below which an episode is a success by the strict rule."""

FROM_REPORT = (
    "outcome", "success", "planning_time", "shape_error", "least_achievable_error", "mean_keypoint_error", "steps",
)  # fmt: skip
"""Figures of a result that are the report's."""

LIMITED = ("gripper step", "gripper turn")
"""Checks of a rollout that compare the grippers' motion with its limits."""

BLOCKED = "blocked"
"""The suite of tasks without a solution."""


@dataclass(frozen=True, kw_only=True)
class Result:
    """What became of an episode; metres, seconds. None where there is no such figure.

    Attributes:
        suite: Name.
        episode: Name.
        method: Name.
        task: As in `Episode`.
        plant: Name.
        seed: Of planner and noise.
        digest: Of the task.
        made_by: What else it depends on, see `methods.made_by`.
        commit: At which cableway was, see `core.provenance.commit`; None where it is not run from a checkout.
        outcome: Value of an `Outcome`.
        detail: Why it was no success, in a sentence.
        success: As `cableway.report.judge` has it; of a blocked task: the planner said that no plan exists.
        strict: The same with 1 cm.
        planned: In space, whether a plan was found that the judge accepts; None on the table.
        contact: Whether something was touched.
        unavoidable: Whether that was the first touch of something unknown and nothing else, see `benchmark.contacts`;
            None where the plant has no faults.
        verified: Whether the independent judge found nothing wrong with the rollout.
        shape_error: Final stacked error; None where the cable was not moved, as where no plan was found.
        least_achievable_error: Least that any gripper poses reach with this cable.
        mean_keypoint_error: Mean distance of a final keypoint from its goal.
        clearance: Least clearance of cable and grippers.
        deviation: Largest distance of a keypoint from its reference.
        stopping: Longest time from a stop until both grippers were at rest; None where they were never stopped.
        within_limits: Whether no gripper moved or turned faster than it may, by the independent judge.
        gripper_travel: Way of both grippers together.
        steps: Control steps.
        recovered: How many times a new plan was made.
        planning_time: Wall time; in space, where it includes judging the plan, processor time.
        control_median: Of the wall times of control steps.
        control_p99: Of the same.
        control_max: Of the same.
        missed: Control steps that missed the deadline; None where there is none.
        condition: As in `Episode`.
        tracking_error: Mean distance of the keypoints found in pictures from the true ones, over the frames in which
            the cable was known; None where there are no cameras.
        tracking_p99: 99th percentile of the same, over all keypoints of all these frames.
        hidden: Mean share of the cable that no camera shows.
        unknown: Share of the frames in which the cable was not known.
        lost: Whether it was taken to be where it was not, or was not known at the end, see `tracking.eyes.LOST`.
        reference_time: Wall time of a million additions in a plain Python loop, just before.
    """

    suite: str
    episode: str
    method: str
    task: str
    plant: str
    seed: int
    digest: str
    made_by: str
    commit: str | None = None
    outcome: str
    detail: str = ""
    success: bool = False
    strict: bool = False
    planned: bool | None = None
    contact: bool = False
    unavoidable: bool | None = None
    verified: bool | None = None
    shape_error: float | None = None
    least_achievable_error: float | None = None
    mean_keypoint_error: float | None = None
    clearance: float | None = None
    deviation: float | None = None
    stopping: float | None = None
    within_limits: bool | None = None
    gripper_travel: float | None = None
    steps: int | None = None
    recovered: int | None = None
    planning_time: float | None = None
    control_median: float | None = None
    control_p99: float | None = None
    control_max: float | None = None
    missed: int | None = None
    condition: str = ""
    tracking_error: float | None = None
    tracking_p99: float | None = None
    hidden: float | None = None
    unknown: float | None = None
    lost: bool | None = None
    reference_time: float | None = None


@dataclass(frozen=True)
class Scored:
    """A result and, where the episode failed, its picture.

    Attributes:
        result: The figures.
        picture: A PNG file's content.
    """

    result: Result
    picture: bytes | None = None


@dataclass(frozen=True)
class Job:
    """An episode for a method.

    Attributes:
        episode: Which.
        source: The method, as for `load_method`.
        method: Its name.
        made_by: What a result depends on beside the episode, see `methods.made_by`.
        commit: At which cableway is as the job is made.
        deadline: Wall time [s] after which a control step counts as missed; never where None.
    """

    episode: Episode
    source: str
    method: str
    made_by: str
    commit: str | None = None
    deadline: float | None = None


def jobs_of(source: str, episodes: Iterable[Episode], deadline: float | None = None) -> list[Job]:
    """A method's jobs; `deadline` as for `Job`.

    Raises:
        InputError: The method cannot be loaded, or the deadline is not positive.
        MissingExtraError: The method, or an episode in space, needs an extra that is not installed.
        UnknownNameError: An episode is in space, where there is no such method.
    """
    Watchdog(deadline=deadline)  # checks it
    method, maker = load_method(source), made_by(source) + ("" if deadline is None else f", deadline {deadline:g} s")
    require_extras(*(name for name in (method.planner, method.controller) if isinstance(name, str)))
    episodes = list(episodes)
    if any(episode.in_space for episode in episodes):
        require_in_space(source, deadline)
    return [Job(episode, source, method.name, maker, commit(), deadline) for episode in episodes]


def run_job(job: Job) -> Scored:
    """Run an episode.

    Raises:
        CablewayError: The method or the task cannot be loaded. What a method raises comes through.
    """
    LOGGER.info("%s, %s of %s", job.method, job.episode.name, job.episode.suite)
    if job.episode.in_space:
        warm_up_in_space()
    else:
        warm_up(job.source)
    reference = reference_time()
    scored = _score_in_space(job) if job.episode.in_space else _score(job)
    return replace(scored, result=replace(scored.result, reference_time=reference))


def _score_in_space(job: Job) -> Scored:
    task = job.episode.load_spatial()
    run = run_in_space(task, job.source, job.episode.seed)
    error, success = run.figures.get("shape_error"), run.figures.get("success", False)
    strict = success and error is not None and error < stacked_limit(STRICT_ERROR, task.cable.keypoints)
    result = Result(**_known(job), **run.figures, strict=strict)
    return Scored(result, None if success else run.draw())


def _score(job: Job) -> Scored:
    episode, task = job.episode, job.episode.load_planar()
    perturbation = named_perturbation(episode.plant, task, episode.seed)
    eyes = None
    if episode.condition:  # the noise and latency of the plant's keypoints are those of another way to know the cable
        perturbation = replace(perturbation, sensing=SensingConfig())
        tracker = _method(job.source).tracker
        eyes = tracker and condition_of(episode.condition).seen(episode.seed, tracker)
    controller = _controller(job.source)
    if episode.plant in FAULTS:
        controller = FaultyController(controller, episode.plant, episode.seed)
    options = _method(job.source).options(
        controller=controller,
        perturbation=perturbation,
        eyes=eyes,
        seed=episode.seed,
        track=episode.suite != BLOCKED,
        deadline=job.deadline,
        clock=time.process_time,  # as others may work on this machine
    )
    run = solve(task, options)
    if task != episode.load_planar():
        raise InputError(f"the method {job.method} overwrote the task")
    if episode.suite == BLOCKED:
        return Scored(_certified(job, run))
    result = _measured(job, run, perturbation)
    return Scored(result, None if result.success else _picture(run, perturbation))


def reference_time() -> float:
    """Seconds that a million additions take in a plain Python loop, here and now, to compare machines by."""
    before, total = time.perf_counter(), 0
    for number in range(1_000_000):
        total += number
    return time.perf_counter() - before


@cache
def warm_up(source: str = DEFAULT) -> None:
    """Compile and load what a method's episodes need, so that no figure of time has that in it.

    Args:
        source: The method, as for `load_method`.
    """
    _controller(source).init(load_planar_task(EXAMPLE), _example_plan())


def died(job: Job, outcome: Outcome, detail: str) -> Scored:
    """The outcome of an episode in which the method died: the cable was not moved."""
    from cableway.figures.scene import task_figure
    from cableway.figures.space import spatial_task_figure
    from cableway.figures.style import figure_png

    task, fault = job.episode.load(), TaskError(f"{outcome}: {detail}")
    figure = task_figure(task, [fault]) if isinstance(task, Task) else spatial_task_figure(task, [fault])
    picture = figure_png(figure)
    planned = False if job.episode.in_space else None
    return Scored(Result(**_known(job), outcome=outcome, detail=detail, planned=planned), picture)


@cache
def _example_plan() -> Plan:
    return find_plan(load_planar_task(EXAMPLE))


@cache
def _method(source: str) -> Method:
    return load_method(source)


@cache
def _controller(source: str) -> Controller[Any]:
    return _method(source).make_controller()


def _known(job: Job) -> dict[str, Any]:
    given = asdict(job.episode)
    return {"episode": given.pop("name"), "method": job.method, "made_by": job.made_by, "commit": job.commit, **given}


def _certified(job: Job, run: Run) -> Result:
    """Of a task without a solution: a success where the planner says so."""
    certified = run.report.outcome is Outcome.INFEASIBLE
    return Result(
        **_known(job),
        outcome=Outcome.SUCCESS if certified else Outcome.NOT_CERTIFIED,
        detail=run.report.failure or "a plan was returned",
        success=certified,
        strict=certified,
        planning_time=run.report.planning_time,
    )


def _measured(job: Job, run: Run, perturbation: Perturbation) -> Result:
    report, rollout = run.report, run.rollout
    figures = {name: getattr(report, name) for name in FROM_REPORT}
    if rollout is not None:
        figures |= {
            "strict": report.success and report.shape_error is not None and report.shape_error < STRICT_ERROR,
            "contact": not rollout.least_clearance > 0,
            "unavoidable": is_unavoidable(rollout, run.task, perturbation.revealed)
            if job.episode.plant in FAULTS_SUITE
            else None,
            "clearance": rollout.least_clearance,
            "recovered": len(rollout.metadata.get("recovered", [])),
            "missed": None if job.deadline is None else rollout.metadata["watchdog"]["late"],
            "verified": None if report.rollout_verdict is None else report.rollout_verdict.passed,
            "deviation": report.largest_deviation,
            "stopping": stopping_time(rollout),
            "within_limits": _within_limits(report),
            "gripper_travel": None if report.gripper_travel is None else sum(report.gripper_travel),
        }
        figures |= _of_eyes(rollout.metadata.get("eyes"))
    if report.control_time is not None:
        figures |= {f"control_{name}": seconds for name, seconds in asdict(report.control_time).items()}
    return Result(**_known(job), **figures, detail=_detail(report))


def _of_eyes(record: Mapping[str, Any] | None) -> dict[str, Any]:
    """What `SeenPlant.record` says of how well the cable was seen."""
    if record is None:
        return {}
    errors = {"tracking_error": record["mean_error"], "tracking_p99": record["p99_error"]}
    return {**errors, "hidden": record["hidden"], "unknown": 1 - record["known"], "lost": record["lost"]}


def _within_limits(report: Report) -> bool | None:
    if report.rollout_verdict is None:
        return None
    return all(check.passed for check in report.rollout_verdict.checks if check.name in LIMITED)


def _detail(report: Report) -> str:
    """Why an episode was no success, with the figures where it was tracked."""
    if report.shape_error is None or report.min_clearance is None or report.gripper_clearance is None:
        return report.failure or ""
    if report.success:
        return ""
    clearance = min(report.min_clearance, report.gripper_clearance)
    figures = f"final error {quantity(report.shape_error)}, clearance {quantity(clearance)}"
    return f"{report.failure}; {figures}"


def _picture(run: Run, perturbation: Perturbation) -> bytes:
    """A PNG file of what went wrong."""
    from cableway.figures.plan import attempt_figure
    from cableway.figures.rollout import rollout_figure
    from cableway.figures.style import figure_png

    if run.rollout is not None:
        return figure_png(
            rollout_figure(
                perturbation.true_task(run.task),
                run.rollout,
                failure=run.report.failure,
                verdict=run.report.rollout_verdict,
            )
        )
    return figure_png(attempt_figure(run.task, run.attempt or Attempt(run.report.failure or "")))
