"""What observations show of the cable: where it rests, how far it is from a shape, and how near to an obstacle."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import convolve1d, uniform_filter1d

from cableway.estimation.gating import connected, poses_usable
from cableway.geometry.groups import SE2
from cableway.records import Observation
from cableway.scene.clearance import clearances
from cableway.scene.task import CONTROL_STEP, Task

LEAVING = 0.03
"""Margin [m] with which a cable leaves the gripper that holds it. Nearer to it nothing can be seen of contact with its
body: a frame is older than the gripper poses by a step of up to 13 mm, which extrapolation doubles, and ends are held
askew."""


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


def hysteresis(rested: Float[np.ndarray, "n 2"], way: Float[np.ndarray, "t n 2"]) -> float:
    """How far a cable whose grippers went back lies from the nearest shape that it had on the way there: root mean
    square over the keypoints [m]. Inertia and what obstacles do leave nothing of it; friction and a set do.

    Neighbours along the cable and three frames in a row are averaged. NaN where no keypoint was ever observed.

    Args:
        rested: (n, 2) where it lies now [m].
        way: (t, n, 2) frames until the grippers turned back [m], NaN where missing.
    """
    observed = np.isfinite(way[..., 0])
    known = observed.any(axis=0)
    if not known.any():
        return math.nan
    times, filled = np.arange(len(way)), np.empty((len(way), int(known.sum()), 2))
    for column, keypoint in enumerate(np.flatnonzero(known)):
        there = observed[:, keypoint]
        for axis in range(2):
            filled[:, column, axis] = np.interp(times, times[there], way[there, keypoint, axis])
    path = _smoothed(uniform_filter1d(filled, 3, axis=0, mode="nearest"))
    step, away = np.diff(path, axis=0), _smoothed(rested[None, known]) - path[:-1]
    share = np.sum(away * step, axis=(1, 2)) / np.maximum(np.sum(step**2, axis=(1, 2)), 1e-12)
    off = away - np.clip(share, 0.0, 1.0)[:, None, None] * step
    return float(np.sqrt(np.mean(np.sum(off**2, axis=-1), axis=-1).min(initial=np.inf)))


def _smoothed(shapes: Float[np.ndarray, "t n 2"]) -> Float[np.ndarray, "t n 2"]:
    """Weighted means of neighbours along the cable."""
    return convolve1d(shapes, [0.25, 0.5, 0.25], axis=1, mode="nearest")


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
    gripper pose is missing. How near the cable is to a gripper that it leaves does not count, see `LEAVING`.
    """
    keypoints = connected(observation.keypoints, task.cable)
    if not (np.isfinite(keypoints).all() and poses_usable(observation)):
        return math.inf
    return float(clearances(keypoints[None], observation.poses[None], task, LEAVING).min())


def swing(task: Task) -> float:
    """How far [m] a cable that swings is from its equilibria where the grippers come to full speed in one period of its
    first mode, as plans have it: acceleration over the square of the angular frequency; 0 for others.
    """
    return task.grippers.max_step / CONTROL_STEP * task.cable.swing_period / (4 * np.pi**2)
