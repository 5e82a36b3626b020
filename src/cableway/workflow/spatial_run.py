"""A run in space: a plan, and the simulated cable led along it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from cableway.control.spatial_feedback import SpatialFeedback, SpatialFeedbackConfig
from cableway.control.spatial_mpc import SpatialMPC
from cableway.core.compiled import clock
from cableway.core.errors import InputError, SimulationError, UnknownNameError
from cableway.core.provenance import describe
from cableway.judge import judge_in_space
from cableway.outcome import Outcome
from cableway.planning.planner import plan as find_plan
from cableway.records import Plan, Rollout, Verdict
from cableway.scene.spatial.task import SpatialTask
from cableway.simulation.spatial_perturbation import SpatialPerturbation
from cableway.tracking.logbook import OnRow
from cableway.tracking.photographer import EyesConfig
from cableway.tracking.spatial_eyes import SpatialSeenPlant
from cableway.tracking.spatial_loop import track_in_space
from cableway.verification.spatial_rollout import verify_spatial_rollout

CONTROLLERS: dict[str, Callable[[], SpatialMPC | SpatialFeedback]] = {
    "rod-mpc": SpatialMPC,
    "rod-jacobian": SpatialFeedback,
    "open-loop": lambda: SpatialFeedback(SpatialFeedbackConfig(gain=0.0)),
}
"""Controllers in space, the first one the default."""


REPLANNING = 10.0
"""Time [s] that the search for a plan takes at most in a run."""


def follow_in_space(
    task: SpatialTask,
    plan: Plan,
    *,
    controller: str = "rod-mpc",
    perturbation: SpatialPerturbation | None = None,
    eyes: EyesConfig | None = None,
    seed: int = 0,
    on_row: OnRow | None = None,
) -> tuple[Rollout | None, Verdict | None, Outcome, str]:
    """Lead the simulated cable along a plan, and judge what became of it.

    Args:
        task: The task.
        plan: Its plan.
        controller: One of `CONTROLLERS`.
        perturbation: How the cable differs; not at all where None.
        eyes: Cameras by which the controller knows the cable; None where it gets the plant's keypoints.
        seed: Of the noise.
        on_row: Told of each row as it comes; the run ends where it raises `Cancelled`.

    Returns:
        The rollout and its checks, None where the plant cannot start; the outcome and a sentence on why it is no
        success.

    Raises:
        UnknownNameError: There is no such controller.
        InputError: The task has a cell, obstacles cannot be where the perturbation has them, or the cameras are to see
            what they cannot in space.
        MissingExtraError: Coal, which the judge needs, is not installed.
    """
    if controller not in CONTROLLERS:
        raise UnknownNameError("controller in space", controller, CONTROLLERS)
    require_without_arms(task)
    perturbation, leading = perturbation or SpatialPerturbation(), CONTROLLERS[controller]()
    try:
        plant = perturbation.build(task, seed)
    except SimulationError as error:
        return None, None, Outcome.PLANT_FAILED, f"the plant cannot start: {error}"
    seen = None if eyes is None else SpatialSeenPlant(plant, eyes, perturbation.true_task(task).scene)
    rollout = track_in_space(task, seen or plant, leading, plan, partial(_planned_anew, seed), on_row)
    made_by = {
        **({} if seen is None else {"eyes": seen.record()}),
        "seed": seed,
        "controller": controller,
        "another_start": perturbation.another_start,
        "configuration": describe({"controller": leading.config, "plant": perturbation}),
    }
    rollout, true = replace(rollout, metadata={**rollout.metadata, **made_by}), perturbation.true_task(task)
    verdict = verify_spatial_rollout(rollout, true, same_start=not perturbation.another_start)
    return rollout, verdict, *judge_in_space(true, rollout, verdict)


def require_without_arms(task: SpatialTask) -> None:
    """Require of a task that is to be run that it has no arms.

    Raises:
        InputError: It has a cell.
    """
    if task.cell is not None:
        raise InputError(
            f"in space arms, as of {task.cell.name}, are planned for and judged, but not simulated: no run"
        )


def _planned_anew(seed: int, task: SpatialTask) -> Plan:
    """A plan of a run under way.

    Raises:
        PlanningError: None was found in `REPLANNING` seconds.
    """
    deadline = clock() + REPLANNING
    return find_plan(task, seed=seed, expired=lambda: clock() > deadline)
