"""What is measured of a run: the one list that the report, the benchmark's tables and its gate read.

A metric reads its value from a `cableway.report.Report` or a `cableway.benchmark.episode.Result`, whichever of the two
has it; values are in SI units.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

REACHABLE = 0.008
"""Least achievable error [m] below which the strict rule can fairly be asked for."""

SHOWN = {"1": ("%", 100.0), "share": ("%", 100.0), "m": ("mm", 1000.0), "s": ("s", 1.0)}
"""Unit of a value in tables and reports, and the factor to it, by the SI unit; where a metric says nothing else."""


@dataclass(frozen=True, kw_only=True)
class Metric:
    """Something measured of a run.

    Attributes:
        key: Name in `summary.json`.
        unit: SI unit; "1" for the share of episodes in which something holds, "share" for one of each episode, such as
            of its frames.
        better: Which way is better.
        definition: What it is.
        value: Of a report or a result: a number, or for a share whether it holds; None where there is none.
        label: Name in a report; "" where a report says it otherwise or not at all.
        title: Head of its column in tables.
        field: Name in a result and in the gate's baseline, the key unless given.
        tolerance: What the gate lets pass: of a share, how many successes may be lost on balance; else the ratio to the
            baseline. None where the gate does not look.
        shown: Unit in tables and factor to it, where not that of `SHOWN`.
    """

    key: str
    unit: Literal["1", "share", "m", "s"]
    better: Literal["higher", "lower"]
    definition: str
    value: Callable[[Any], Any]
    label: str = ""
    title: str = ""
    field: str = ""
    tolerance: float | None = None
    shown: tuple[str, float] | None = None

    @property
    def is_share(self) -> bool:
        """Whether it is the share of episodes in which something holds."""
        return self.unit == "1"

    @property
    def shown_unit(self) -> str:
        """Unit in tables and reports."""
        return (self.shown or SHOWN[self.unit])[0]

    @property
    def scale(self) -> float:
        """Factor from the SI unit to the one shown."""
        return (self.shown or SHOWN[self.unit])[1]

    @property
    def head(self) -> str:
        """Head of its column in tables, with the unit."""
        return f"{self.title} [{self.shown_unit}]"


def _first(*names: str) -> Callable[[Any], Any]:
    """Reads the first of these attributes that a record has."""
    return lambda record: next((getattr(record, name) for name in names if hasattr(record, name)), None)


def _strict_where_reachable(result: Any) -> bool | None:
    return (
        None
        if result.least_achievable_error is not None and result.least_achievable_error >= REACHABLE
        else result.strict
    )


def _over_least(result: Any) -> float | None:
    if result.shape_error is None or result.least_achievable_error is None:
        return None
    return max(0.0, result.shape_error - result.least_achievable_error)


def _avoidable(result: Any) -> bool | None:
    unavoidable = getattr(result, "unavoidable", None)
    return None if unavoidable is None else result.contact and not unavoidable


def _survived(result: Any) -> bool | None:
    return result.success if getattr(result, "unavoidable", None) is False else None


def _missed(result: Any) -> bool | None:
    missed = getattr(result, "missed", None)
    return None if missed is None else missed > 0


METRICS = {
    metric.key: metric
    for metric in (
        Metric(key="success", title="< 3 cm", unit="1", better="higher", value=_first("success"), tolerance=1,
               definition="Share of episodes whose final shape error, the L2 norm over all coordinates of all "
               "keypoints, is below 3 cm and in which neither cable nor grippers touched anything, by the simulator, "
               "at any substep: the paper's rule. Of a blocked task: the planner said that there is no plan. No plan, "
               "a crash and a time-out count as failures."),
        Metric(key="strict", title="< 1 cm", unit="1", better="higher", value=_first("strict"), tolerance=1,
               definition="The same with 1 cm."),
        Metric(key="strict_reachable", title="< 1 cm where achievable", unit="1", better="higher",
               value=_strict_where_reachable,
               definition=f"The same over the episodes whose least achievable error is below {1000 * REACHABLE:.0f} mm "
               "with the plant's cable, and those that ended before it was known."),
        Metric(key="planned", title="planned", unit="1", better="higher", value=_first("planned"),
               definition="In space, the share of episodes with a plan, found within 30 s of processor time, that the "
               "independent judge accepts."),
        Metric(key="contact", title="contact", unit="1", better="lower", value=_first("contact"),
               definition="Share of episodes in which cable or grippers touched an obstacle or a wall."),
        Metric(key="avoidable_contact", title="avoidable contact", unit="1", better="lower", value=_avoidable,
               definition="With faults, the share of episodes with a contact beyond the first touch of something that "
               "the controller could not know of yet."),
        Metric(key="survived", title="survived", unit="1", better="higher", value=_survived,
               definition="With faults, the share of successes in the episodes without such a first touch, which is "
               "never a success."),
        Metric(key="shape_error", title="error", label="shape error, stacked", unit="m", better="lower",
               value=_first("shape_error"), tolerance=1.25,
               definition="Final shape error, stacked; none where nothing moved (no plan, a crash, a time-out)."),
        Metric(key="least_achievable_error", label="least achievable error", unit="m", better="lower",
               value=_first("least_achievable_error"),
               definition="Least stacked error that any gripper poses reach with the plant's cable on a table without "
               "friction."),
        Metric(key="above_least_achievable", title="above least achievable", unit="m", better="lower",
               value=_over_least,
               definition="Final shape error less the least that any gripper poses reach with the plant's cable on a "
               "table without friction."),
        Metric(key="mean_keypoint_error", title="mean error", label="shape error, mean keypoint", unit="m",
               better="lower", value=_first("mean_keypoint_error"),
               definition="Mean distance of a keypoint from its goal at the end; none where nothing moved."),
        Metric(key="min_clearance", label="least clearance, cable", unit="m", better="higher",
               value=_first("min_clearance"), definition="Least clearance of the whole cable, by the simulator."),
        Metric(key="gripper_clearance", label="least clearance, grippers", unit="m", better="higher",
               value=_first("gripper_clearance"), definition="Least clearance of the grippers, by the simulator."),
        Metric(key="plug_clearance", label="least clearance, plug", unit="m", better="higher",
               value=_first("plug_clearance"), definition="Least clearance of the plug before its insertion."),
        Metric(key="clearance", title="clearance", unit="m", better="higher", value=_first("clearance"),
               definition="Least clearance of the whole cable and of the grippers over the rollout, by the simulator; "
               "none where nothing moved."),
        Metric(key="deviation", title="deviation", label="largest deviation from plan", unit="m", better="lower",
               value=_first("deviation", "largest_deviation"),
               definition="Largest distance of a keypoint from its reference at the time; none where nothing moved."),
        Metric(key="tracking_error", title="tracking", unit="m", better="lower", value=_first("tracking_error"),
               definition="With cameras, the mean distance of the keypoints that were found in pictures from the true "
               "ones, over the frames of an episode in which the cable was known."),
        Metric(key="tracking_p99", title="tracking p99", unit="m", better="lower", value=_first("tracking_p99"),
               definition="99th percentile of the same, over all keypoints of these frames."),
        Metric(key="hidden", title="hidden", unit="share", better="lower", value=_first("hidden"),
               definition="With cameras, the share of the cable that none of them shows, mean over an episode; of a "
               "cable that was lost, of where it was taken to be."),
        Metric(key="unknown", title="not known", unit="share", better="lower", value=_first("unknown"),
               definition="With cameras, the share of an episode's frames in which the tracker said that it does not "
               "know where the cable is; the grippers stand still then."),
        Metric(key="lost", title="lost", unit="1", better="lower", value=_first("lost"),
               definition="With cameras, the share of episodes in which a frame was taken for known whose keypoints "
               "err by more than 2 cm in the mean, or in which the cable was not known at the end."),
        Metric(key="stopping", title="stopping", unit="s", better="lower", value=_first("stopping"),
               definition="Longest time from a stop (three control steps or more without a command) until both "
               "grippers were at rest; none where they were never stopped."),
        Metric(key="within_limits", title="within limits", unit="1", better="higher", value=_first("within_limits"),
               definition="Share of episodes in which no gripper moved or turned faster than it may, by 5% at most, as "
               "the independent judge has it."),
        Metric(key="gripper_travel", title="travel", unit="m", better="lower", value=_first("gripper_travel"),
               shown=("m", 1.0), definition="Way of both grippers together; none where nothing moved."),
        Metric(key="planning_time", title="planning", unit="s", better="lower", value=_first("planning_time"),
               tolerance=2.0, definition="Wall time of planning; in space processor time, with that of judging. It "
               "depends on the machine."),
        Metric(key="control_time", title="step", unit="s", better="lower", value=_first("control_median"),
               field="control_median", tolerance=2.0, shown=("ms", 1000.0),
               definition="Median over an episode of the wall time of a control step. It depends on the machine."),
        Metric(key="control_p99", title="step p99", unit="s", better="lower", value=_first("control_p99"),
               shown=("ms", 1000.0), definition="99th percentile of the same."),
        Metric(key="missed", title="deadline missed", unit="1", better="lower", value=_missed,
               definition="With a deadline, the share of episodes in which a control step missed it."),
    )
}  # fmt: skip
"""Metrics by key."""
