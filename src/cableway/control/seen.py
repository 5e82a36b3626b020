"""Which observations a controller may use."""

from __future__ import annotations

import numpy as np

from cableway.records import Observation
from cableway.scene.cable import Cable

SLACK = 1.0
"""How far off, in distances between keypoints, what was seen may be: noise, a grasp that slipped, a cable of another
length stay below a quarter of that."""

FAR = 1e3
"""Gripper coordinates beyond this [m, rad] are no measurement."""


def poses_usable(observation: Observation | None) -> bool:
    """Whether the gripper poses are there, finite and no nonsense."""
    if observation is None or np.shape(observation.poses) != (2, 3):
        return False
    return bool(np.isfinite(observation.poses).all() and np.abs(observation.poses).max() < FAR)


def keypoints_usable(observation: Observation, cable: Cable) -> bool:
    """Whether all keypoints were seen where a cable held by these grippers can be.

    Neighbouring keypoints may not be farther apart than twice their distance along the cable, and the outer ones not
    farther than that distance from their grippers.
    """
    keypoints = observation.keypoints
    if np.shape(keypoints) != (cable.keypoints, 2) or not np.isfinite(keypoints).all():
        return False
    spacing = cable.length / (cable.keypoints - 1)
    with np.errstate(over="ignore"):
        gaps = np.linalg.norm(np.diff(keypoints, axis=0), axis=1)
        ends = np.linalg.norm(keypoints[[0, -1]] - observation.poses[:, :2], axis=1)
    return bool(gaps.max() < (1 + SLACK) * spacing and ends.max() < SLACK * spacing)
