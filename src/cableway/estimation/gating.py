"""Gating: measurements that no cable between these grippers can cause are rejected."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from cableway.geometry.groups import SE2
from cableway.records import Observation
from cableway.scene.cable import Cable

SLACK = 1.0
"""Tolerance of distances, in distances between keypoints; noise, a slipped grasp and a cable of another length stay
below a quarter of it."""

LEAST_SHARE = 0.5
"""Share of the keypoints below which the rest of a frame is rejected too."""

FAR = 1e3
"""Gripper coordinates beyond this [m, rad] are no measurement."""


def poses_usable(observation: Observation | None) -> bool:
    """Whether an observation has gripper poses, finite and within `FAR`."""
    if observation is None or np.shape(observation.poses) != (2, SE2.size):
        return False
    return bool(np.isfinite(observation.poses).all() and np.abs(observation.poses).max() < FAR)


def gated_keypoints(
    keypoints: Float[np.ndarray, "m 2"], poses: Float[np.ndarray, "2 3"], cable: Cable
) -> Float[np.ndarray, "n 2"]:
    """The keypoints [m], NaN where they are missing or cannot be those of a cable held by grippers at `poses`.

    A keypoint may not be farther from either gripper than along the cable, neighbours not farther apart than twice
    their distance along it, both with some slack. A frame with too few keypoints left is rejected whole.
    """
    n, nothing = cable.keypoints, np.full((cable.keypoints, SE2.space), np.nan)
    if np.shape(keypoints) != nothing.shape:
        return nothing
    left = np.array(keypoints, dtype=float)
    left[~(np.abs(left) < FAR).all(axis=1)] = np.nan
    spacing, along = cable.length / (n - 1), np.linspace(0.0, cable.length, n)
    slack = SLACK * spacing
    for gripper, distance in zip(SE2.position(poses), (along, along[::-1]), strict=True):
        left[np.linalg.norm(left - gripper, axis=1) > distance + slack] = np.nan
    apart = np.flatnonzero(np.linalg.norm(np.diff(left, axis=0), axis=1) > spacing + slack)
    left[apart] = left[apart + 1] = np.nan
    return left if np.isfinite(left[:, 0]).sum() >= LEAST_SHARE * n else nothing
