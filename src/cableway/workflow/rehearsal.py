"""Rehearsal: of several plans, the one that the simulated cable follows best.

A plan's shapes are equilibria of a uniform elastic rod that lies free. A cable that friction holds on the table, or
that is not as stiff or as straight everywhere, is led through them all the same by its controller, but one plan asks
more of it than another. Where the task's cable calls for it, a plan is tried in simulation before it is used.

Note:
    Not in the paper (Tang et al.), whose plans know nothing of the cable.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cableway.control.base import Controller
from cableway.control.rod_mpc import RodMPC
from cableway.core.checks import Checked, Positive
from cableway.core.errors import PlanningError, SimulationError
from cableway.core.quantities import quantity
from cableway.core.time_limit import OutOfTime, checkpoint
from cableway.records import Plan
from cableway.scene.files.loading import TaskSource, as_task
from cableway.scene.task import Task
from cableway.simulation.perturbations.perturbation import Perturbation
from cableway.tracking import Plant, track

LOGGER = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class RehearsalConfig(Checked):
    """When a rehearsal is good enough.

    Attributes:
        plans: Plans that are tried at most.
        deviation: Largest distance [m] of a keypoint from its reference.
        clearance: Least clearance [m] of cable and grippers.
        shape_error: Largest stacked final shape error [m].

    Raises:
        InputError: A value is out of range.
    """

    plans: Positive[int] = 8
    deviation: Positive[float] = 0.01
    clearance: Positive[float] = 0.004
    shape_error: Positive[float] = 0.01


@dataclass(frozen=True, kw_only=True)
class Rehearsed:
    """How a rehearsal went.

    Attributes:
        deviation: Largest distance [m] of a keypoint from its reference.
        clearance: Least clearance [m] of cable and grippers.
        shape_error: Stacked final shape error [m].
    """

    deviation: float
    clearance: float
    shape_error: float

    def __str__(self) -> str:
        clearance, error = quantity(self.clearance), quantity(self.shape_error)
        return f"largest deviation {quantity(self.deviation)}, clearance {clearance}, final error {error}"

    def passes(self, config: RehearsalConfig) -> bool:
        """Whether it is good enough."""
        return (
            self.deviation <= config.deviation
            and self.clearance >= config.clearance
            and self.shape_error <= config.shape_error
        )

    def badness(self) -> tuple[bool, float]:
        """To choose the least of: whether something was touched, then the deviation."""
        return (not self.clearance > 0, self.deviation)


def needs_rehearsal(task: Task) -> bool:
    """Whether the nominal cable of a task has other equilibria than the rod of its plans."""
    return task.cable.friction > 0 or not task.cable.bends_as_rod


def rehearse(task: Task, plan: Plan, plant: Plant, controller: Controller[Any]) -> Rehearsed:
    """Follow a plan and see how it goes.

    Args:
        task: The nominal task.
        plan: To follow.
        plant: The cable of the task, simulated.
        controller: What leads the grippers.

    Raises:
        OutOfTime: The time limit is over.
    """
    rollout = track(plant, controller, plan, progress=lambda stage, share: checkpoint())
    return Rehearsed(
        deviation=float(rollout.deviations_from_reference.max()),
        clearance=rollout.least_clearance,
        shape_error=rollout.shape_error(task.goal),
    )


def rehearsed_plan(
    task: TaskSource,
    find: Callable[[int], Plan],
    *,
    seed: int = 0,
    config: RehearsalConfig | None = None,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> Plan:
    """The first plan that is good enough in rehearsal, or else the best of those tried until the time was over.

    It is `find(seed)` where the task's cable needs no rehearsal, or cannot be simulated at the task's start.

    Args:
        task: What is to be planned.
        find: Finds a plan by seed.
        seed: Of the first plan; those of the others follow from it.
        config: When to be content.
        progress: Called with the name of a stage and the share of it that is done.

    Returns:
        The plan; `metadata["rehearsal"]` says how many were tried and how it went.

    Raises:
        PlanningError: There is no plan with the first seed.
    """
    plan, task = find(seed), as_task(task)
    if not needs_rehearsal(task):
        return plan
    try:
        plant = Perturbation(arms="exact").build(task, seed=0)
    except SimulationError:
        return plan
    config, controller = config or RehearsalConfig(), RodMPC()
    tried: list[tuple[Rehearsed, Plan]] = []
    while True:
        progress("rehearsal", len(tried) / config.plans)
        try:
            tried.append((_known(plan, tried) or rehearse(task, plan, plant, controller), plan))
            LOGGER.info("rehearsal %d: %s", len(tried), tried[-1][0])
            if tried[-1][0].passes(config) or len(tried) == config.plans:
                break
            plan = find(_seed(seed, len(tried)))
        except (PlanningError, OutOfTime):
            break
    progress("rehearsal", 1.0)
    if not tried:
        return plan.noted(rehearsal={"plans": 0})
    best, plan = min(tried, key=lambda pair: (not pair[0].passes(config), *pair[0].badness()))
    record = {"plans": len(tried), "passed": best.passes(config), **asdict(best)}
    return plan.noted(rehearsal=record)


def _known(plan: Plan, tried: Sequence[tuple[Rehearsed, Plan]]) -> Rehearsed | None:
    """How the rehearsal of the same plan went, as one that depends on no seed is found again and again."""
    same = (how for how, other in tried if np.array_equal(other.poses, plan.poses)
            and np.array_equal(other.shapes, plan.shapes))  # fmt: skip
    return next(same, None)


def _seed(seed: int, number: int) -> int:
    return int(np.random.SeedSequence([seed, number]).generate_state(1)[0])
