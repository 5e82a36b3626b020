"""The closed loop in space: a controller leads a plant along a plan until the cable has come to rest.

Note:
    Simulation only: there is no watchdog, no last filter and no recovery here as there are in `tracking.closed_loop`.
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
from cableway.tracking.logbook import OnRow, Row

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
    state, seen = controller.init(task, plan), plant.reset()
    rows: list[tuple[Observation, Measurement, Float[np.ndarray, "n 3"]]] = [(seen, plant.measure(), plan.shapes[0])]
    actions, took, said = [], [], []
    outcome, detail, arrived = Outcome.SETTLED, "", 0
    while not _over(rows, arrived * plant.control_step, plant.control_step):
        checkpoint()
        try:
            _tell(on_row, rows[-1], said)
        except Cancelled as stop:
            outcome, detail = Outcome.INTERRUPTED, str(stop)
            break
        begun = time.perf_counter()
        action, state = controller.step(state, seen)
        took.append(time.perf_counter() - begun)
        try:
            seen = plant.step(action)
        except SimulationError as error:
            outcome, detail = Outcome.PLANT_FAILED, str(error)
            took.pop()
            break
        actions.append(action)
        said.append(str(state.status))
        rows.append((seen, plant.measure(), plan.shapes[controller.row(state)]))
        arrived += controller.row(state) == plan.steps
    else:
        _tell(on_row, rows[-1], said)
    seen_rows, true, wanted = zip(*rows, strict=True)
    return Rollout(
        times=np.array([each.time for each in seen_rows]),
        keypoints=np.array([each.keypoints for each in true]),
        observed=np.array([each.keypoints for each in seen_rows]),
        poses=np.array([each.poses for each in true]),
        centreline=np.array([each.centreline for each in true]),
        actions=np.array(actions).reshape(-1, 2, 6),
        reference=np.array(wanted),
        solve_time=np.array(took),
        status=np.array(said, dtype=str),
        clearance=np.array([each.clearance for each in true]),
        gripper_clearance=np.array([each.gripper_clearance for each in true]),
        metadata={"outcome": str(outcome), "detail": detail, "versions": versions()},
    )


def _tell(on_row: OnRow | None, row: tuple[Observation, Measurement, np.ndarray], said: Sequence[str]) -> None:
    """Tell of the newest row, to which the last of `said` led."""
    if on_row is not None:
        seen, true, wanted = row
        on_row(Row(seen.time, seen.keypoints, true, wanted, said[-1] if said else ""))


def _over(rows: Sequence[tuple[Observation, Measurement, np.ndarray]], since: float, step: float) -> bool:
    """Whether the cable is at rest, or should long be, `since` [s] after the plan's last row."""
    if since < SETTLING[0]:
        return False
    moved = np.linalg.norm(rows[-1][1].keypoints - rows[-2][1].keypoints, axis=1).max()
    return bool(moved < REST * step or since >= SETTLING[1])
