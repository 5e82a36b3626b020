"""What observations show of the cable: where it rests, how far it is from a shape, and how near to an obstacle."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator

from cableway.estimation.gating import connected, poses_usable
from cableway.geometry.groups import SE2
from cableway.motion.clearance import clearances
from cableway.records import Observation
from cableway.scene.task import Task


def at_rest(frames: list[Float[np.ndarray, "n 2"]], poses: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "n 2"]:
    """Where the cable came to rest [m].

    The median of the later half of the frames, or of all where it has none; ends that are hidden are where the grippers
    are, others on a curve through their neighbours.
    """
    keypoints = np.full_like(frames[0], np.nan)
    for some in (frames, frames[len(frames) // 2 :]):
        rows = np.array(some)
        there = np.isfinite(rows).any(axis=0)
        keypoints[there] = np.nanmedian(rows[:, there], axis=0)
    keypoints[[0, -1]] = np.where(np.isfinite(keypoints[[0, -1]]), keypoints[[0, -1]], SE2.position(poses))
    there = np.isfinite(keypoints[:, 0])
    return PchipInterpolator(np.flatnonzero(there), keypoints[there])(np.arange(len(keypoints)))


def distances(observation: Observation, shape: Float[np.ndarray, "n 2"], task: Task) -> Float[np.ndarray, "k"]:
    """Of the observed keypoints from those of a shape [m], without those that no cable can have."""
    distance = np.linalg.norm(connected(observation.keypoints, task.cable) - shape, axis=1)
    return distance[np.isfinite(distance)]


def mean(distances: Float[np.ndarray, "k"]) -> float:
    """Mean [m]; NaN where there are none."""
    return float(distances.mean()) if len(distances) else np.nan


def root_mean_square(distances: Float[np.ndarray, "k"]) -> float:
    """Root mean square [m]; NaN where there are none."""
    return float(np.sqrt(np.mean(distances**2))) if len(distances) else np.nan


def clearance(observation: Observation, task: Task) -> float:
    """Of the observed cable and the grippers [m]; infinite where a keypoint is missing or no cable can have it, or a
    gripper pose is missing.
    """
    keypoints = connected(observation.keypoints, task.cable)
    if not (np.isfinite(keypoints).all() and poses_usable(observation)):
        return math.inf
    return float(clearances(keypoints[None], observation.poses[None], task).min())
