"""The planner: guides in a fixed order, each made true and judged, until one verifies.

The first guide in the order whose realisation verifies is the plan, so that the answer does not depend on timing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from cableway.errors import PlanningError
from cableway.planning.config import Guide, PlannerConfig
from cableway.planning.guides import Guides, Progress
from cableway.planning.reachability import find_blockage
from cableway.planning.realization import end_equilibria, realize
from cableway.provenance import describe, versions
from cableway.records import Attempt, DeformationSequence, PathSet, Plan
from cableway.scene.task import Task
from cableway.verification import verify_plan


class _OutOfTime(Exception):
    """The time limit ran out within a stage."""


# Threads of the linear algebra library wait for each other at every column of a banded factor: 20 times slower.
@threadpool_limits.wrap(limits=1, user_api="blas")
def plan(
    task: Task,
    *,
    seed: int = 0,
    config: PlannerConfig | None = None,
    progress: Progress | None = None,
    expired: Callable[[], bool] | None = None,
) -> Plan:
    """Find a verified sequence of shapes and gripper poses from start to goal.

    Args:
        task: The task.
        seed: For the guides that draw random numbers.
        config: What to use in each stage; `PlannerConfig.paper()` for the paper's choices.
        progress: Called with the name of a stage and the share of it that is done.
        expired: Asked at every report of progress; the search ends once it says yes.

    Raises:
        PlanningError: No plan was found; `attempt` holds the one that came closest. The message says so where the
            grippers or the cable cannot pass, and where the time ran out.
    """
    config = config or PlannerConfig()

    def report(stage: str, share: float) -> None:
        if expired is not None and expired():
            raise _OutOfTime
        if progress is not None:
            progress(stage, share)

    end_equilibria(task, config.realization)
    guides, best = Guides(task, config, seed, report), None
    try:
        for place, name in enumerate(config.guides):
            outcome = _try(guides, name)
            if isinstance(outcome, Plan):
                made_by = {"guide": name, "seed": seed, "versions": versions(), "planner": describe(config)}
                return replace(outcome, metadata=made_by)
            best = outcome if best is None else _better(best, outcome)
            if place == 0 and (blockage := find_blockage(task)) is not None:
                raise PlanningError(f"there is no plan: {blockage}", best)
    except _OutOfTime:
        reason = f"; what came closest: {best.reason}" if best else ""
        raise PlanningError(f"the time limit ran out before a plan was found{reason}", best) from None
    assert best is not None
    raise PlanningError(f"no plan was found with any of {len(config.guides)} guides: {best.reason}", best)


def _try(guides: Guides, name: Guide) -> Plan | Attempt:
    """The plan that a guide leads to, or what is wrong with it."""
    try:
        sequence, paths = guides.make(name)
    except PlanningError as error:
        return Attempt(str(error))
    return _realize(sequence, paths, guides)


def _realize(sequence: DeformationSequence, paths: PathSet, guides: Guides) -> Plan | Attempt:
    """The verified plan that a sequence of shapes becomes, or what is wrong with it."""
    task, config, report = guides.task, guides.config, guides.progress
    report("realisation", 0.0)
    realised = realize(sequence, task, config.realization)
    report("realisation", 1.0)
    rod = task.cable.rod
    stations, poses = rod.shapes(realised.q)
    shapes = np.ascontiguousarray(rod.at_keypoints(stations))
    candidate = Plan(shapes, poses, paths.pivot, paths.passages, paths.paths, realised.progress)
    report("verification", 0.0)
    verdict = verify_plan(candidate, task, config.limits)
    report("verification", 1.0)
    if verdict.passed:
        return candidate
    return Attempt(str(verdict), pivot=paths.pivot, path_set=paths, shapes=shapes, verdict=verdict)


def _better(best: Attempt, other: Attempt) -> Attempt:
    """The attempt with fewer failed checks; the earlier one of two equals."""

    def failures(attempt: Attempt) -> int:
        return len(attempt.verdict.failures()) if attempt.verdict else 99

    return other if failures(other) < failures(best) else best
