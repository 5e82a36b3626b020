"""The arms of a plant take hold of the cable before a run, and let go of it after one.

A plant that can do so has `can_grasp`, true, and two methods beside those of `Plant`: `take_hold(joints, opening)`,
which lowers the open hands along joint positions and closes them, and returns an observation as `reset` does or raises
a `GraspError`; and `let_go(joints, opening)`, which opens and raises them, and returns how far the cable moved.
`cableway.simulation.handling.HandlingPlant` is one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from cableway.core.errors import SimulationError
from cableway.records import Measurement, Observation, Plan
from cableway.robot.branches import NoMotion
from cableway.robot.grasping import HELD, lowered
from cableway.robot.held_arms import HeldArms
from cableway.scene.task import Task
from cableway.tracking.answers import AnsweringPlant
from cableway.tracking.plant import Plant


def take_hold(plant: Plant, plan: Plan) -> Observation | None:
    """The first observation of a plant once its arms hold the cable; None where it or the plan cannot grasp.

    Raises:
        GraspError: A hand missed the cable.
        SimulationError: The plant cannot go on.
    """
    if plan.approach is None or not isinstance(plant, AnsweringPlant) or not plant.can_grasp:
        return None
    return plant.take_hold(plan.approach, float(plan.metadata["arms"]["opening"][0]))


def let_go(
    plant: Plant, arms: HeldArms, poses: Float[np.ndarray, "2 3"], keypoints: Float[np.ndarray, "n 2"],
    task: Task,
) -> tuple[dict[str, Any], Measurement | None]:  # fmt: skip
    """Let go of the cable where it is, not where the plan ends.

    Args:
        plant: The plant.
        arms: Where they were sent.
        poses: Of the grippers there [m, m, rad].
        keypoints: Where the cable lies [m].
        task: The task as it is known.

    Returns:
        Whether it was let go, how far it moved [m] by then, and if not why, for the record; and what was measured.
    """
    assert isinstance(plant, AnsweringPlant)
    if task.port is not None:
        return {"let_go": False, "why": HELD}, None
    hands = lowered(poses, keypoints, arms.joints, task, arms.kinematics.way)
    if isinstance(hands, NoMotion):
        x, y = hands.at
        return {"let_go": False, "why": f"{hands.reason} at ({x:.3f}, {y:.3f}) m"}, None
    try:
        moved, measured = plant.let_go(hands.joints[::-1], hands.opening)
    except SimulationError as error:
        return {"let_go": False, "why": str(error)}, None
    return {"let_go": True, "moved": moved}, measured
