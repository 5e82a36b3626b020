"""What was observed and done in a run so far."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.core.errors import GraspError, PressedError, SimulationError
from cableway.geometry.groups import SE2, SE3
from cableway.outcome import Outcome
from cableway.records import THEN_FAILED, Estimate, Measurement, Observation, Rollout
from cableway.tracking.stopping import Ending

LOGGER = logging.getLogger(__name__)


@dataclass(frozen=True)
class Row:
    """One row of the rollout that is being made.

    Attributes:
        time: [s] since the start.
        observed: (n, 2) keypoints, in space (n, 3), as the controller gets them [m], NaN where nothing.
        measured: The truth, as far as the plant knows it.
        reference: (n, 2) keypoints, in space (n, 3), wanted now [m].
        status: Of the step that led here; "" at the start.
        estimates: What the controller took the cable for in that step, by name.
    """

    time: float
    observed: Float[np.ndarray, "n space"]
    measured: Measurement
    reference: Float[np.ndarray, "n space"]
    status: str = ""
    estimates: Mapping[str, Estimate] = field(default_factory=dict)


OnRow = Callable[[Row], Any]
"""Called with each row as it comes."""


class Log:
    """What was observed and done so far.

    Args:
        on_row: Told of each row.
    """

    def __init__(self, on_row: OnRow | None = None) -> None:
        self._on_row = on_row
        self.times: list[float] = []
        self.observed: list[np.ndarray] = []
        self.measured: list[Measurement] = []
        self.reference: list[np.ndarray] = []
        self.actions: list[np.ndarray] = []
        self.solve_time: list[float] = []
        self.status: list[str] = []
        self.estimates: list[Mapping[str, Estimate]] = []

    def see(self, time: float, observation: Observation, measurement: Measurement, reference: np.ndarray) -> None:
        """Add a row of what is."""
        self.times.append(time)
        self.observed.append(observation.keypoints)
        self.measured.append(measurement)
        self.reference.append(reference)
        if self._on_row is not None:
            status, estimates = (self.status[-1], self.estimates[-1]) if self.status else ("", {})
            self._on_row(Row(time, observation.keypoints, measurement, reference, status, estimates))

    def act(self, action: np.ndarray, solve_time: float, status: str, estimates: Mapping[str, Estimate]) -> None:
        """Add a row of what is done about it and of the controller's estimates."""
        self.estimates.append(estimates)
        self.actions.append(action)
        self.solve_time.append(solve_time)
        if not self.status or status != self.status[-1]:
            LOGGER.info("from %.1f s on: %s", self.times[-1], status)
        self.status.append(status)

    def end_early(self, error: SimulationError) -> Ending:
        """Leave out the step that failed, but not what it touched, and say so in the status of the one before."""
        self.status.pop()
        if isinstance(error, PressedError):
            last = self.measured[-1]
            self.measured[-1] = replace(last, clearance=min(last.clearance, error.clearance))
        if self.status:
            self.status[-1] += THEN_FAILED
        return Ending(Outcome.NOT_HELD if isinstance(error, GraspError) else Outcome.PLANT_FAILED, str(error))

    def rollout(self, metadata: dict[str, Any]) -> Rollout:
        """The record of it all; a row that an interrupt left unfinished is none."""
        rows = min(map(len, (self.times, self.observed, self.measured, self.reference)))
        steps = min(rows - 1, *map(len, (self.estimates, self.actions, self.solve_time, self.status)))
        truth = {
            name: np.array([getattr(row, name) for row in self.measured[: steps + 1]])
            for name in ("keypoints", "poses", "centreline", "clearance", "gripper_clearance")
        }
        estimates = self._estimates(steps)
        dof = SE2.dof if truth["poses"].shape[-1] == SE2.size else SE3.dof
        return Rollout(
            times=np.array(self.times[: steps + 1]),
            observed=np.array(self.observed[: steps + 1]),
            reference=np.array(self.reference[: steps + 1]),
            actions=np.array(self.actions[:steps]).reshape(steps, 2, dof),
            solve_time=np.array(self.solve_time[:steps]),
            status=np.array(self.status[:steps], dtype=np.str_),
            metadata={**metadata, **estimates.pop("metadata", {})},
            **truth,
            **estimates,
        )

    def _estimates(self, steps: int) -> dict[str, Any]:
        """The fields of a rollout that hold estimates."""
        if not steps or not self.estimates[0]:
            return {}
        first, rows = self.estimates[0], self.estimates[:steps]
        described = [
            {"name": name, "unit": e.unit, "nominal": e.nominal, "prior": e.prior} for name, e in first.items()
        ]
        return {
            "estimates": np.array([[row[name].value for name in first] for row in rows]),
            "deviations": np.array([[row[name].deviation for name in first] for row in rows]),
            "metadata": {"estimates": described},
        }
