"""The plan's own gripper steps, whatever the cable does: the simplest baseline."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from cableway.control.base import Controller, ControllerState, Status
from cableway.control.limits import within_limits
from cableway.control.reference import PlanReference, reference_for
from cableway.control.seen import poses_usable
from cableway.records import Observation, Plan
from cableway.scene.task import Task


@dataclass(frozen=True, kw_only=True)
class OpenLoopConfig:
    """Settings of `OpenLoop`.

    Attributes:
        hold: Time [s] at the plan's first row before it is followed, as for the other controllers.
    """

    hold: float = 1.5


@dataclass(frozen=True, kw_only=True)
class OpenLoopState(ControllerState):
    """State of `OpenLoop`.

    Attributes:
        task: The task.
        plan: The reference.
        index: Control steps of the reference that are over.
        poses: (2, 3) gripper poses [m, m, rad] as last seen, moved on by what was sent since.
    """

    task: Task
    plan: PlanReference
    index: int
    poses: Float[np.ndarray, "2 3"]


class OpenLoop(Controller[OpenLoopState]):
    """Sends the steps between the plan's gripper poses.

    Args:
        config: The settings, the defaults where None.
    """

    def __init__(self, config: OpenLoopConfig | None = None) -> None:
        self.config = config or OpenLoopConfig()

    def init(self, task: Task, plan: Plan) -> OpenLoopState:
        """See `Controller.init`."""
        reference = reference_for(task, plan, self.config.hold)
        return OpenLoopState(
            status=Status.STARTED,
            reference=reference.shape(0),
            progress=0.0,
            task=task,
            plan=reference,
            index=0,
            poses=plan.poses[0],
        )

    def step(
        self, state: OpenLoopState, observation: Observation | None
    ) -> tuple[Float[np.ndarray, "2 3"], OpenLoopState]:
        """See `Controller.step`; of the observation only the gripper poses are used, for the limits."""
        seen = poses_usable(observation)
        poses = observation.poses if observation is not None and seen else state.poses
        wanted = state.plan.actions(state.index, 1)[0]
        action = within_limits(wanted, poses, state.task.grippers, state.task.cable.length)
        index = state.index + 1
        return action, replace(
            state,
            status=Status.TRACKING if seen else Status.UNSEEN,
            reference=state.plan.shape(index),
            progress=state.plan.progress(index),
            index=index,
            poses=poses + action,
        )
