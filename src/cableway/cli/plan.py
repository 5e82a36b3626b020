"""`cableway plan`: plan a task and stop there."""

from __future__ import annotations

import time
from dataclasses import dataclass

from cableway.cli.planning import PlanOptions
from cableway.core.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Plan(PlanOptions):
    """Plan a task: plan.npz, plan.png, report.json and the task itself."""

    alternatives: int = 1
    """Plans wanted that go round the obstacles in different ways, the default one among them, best first: plan-2.npz,
    ... and alternatives.png."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.alternatives < 1:
            raise InputError(f"--alternatives must be 1 or more, got {self.alternatives}")

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        since = time.perf_counter()
        return self.solve(self.load(), since=since, track=False, rehearse=False, alternatives=self.alternatives)
