"""What moves the grippers of the table plant: servos of their own, or a cell's arms (`cableway.simulation.arms`)."""

# MuJoCo's bindings are compiled and carry no type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from typing import Protocol

import mujoco
import numpy as np
from jaxtyping import Float

from cableway.geometry.groups import SE2
from cableway.simulation.solid_grippers import SolidGrippers
from cableway.simulation.surroundings import add_free_gripper, turned

NAMES = ("left", "right")
"""Of the grippers in a model: their bodies are "left gripper" and "right gripper", their welds "left" and "right"."""


class GripperDrive(Protocol):
    """Moves both grippers of a model.

    A body of the model called "left gripper" and one called "right gripper" have the x axis along the cable's tangent
    and z upwards; the plant welds the ends of the cable to them.
    """

    def add(self, spec: mujoco.MjSpec) -> None:
        """Add both bodies, with all that carries them."""
        ...

    def begin(self, model: mujoco.MjModel, data: mujoco.MjData, poses: Float[np.ndarray, "2 3"]) -> None:
        """Stand at rest at gripper poses [m, m, rad].

        Raises:
            SimulationError: They cannot be there.
        """
        ...

    def lead(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        wanted: Float[np.ndarray, "2 3"],
        offsets: Float[np.ndarray, "2 3"],
    ) -> float:
        """Ask for gripper poses [m, m, rad] at the end of the next time step.

        Args:
            model: The model.
            data: Its state.
            wanted: The poses.
            offsets: Poses of the cable's ends in the gripper frames [m, m, rad].

        Returns:
            Clearance [m] that they were kept from; infinite where from none, or where that is the model's business.

        Raises:
            SimulationError: What is asked for cannot be commanded; nothing is.
        """
        ...

    def poses(self) -> Float[np.ndarray, "2 3"]:
        """Where the grippers are [m, m, rad], angles up to whole turns."""
        ...

    def joints(self) -> Float[np.ndarray, "2 j"] | None:
        """Joint positions [rad] of the arms that carry them; None where there are none."""
        ...

    def clearance(self, joints: Float[np.ndarray, "t 2 j"]) -> float:
        """Least clearance [m] of these arms, hands left out."""
        ...

    def state(self) -> Float[np.ndarray, "2 k"]:
        """A copy of what it remembers beside the model's state."""
        ...

    def restore(self, state: Float[np.ndarray, "2 k"]) -> None:
        """Go back to a state."""
        ...


class FreeGrippers:
    """Grippers that float, each a first-order servo; one that runs into something stands still.

    Args:
        servo_time: Their time constant [s].
        time_step: Of the model [s].
        height: At which they hold the cable [m].
        solid: What keeps them out of obstacles and walls.
    """

    def __init__(self, servo_time: float, time_step: float, height: float, solid: SolidGrippers) -> None:
        self._late = math.exp(-time_step / servo_time) if servo_time else 0.0
        self._height, self._reached, self._solid = height, np.zeros((2, SE2.size)), solid

    def add(self, spec: mujoco.MjSpec) -> None:
        """See `GripperDrive`."""
        for name in NAMES:
            add_free_gripper(spec, name)

    def begin(self, model: mujoco.MjModel, data: mujoco.MjData, poses: Float[np.ndarray, "2 3"]) -> None:
        """See `GripperDrive`."""
        self._reached = poses.copy()

    def lead(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        wanted: Float[np.ndarray, "2 3"],
        offsets: Float[np.ndarray, "2 3"],
    ) -> float:
        """See `GripperDrive`."""
        self._reached, kept_from = self._solid.stopped(self._reached, wanted + self._late * (self._reached - wanted))
        ends = SE2.compose(self._reached, offsets)
        data.mocap_pos[:] = np.column_stack([ends[:, :2], np.full(2, self._height)])
        data.mocap_quat[:] = turned(ends[:, 2])
        return kept_from

    def poses(self) -> Float[np.ndarray, "2 3"]:
        """See `GripperDrive`."""
        return self._reached.copy()

    def joints(self) -> None:
        """See `GripperDrive`."""

    def clearance(self, joints: Float[np.ndarray, "t 2 j"]) -> float:
        """See `GripperDrive`."""
        return math.inf

    def state(self) -> Float[np.ndarray, "2 3"]:
        """See `GripperDrive`."""
        return self._reached.copy()

    def restore(self, state: Float[np.ndarray, "2 3"]) -> None:
        """See `GripperDrive`."""
        self._reached = state.copy()
