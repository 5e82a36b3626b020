"""The insertion into a port, in closed loop, from where the run along the plan ended."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np

from cableway.control.insertion import InsertionController
from cableway.core.deprecation import renamed_keywords
from cableway.core.errors import TrackingInterrupted
from cableway.geometry.groups import SE2
from cableway.outcome import SUCCESS_ERROR, stacked_limit
from cableway.records import INSERTION, Observation, Plan, Rollout
from cableway.scene.task import Task
from cableway.tracking.answers import AnsweringPlant
from cableway.tracking.closed_loop import Progress, track
from cableway.tracking.logbook import OnRow
from cableway.tracking.plant import Plant
from cableway.tracking.stopping import TrackConfig
from cableway.tracking.watchdog import Watchdog


class _GoingOn(AnsweringPlant):
    """A plant whose start is where it is: its reset is one control step of standing still."""

    def reset(self) -> Observation:
        """See `Plant.reset`."""
        return self.step(np.zeros((2, SE2.dof)))


@renamed_keywords(push="plan")
def insert_plug(
    plant: Plant,
    plan: Plan,
    *,
    controller: InsertionController | None = None,
    config: TrackConfig | None = None,
    watchdog: Watchdog | None = None,
    progress: Progress | None = None,
    on_row: OnRow | None = None,
    seed: int = 0,
) -> Rollout:
    """Insert the plug into the port.

    Args:
        plant: Where `track` left it, the plug before the port.
        plan: From `planning.insertion.plan_insertion`.
        controller: What leads, with the default settings where None.
        config: When to end, the defaults where None.
        watchdog: As for `track`.
        progress: Called with the share of the insertion that is done.
        on_row: As for `track`.
        seed: For the record.

    Returns:
        All that happened from there on, as from `track`; `metadata["part"]` is "insertion".

    Raises:
        InputError: The plan has another number of keypoints than the plant's task.
        SimulationError: The plant cannot go on.
    """
    try:
        return _inserting(track(
            cast(Plant, _GoingOn(plant)), controller or InsertionController(), plan, config=config, watchdog=watchdog,
            progress=progress, on_row=on_row, seed=seed,
        ))  # fmt: skip
    except TrackingInterrupted as stop:
        raise TrackingInterrupted(_inserting(stop.rollout)) from None


def _inserting(rollout: Rollout) -> Rollout:
    return replace(rollout, metadata={**rollout.metadata, "part": INSERTION})


def may_insert(rollout: Rollout, task: Task) -> bool:
    """Whether a run along the plan ended close enough to its goal for the plug to be aligned from there."""
    return rollout.outcome.finished and rollout.shape_error(task.goal) < stacked_limit(SUCCESS_ERROR, len(task.goal))
