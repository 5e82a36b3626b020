"""What a controller may believe of an observation."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.records import Observation
from cableway.scene.cable import Cable

SLACK = 1.0
"""How far off, in distances between keypoints, what was seen may be: noise, a grasp that slipped, a cable of another
length stay below a quarter of that."""

ENOUGH = 0.5
"""Share of the keypoints below which what is left of a frame is not believed either."""

FAR = 1e3
"""Gripper coordinates beyond this [m, rad] are no measurement."""


def poses_usable(observation: Observation | None) -> bool:
    """Whether the gripper poses are there, finite and no nonsense."""
    if observation is None or np.shape(observation.poses) != (2, 3):
        return False
    return bool(np.isfinite(observation.poses).all() and np.abs(observation.poses).max() < FAR)


def believed_keypoints(
    keypoints: Float[np.ndarray, "m 2"], poses: Float[np.ndarray, "2 3"], cable: Cable
) -> Float[np.ndarray, "n 2"]:
    """The keypoints [m], NaN where they are missing or not where a cable held by grippers at `poses` can be.

    A keypoint may not be farther from either gripper than along the cable, neighbours not farther apart than twice
    their distance along it, both with some slack. Of a frame with too few keypoints none are left.
    """
    n, nothing = cable.keypoints, np.full((cable.keypoints, 2), np.nan)
    if np.shape(keypoints) != (n, 2):
        return nothing
    seen = np.array(keypoints, dtype=float)
    seen[~(np.abs(seen) < FAR).all(axis=1)] = np.nan
    spacing, along = cable.length / (n - 1), np.linspace(0.0, cable.length, n)
    slack = SLACK * spacing
    for gripper, distance in zip(poses[:, :2], (along, along[::-1]), strict=True):
        seen[np.linalg.norm(seen - gripper, axis=1) > distance + slack] = np.nan
    apart = np.flatnonzero(np.linalg.norm(np.diff(seen, axis=0), axis=1) > spacing + slack)
    seen[apart] = seen[apart + 1] = np.nan
    return seen if np.isfinite(seen[:, 0]).sum() >= ENOUGH * n else nothing
