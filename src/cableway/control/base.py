"""What a controller is: `init(task, plan)` makes a state, `step(state, observation)` an action and the next state.

Nothing but compiled code is kept in the controller itself, so one controller can lead any number of runs. All
compilation belongs in `init`. A `step` always answers: where it cannot use what it saw it says so in the state's
status and goes on with the plan's own gripper motion, or stands still. One that fails all the same, or comes too late,
is made good for by the loop (`tracking.watchdog`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Generic, Self, TypeVar

import numpy as np
from jaxtyping import Float

from cableway.core.checks import require_interface
from cableway.records import Estimate, Observation, Plan
from cableway.scene.cable import EstimatedCable
from cableway.scene.task import CONTROL_STEP, Task


class Status(StrEnum):
    """How a controller came to its last action."""

    STARTED = "started"
    """No step was made yet."""
    TRACKING = "tracking"
    """The action is what the controller computed."""
    UNSEEN = "unseen: feedforward"
    """The observation was missing or implausible; the plan's gripper motion went on."""
    STOPPED = "unseen: stopped"
    """Too many such observations in a row, or gripper poses unknown; the grippers stand still."""
    UNEXPLAINED = "unexplained: stopped"
    """The model cannot be held as the grippers hold the cable; they stand still until it can."""
    NOMINAL = "unexplained: nominal rod"
    """The model cannot be held as the grippers hold the cable; the action is feedback by the nominal one."""
    FAILED = "solver failed: feedforward"
    """The computation gave numbers that are not finite; the plan's gripper motion went on."""


@dataclass(frozen=True)
class Contact:
    """Something that is not known and seems to hold the cable.

    Attributes:
        place: Where on the centreline [m].
        direction: Unit vector in which it pushes the cable.
        off: Root mean square distance [m] of the keypoints from where the cable would be without it, if known.
    """

    place: Float[np.ndarray, "2"]
    direction: Float[np.ndarray, "2"]
    off: float | None = None


@dataclass(frozen=True, kw_only=True)
class ControllerState:
    """What every controller's state shows.

    Attributes:
        status: How the last action came about: one of `Status`, or what the loop says that overruled it.
        reference: (n, 2) keypoints [m] wanted at the next observation.
        progress: How far along the reference that is, 0 at the start, 1 from its last row on.
    """

    status: str
    reference: Float[np.ndarray, "n 2"]
    progress: float

    def estimates(self) -> Mapping[str, Estimate]:
        """The controller's estimates of the cable's parameters, by name; the same names in every step."""
        return {}

    def estimated_cable(self) -> EstimatedCable | None:
        """The cable as it turned out to be, for controllers that estimate it once they have; None for others."""
        return None

    def contact(self, share: float = 1.0) -> Contact | None:
        """What seems to hold the cable, for controllers that can tell; None for nothing.

        Args:
            share: Of what it takes to be sure, from which something may.
        """
        return None

    def overruled(self, action: Float[np.ndarray, "2 3"], status: str, waits: bool | None = None) -> Self:
        """The state after a control step whose answer was dropped, another action being sent in its place.

        Args:
            action: (2, 3) what was sent [m, m, rad].
            status: How that came about.
            waits: Whether the reference waits; where None, it does where the grippers stand still.
        """
        return replace(self, status=status)

    def cut(self, action: Float[np.ndarray, "2 3"], made: float) -> Self:
        """The state after a control step of whose answer only a part was sent.

        Args:
            action: (2, 3) what was sent [m, m, rad].
            made: The share of the way that it makes, from 0 to 1.
        """
        return self


S = TypeVar("S", bound=ControllerState)


class Controller(ABC, Generic[S]):
    """Leads the grippers so that the cable follows a plan.

    Attributes:
        config: Frozen dataclass of the settings, for the record.
        control_step: Time [s] between two steps that it is made for.
    """

    config: Any
    control_step: float = CONTROL_STEP

    @abstractmethod
    def init(self, task: Task, plan: Plan) -> S:
        """The state before the first step; compiles whatever `step` needs.

        Raises:
            InputError: Task and plan differ in their number of keypoints.
        """

    @abstractmethod
    def step(self, state: S, observation: Observation | None) -> tuple[Float[np.ndarray, "2 3"], S]:
        """One control step.

        Args:
            state: From `init` or the step before.
            observation: The newest observation, or None where none came.

        Returns:
            The gripper motion (dx, dy, dtheta) [m, m, rad], left then right, never beyond the task's limits, and
            the next state.
        """

    def resume(self, state: S, task: Task, plan: Plan) -> S:
        """The state before the first step of another plan, with what was learned about the cable; here nothing is.

        Args:
            state: As it was.
            task: From where the cable is now, otherwise the same.
            plan: To follow from now on.
        """
        return self.init(task, plan)

    def in_scene(self, state: S, task: Task) -> S:
        """The state once the scene is known to be another one; the same where obstacles mean nothing to a controller.

        Args:
            state: As it was.
            task: With the scene as it is known now, and otherwise the same.
        """
        return state


METHODS = {"init": 2, "step": 2, "resume": 3, "in_scene": 2}
"""Methods of a controller that a run calls, and how many arguments each takes."""


def require_controller(value: Any) -> None:
    """Check that an object has all that a run asks of a controller.

    Raises:
        InputError: It is a class instead, something is missing, or a method takes other arguments.
    """
    require_interface(value, "the controller", ("config", "control_step"), METHODS)
