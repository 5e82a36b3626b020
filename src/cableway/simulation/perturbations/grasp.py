"""A cable held askew, which may slip on the way."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from cableway.core.checks import Checked, Positive
from cableway.core.deprecation import renamed, renamed_keywords
from cableway.core.errors import InputError
from cableway.geometry.groups import SE2
from cableway.records import Observation
from cableway.scene.task import Task
from cableway.simulation.perturbations.layer import Layer
from cableway.simulation.plant import CableSimulator

HOLD = 12.0
"""Pull [N] up to which a hand holds the cable: twice its grip times the coefficient of friction. The grip is the least
of a 2F-85, 20 N of 20 to 235, since a cable is not to be crushed; the coefficient is 0.3, what Robotiq measured of its
silicone fingertips on oiled steel (instruction manual of the Hand-E, "Payload and force")."""

MOST_SHIFT = 0.02
"""Largest distance [m] of a cable's end from where it should be held."""

MOST_TURN = 0.5
"""Largest turn [rad] of a cable's end from how it should be held."""

Offset = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class GraspConfig(Checked):
    """Where the ends of the cable are in the frames of the grippers: (dx, dy, dtheta) [m, m, rad].

    Attributes:
        left: At the start.
        right: At the start.
        slip_time: Time [s] at which the cable slips; never where None.
        left_after: After the slip.
        right_after: After the slip.
        hold: Pull [N] beyond which the hand of a simulated arm loses the cable.
        clips: Whether clips hold the ends of the cable while no simulated hand does; without, it springs straight.

    Raises:
        InputError: A value is out of range.
    """

    left: Offset = (0.0, 0.0, 0.0)
    right: Offset = (0.0, 0.0, 0.0)
    slip_time: Positive[float] | None = None
    left_after: Offset = (0.0, 0.0, 0.0)
    right_after: Offset = (0.0, 0.0, 0.0)
    hold: Positive[float] = HOLD
    clips: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("left", "right", "left_after", "right_after"):
            value = np.asarray(getattr(self, name), float)
            if value.shape != (3,) or not np.isfinite(value).all():
                raise InputError(f"grasp.{name} must be three numbers, got {getattr(self, name)!r}")
            if np.hypot(value[0], value[1]) > MOST_SHIFT or abs(value[2]) > MOST_TURN:
                raise InputError(
                    f"grasp.{name} must be within {MOST_SHIFT:g} m and {MOST_TURN:g} rad, got {value.tolist()}"
                )

    def offsets(self, time: float) -> Float[np.ndarray, "2 3"]:
        """Offsets of both ends at a time [s]."""
        slipped = self.slip_time is not None and time >= self.slip_time
        return np.array([self.left_after, self.right_after] if slipped else [self.left, self.right])


class GraspedCable(Layer[CableSimulator]):
    """A simulated cable whose ends are not where the grippers are.

    The cable starts where the task has it, grasped askew there. Observations hold the poses of the grippers,
    measurements those of the cable's ends. A slip takes one control step.

    Args:
        plant: The cable, led by its ends.
        config: How it is held.
        nominal: The task that planner and controller know; the plant's own where None.
    """

    remembers = ("_poses",)

    @renamed_keywords(believed="nominal")
    def __init__(self, plant: CableSimulator, config: GraspConfig, nominal: Task | None = None) -> None:
        super().__init__(plant)
        self.config = config
        self._nominal = nominal or plant.task
        self.reset()

    @property
    def task(self) -> Task:
        """What planner and controller know."""
        return self._nominal

    def reset(self) -> Observation:
        """Go back to the start."""
        observation = self.plant.reset()
        self._poses = SE2.compose(observation.poses, SE2.inverse(self.config.offsets(0.0)))
        return replace(observation, poses=self._poses.copy())

    def check(self, action: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "2 3"]:
        """See `CableSimulator.check`."""
        return self.plant.check(action)

    def step(self, action: Float[np.ndarray, "2 3"]) -> Observation:
        """Move the grippers; see `CableSimulator.step`."""
        poses = self._poses + self.check(action)
        offsets = self.config.offsets(self.plant.time + self.control_step / 2)
        observation = self.plant.step(SE2.compose(poses, offsets) - self.plant.commanded)
        self._poses = poses
        if self.plant.is_obstructed:
            return replace(observation, poses=SE2.compose(self.plant.reached, SE2.inverse(offsets)))
        return replace(observation, poses=poses.copy())


__getattr__ = renamed(__name__, {"GraspedState": "simulation.perturbations.layer.LayerState"})
