"""Limits near a start or goal that does not keep them itself.

A task may begin with the cable 1 mm from an obstacle, or in a shape that is stable but nearer to snapping than a plan
may come. There a plan is asked for as much as its end has, and more with every millimetre that the cable is led away.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cableway.records import Plan
from cableway.scene.spatial.task import SpatialTask
from cableway.scene.task import Task
from cableway.verification.swept import Measure

CLEARANCE_WAY = 0.05
"""Distance [m] of a keypoint from where it is at an end by which clearance must have risen to its limit."""

STABILITY_WAY = 0.3
"""The same for the stability margin, in lengths of the cable."""


@dataclass(frozen=True)
class Ends:
    """How far a plan is from where it begins and ends.

    Attributes:
        away: (2, t) largest distance [m] of a keypoint from its place in the first and in the last row.
        length: Of the cable [m].
    """

    away: Float[np.ndarray, "2 t"]
    length: float

    @classmethod
    def of(cls, plan: Plan, task: Task | SpatialTask) -> Ends:
        """Those of a plan."""
        away = [np.linalg.norm(plan.shapes - end, axis=2).max(1) for end in plan.shapes[[0, -1]]]
        return cls(np.stack(away), task.cable.length)

    def clearance(
        self, limit: float, lines: Float[np.ndarray, "t m space"], measure: Measure, radius: float = 0.0
    ) -> Float[np.ndarray, "t"]:
        """Clearance [m] asked for, at each row, of something of a `radius` [m] about moving lines; never below 0."""
        return self._risen(limit, measure(lines[[0, -1]])[0] - radius, CLEARANCE_WAY)

    def stability(self, limit: float, kept: Float[np.ndarray, "2"]) -> Float[np.ndarray, "t"]:
        """The stability margin asked for at each row, where the ends keep `kept`."""
        return self._risen(limit, kept, STABILITY_WAY * self.length)

    def _risen(self, limit: float, kept: Float[np.ndarray, "2"], way: float) -> Float[np.ndarray, "t"]:
        lowest = np.clip(kept, 0.0, limit)[:, None]
        return (lowest + (limit - lowest) * np.minimum(1.0, self.away / way)).min(0)
