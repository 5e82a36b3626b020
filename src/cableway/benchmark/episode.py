"""One episode of one method: planned, tracked, measured."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from cableway.benchmark.methods import DEFAULT, Method, default_planner, load_method, made_by
from cableway.benchmark.suites import Episode
from cableway.control.base import Controller
from cableway.core.errors import PlanningError
from cableway.planning.compilation import EXAMPLE
from cableway.records import SUCCESS_ERROR, Attempt, Plan, Rollout
from cableway.report import Report, summarize
from cableway.scene.files.loading import load_task
from cableway.scene.task import Task
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.simulation.perturbations.variants import named_perturbation
from cableway.tracking import Recovery, track
from cableway.tracking.recovery import IN_THE_WAY, LEFT
from cableway.tracking.watchdog import GIVEN_UP

STRICT_ERROR = 0.01
"""Stacked shape error [m] below which an episode is a success by the strict rule."""

GAVE_UP = {"plant failed": "plant failed", GIVEN_UP: "controller failed", LEFT: "left plan", IN_THE_WAY: "left plan"}
"""Outcomes of runs that ended early, by how the rollout's own outcome begins."""

MISSED = "missed goal"
"""Outcome of a run to its end that did not come to the goal."""

BLOCKED = "blocked"
"""The suite of tasks without a solution."""

IMPOSSIBLE = "there is no plan"
"""How the message begins of a planner that says that no cable can get there."""


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
        outcome: "success", or what went wrong, in two words.
        detail: In a sentence.
        success: The final stacked error is below 3 cm and neither cable nor grippers touched anything; of a blocked
            task: it was said that there is no plan.
        strict: The same with 1 cm.
        contact: Whether something was touched.
        verified: Whether the independent judge found nothing wrong with the rollout.
        shape_error: Final stacked error; where the cable was not moved, that of the start.
        floor: Least that any gripper poses reach with this cable.
        mean_keypoint_error: Mean distance of a final keypoint from its goal.
        clearance: Least clearance of cable and grippers.
        deviation: Largest distance of a keypoint from its reference.
        gripper_travel: Way of both grippers together.
        steps: Control steps.
        recovered: How many times a new plan was made.
        planning_time: Wall time.
        control_median: Of the wall times of control steps.
        control_p99: Of the same.
        control_max: Of the same.
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
    outcome: str
    detail: str = ""
    success: bool = False
    strict: bool = False
    contact: bool = False
    verified: bool | None = None
    shape_error: float | None = None
    floor: float | None = None
    mean_keypoint_error: float | None = None
    clearance: float | None = None
    deviation: float | None = None
    gripper_travel: float | None = None
    steps: int | None = None
    recovered: int | None = None
    planning_time: float | None = None
    control_median: float | None = None
    control_p99: float | None = None
    control_max: float | None = None
    reference_time: float | None = None


@dataclass(frozen=True)
class Outcome:
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
    """

    episode: Episode
    source: str
    method: str
    made_by: str


def jobs_of(source: str, episodes: Iterable[Episode]) -> list[Job]:
    """A method's jobs.

    Raises:
        InputError: The method cannot be loaded.
    """
    method, maker = load_method(source), made_by(source)
    return [Job(episode, source, method.name, maker) for episode in episodes]


def run_job(job: Job) -> Outcome:
    """Run an episode.

    Raises:
        CablewayError: The method or the task cannot be loaded. What a method raises comes through.
    """
    warm_up(job.source)
    reference = reference_time()
    outcome = _run(job)
    return replace(outcome, result=replace(outcome.result, reference_time=reference))


def _run(job: Job) -> Outcome:
    episode, method, task = job.episode, _method(job.source), job.episode.load()
    start = time.perf_counter()
    try:
        plan = method.planner(task, episode.seed)
    except PlanningError as error:
        return _unplanned(job, task, error, time.perf_counter() - start)
    planning_time = time.perf_counter() - start
    if episode.suite == BLOCKED:
        return Outcome(Result(**_known(job), outcome="not told", detail="a plan was returned"))
    perturbation = named_perturbation(episode.plant, task, episode.seed)
    true_task = perturbation.true_task(task)
    rollout = _follow(job, method, task, plan, perturbation)
    report = summarize(true_task, None, rollout, cable=perturbation.cable)
    result = _tracked(job, report, rollout, planning_time)
    if result.success:
        return Outcome(result)
    from cableway.figures.rollout import rollout_figure
    from cableway.figures.style import figure_png

    return Outcome(result, figure_png(rollout_figure(true_task, rollout)))


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
    _controller(source).init(load_task(EXAMPLE), _example_plan())


def died(job: Job, outcome: str, detail: str) -> Outcome:
    """The outcome of an episode in which the method died: the cable was not moved."""
    from cableway.figures.scene import task_figure
    from cableway.figures.style import figure_png

    task = job.episode.load()
    result = Result(**_known(job), outcome=outcome, detail=detail, **_unmoved(task))
    return Outcome(result, figure_png(task_figure(task)))


@cache
def _example_plan() -> Plan:
    return default_planner(load_task(EXAMPLE), 0)


@cache
def _method(source: str) -> Method:
    return load_method(source)


@cache
def _controller(source: str) -> Controller[Any]:
    return _method(source).controller()


def _follow(job: Job, method: Method, task: Task, plan: Plan, perturbation: Perturbation) -> Rollout:
    """The rollout.

    Raises:
        SimulationError: The plant cannot take the start.
    """
    recovery, seed = None, job.episode.seed
    if method.recovers:
        recovery = Recovery(replan=lambda changed, _: method.planner(changed, seed))
    return track(perturbation.build(task, seed), _controller(job.source), plan, recovery=recovery, seed=seed)


def _known(job: Job) -> dict[str, Any]:
    given = asdict(job.episode)
    return {"episode": given.pop("name"), "method": job.method, "made_by": job.made_by, **given}


def _unmoved(task: Task) -> dict[str, Any]:
    """Figures of a cable that was left where it lay."""
    offset = task.start - task.goal
    return {
        "shape_error": float(np.linalg.norm(offset)),
        "mean_keypoint_error": float(np.linalg.norm(offset, axis=1).mean()),
    }


def _unplanned(job: Job, task: Task, error: PlanningError, seconds: float) -> Outcome:
    """No plan: right where there is none, a failure elsewhere."""
    told = str(error).startswith(IMPOSSIBLE)
    known = _known(job) | {"detail": str(error), "planning_time": seconds}
    if job.episode.suite == BLOCKED:
        outcome = "success" if told else "not told"
        return Outcome(Result(**known, outcome=outcome, success=told, strict=told))
    from cableway.figures.plan import attempt_figure
    from cableway.figures.style import figure_png

    picture = figure_png(attempt_figure(task, error.attempt or Attempt(str(error))))
    return Outcome(Result(**known, outcome="no plan", **_unmoved(task)), picture)


def _tracked(job: Job, report: Report, rollout: Rollout, planning_time: float) -> Result:
    clearance, error = rollout.least_clearance, float(report.shape_error or 0.0)
    contact = not clearance > 0
    ended = str(rollout.metadata["outcome"])
    success = error < SUCCESS_ERROR and not contact and rollout.gave_up is None
    outcome = "contact" if contact else next((n for begins, n in GAVE_UP.items() if ended.startswith(begins)), MISSED)
    times = report.control_time
    return Result(
        **_known(job),
        outcome="success" if success else outcome,
        detail="" if success else f"{ended}; final error {1000 * error:.1f} mm, clearance {1000 * clearance:.1f} mm",
        success=success,
        strict=success and error < STRICT_ERROR,
        contact=contact,
        verified=None if report.rollout_verdict is None else report.rollout_verdict.passed,
        shape_error=error,
        floor=report.shape_error_floor,
        mean_keypoint_error=report.mean_keypoint_error,
        clearance=clearance,
        deviation=report.largest_deviation,
        gripper_travel=float(np.linalg.norm(np.diff(rollout.poses[..., :2], axis=0), axis=2).sum()),
        steps=report.steps,
        recovered=len(rollout.metadata.get("recovered", [])),
        planning_time=planning_time,
        control_median=times.median if times else None,
        control_p99=times.p99 if times else None,
        control_max=times.max if times else None,
    )
