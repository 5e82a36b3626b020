"""`cableway plan`: plan a task and stop there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from cableway.cli.planning import PlanOptions
from cableway.core.errors import InputError

if TYPE_CHECKING:
    from cableway.scene.spatial.task import SpatialTask


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
        from cableway.core.compiled import clock
        from cableway.scene.spatial.task import SpatialTask

        since = clock()
        task = self.load_any()
        if isinstance(task, SpatialTask):
            return self._in_space(task, since)
        return self.solve(self.load(), since=since, track=False, rehearse=False, alternatives=self.alternatives)

    def _in_space(self, task: SpatialTask, since: float) -> int:
        from cableway.cli.in_space import leave_in_space, refuse

        refuse(task, self.planar_options() | {"--alternatives": self.alternatives != 1})
        if self.cell is not None:
            from cableway.scene.files.loading import load_cell

            task = task.in_cell(load_cell(self.cell))
        return leave_in_space(self, task, since)
