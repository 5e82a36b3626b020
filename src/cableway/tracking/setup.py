"""Before the first motion: does what is observed fit the start of the plan, and if not, which mistake explains it?"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.geometry.groups import SE2
from cableway.records import Observation, Plan
from cableway.scene.task import Task

OFF = 0.03
"""Mean distance [m] of keypoints or grippers from the start of the plan beyond which an explanation is looked for."""

TURNED = 0.3
"""The same for the angle of a gripper [rad]."""

FITS = 0.25
"""Share of the difference that may be left where a mistake explains it."""


def setup_mistake(observation: Observation, plan: Plan, task: Task) -> str:
    """A sentence on a mistake in the set-up of a robot or a camera that explains the first observation; "" for none.

    A cable that merely lies elsewhere is no such mistake.

    Args:
        observation: The first one.
        plan: What is about to be followed.
        task: With the size of the workspace.
    """
    mistake = _explained(observation.keypoints, plan.shapes[0], task, "the camera's keypoints")
    return mistake or _explained_poses(observation.poses, plan.poses[0], task)


def _explained(points: Float[np.ndarray, "k 2"], wanted: Float[np.ndarray, "k 2"], task: Task, what: str) -> str:
    """Which mistake brings points to where they should be."""
    size = np.array(task.scene.size)
    mistakes = {
        "look like millimetres, not metres": points / 1000,
        "look like centimetres, not metres": points / 100,
        "come in the opposite order; the first must be at the left gripper": points[::-1],
        "look as if y pointed downwards": points * [1.0, -1.0] + [0.0, size[1]],
        "look as if x pointed to the left": points * [-1.0, 1.0] + [size[0], 0.0],
        "look as if x and y were exchanged": points[:, ::-1],
    }
    off = _mean_distance(points, wanted)
    if not OFF < off < np.inf:
        return ""
    name = min(mistakes, key=lambda name: _mean_distance(mistakes[name], wanted))
    if _mean_distance(mistakes[name], wanted) > FITS * off:
        return ""
    return f"{what} {name}: they are {off:.3g} m off the start of the plan"


def _explained_poses(poses: Float[np.ndarray, "2 3"], wanted: Float[np.ndarray, "2 3"], task: Task) -> str:
    if not np.isfinite(poses).all():
        return ""
    mistake = _explained(poses[:, :2], wanted[:, :2], task, "the robot's gripper positions")
    turned = SE2.distance(poses, wanted)[1].max()
    in_degrees = np.column_stack([poses[:, :2], np.radians(poses[:, 2])])
    if not mistake and turned > TURNED and SE2.distance(in_degrees, wanted)[1].max() <= FITS * turned:
        degrees = " and ".join(f"{angle:.4g}" for angle in poses[:, 2])
        return f"the robot's gripper angles, {degrees}, look like degrees, not radians"
    return mistake


def _mean_distance(points: Float[np.ndarray, "k 2"], wanted: Float[np.ndarray, "k 2"]) -> float:
    """Of those that are there; infinite where none is."""
    distance = np.linalg.norm(points - wanted, axis=1)
    there = distance[np.isfinite(distance)]
    return float(there.mean()) if len(there) else np.inf


def disagreement(keypoints: Float[np.ndarray, "n 2"], poses: Float[np.ndarray, "2 3"]) -> str:
    """A sentence where the ends of a cable are not where its grippers are; "" where they are."""
    apart = np.linalg.norm(keypoints[[0, -1]] - poses[:, :2], axis=1)
    if (apart <= OFF).all():
        return ""
    side = int(np.argmax(apart))
    return f"the camera's cable ends {1000 * apart[side]:.0f} mm from the {('left', 'right')[side]} gripper"
