"""The closed loop: a plant, a controller and a plan, until the cable lies at its goal."""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Callable
from typing import Any

from threadpoolctl import threadpool_limits

from cableway.control.base import Controller, require_controller
from cableway.core.checks import require_type
from cableway.core.errors import Cancelled, GraspError, InputError, SimulationError, TrackingInterrupted
from cableway.core.provenance import describe
from cableway.outcome import Outcome
from cableway.records import Plan, Rollout
from cableway.tracking.answers import AnsweringPlant
from cableway.tracking.logbook import OnRow
from cableway.tracking.loop import Loop
from cableway.tracking.plant import Plant
from cableway.tracking.recovering import Recovery
from cableway.tracking.recovery import Watch, held_up
from cableway.tracking.setup import setup_mistake
from cableway.tracking.stopping import Ending, TrackConfig
from cableway.tracking.watchdog import Watchdog

LOGGER = logging.getLogger(__name__)

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
    on_row: OnRow | None = None,
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
        progress: Called after every control step with the share of the plan that is done; a `Cancelled` that it raises
            ends the run there.
        on_row: Called with each row of the rollout as it comes, the start first; once more with a start where arms took
            hold of the cable.
        seed: For the record.

    Returns:
        All that happened. `outcome` says how it ended: settled, timed out, wrong setup, left plan, blocked way,
        controller failed, plant failed or interrupted; `detail` says why. Where the plant failed, the rollout ends with
        the last state before that. `metadata["recovered"]` has the times [s] from which a new plan was followed,
        `metadata["suspected"]` the discs (x, y, radius) [m] that were supposed to stand where something unknown held
        the cable, `metadata["friction"]` how far [m] a cable led back lay from its way, where that was more than noise
        makes, `metadata["watchdog"]` how many steps were late, failed, or cut to the limits. Where arms take hold of
        the cable, `metadata["hands"]` says whether they `grasped` it and `let_go`.

    Raises:
        InputError: Plan and plant differ in their number of keypoints, or controller and plant in their control step;
            one of the latter lacks something; or the plant's first answers are no records of the task's cable.
        SimulationError: The plant could not even take its start.
        ControlError: The controller could not begin.
        TrackingInterrupted: An interrupt from the keyboard; its `rollout` is what was tracked until then.
    """
    require_type(plan, Plan, "the plan")
    require_controller(controller)
    config, plant = config or TrackConfig(), AnsweringPlant.of(plant)
    if not math.isclose(controller.control_step, plant.control_step, rel_tol=1e-6):
        raise InputError(
            f"the controller steps every {controller.control_step:.4g} s, "
            f"but the plant every {plant.control_step:.4g} s"
        )
    loop = Loop(plant, controller, plan, config, watchdog or Watchdog(), on_row)
    watch = Watch(recovery, plant.control_step) if recovery is not None else None
    settings = _settings(controller, config, recovery, seed)
    LOGGER.info("tracking: %s", json.dumps(settings))
    try:
        ending = _lead(loop, watch, progress)
        if ending.outcome is Outcome.SETTLED:
            loop.let_go()
    except KeyboardInterrupt:
        stopped = Ending(Outcome.INTERRUPTED, "from the keyboard")
        raise TrackingInterrupted(_record(loop, watch, stopped, settings)) from None
    return _record(loop, watch, ending, settings)


def _lead(loop: Loop, watch: Watch | None, progress: Progress | None) -> Ending:
    """All control steps of a run; how it ended."""
    task = loop.plant.task
    if mistake := setup_mistake(loop.observation, loop.plan, task):
        return Ending(Outcome.WRONG_SETUP, mistake)
    try:
        loop.take_hold()
    except GraspError as error:
        loop.hands = {"grasped": False, "why": str(error)}
        return Ending(Outcome.NOT_HELD, str(error))
    except SimulationError as error:
        return Ending(Outcome.WRONG_SETUP, str(error))
    ending = None
    try:
        if watch is not None and watch.is_elsewhere(loop.observation, loop.plan, task):
            ending = watch.recover(loop, None)
        while ending is None:
            ending = _advance(loop, watch)
            if progress is not None:
                progress("track", 1.0 if ending else min(loop.state.progress, 0.99))
    except Cancelled as error:
        return Ending(Outcome.INTERRUPTED, str(error))
    except SimulationError as error:  # from its task, which is read anywhere
        return Ending(Outcome.PLANT_FAILED, str(error))
    return ending


def _record(loop: Loop, watch: Watch | None, ending: Ending, settings: dict[str, Any]) -> Rollout:
    """The rollout so far."""
    LOGGER.info("ended after %.1f s: %s; %s", loop.time, ending.outcome.value, ending.detail or "no detail")
    recovered = watch.recovered if watch is not None else []
    suspected = [[*disc.center, disc.radius] for disc in loop.suspected]
    happened = {
        "recovered": recovered,
        "suspected": suspected,
        "friction": watch.friction if watch is not None else 0.0,
        "watchdog": loop.guard.record(),
    }
    if loop.hands:
        happened["hands"] = loop.hands
    return loop.log.rollout({**settings, "outcome": ending.outcome.value, "detail": ending.detail, **happened})


def _advance(loop: Loop, watch: Watch | None) -> Ending | None:
    """One control step, or a recovery; how the run ended, if it did."""
    loop.look_round()
    if watch is not None and watch.is_blocked(loop.task, loop.plan, loop.state.progress):
        return watch.recover(loop, Outcome.BLOCKED_WAY)
    if watch is not None and watch.foresees(loop):
        return watch.recover(loop, None)
    ending = loop.step() if watch is None else loop.step(watch.stops)
    contact = loop.state.contact()
    if ending is None and (found := loop.obstructed) is not None:
        return watch.go_round(loop, found) if watch is not None else Ending(Outcome.BLOCKED_WAY, str(found))
    if ending is None and contact is not None and not (watch is not None and watch.takes_for_friction(contact)):
        return watch.avoid(loop, contact) if watch is not None else Ending(Outcome.BLOCKED_WAY, held_up(contact))
    if watch is None:
        return ending
    if ending is None and watch.may_be_held(loop):
        return watch.look(loop)
    closing_in = watch.is_closing_in(loop.observation, loop.plan, loop.state.progress, loop.task)
    if (
        ending is None
        and not loop.waits
        and (closing_in or watch.is_lost(loop.observation, loop.recent_references, loop.task))
    ):
        return watch.avoid(loop, None)
    if (
        ending is not None
        and ending.outcome is Outcome.SETTLED
        and watch.is_off_goal(loop.observation, loop.plan, loop.task)
    ):
        before = len(watch.recovered)
        return watch.recover(loop, None) or (ending if len(watch.recovered) == before else None)
    return ending


def _settings(controller: Controller[Any], config: TrackConfig, recovery: Recovery | None, seed: int) -> dict[str, Any]:
    recovers = {} if recovery is None else {name: value for name, value in vars(recovery).items() if name != "replan"}
    return {
        "seed": seed,
        "control_step": controller.control_step,
        "controller": {"name": type(controller).__name__, "config": describe(controller.config)},
        "track": describe(config),
        "recovery": recovers or None,
    }
