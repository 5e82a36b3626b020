"""The closed loop: a plant, a controller and a plan, until the cable lies at its goal."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from threadpoolctl import threadpool_limits

from cableway.control.base import Controller
from cableway.core.errors import InputError
from cableway.core.provenance import describe
from cableway.records import Plan, Rollout
from cableway.tracking.loop import Loop
from cableway.tracking.plant import Plant
from cableway.tracking.recovery import ELSEWHERE, IN_THE_WAY, Recovery, Watch
from cableway.tracking.stopping import TrackConfig
from cableway.tracking.watchdog import Watchdog

Progress = Callable[[str, float], None]
"""Called with the name of a stage and the share of it that is done, from 0 to 1."""


# Threads of the linear algebra library cost more than they save on matrices of this size, most on a busy machine.
@threadpool_limits.wrap(limits=1, user_api="blas")
def track(
    plant: Plant,
    controller: Controller[Any],
    plan: Plan,
    *,
    config: TrackConfig | None = None,
    recovery: Recovery | None = None,
    watchdog: Watchdog | None = None,
    progress: Progress | None = None,
    seed: int = 0,
) -> Rollout:
    """Lead the plant along the plan until the cable has settled.

    Args:
        plant: What is led.
        controller: What leads.
        plan: Shapes and gripper poses to follow.
        config: When to end, the defaults where None.
        recovery: What to do when the cable does not lie at the plan's start or leaves the plan, or the scene of the
            plant's task has something in its way; nothing where None.
        watchdog: When a controller's step counts as missed, and what then; no deadline where None.
        progress: Told how far along the plan the run is.
        seed: For the record.

    Returns:
        All that happened. `metadata["outcome"]` says how it ended, which is "settled", "time ran out", "the cable left
        its plan: ..." or "something stands in the way: ..." with why it was not brought back, "controller failed: ..."
        where it missed too many steps in a row, or, where the plant gave up, "plant failed: ..." with its reason, which
        the last status says too; the rollout then ends with the last state before that. `metadata["recovered"]` has the
        times [s] from which a new plan was followed, `metadata["watchdog"]` how many steps were late, failed, or cut to
        the limits.

    Raises:
        InputError: Plan and plant differ in their number of keypoints, or controller and plant in their control step.
        SimulationError: The plant could not even take its start.
    """
    config = config or TrackConfig()
    if not math.isclose(controller.control_step, plant.control_step, rel_tol=1e-6):
        raise InputError(
            f"the controller makes a step every {controller.control_step:.4g} s, "
            f"the plant takes steps of {plant.control_step:.4g} s"
        )
    loop = Loop(plant, controller, plan, config, watchdog or Watchdog())
    watch = Watch(recovery, plant.control_step) if recovery is not None else None
    outcome = None
    if watch is not None and watch.is_elsewhere(loop.observation, plan.shapes[0]):
        outcome = watch.recover(loop, ELSEWHERE)
    while outcome is None:
        anew = loop.looked_round()
        if anew and watch is not None and watch.is_blocked(plant.task, loop.plan, loop.state.progress):
            outcome = watch.recover(loop, IN_THE_WAY)
            continue
        outcome = loop.step()
        if outcome is None and watch is not None and watch.is_lost(loop.observation, loop.state.reference):
            outcome = watch.recover(loop)
        if progress is not None:
            progress("track", 1.0 if outcome else min(loop.state.progress, 0.99))
    recovered = watch.recovered if watch is not None else []
    happened = {"recovered": recovered, "watchdog": loop.guard.record()}
    return loop.log.rollout(_metadata(controller, config, outcome, seed) | happened)


def _metadata(controller: Controller[Any], config: TrackConfig, outcome: str, seed: int) -> dict[str, Any]:
    return {
        "seed": seed,
        "outcome": outcome,
        "controller": {"name": type(controller).__name__, "config": describe(controller.config)},
        "track": describe(config),
    }
