"""One search for plans of a task: guides are tried one after the other, and the closest failure is remembered."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from cableway.core.errors import PlanningError
from cableway.core.provenance import describe, versions
from cableway.planning.config import Guide, PlannerConfig
from cableway.planning.initial_trajectories import Guides, Progress
from cableway.planning.local_replanning import repaired
from cableway.planning.projection import RealizedSequence, realize
from cableway.planning.routes.infeasibility import find_blockage
from cableway.records import Attempt, DeformationSequence, PathSet, Plan, Verdict
from cableway.scene.task import Task
from cableway.verification import verify_plan

Accept = Callable[[Plan], str]
"""What is wrong with a verified plan, "" if nothing."""


class OutOfTime(Exception):
    """The time limit ran out within a stage."""


class Search:
    """Tries guides and remembers what came closest.

    Args:
        task: The task.
        config: What to use in each stage.
        seed: For the guides that draw random numbers.
        progress: Called with the name of a stage and the share of it that is done.
        expired: Asked at every report of progress.

    Attributes:
        best: The failure with the fewest failed checks.
    """

    def __init__(
        self,
        task: Task,
        config: PlannerConfig,
        seed: int,
        progress: Progress | None,
        expired: Callable[[], bool] | None,
    ) -> None:
        self.task, self.config, self.seed = task, config, seed
        self.best: Attempt | None = None
        self._progress, self._expired = progress, expired

    def guides(
        self, route: Callable[[], Float[np.ndarray, "P 2"]] | None = None, previous: Plan | None = None
    ) -> Guides:
        """The guides of the task, which use a given pivot path or an earlier plan if there are any."""
        return Guides(self.task, self.config, self.seed, self.report, route=route, previous=previous)

    def report(self, stage: str, share: float) -> None:
        """Tell of progress.

        Raises:
            OutOfTime: The time is up.
        """
        if self._expired is not None and self._expired():
            raise OutOfTime
        if self._progress is not None:
            self._progress(stage, share)

    def follow(self, guides: Guides, name: Guide, accept: Accept | None = None) -> Plan | None:
        """The verified plan that a guide leads to; None where it leads to none that is accepted."""
        try:
            sequence, paths = guides.make(name)
        except PlanningError as error:
            return self._fail(Attempt(str(error)))
        found = self._realize(sequence, paths)
        if isinstance(found, Attempt):
            return self._fail(found)
        if accept is not None and (fault := accept(found)):
            return self._fail(_attempt(fault, found, paths))
        made_by = {"guide": name, "seed": self.seed, "versions": versions(), "planner": describe(self.config)}
        return Plan(found.shapes, found.poses, found.pivot, found.passages, found.path_set, found.progress, made_by)

    def blocked(self) -> PlanningError | None:
        """The error that says what certainly cannot pass, and where; None where all may."""
        blockage = find_blockage(self.task, self.config.limits.clearance)
        if blockage is None:
            return None
        attempt = Attempt(str(blockage)) if self.best is None else replace(self.best, reason=str(blockage))
        return PlanningError(f"there is no plan: {blockage}", attempt)

    def nothing(self, tried: str) -> PlanningError:
        """The error that says what was tried, and why the closest attempt is no plan."""
        reason = f": {self.best.reason}" if self.best else ""
        return PlanningError(f"no plan was found {tried}{reason}", self.best)

    def _realize(self, sequence: DeformationSequence, paths: PathSet) -> Plan | Attempt:
        task, config = self.task, self.config
        self.report("realisation", 0.0)
        realised = realize(sequence, task, config.realization, lambda share: self.report("realisation", share))
        self.report("realisation", 1.0)
        found = self._judge(realised, paths)
        if isinstance(found, Plan) or config.realization.kind != "repair":
            return found
        self._fail(found)  # now, because the time may run out within the repair
        try:
            realised = repaired(
                realised, sequence, task, config.realization, config.explore,
                seed=self.seed, progress=lambda share: self.report("repair", share),
            )  # fmt: skip
        except PlanningError:
            return found
        self.report("repair", 1.0)
        again = self._judge(realised, paths)
        return again if isinstance(again, Plan) or _faults(again) < _faults(found) else found

    def _judge(self, realised: RealizedSequence, paths: PathSet) -> Plan | Attempt:
        candidate = Plan(realised.shapes, realised.poses, paths.pivot, paths.passages, paths.paths, realised.progress)
        self.report("verification", 0.0)
        verdict = verify_plan(candidate, self.task, self.config.limits)
        self.report("verification", 1.0)
        return candidate if verdict.passed else _attempt(str(verdict), candidate, paths, verdict)

    def _fail(self, attempt: Attempt) -> None:
        if self.best is None or _faults(attempt) < _faults(self.best):
            self.best = attempt


def _attempt(reason: str, plan: Plan, paths: PathSet, verdict: Verdict | None = None) -> Attempt:
    return Attempt(reason, paths.pivot, paths, plan.shapes, verdict, plan.poses)


def _faults(attempt: Attempt) -> int:
    return len(attempt.verdict.failures()) if attempt.verdict else 99
