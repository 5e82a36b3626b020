"""What is kept of a run while it lasts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cableway.core.errors import SimulationError
from cableway.outcome import Outcome
from cableway.records import Estimate, Measurement, Observation, Rollout
from cableway.tracking.stopping import Ending


class Log:
    """What was seen and done so far."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self.observed: list[np.ndarray] = []
        self.measured: list[Measurement] = []
        self.reference: list[np.ndarray] = []
        self.actions: list[np.ndarray] = []
        self.solve_time: list[float] = []
        self.status: list[str] = []
        self.estimates: list[Mapping[str, Estimate]] = []

    def see(self, time: float, observation: Observation, measurement: Measurement, reference: np.ndarray) -> None:
        """Add a row of what is.

        Raises:
            SimulationError: The plant reported numbers that are not finite.
        """
        _require_finite(measurement)
        self.times.append(time)
        self.observed.append(observation.keypoints)
        self.measured.append(measurement)
        self.reference.append(reference)

    def act(self, action: np.ndarray, solve_time: float, status: str, estimates: Mapping[str, Estimate]) -> None:
        """Add a row of what is done about it and of what the controller believes."""
        self.estimates.append(estimates)
        self.actions.append(action)
        self.solve_time.append(solve_time)
        self.status.append(status)

    def end_early(self, error: SimulationError) -> Ending:
        """Leave out the step that failed and say so in the status of the one before."""
        self.status.pop()
        if self.status:
            self.status[-1] += "; then the plant failed"
        return Ending(Outcome.PLANT_FAILED, str(error))

    def rollout(self, metadata: dict[str, Any]) -> Rollout:
        """The record of it all."""
        steps = len(self.times) - 1
        truth = {
            name: np.array([getattr(row, name) for row in self.measured])
            for name in ("keypoints", "poses", "centreline", "clearance", "gripper_clearance")
        }
        estimates = self._estimates(steps)
        return Rollout(
            times=np.array(self.times),
            observed=np.array(self.observed),
            reference=np.array(self.reference),
            actions=np.array(self.actions[:steps]).reshape(steps, 2, 3),
            solve_time=np.array(self.solve_time[:steps]),
            status=np.array(self.status, dtype=np.str_),
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


def _require_finite(measurement: Measurement) -> None:
    for name in ("keypoints", "poses", "centreline"):
        if not np.isfinite(getattr(measurement, name)).all():
            raise SimulationError(f"the plant reported {name} that are not finite")
