"""What a plant is: a cable held by two grippers, as the closed loop sees it.

A plant is any object with these five members; nothing is inherited. One with arms may have more, see
`cableway.tracking.hands`. The loop calls `reset` once and then `step` and `measure` in turn, once each per control
step, from one thread. It does not wait for wall time: a simulator answers as fast as it can, a robot when its control
step is over, so the plant sets the pace. Any error that `step` and `measure` raise, and any answer that is no record of
the task's cable, ends the run with what was recorded before.

Units, frames and order of the numbers are those of `docs/conventions.md`: metres and radians in the world frame of the
task, keypoint 0 at the left gripper, gripper angles that of the cable's tangent there, left before right.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from jaxtyping import Float

from cableway.records import Measurement, Observation
from cableway.scene.task import Task


class Plant(Protocol):
    """What a cable held by two grippers must offer: a simulator, a robot, a recording."""

    @property
    def task(self) -> Task:
        """The nominal task, which planner and controller know; the plant itself may differ.

        The loop reads it at every step: its scene changes when the known obstacles do.
        """
        ...

    @property
    def control_step(self) -> float:
        """Time [s] that one step takes; the shipped controllers are made for 0.1 s."""
        ...

    def reset(self) -> Observation:
        """Go to the start and look.

        Returns:
            The first observation: time 0, n keypoints at equal arc length, NaN where none was observed, and the poses
            of both grippers. Angles may be off by whole turns.

        Raises:
            SimulationError: The start cannot be taken.
        """
        ...

    def step(self, action: Float[np.ndarray, "2 3"]) -> Observation:
        """Move the grippers, and look when the control step is over.

        Args:
            action: (2, 3) motion (dx, dy, dtheta) [m, m, rad] from the gripper poses last commanded, left then
                right; finite and within the limits of the task's grippers.

        Returns:
            What was observed since the step before. Late, irregular or lost frames need no correction: keypoints that
            were not observed are NaN, and controllers estimate the latency of the others themselves.

        Raises:
            SimulationError: The plant cannot go on: the connection is lost, a gripper stopped, a cable came loose. The
                run ends with what was recorded before this step, and its outcome holds the message.
        """
        ...

    def measure(self) -> Measurement:
        """The state after the last step as well as it can be known; hidden from controllers.

        A run is judged by it. A simulator knows the truth. A robot gives its best knowledge: the keypoints last
        observed, a line through them for the whole cable, and the clearance of that line. All of it must be finite.
        Where arms carry the grippers, it may have their joints: in a cell the rollout then has them.
        """
        ...
