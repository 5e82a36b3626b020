"""What became of a task: one report of its plan and rollout, for people and for programs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.commands import Commands
from cableway.core.brief import Brief, notebook
from cableway.core.deprecation import renamed, renamed_attributes, renamed_keywords
from cableway.core.provenance import describe, versions
from cableway.core.quantities import limit_text, quantity
from cableway.geometry.groups import SE2
from cableway.judge import judge as judge
from cableway.metrics import METRICS
from cableway.outcome import Outcome
from cableway.records import Attempt, Estimate, Plan, Rollout, Verdict
from cableway.rod.inverse import nearest_shape
from cableway.scene.cable import Cable
from cableway.scene.files.loading import TaskSource, as_task
from cableway.scene.task import Task
from cableway.verification import (
    Inserted,
    VerificationLimits,
    measure_insertion,
    verify_insertion,
    verify_insertion_plan,
    verify_plan,
    verify_rollout,
)


@dataclass(frozen=True, kw_only=True)
class ControlTime:
    """Wall time of the controller in a step.

    Attributes:
        median: [s].
        p99: 99th percentile [s].
        max: [s].
    """

    median: float
    p99: float
    max: float


@renamed_attributes(push_verdict="insertion_plan_verdict", shape_error_floor="least_achievable_error")
@dataclass(frozen=True, kw_only=True, repr=False)
class Report(Brief):
    """The figures of one task; None where there is none, as after planning only.

    Attributes:
        task: Its name.
        outcome: How it ended; see `judge`.
        failure: Why it did not succeed, in a sentence; None where it did.
        seed: Of everything random.
        shape_error: Stacked distance of the final keypoints from the goal [m].
        least_achievable_error: Least stacked distance from the goal [m] that any gripper poses reach with the plant's
            cable on a frictionless table; none for a cable that keeps a set.
        mean_keypoint_error: Mean distance of a final keypoint from its goal [m].
        min_clearance: Least clearance of the cable's surface [m], whole cable, every simulated substep.
        gripper_clearance: Least clearance of the gripper discs [m].
        plug_clearance: Least clearance of the plug [m] until it is inserted, swept between control steps.
        largest_deviation: Largest distance of a keypoint from its reference at the time [m].
        gripper_travel: Length of the ways of the left and the right gripper [m].
        plan_steps: Control steps of the plan.
        steps: Control steps of the rollout.
        duration: Of the rollout [s].
        planning_time: Wall time of planning [s].
        stage_times: Wall time of each planning stage [s].
        control_time: Wall time of the controller's steps.
        estimates: The controller's estimates at the end, by name.
        commands: What a dry run would have sent.
        timing: Of a run in real time, how evenly commands and control steps came [s, Hz].
        insertion: How the plug went into its port.
        plan_verdict: Checks of the plan.
        rollout_verdict: Checks of the rollout.
        insertion_plan_verdict: Checks of the plan of the insertion.
        insertion_verdict: Checks of the insertion.
        notes: What a reader should know, such as what was not simulated.
        versions: Of cableway and what it builds on.
        configuration: Everything that was chosen, as plain data.
    """

    task: str
    outcome: Outcome
    failure: str | None = None
    seed: int | None = None
    shape_error: float | None = None
    least_achievable_error: float | None = None
    mean_keypoint_error: float | None = None
    min_clearance: float | None = None
    gripper_clearance: float | None = None
    plug_clearance: float | None = None
    largest_deviation: float | None = None
    gripper_travel: tuple[float, float] | None = None
    plan_steps: int | None = None
    steps: int | None = None
    duration: float | None = None
    planning_time: float | None = None
    stage_times: Mapping[str, float] | None = None
    control_time: ControlTime | None = None
    estimates: Mapping[str, Estimate] | None = None
    commands: Commands | None = None
    timing: Mapping[str, Any] | None = None
    insertion: Inserted | None = None
    plan_verdict: Verdict | None = None
    rollout_verdict: Verdict | None = None
    insertion_plan_verdict: Verdict | None = None
    insertion_verdict: Verdict | None = None
    notes: tuple[str, ...] = ()
    versions: Mapping[str, str] = field(default_factory=dict)
    configuration: Mapping[str, Any] = field(default_factory=dict)

    @property
    def success(self) -> bool:
        """Whether the task succeeded; see `judge`."""
        return self.outcome is Outcome.SUCCESS

    def _facts(self) -> Iterator[str]:
        yield repr(self.task)
        yield "success" if self.success else f"{self.outcome}: {self.failure}"
        if self.shape_error is not None:
            yield f"shape error {quantity(self.shape_error)}"

    def _repr_html_(self) -> str:
        return notebook().page(self.rows())

    def as_dict(self) -> dict[str, Any]:
        """Plain data for JSON, without the figures that there are none for; no number in it is not finite."""
        content: dict[str, Any] = {"success": self.success}
        for entry in fields(self):
            value = getattr(self, entry.name)
            if isinstance(value, Verdict):
                content[entry.name] = {"passed": value.passed, "checks": value.as_dict()}
            elif isinstance(value, ControlTime | Inserted | Commands):
                content[entry.name] = asdict(value)
            elif not (value is None or (isinstance(value, float) and not math.isfinite(value))):
                content[entry.name] = describe(value)
        return content

    def rows(self) -> list[tuple[str, str]]:
        """Names and values as text with units, in reading order."""
        rows = [("task", self.task), ("result", "success" if self.success else f"failed: {self.failure}")]
        rows += [
            (metric.label, quantity(value, metric.unit))
            for metric in METRICS.values()
            if metric.label and (value := metric.value(self)) is not None
        ]
        if self.commands is not None:
            rows += self.commands.rows()
        if self.insertion is not None:
            rows.append(("inserted", str(self.insertion)))
        return rows + self._effort()

    def _effort(self) -> list[tuple[str, str]]:
        rows = []
        if self.gripper_travel is not None:
            left, right = self.gripper_travel
            rows.append(("gripper travel, left and right", f"{quantity(left)}, {quantity(right)}"))
        if self.plan_steps is not None:
            rows.append(("plan", f"{self.plan_steps} steps"))
        if self.steps is not None:
            rows.append(("rollout", f"{self.steps} steps, {self.duration:.1f} s"))
        if self.planning_time is not None:
            stages = ", ".join(f"{name} {seconds:.2f}" for name, seconds in (self.stage_times or {}).items())
            rows.append(("planning time", f"{self.planning_time:.2f} s" + (f" ({stages})" if stages else "")))
        if self.control_time is not None:
            times = self.control_time
            each = f"{1000 * times.median:.1f} / {1000 * times.p99:.1f} / {1000 * times.max:.1f} ms"
            rows.append(("control time, median / p99 / max", each))
        if self.timing is not None:
            rows += _punctuality(self.timing)
        if self.estimates is not None:
            rows += _found(self.estimates)
        for name, verdict in (
            ("plan checks", self.plan_verdict),
            ("rollout checks", self.rollout_verdict),
            ("insertion plan checks", self.insertion_plan_verdict),
            ("insertion checks", self.insertion_verdict),
        ):
            if verdict is not None:
                rows.append((name, f"{len(verdict.checks) - len(verdict.failures())} of {len(verdict.checks)} passed"))
        return rows + [("note", note) for note in self.notes]

    def __str__(self) -> str:
        width = max(len(name) for name, _ in self.rows())
        return "\n".join(f"{name:<{width}}  {value}" for name, value in self.rows())


def _punctuality(timing: Mapping[str, Any]) -> list[tuple[str, str]]:
    """How evenly a robot got its commands, and the controller its steps."""

    def period(name: str) -> str:
        found = timing.get(name)
        return "" if not found else " / ".join(f"{1000 * found[each]:.1f}" for each in ("median", "p95", "worst"))

    sent = f"{timing.get('commands', 0)} at {timing.get('rate', 0):g} Hz, {timing.get('late', 0)} late"
    return [
        ("commands", sent),
        ("period of commands, median / p95 / worst", f"{period('period')} ms"),
        ("period of control steps", f"{period('control_period')} ms, {timing.get('slipped', 0)} late"),
    ]


def _found(estimates: Mapping[str, Estimate]) -> list[tuple[str, str]]:
    """Estimates that differ from their nominal values."""
    rows = []
    for name, found in estimates.items():
        if found.differs:
            rows.append((f"estimated {name}", f"{found}, nominal {limit_text(found.nominal, found.unit)}"))
    return rows or [("estimates", f"none of {len(estimates)} estimates differs by two standard deviations")]


@renamed_keywords(push="insertion_plan")
def summarize(
    task: TaskSource,
    plan: Plan | None,
    rollout: Rollout | None = None,
    *,
    insertion_plan: Plan | None = None,
    insertion: Rollout | None = None,
    timings: Mapping[str, float] | None = None,
    attempt: Attempt | None = None,
    seed: int | None = None,
    configuration: Mapping[str, Any] | None = None,
    notes: Sequence[str] = (),
    limits: VerificationLimits | None = None,
    plan_verdict: Verdict | None = None,
    insertion_plan_verdict: Verdict | None = None,
    cable: Cable | None = None,
    actual: Task | None = None,
    problem: tuple[Outcome, str] | None = None,
) -> Report:
    """Judge and measure what became of a task.

    Args:
        task: The task, or its name or file.
        plan: Its plan, or None where planning failed.
        rollout: What happened when the plan was tracked, if it was.
        insertion_plan: The plan of the insertion into the task's port.
        insertion: What happened in the insertion, if the run came to it.
        timings: Wall time [s] of each planning stage.
        attempt: What planning came closest to, where it failed.
        seed: Of everything random; else what the records say.
        configuration: What was chosen, on top of what the records say.
        notes: Sentences for the reader.
        limits: What the plan had to keep, where that is not the default.
        plan_verdict: Checks of the plan, where it has been verified for this task; it is verified here where None.
        insertion_plan_verdict: The same of the plan of the insertion.
        cable: The plant's cable where it is not the task's.
        actual: The task as the plant has it, where start or obstacles differ; the rollout is judged by it.
        problem: What stopped planning or tracking, where something did, and a sentence on it.
    """
    task = as_task(task)
    actual = actual or task
    known = attempt.verdict if attempt else plan_verdict
    verdicts: dict[str, Any] = {
        "plan_verdict": known or (None if plan is None else verify_plan(plan, task, limits)),
        "insertion_plan_verdict": insertion_plan_verdict
        or (None if insertion_plan is None else verify_insertion_plan(insertion_plan, task, limits)),
        **_rollout_verdicts(rollout, insertion, actual, cable or task.cable),
    }
    outcome, failure = problem or (_no_plan(attempt) if plan is None else judge(actual, rollout, **verdicts))
    return Report(
        task=task.name, outcome=outcome, failure=failure or None,
        planning_time=None if timings is None else float(sum(timings.values())), stage_times=timings,
        insertion=None if insertion is None else measure_insertion(insertion.poses[:, 1], task),
        notes=tuple(dict.fromkeys((*notes, *_unconverged(plan, attempt), *_planned_anew(rollout), *_missed(rollout)))),
        **_made_by(seed, configuration, plan=plan, rollout=rollout, insertion_plan=insertion_plan, insertion=insertion),
        **verdicts,
        **({} if plan is None else {"plan_steps": plan.steps, "gripper_travel": _travel((rollout or plan).poses)}),
        **({} if rollout is None else _figures(task, rollout, verdicts["rollout_verdict"], cable or task.cable)),
    )  # fmt: skip


def _no_plan(attempt: Attempt | None) -> tuple[Outcome, str]:
    """What became of a task without a plan."""
    return Outcome.NO_PLAN, "no plan was found" + (f": {attempt.reason}" if attempt else "")


def _made_by(
    seed: int | None, configuration: Mapping[str, Any] | None, **parts: Plan | Rollout | None
) -> dict[str, Any]:
    """Where a report comes from, as its arguments and the metadata of its records say."""
    recorded = {name: record.metadata for name, record in parts.items() if record is not None}
    return {
        "seed": next((r["seed"] for r in recorded.values() if "seed" in r), None) if seed is None else seed,
        "versions": versions(),
        "configuration": {**describe(recorded), **describe(dict(configuration or {}))},
    }


def _rollout_verdicts(
    rollout: Rollout | None, insertion: Rollout | None, task: Task, cable: Cable
) -> dict[str, Verdict | None]:
    """Checks of what there is of a run and its insertion, with the plant's task and cable."""
    length = None if cable == task.cable else cable.length
    return {
        "rollout_verdict": None if rollout is None else verify_rollout(rollout, task, length=length),
        "insertion_verdict": None if insertion is None else verify_insertion(insertion, task, length=length),
    }


def least_achievable_error(cable: Cable, goal: Float[np.ndarray, "n 2"]) -> float | None:
    """Least stacked distance [m] from a goal that any gripper poses reach, see `Report.least_achievable_error`."""
    if cable.yield_curvature:
        return None
    places = (np.arange(cable.rod.hinges) + 0.5) / cable.rod.hinges
    rest = cable.length * cable.along("rest_curvature", places)
    return nearest_shape(cable.rod, cable.along("stiffness_profile", places), rest, goal)[1]


def _figures(task: Task, rollout: Rollout, verdict: Verdict, cable: Cable) -> dict[str, Any]:
    """The figures of a rollout with the plant's cable."""
    return {
        "plug_clearance": next((check.value for check in verdict.checks if check.name == "plug clearance"), None),
        "least_achievable_error": least_achievable_error(cable, task.goal),
        **rollout_figures(rollout, task.goal),
    }


def rollout_figures(rollout: Rollout, goal: Float[np.ndarray, "n space"]) -> dict[str, Any]:
    """The figures of a rollout, on the table or in space, that was to lead the keypoints to `goal` [m]."""
    return {
        "shape_error": rollout.shape_error(goal),
        "mean_keypoint_error": float(np.linalg.norm(rollout.keypoints[-1] - goal, axis=1).mean()),
        "min_clearance": float(rollout.clearance.min()),
        "gripper_clearance": float(rollout.gripper_clearance.min()),
        "largest_deviation": float(rollout.deviations_from_reference.max()),
        "steps": rollout.steps,
        "duration": float(rollout.times[-1] - rollout.times[0]),
        "control_time": _control_time(rollout.solve_time),
        "estimates": rollout.estimated() or None,
        "timing": rollout.metadata.get("timing"),
    }


def _control_time(seconds: Float[np.ndarray, "K"]) -> ControlTime | None:
    if len(seconds) == 0 or not np.isfinite(seconds).all():
        return None
    median, p99, most = np.percentile(seconds, [50, 99, 100])
    return ControlTime(median=float(median), p99=float(p99), max=float(most))


def _unconverged(plan: Plan | None, attempt: Attempt | None) -> tuple[str, ...]:
    """That the deformation is no minimum, in a sentence, where Ipopt stopped before it had found one."""
    stages = None if attempt is None else attempt.stages
    made_by = plan.metadata if plan is not None else {} if stages is None else stages.metadata
    ended = made_by.get("ipopt")
    if not isinstance(ended, Mapping) or ended.get("converged", True):
        return ()
    return (f"Ipopt stopped after {ended.get('iterations')} iterations without converging ({ended.get('status')}).",)


def _planned_anew(rollout: Rollout | None) -> tuple[str, ...]:
    """When the run went on with a new plan, in sentences."""
    times = [] if rollout is None else rollout.metadata.get("recovered", [])
    return tuple(f"From {time:.1f} s on, the run follows a new plan from where the cable was." for time in times)


def _missed(rollout: Rollout | None) -> tuple[str, ...]:
    """What the loop had to make good for, in a sentence, if there was anything."""
    missed = {} if rollout is None else rollout.metadata.get("watchdog", {})
    late, failed, fallback, cut = (missed.get(name, 0) for name in ("late", "failed", "fallback", "cut"))
    if not late + failed + fallback + cut:
        return ()
    reason = f"; {missed['reason']}" if missed.get("reason") else ""
    counts = f"{late} came late, {failed} failed, {fallback} had no solution, {cut} were cut to the limits"
    return (f"Of the controller's steps {counts}{reason}.",)


def _travel(poses: Float[np.ndarray, "t 2 3"]) -> tuple[float, float]:
    left, right = SE2.distance(poses[1:], poses[:-1])[0].sum(axis=0)
    return float(left), float(right)


__getattr__ = renamed(__name__, {"shape_error_floor": "least_achievable_error"})
