"""What is measured of a method: each metric with its definition, its unit and which way is better."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cableway.benchmark import statistics
from cableway.benchmark.episode import Result
from cableway.benchmark.statistics import Estimate


@dataclass(frozen=True)
class Metric:
    """Something measured.

    Attributes:
        name: Its name.
        title: In tables.
        unit: In tables; values are in SI units.
        scale: From SI units to that one.
        higher_is_better: Which way is better.
        is_share: Whether it is the share of episodes in which something holds.
        definition: What it is.
        value: Of an episode; None where there is none.
    """

    name: str
    title: str
    unit: str
    scale: float
    higher_is_better: bool
    is_share: bool
    definition: str
    value: Callable[[Result], Any]

    def estimate(self, results: Sequence[Result]) -> Estimate | None:
        """Share or mean over episodes with its interval; None where no episode has a value."""
        rows = [(value, result.task) for result in results if (value := self.value(result)) is not None]
        of = statistics.share if self.is_share else statistics.mean
        return of([value for value, _ in rows], [task for _, task in rows])

    def quantiles(self, results: Sequence[Result]) -> dict[str, float] | None:
        """Median, 95th percentile towards the worse side, and the worst; None where no episode has a value."""
        values = [value for result in results if (value := self.value(result)) is not None]
        if self.is_share or not values:
            return None
        ends = (0.5, 0.05, 0.0) if self.higher_is_better else (0.5, 0.95, 1.0)
        return {
            name: float(value)
            for name, value in zip(("median", "p95", "worst"), np.quantile(values, ends), strict=True)
        }

    def difference(self, results: Sequence[Result], others: Sequence[Result]) -> Estimate | None:
        """Mean of the differences to other results of the same episodes, with its interval; None where there are none.

        Both must have a value in an episode for it to count.
        """
        known = {(result.suite, result.episode): self.value(result) for result in others}
        rows = []
        for result in results:
            value, other = self.value(result), known.get((result.suite, result.episode))
            if value is not None and other is not None:
                rows.append((float(value) - float(other), result.task))
        return statistics.mean([value for value, _ in rows], [task for _, task in rows])


REACHABLE = 0.008
"""Floor [m] below which the strict rule can fairly be asked for."""


def _reachable(result: Result) -> bool | None:
    return None if result.floor is not None and result.floor >= REACHABLE else result.strict


def _over_floor(result: Result) -> float | None:
    if result.shape_error is None or result.floor is None:
        return None
    return max(0.0, result.shape_error - result.floor)


METRICS = {
    metric.name: metric
    for metric in (
        Metric("success", "< 3 cm", "%", 100, True, True,
               "Share of episodes whose final shape error, the L2 norm over all coordinates of all keypoints, is below "
               "3 cm and in which neither cable nor grippers touched anything, by the simulator, at any substep: the "
               "paper's rule. Of a blocked task: it was said that there is no plan. No plan, a crash and a time-out "
               "count as failures.", lambda r: r.success),
        Metric("strict", "< 1 cm", "%", 100, True, True, "The same with 1 cm.", lambda r: r.strict),
        Metric("strict_reachable", f"< 1 cm, floor < {1000 * REACHABLE:.0f} mm", "%", 100, True, True,
               f"The same over the episodes in which some gripper poses come within {1000 * REACHABLE:.0f} mm with the "
               "plant's cable, and those that ended before that could be told.", _reachable),
        Metric("contact", "contact", "%", 100, False, True,
               "Share of episodes in which cable or grippers touched an obstacle or a wall.", lambda r: r.contact),
        Metric("shape_error", "error", "mm", 1000, False, False,
               "Final shape error, stacked. Where the cable was not moved (no plan, a crash), that of the start.",
               lambda r: r.shape_error),
        Metric("over_floor", "over the floor", "mm", 1000, False, False,
               "Final shape error less the least that any gripper poses reach with the plant's cable on a table "
               "without friction.", _over_floor),
        Metric("mean_keypoint_error", "mean error", "mm", 1000, False, False,
               "Mean distance of a keypoint from its goal at the end.", lambda r: r.mean_keypoint_error),
        Metric("clearance", "clearance", "mm", 1000, True, False,
               "Least clearance of the whole cable and of the grippers over the rollout, by the simulator; none where "
               "nothing moved.", lambda r: r.clearance),
        Metric("deviation", "deviation", "mm", 1000, False, False,
               "Largest distance of a keypoint from its reference of the time; none where nothing moved.",
               lambda r: r.deviation),
        Metric("gripper_travel", "travel", "m", 1, False, False,
               "Way of both grippers together; none where nothing moved.", lambda r: r.gripper_travel),
        Metric("planning_time", "planning", "s", 1, False, False,
               "Wall time of planning. It depends on the machine.", lambda r: r.planning_time),
        Metric("control_time", "step", "ms", 1000, False, False,
               "Median over an episode of the wall time of a control step. It depends on the machine.",
               lambda r: r.control_median),
        Metric("control_p99", "step p99", "ms", 1000, False, False,
               "99th percentile of the same.", lambda r: r.control_p99),
    )
}  # fmt: skip
"""Metrics by name."""
