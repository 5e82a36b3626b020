"""The planner: pivot path, passages, path set, deformation, realisation, verification.

Guides are sequences of shapes that need not be true: the deformation optimised along the path set from each of its
first guesses, then the cable sliding along one curve. They are tried in a fixed order, and the first one whose
realisation verifies is the plan, so that the answer does not depend on timing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from cableway.errors import PlanningError
from cableway.planning.config import Guide, PlannerConfig
from cableway.planning.deformation import optimize_deformation
from cableway.planning.passages import find_passages
from cableway.planning.path_set import generate_path_set
from cableway.planning.pivot import pivot_keypoint, plan_pivot_path
from cableway.planning.realization import end_equilibria, realize
from cableway.planning.slide import slide
from cableway.provenance import describe, versions
from cableway.records import Attempt, DeformationSequence, PathSet, Plan
from cableway.scene.task import Task
from cableway.verification import verify_plan

Progress = Callable[[str, float], None]


# Threads of the linear algebra library wait for each other at every column of a banded factor: 20 times slower.
@threadpool_limits.wrap(limits=1, user_api="blas")
def plan(task: Task, *, seed: int = 0, config: PlannerConfig | None = None, progress: Progress | None = None) -> Plan:
    """Find a verified sequence of shapes and gripper poses from start to goal.

    Args:
        task: The task.
        seed: For the stages that draw random numbers.
        config: What to use in each stage; `PlannerConfig.paper()` for the paper's choices.
        progress: Called with the name of a stage and the share of it that is done.

    Raises:
        PlanningError: No plan was found; `attempt` holds the one that came closest.
    """
    config = config or PlannerConfig()
    report = progress or (lambda stage, share: None)
    end_equilibria(task, config.realization)
    path_set = _path_set(task, config, seed, report)
    best: Attempt | None = None
    for guide, sequence in _sequences(task, path_set, config, seed, report):
        outcome = _try(task, path_set, sequence, config, report)
        if isinstance(outcome, Plan):
            made_by = {"guide": guide, "seed": seed, "versions": versions(), "planner": describe(config)}
            return replace(outcome, metadata=made_by)
        best = _better(best, outcome)
    if best is None:
        raise PlanningError("no guide led anywhere", Attempt("no guide led anywhere", path_set=path_set))
    raise PlanningError(f"no plan was found: {best.reason}", best)


def _path_set(task: Task, config: PlannerConfig, seed: int, report: Progress) -> PathSet:
    report("pivot path", 0.0)
    middle = pivot_keypoint(task.cable.keypoints)
    ends = task.start[middle], task.goal[middle]
    pivot = plan_pivot_path(task.scene, *ends, task.cable.radius, config.pivot, seed=seed)
    report("pivot path", 1.0)
    report("path set", 0.0)
    path_set = generate_path_set(task, pivot, find_passages(task.scene), config.path_set)
    report("path set", 1.0)
    return path_set


def _sequences(
    task: Task, path_set: PathSet, config: PlannerConfig, seed: int, report: Progress
) -> Iterator[tuple[Guide, DeformationSequence]]:
    """The guides in order, each made when it is asked for; one that cannot be made is left out."""
    for guide in config.guides:
        report("deformation", 0.0)
        try:
            if guide == "slide-head" or guide == "slide-tail":
                sequence = slide(task, "head" if guide == "slide-head" else "tail", config.pivot, seed=seed)
            else:
                sequence = optimize_deformation(path_set, task.cable, config.deformation, guide)
        except PlanningError:
            continue
        report("deformation", 1.0)
        yield guide, sequence


def _try(
    task: Task,
    path_set: PathSet,
    sequence: DeformationSequence,
    config: PlannerConfig,
    report: Progress,
) -> Plan | Attempt:
    """The plan that a guide leads to, or what is wrong with it."""
    report("realisation", 0.0)
    realised = realize(sequence, task, config.realization)
    report("realisation", 1.0)
    rod = task.cable.rod
    stations, poses = rod.shapes(realised.q)
    shapes = np.ascontiguousarray(rod.at_keypoints(stations))
    candidate = Plan(
        shapes,
        poses,
        path_set.pivot,
        path_set.passages,
        path_set.paths,
        realised.progress,
    )
    report("verification", 0.0)
    verdict = verify_plan(candidate, task, config.limits)
    report("verification", 1.0)
    if verdict.passed:
        return candidate
    return Attempt(str(verdict), pivot=path_set.pivot, path_set=path_set, shapes=shapes, verdict=verdict)


def _better(best: Attempt | None, other: Attempt) -> Attempt:
    """The attempt with fewer failed checks; the earlier one of two equals."""

    def failures(attempt: Attempt) -> int:
        return len(attempt.verdict.failures()) if attempt.verdict else 99

    return other if best is None or failures(other) < failures(best) else best
