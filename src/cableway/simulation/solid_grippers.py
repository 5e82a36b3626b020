"""Grippers that stand still where they run into something, as those of a robot do that limits its force."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float

from cableway.scene.bodies import outer_bodies
from cableway.scene.clearance import body_clearance
from cableway.scene.task import Task


class SolidGrippers:
    """Keeps grippers out of what is really there.

    A gripper that would enter an obstacle or a wall, or enter it deeper, stays where it is.

    Args:
        task: Grippers, and the scene as it is.
    """

    def __init__(self, task: Task) -> None:
        self._scene, self._grippers = task.scene, task.grippers
        self._bodies = outer_bodies(task.grippers.bodies, task.scene.heights)

    def path(
        self, reached: Float[np.ndarray, "2 3"], commanded: Float[np.ndarray, "2 3"], target: Float[np.ndarray, "2 3"],
        steps: int,
    ) -> tuple[Float[np.ndarray, "t 2 3"], float]:  # fmt: skip
        """Where grippers are at every time step of a control step, and what clearance [m] they were kept from.

        Those that are not where they were commanded go there at their speed limit.

        Args:
            reached: Where they are [m, m, rad].
            commanded: Where they were commanded so far.
            target: Where they are commanded now, at constant speed.
            steps: Number of time steps.
        """
        wanted = commanded + np.arange(1, steps + 1)[:, None, None] / steps * (target - commanded)
        if np.array_equal(reached, commanded) and (self._clearance(wanted) > 0).all():
            return wanted, math.inf
        made, least = [], math.inf
        for poses in wanted:
            reached, kept_from = self.stopped(reached, self._towards(poses, reached, steps))
            made.append(reached)
            least = min(least, kept_from)
        return np.array(made), least

    def stopped(
        self, reached: Float[np.ndarray, "2 3"], ahead: Float[np.ndarray, "2 3"]
    ) -> tuple[Float[np.ndarray, "2 3"], float]:
        """Where grippers get to that are led a little ahead [m, m, rad], and what clearance [m] they were kept from.

        The latter is infinite where none was.
        """
        here, there = self._clearance(np.stack([reached, ahead]))
        kept: Bool[np.ndarray, "2"] = (there <= 0) & (there < here)
        return np.where(kept[:, None], reached, ahead), min(there[kept], default=math.inf)

    def _clearance(self, poses: Float[np.ndarray, "t 2 3"]) -> Float[np.ndarray, "t 2"]:
        """Clearance [m] of each gripper from obstacles and walls."""
        least = np.full(poses.shape[:2], np.inf)
        for body in self._bodies:
            least[:, body.side] = np.minimum(least[:, body.side], body_clearance(body, poses, self._scene))
        return least

    def _towards(
        self, poses: Float[np.ndarray, "2 3"], reached: Float[np.ndarray, "2 3"], steps: int
    ) -> Float[np.ndarray, "2 3"]:
        """As far towards poses as a time step allows."""
        way = poses - reached
        efforts = steps * self._grippers.efforts(way)[:, None]
        return np.where(efforts > 1, reached + way / np.maximum(efforts, 1.0), poses)
