"""The planner: initial trajectories in a fixed order, each projected to equilibria and judged, until one verifies.

The first in the order whose projection verifies is the plan, so that the answer does not depend on timing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, overload

from threadpoolctl import threadpool_limits

from cableway.core.errors import Cancelled, InputError, PlanningError, PlanningInterrupted
from cableway.core.time_limit import OutOfTime, time_limit
from cableway.outcome import Outcome
from cableway.planning.alternatives import find_alternatives
from cableway.planning.candidates import Search
from cableway.planning.config import InitialName, PlannerConfig
from cableway.planning.initial_trajectories import Progress, routed
from cableway.planning.projection import end_equilibria
from cableway.planning.routes.homotopy import requested_route, unmet_request
from cableway.records import Attempt, Passage, Plan
from cableway.scene.files.loading import TaskSource, as_any_task
from cableway.scene.spatial.task import SpatialTask

if TYPE_CHECKING:
    from cableway.planning.spatial_planner import SpatialPlannerConfig


@overload
def plan(
    task: TaskSource | SpatialTask,
    *,
    seed: int = ...,
    config: PlannerConfig | SpatialPlannerConfig | None = ...,
    progress: Progress | None = ...,
    expired: Callable[[], bool] | None = ...,
    through: Sequence[Passage] = ...,
    avoiding: Sequence[Passage] = ...,
    previous: Plan | None = ...,
    alternatives: None = None,
) -> Plan: ...


@overload
def plan(
    task: TaskSource,
    *,
    seed: int = ...,
    config: PlannerConfig | None = ...,
    progress: Progress | None = ...,
    expired: Callable[[], bool] | None = ...,
    alternatives: int,
) -> tuple[Plan, ...]: ...


# Threads of the linear algebra library wait for each other at every column of a banded factor: 20 times slower.
@threadpool_limits.wrap(limits=1, user_api="blas")
def plan(
    task: TaskSource | SpatialTask,
    *,
    seed: int = 0,
    config: PlannerConfig | SpatialPlannerConfig | None = None,
    progress: Progress | None = None,
    expired: Callable[[], bool] | None = None,
    through: Sequence[Passage] = (),
    avoiding: Sequence[Passage] = (),
    previous: Plan | None = None,
    alternatives: int | None = None,
) -> Plan | tuple[Plan, ...]:
    """Find a verified sequence of shapes and gripper poses from start to goal.

    Args:
        task: The task, on the table or in space, or its name or file.
        seed: For the initial trajectories that draw random numbers.
        config: What to use in each stage; `PlannerConfig.paper()` for the paper's choices. In space, a
            `SpatialPlannerConfig`.
        progress: Called with the name of a stage and the share of it that is done.
        expired: Asked several times a second; the search ends once it says yes.
        through: Passages (`find_passages`) that the cable's middle must go through, in this order.
        avoiding: Passages that it must not go through.
        previous: A plan for a task that has changed since; what is left of it is tried first.
        alternatives: Number of plans wanted that go round the obstacles in different ways (homotopy classes).

    Returns:
        The plan; with `alternatives`, up to that many, this one among them, in the order of `alternatives.plan_cost`.

    Raises:
        PlanningError: No plan was found; `attempt` holds the one that came closest. The message says so where the
            grippers or the cable cannot pass, and where the time ran out. An interrupt from the keyboard comes as
            `PlanningInterrupted` once there is an attempt, and ends a search for alternatives with those found.
        InputError: `alternatives` is not positive, or comes with a requested way; or a task in space with any of them.
    """
    task = as_any_task(task)
    if isinstance(task, SpatialTask):
        if through or avoiding or previous or alternatives is not None:
            raise InputError("in space there are no requested ways, earlier plans or alternatives yet")
        return _in_space(task, config, seed=seed, progress=progress, expired=expired)
    if not isinstance(config, PlannerConfig | None):
        raise InputError(f"a task on the table needs a PlannerConfig, got {type(config).__name__}")
    if alternatives is not None and (alternatives < 1 or through or avoiding or previous):
        raise InputError(f"alternatives must be 1 or more, without a requested way, got {alternatives}")
    search = Search(task, config or PlannerConfig(), seed, progress)
    if search.config.projection.kind != "none":
        end_equilibria(task, search.config.projection)
    if error := search.out_of_reach():
        raise error
    try:
        with time_limit(expired):
            if alternatives is None:
                return _find(search, through, avoiding, previous)
            return find_alternatives(search, alternatives, lambda: _find(search, (), (), None))
    except OutOfTime:
        if search.straight is not None and alternatives is None:
            return search.straight
        reason = f"; the closest attempt: {search.best.reason}" if search.best else ""
        message = f"the time limit ran out before a plan was found{reason}"
        raise PlanningError(message, search.best, Outcome.TIMED_OUT) from None
    except (Cancelled, KeyboardInterrupt):
        if search.best is None:
            raise
        reason = f"interrupted before a plan was found; the closest attempt: {search.best.reason}"
        raise PlanningInterrupted(reason, search.best, Outcome.INTERRUPTED) from None


def _in_space(task: SpatialTask, config: PlannerConfig | SpatialPlannerConfig | None, **given: Any) -> Plan:
    from cableway.planning.spatial_planner import SpatialPlannerConfig, plan_in_space  # which most tasks do without

    if not isinstance(config, SpatialPlannerConfig | None):
        raise InputError(f"a task in space needs a SpatialPlannerConfig, got {type(config).__name__}")
    return plan_in_space(task, config=config, **given)


def _find(search: Search, through: Sequence[Passage], avoiding: Sequence[Passage], previous: Plan | None) -> Plan:
    """The plan of the first initial trajectory that leads to one."""
    task, config = search.task, search.config
    names: tuple[InitialName, ...] = config.initial_trajectories
    trajectories = search.trajectories(previous=previous)
    if through or avoiding:
        names = routed(names)
        search.report("pivot path", 0.0)
        try:
            trajectories = search.trajectories(requested_route(task, config.pivot, search.seed, through, avoiding))
        except PlanningError as error:
            reason = str(error)
            raise search.blocked() or PlanningError(f"no plan was found: {reason}", Attempt(reason)) from None
    elif previous is not None:
        names = ("previous", *names)

    def accept(plan: Plan) -> str:
        return unmet_request(plan.shapes, task, through, avoiding)

    for place, name in enumerate(names):
        found = search.follow(trajectories, name, accept)
        if found is not None:
            return found
        if place == 0 and (error := search.blocked()):
            raise error
    found = search.follow_closely(accept) or search.straight
    if found is not None:
        return found
    one = len(names) == 1
    raise search.nothing(
        f"with the initial trajectory {names[0]!r}" if one else f"with any of {len(names)} initial trajectories"
    )
