"""The closed loop in space: a controller leads a plant along a plan until the cable has come to rest.

Note:
    Simulation only: there is no watchdog and no recovery here as there are in `tracking.closed_loop`.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float
from threadpoolctl import threadpool_limits

from cableway.control.spatial_following import SpatialFollower
from cableway.core.errors import Cancelled, SimulationError
from cableway.core.provenance import versions
from cableway.core.time_limit import checkpoint
from cableway.outcome import Outcome
from cableway.records import Measurement, Observation, Plan, Rollout
from cableway.scene.spatial.task import SpatialTask
from cableway.tracking.logbook import Log, OnRow
from cableway.tracking.stopping import Ending

SETTLING = (1.0, 5.0)
"""Time [s] after the plan's last row, at the least and at the most, that the cable is given to come to rest."""

REST = 0.002
"""Speed [m/s] of a keypoint that counts as rest."""


class SpatialPlantLike(Protocol):
    """A cable between two grippers in space, as the loop sees it; see `tracking.plant.Plant`."""

    control_step: float

    def reset(self) -> Observation:
        """What is seen at the start."""
        ...

    def step(self, action: Float[np.ndarray, "2 6"]) -> Observation:
        """What is seen after a motion [m, rad] of the grippers; a `SimulationError` ends the run."""
        ...

    def measure(self) -> Measurement:
        """The truth, hidden from the controller."""
        ...


# Threads of the linear algebra library wait for each other in small matrices.
@threadpool_limits.wrap(limits=1, user_api="blas")
def track_in_space(
    task: SpatialTask,
    plant: SpatialPlantLike,
    controller: SpatialFollower[Any],
    plan: Plan,
    on_row: OnRow | None = None,
) -> Rollout:
    """Lead a cable along a plan in space.

    Args:
        task: The task, as the controller knows it.
        plant: The cable.
        controller: The controller.
        plan: The plan.
        on_row: Told of each row as it comes; the run ends where it raises `Cancelled`.

    Returns:
        What happened; a plant that fails ends it, which its outcome says.
    """
    state, log, arrived = controller.init(task, plan), Log(on_row), 0
    seen, ending = plant.reset(), Ending(Outcome.SETTLED)
    try:
        log.see(seen.time, seen, plant.measure(), plan.shapes[0])
        while not _over(log.measured, arrived * plant.control_step, plant.control_step):
            checkpoint()
            begun = time.perf_counter()
            action, state = controller.step(state, seen)
            log.act(action, time.perf_counter() - begun, str(state.status), state.estimates())
            try:
                seen = plant.step(action)
            except SimulationError as error:
                ending = log.end_early(error)
                break
            row = controller.row(state)
            arrived += row == plan.steps
            log.see(seen.time, seen, plant.measure(), plan.shapes[row])
    except Cancelled as stop:
        ending = Ending(Outcome.INTERRUPTED, str(stop))
    outcome, detail = ending
    return log.rollout({"outcome": str(outcome), "detail": detail, "versions": versions()})


def _over(measured: Sequence[Measurement], since: float, step: float) -> bool:
    """Whether the cable is at rest, or should long be, `since` [s] after the plan's last row."""
    if since < SETTLING[0]:
        return False
    moved = np.linalg.norm(measured[-1].keypoints - measured[-2].keypoints, axis=1).max()
    return bool(moved < REST * step or since >= SETTLING[1])
