"""The plan's own gripper steps, whatever the cable does: the simplest baseline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from cableway.control.base import Controller, Status
from cableway.control.following import FollowerState
from cableway.records import Observation, Plan
from cableway.scene.task import Task


@dataclass(frozen=True, kw_only=True)
class OpenLoopConfig:
    """Settings of `OpenLoop`.

    Attributes:
        hold: Time [s] at the plan's first row before it is followed, as for the other controllers.
    """

    hold: float = 1.5


class OpenLoop(Controller[FollowerState]):
    """Sends the steps between the plan's gripper poses.

    Args:
        config: The settings, the defaults where None.
    """

    def __init__(self, config: OpenLoopConfig | None = None) -> None:
        self.config = config or OpenLoopConfig()

    def init(self, task: Task, plan: Plan) -> FollowerState:
        """See `Controller.init`."""
        return FollowerState(**FollowerState.beginning(task, plan, self.config.hold))

    def step(
        self, state: FollowerState, observation: Observation | None
    ) -> tuple[Float[np.ndarray, "2 3"], FollowerState]:
        """See `Controller.step`; of the observation only the gripper poses are used, for the limits."""
        state = state.looking(observation)
        status = Status.UNSEEN if state.tracker.steps_without_poses else Status.TRACKING
        return state.sending(state.plan.actions(state.index, 1)[0], status, state.task.cable.length)
