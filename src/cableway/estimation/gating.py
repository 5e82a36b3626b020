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
    keypoints: Float[np.ndarray, "m 2"], poses: Float[np.ndarray, "2 3"], cable: Cable, hidden: bool = False
) -> Float[np.ndarray, "n 2"]:
    """The keypoints [m], NaN where they are missing or cannot be those of a cable held by grippers at `poses`.

    A keypoint may not be farther from either gripper than along the cable, neighbours not farther apart than twice
    their distance along it, both with some slack. A frame with too few keypoints left is rejected whole.

    Args:
        keypoints: As measured.
        poses: Of the grippers at the time of the frame [m, m, rad].
        cable: The nominal cable.
        hidden: Whether any number of keypoints may be hidden: `LEAST_SHARE` is then of those that are not.
    """
    n, nothing = cable.keypoints, np.full((cable.keypoints, SE2.space), np.nan)
    if np.shape(keypoints) != nothing.shape:
        return nothing
    left = np.array(keypoints, dtype=float)
    left[~(np.abs(left) < FAR).all(axis=1)] = np.nan
    least = LEAST_SHARE * (np.isfinite(left[:, 0]).sum() if hidden else n)
    along = np.linspace(0.0, cable.length, n)
    slack = SLACK * cable.length / (n - 1)
    for gripper, distance in zip(SE2.position(poses), (along, along[::-1]), strict=True):
        left[np.linalg.norm(left - gripper, axis=1) > distance + slack] = np.nan
    left = connected(left, cable)
    return left if np.isfinite(left[:, 0]).sum() >= least else nothing


def connected(keypoints: Float[np.ndarray, "n 2"], cable: Cable) -> Float[np.ndarray, "n 2"]:
    """The keypoints [m], NaN for neighbours that are farther apart than a cable can have them."""
    left, spacing = np.array(keypoints, float), cable.length / (len(keypoints) - 1)
    apart = np.flatnonzero(np.linalg.norm(np.diff(left, axis=0), axis=1) > (1 + SLACK) * spacing)
    left[apart] = left[apart + 1] = np.nan
    return left


def is_blind(observation: Observation) -> bool:
    """Whether no keypoint can be relied on, by whoever observes them: that none was observed is another matter."""
    confidence = observation.confidence
    return confidence is not None and not confidence.any()
